"""The verdict on solved errors of a run that was compared with a model: whose verdict it is."""

from argparse import Namespace
from pathlib import Path

from results_by_hand import make_report

from stepdiag_ros.commands.solve import FREE, _with_model_named
from stepdiag_ros.metrology.discrepancy.summary import Verdict

VERDICT = Verdict("NAMED", "The model lacks backlash of X.", ("backlash of X",))
BAG = Path("runs/monday.mcap")


def test_it_names_the_model_that_it_is_without_and_the_command_that_is_with_it():
    report = make_report(verdict=VERDICT)
    said = _with_model_named(report, Namespace(model="mine.yaml", bag=BAG)).verdict
    assert (said.name, said.effects) == (VERDICT.name, VERDICT.effects)
    assert said.sentence.startswith(VERDICT.sentence)
    assert f"stepdiag diagnose {BAG} --model mine.yaml" in said.sentence


def test_without_another_model_it_stays_as_it_is():
    report = make_report(verdict=VERDICT)
    for given in (Namespace(model=FREE, bag=BAG), Namespace(bag=BAG)):
        assert _with_model_named(report, given) is report
    bare = make_report(verdict=None)
    assert _with_model_named(bare, Namespace(model="mine.yaml", bag=BAG)) is bare
