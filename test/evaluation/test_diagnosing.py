"""What is published of a diagnosis, and what the command line shows of it."""

import hashlib
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from refused import refused

from stepdiag_ros import cli
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import load_cell, load_model, load_plan
from stepdiag_ros.evaluation.diagnosing import (
    MOST_SETTINGS,
    Reference,
    diagnose_lines,
    diagnose_reproducibly,
    summary_of,
    when_over,
)
from stepdiag_ros.evaluation.diagnosis import NO_CHAIN
from stepdiag_ros.evaluation.recorded_run import diagnosed
from stepdiag_ros.metrology.discrepancy import NOT_TESTABLE
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate

BAG = Path(__file__).parents[1] / "data" / "bags" / "schema_1.mcap"
TEXT = load_model("free")[1]


@pytest.fixture(scope="module")
def plan():
    return load_plan("demo")[0]


@pytest.fixture(scope="module")
def measurement(plan):
    return simulate(plan, load_cell("hidden_backlash")[0], seed=2)


@pytest.fixture(scope="module")
def made(plan, measurement):
    reference = Reference.from_text(TEXT, "free", 5)
    diagnosis = diagnose_reproducibly(measurement, reference)
    return diagnosis, summary_of(diagnosis, measurement, reference, plan)


def test_the_summary_says_what_the_diagnosis_says(made, measurement):
    diagnosis, summary = made
    assert (summary.verdict, summary.sentence) == ("NAMED", diagnosis.sentence)
    (finding,), (found,) = diagnosis.findings, summary.findings
    (size,) = found.sizes
    assert (size.name, size.unit) == ("lost_motion", "m")
    assert size.value == finding.sizes["lost_motion"]
    assert size.band == finding.band["lost_motion"]
    assert size.band[0] < 0.8e-6 < size.band[1]
    known = diagnosis.residual_after[np.isfinite(diagnosis.residual_after)]
    assert summary.after.rms == pytest.approx(math.sqrt(np.mean(known**2)), rel=1e-12)
    assert summary.after.rms < 0.5 * summary.before.rms
    assert summary.time == max(line.end_time for line in measurement.lines)
    assert summary.remarks == ()
    assert summary.words.startswith("NAMED (28 passes): The model lacks backlash of X")


def test_the_model_is_told_with_its_text_and_hash(made):
    _, summary = made
    assert summary.model.text == TEXT
    assert summary.model.sha256 == hashlib.sha256(TEXT.encode()).hexdigest()
    assert summary.seed == 5


def test_every_detection_limit_is_in_one_entry_with_its_unit(made):
    diagnosis, summary = made
    limits = diagnosis.detection_limits
    assert sum(limit.settings for limit in summary.detection_limits) == len(limits)
    alone = [limit for limit in summary.detection_limits if limit.settings == 1]
    several = [limit for limit in summary.detection_limits if limit.settings > 1]
    for limit in alone:
        assert limit.smallest == limit.largest == abs(limits[limit.label])
    assert {limit.label for limit in alone} >= {"backlash of Y", "backlash of Z"}
    assert {limit.unit for limit in alone if limit.effect == "backlash"} == {"m"}
    assert {limit.unit for limit in alone if limit.effect == "angular error"} == {"rad"}
    (slip,) = [limit for limit in several if limit.effect == "fringe slip"]
    own = [abs(size) for label, size in limits.items() if label.startswith("fringe slip")]
    assert (slip.settings, slip.smallest, slip.largest) == (len(own), min(own), max(own))
    assert all(limit.settings > MOST_SETTINGS for limit in several)


def test_what_is_missing_is_remarked(plan, measurement):
    some = replace(measurement, lines=measurement.lines[:4], chain="")
    summary = diagnose_lines(some, plan, TEXT, 0)
    assert summary.remarks[0] == NO_CHAIN
    assert summary.remarks[1].startswith("24 of the plan's 28 lines are not among them: y, z, ppp,")
    assert "(4 of 28 passes)" in summary.words
    assert when_over(summary) == replace(summary, run_over=True) != summary


def test_a_run_that_ended_early_is_told_so_and_gets_no_advice_for_its_plan(plan, measurement):
    some = replace(measurement, lines=measurement.lines[:1])
    summary = diagnose_lines(some, plan, TEXT, 0)
    assert summary.verdict == NOT_TESTABLE
    told = when_over(summary)
    assert told == replace(summary, run_over=True, sentence=told.sentence)
    assert "1 of 28" in told.sentence and "1 of 28" not in summary.sentence
    whole = replace(summary, lines_planned=1)
    assert when_over(whole).sentence == summary.sentence


@pytest.mark.parametrize(
    ("domain", "words"),
    [
        ("{X_m: [0.0, 10.0], Y_m: [0.0, 10.0]}", ""),
        ("{X_m: [0.0, 0.001], Y_m: [0.0, 10.0]}", "outside its domain"),
        ("unknown", "no domain"),
    ],
)
def test_where_a_learned_effect_is_used_is_remarked(plan, measurement, domain, words):
    text = (
        "effects:\n- {effect: learned shape, setting: {acts_on: Y, shape: x^1 * y^1},"
        f" sizes: {{amplitude: 0.0}}, domain: {domain}}}\n"
    )
    some = replace(measurement, lines=measurement.lines[:8])
    remarks = diagnose_lines(some, plan, text, 0).remarks
    told = [one for one in remarks if "learned shape" in one]
    assert len(told) == bool(words) and all(words in one for one in told)


def test_a_model_of_another_machine_is_refused(plan, measurement):
    text = TEXT.replace("chain: unknown", "chain: ZXY")
    with refused(Refusal, "mismatch", "YXZ", "ZXY"):
        diagnose_lines(replace(measurement, chain="YXZ"), plan, text, 0)


# -- on the command line --------------------------------------------------------------------------


def test_a_run_against_a_model_that_is_not_there_is_refused_at_once(capsys, tmp_path):
    folder = tmp_path / "out"
    assert cli.main(["run", "--model", "nonsense", "--output", str(folder)]) == 1
    assert "there is no model 'nonsense'" in capsys.readouterr().err
    assert not folder.exists()


def test_info_shows_the_last_verdict(capsys):
    assert cli.main(["info", str(BAG)]) == 0
    assert "Diagnosis: AMBIGUOUS (1 of 3 passes): by hand\n" in capsys.readouterr().out


def test_solve_remarks_the_last_verdict_and_whether_the_run_was_over():
    run = load_run(BAG)
    (remark,) = diagnosed(run)
    assert remark.startswith("diagnosis beside the run, AMBIGUOUS (1 of 3 passes): by hand")
    (early,) = (replace(one, run_over=False) for one in run.diagnoses)
    (remark,) = diagnosed(replace(run, diagnoses=(early,)))
    assert "the last before the recording ends" in remark
    assert diagnosed(replace(run, diagnoses=())) == ()
