"""What the package offers to notebooks: results as of the commands, refusals in one sentence."""

from pathlib import Path

import numpy as np
import pytest
from refused import refused
from results_by_hand import VOLUME, make_report, make_result, with_unknown

import stepdiag_ros
from stepdiag_ros import compare, error_map, open_run, solve, worst_point
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.evaluation.report import same_to_the_last_bit
from stepdiag_ros.metrology.refusal import Refusal

BAG = Path(__file__).parents[1] / "docs" / "examples" / "small_run.mcap"


@pytest.fixture(scope="module")
def run():
    return open_run(BAG)


def test_a_run_is_solved_as_it_was_live(run):
    report = solve(run)
    assert report.run_id == run.run_id and report.plan == run.plan.name
    # To the last bit on the kind of processor that it was recorded on; on others to rounding.
    recorded = {result.method: result for result in run.results}
    assert report.equals_recorded.keys() == recorded.keys()
    for result in report.results:
        for curve, values in recorded[result.method].curves.items():
            np.testing.assert_allclose(result.curves[curve], values, rtol=0.0, atol=1e-15)
    again = solve(run, recorded_lines=True)
    assert same_to_the_last_bit(again.preferred(), report.preferred())


def test_the_map_and_the_worst_point_agree():
    report = make_report(chain="")
    worst = worst_point(report)
    vector = error_map(report).errors(np.array([worst.position]))[0]
    np.testing.assert_allclose(vector, worst.vector)
    np.testing.assert_allclose(np.linalg.norm(vector), worst.value)
    assert worst.value != worst_point(report, "setup_robust").value
    outside = np.array([VOLUME.origin]) - 1.0
    assert np.all(np.isnan(error_map(report).errors(outside)))


def test_what_is_not_known_stays_unknown():
    assert np.isnan(worst_point(make_report(results=(with_unknown(make_result()),))).value)


def test_two_runs_are_compared_by_the_same_method():
    before, after = make_report(chain=""), make_report(chain="")
    assert compare(before, after).before.method == "least_squares"
    assert np.all(compare(before, after).normalised_errors == 0.0)
    assert compare(before, after, "setup_robust").after.method == "setup_robust"


def test_refusals_are_one_sentence(tmp_path):
    with refused(BagError, "not_found", "missing.mcap") as caught:
        open_run(tmp_path / "missing.mcap")
    assert "\n" not in str(caught.value)
    with refused(Refusal, "not_found", "soons", aspect="method"):
        error_map(make_report(), "soons")
    with refused(Refusal, "not_found", aspect="method"):
        worst_point(make_report(results=()))


def test_the_package_offers_what_it_names_and_nothing_else():
    for name in stepdiag_ros.__all__:
        assert getattr(stepdiag_ros, name) is not None
    with refused(AttributeError, None, "pie"):
        _ = stepdiag_ros.pie
