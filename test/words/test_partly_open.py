"""The sentence on a gap that a certain effect and one of several uncertain ones close."""

from dataclasses import replace

from stepdiag_ros.metrology.discrepancy import AMBIGUOUS, NAMED
from stepdiag_ros.metrology.discrepancy.findings import Candidate, Finding, RunnerUp
from stepdiag_ros.metrology.discrepancy.rotation_finding import explained_by
from stepdiag_ros.metrology.effects import catalogue

SAG = Finding(
    candidate=Candidate(catalogue()["sag"], {"error": "Y", "over": "XZ"}, "sag along Y"),
    sizes={},
    standard_uncertainty={},
    band={},
    gain=900.0,
    p_value=1e-9,
    probability=1.0,
)
LOST = replace(
    SAG,
    candidate=Candidate(catalogue()["backlash"], {"axis": "X"}, "backlash of X"),
    gain=30.0,
    runners_up=(RunnerUp("settling of X", 29.0, 0.4, "too close", ambiguous=True),),
)


def test_what_is_certain_is_named_beside_what_is_not():
    verdict, sentence = explained_by((SAG, LOST))
    assert verdict == AMBIGUOUS
    assert sentence.index("sag along Y") < sentence.index("backlash of X")
    assert "settling of X" in sentence


def test_names_that_are_all_certain_are_named():
    verdict, sentence = explained_by((SAG, replace(LOST, runners_up=())))
    assert verdict == NAMED
    assert "sag along Y" in sentence and "backlash of X" in sentence


def test_names_of_one_alignment_that_is_over_are_one_name():
    verdict, sentence = explained_by((replace(LOST, over=True, equivalent=("settling of X",)),))
    assert verdict == NAMED
    assert "backlash of X" in sentence and "settling of X" in sentence


def test_where_nothing_is_certain_every_name_is_one_of_several():
    verdict, sentence = explained_by((LOST,))
    assert verdict == AMBIGUOUS
    assert "backlash of X" in sentence and "settling of X" in sentence
    assert "sag" not in sentence
