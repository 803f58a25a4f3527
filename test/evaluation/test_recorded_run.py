"""A recorded run is solved by one function, whoever asks; a bag that contradicts itself is told."""

from pathlib import Path

import numpy as np
import pytest
from refused import refused
from standard_runs import write_bag

from stepdiag_ros import notebook
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.evaluation.changes import Side, changes_of, common_method, side_of_report
from stepdiag_ros.evaluation.recorded_run import measurement_of, report_of_run
from stepdiag_ros.metrology.refusal import Refusal

TEST = Path(__file__).parents[1]
RECORDED = TEST.parent / "docs" / "examples" / "small_run.mcap"
CONTRADICTING = TEST / "data" / "bags" / "schema_1.mcap"
PLAN = """\
name: small run
step_m: [0.03, 0.02, 0.025]
blocks: 3
repeats: 2
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x, y, z]}
  - {kind: step_diagonal, names: [ppp, npp, pnp]}
"""


def test_lines_that_are_not_those_recorded_are_told_once_and_in_the_remark():
    told = []
    run = load_run(CONTRADICTING)
    _, remark = measurement_of(run, warn=told.append)
    (said,) = [text for text in told if text not in {flaw.sentence for flaw in run.flaws}]
    assert CONTRADICTING.name in said and "differ from those recorded" in said
    assert "NOT the same lines" in remark
    told = []
    _, remark = measurement_of(load_run(CONTRADICTING), recorded_lines=True, warn=told.append)
    assert said not in told and remark == "solved from the lines as recorded"


def test_progress_is_told_from_0_to_1_and_the_lines_are_those_of_the_live_run():
    shares, told = [], []
    _, remark = measurement_of(load_run(RECORDED), progress=shares.append, warn=told.append)
    assert not told and "bit-identical to the recorded" in remark
    assert shares and shares == sorted(shares)
    assert all(0.0 <= share <= 1.0 for share in shares)


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two")
    reports = []
    for seed in (1, 2):
        write_bag(folder / f"{seed}.mcap", PLAN, seed=seed)
        reports.append(report_of_run(load_run(folder / f"{seed}.mcap")))
    return reports


def test_a_notebook_compares_by_the_same_function(solved):
    before, after = (side_of_report(one) for one in solved)
    changes, again = changes_of(before, after), notebook.compare(*solved)
    assert changes.before.method == again.before.method == solved[0].preferred().method
    assert np.array_equal(changes.normalised_errors, again.normalised_errors, equal_nan=True)


def test_the_method_is_the_one_to_rely_on_of_those_that_both_have(solved):
    before = side_of_report(solved[0])
    after = side_of_report(solved[1], "setup_robust")
    assert common_method(before, after) == "setup_robust"
    assert changes_of(before, after).after.method == "setup_robust"
    with refused(Refusal, "mismatch", "1.mcap"):
        changes_of(before, Side("other", {}, "YXZ", None))
    with refused(Refusal, "not_found", "guess"):
        side_of_report(solved[0], "guess")
