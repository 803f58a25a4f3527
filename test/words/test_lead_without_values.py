"""A lead of a run of which no error is known says nothing of errors below."""

from stepdiag_ros.evaluation.lead import RunLead
from stepdiag_ros.metrology.discrepancy.findings import NAMED
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.geometry import ROTATIONS, TRANSLATIONS
from stepdiag_ros.words.lead import coverage_sentences, sentences_of

VERDICT = Verdict(NAMED, "The model lacks backlash of Y.")


def test_neither_verdict_nor_rotations_speak_of_values_that_are_not_there():
    lead = RunLead(VERDICT, solved=True, unknown=TRANSLATIONS, as_zero=ROTATIONS)
    said = sentences_of(lead)
    # The verdict itself, and what is unknown.
    assert len(said) == 2
    assert said[0].endswith(VERDICT.sentence) and all(name in said[1] for name in TRANSLATIONS)
    assert coverage_sentences(lead) == []
