"""The seven-line test: places, sight, ways, evaluation."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from refused import a_fault, refused
from trackers_for_tests import (
    BESIDE,
    BOX,
    SCALES,
    SQUARENESS,
    TRACKER,
    WITHIN,
    seven_line_readings,
    straight_machine,
)

from stepdiag_ros.metrology.forward import ErrorCurves
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.evaluation import evaluate_test, runs_of_line
from stepdiag_ros.metrology.tracker.expectation import expect
from stepdiag_ros.metrology.tracker.instrument import CARRIAGE, Tracker
from stepdiag_ros.metrology.tracker.joint import error_matrix
from stepdiag_ros.metrology.tracker.readings import SEVEN_LINES
from stepdiag_ros.metrology.tracker.route import TrackerRoute
from stepdiag_ros.metrology.tracker.seven_lines import make_test

PERFECT = ErrorCurves.from_curves([np.array([0.0, 1.0])] * 3, {})
INSIDE = np.array([0.0, 0.0, 0.0])
"""At the volume's corner: all seven lines are radial."""
TRUTH = np.array([*SCALES, *SQUARENESS.values()])


def test_the_seven_lines_run_away_from_the_tracker_within_the_volume():
    test = make_test(BOX, BESIDE, TRACKER, targets=7)
    assert [line.name for line in test.lines] == list(SEVEN_LINES)
    for line in test.lines:
        distance = np.linalg.norm(line.targets - BESIDE, axis=1)
        assert np.all(np.diff(distance) > 0)
        assert np.all(line.targets >= BOX.low)
        assert np.all(line.targets <= BOX.high)
        moving = np.abs(line.direction) > 1e-9
        assert "".join(np.array(list("xyz"))[moving]) == line.name
        np.testing.assert_allclose(np.diff(line.targets, 2, axis=0), 0.0, atol=3e-6)
        assert distance[0] - line.overrun > TRACKER.minimum_range - 1e-6
        assert line.obliqueness <= np.radians(45.01)


def test_lines_from_a_corner_are_radial():
    for line in make_test(BOX, INSIDE, TRACKER).lines:
        assert line.obliqueness < np.radians(1.5), line.name


def test_a_line_out_of_the_trackers_elevation_is_left_out_with_its_reason():
    tracker = replace(TRACKER, highest_elevation=np.radians(80.0))
    test = make_test(BOX, INSIDE, tracker)
    assert list(test.left_out) == ["z"]
    assert "elevation" in test.left_out["z"]


def test_on_the_carriage_the_beam_leaves_the_other_way():
    low = Tracker(lowest_elevation=0.0)
    high = np.array([0.1, 0.2, 0.3])
    assert low.unseen(high, np.zeros(3)) == ""
    assert "elevation" in replace(low, held_by=CARRIAGE).unseen(high, np.zeros(3))
    assert replace(low, held_by=CARRIAGE).unseen(-high, np.zeros(3)) == ""


def test_ranges():
    tracker = Tracker(minimum_range=0.1, maximum_range=0.5)
    assert "nearer" in tracker.unseen(np.array([0.09, 0, 0]), np.zeros(3))
    assert "farther" in tracker.unseen(np.array([0.51, 0, 0]), np.zeros(3))
    assert tracker.unseen(np.array([0.3, 0, 0]), np.zeros(3)) == ""
    ends = np.array([-0.3, 0.05, 0.0]), np.array([0.3, 0.05, 0.0])
    assert "nearer" in tracker.unseen_on_the_way(*ends, np.zeros(3))


def test_a_tracker_in_the_midst_locates_from_places_it_sees():
    tracker = replace(TRACKER, minimum_range=0.45)
    station = np.array([0.4, 0.25, 0.2])
    for place in make_test(BOX, np.array([-0.5, 0, 0]), tracker).locating:
        assert not tracker.unseen(place, np.array([-0.5, 0.0, 0.0]))
    with refused(PoorGeometry, "out_of_range", aspect="sight"):
        make_test(BOX, station, tracker, locating=20)


def test_ways_keep_clear_of_the_tracker_one_axis_at_a_time():
    station = np.array([0.4, 0.0, 0.0])
    tracker = Tracker(minimum_range=0.1)
    start, end = np.array([0.0, 0.0, 0.0]), np.array([0.8, 0.0, 0.0])
    assert tracker.unseen_on_the_way(start, end, station)
    way = [start, *TrackerRoute(BOX, station, tracker).way(start, end)]
    np.testing.assert_array_equal(way[-1], end)
    for here, there in pairwise(way):
        assert np.count_nonzero(here != there) == 1
        assert not tracker.unseen_on_the_way(here, there, station)


def test_no_way_is_refused():
    wall = Tracker(minimum_range=0.6)
    station = np.array([0.4, 0.25, 0.2])
    with refused(Refusal, "not_found"):
        TrackerRoute(BOX, station, wall).way(
            np.array([-0.3, 0.25, 0.2]), np.array([1.1, 0.25, 0.2])
        )


@pytest.mark.parametrize(
    ("how", "aspect"),
    [
        ({"targets": 4}, "targets"),
        ({"runs": 0}, "runs"),
        ({"overrun": 0.3}, "overrun"),
        ({"overrun": -1.0}, "overrun"),
        ({"locating": 5}, "places"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(how, aspect):
    with refused(Refusal, aspect=aspect):
        make_test(BOX, BESIDE, TRACKER, **how)


@pytest.mark.parametrize("station", [BESIDE, WITHIN, INSIDE], ids=["beside", "outside", "corner"])
def test_joint_estimate_is_exact_where_eq_1_is_misled(station):
    readings = seven_line_readings(straight_machine(), station, noise=False, runs=1)
    result = evaluate_test(readings)
    np.testing.assert_allclose(result.joint.values, TRUTH, atol=2e-9)
    meeting = np.linalg.solve(error_matrix(TRUTH), station)
    np.testing.assert_allclose(result.joint.machine_position, meeting, atol=2e-9)
    assert np.linalg.norm(result.location.position - station) > 1e-6


def test_squareness_from_face_lines_of_a_radial_test():
    readings = seven_line_readings(straight_machine(), INSIDE, noise=False, runs=2)
    lines = evaluate_test(readings).corrected
    found = {one.name: one.value for one in lines.squareness}
    assert found == pytest.approx(SQUARENESS, abs=0.4e-6)
    assert lines.closure == pytest.approx(0.0, abs=0.2e-6)
    slopes = {one.name: one.slope for one in lines.slopes}
    assert [slopes[name] for name in "xyz"] == pytest.approx(SCALES, abs=0.2e-6)


@pytest.mark.parametrize("name", list(SQUARENESS))
@pytest.mark.parametrize("corner", [INSIDE, BOX.high, BOX.high * [1, 0, 1]])
def test_sign_of_each_squareness_from_every_corner(name, corner):
    alone = dict.fromkeys(SQUARENESS, 0.0) | {name: 20e-6}
    errors = straight_machine((0, 0, 0), alone)
    result = evaluate_test(seven_line_readings(errors, corner, noise=False, runs=1))
    found = {one.name: one.value for one in result.corrected.squareness}
    assert found == pytest.approx(alone, abs=0.5e-6)
    assert dict(zip(SQUARENESS, result.joint.values[3:], strict=True)) == pytest.approx(
        alone, abs=1e-9
    )


def test_no_squareness_is_made_of_lines_that_the_beam_does_not_follow():
    result = evaluate_test(seven_line_readings(straight_machine(), BESIDE, runs=1))
    assert result.located.squareness == ()
    assert np.isnan(result.located.closure)
    assert any("does not run along" in text for text in result.remarks)


def test_iso_figures_of_a_scale_error_along_a_radial_line():
    errors = straight_machine((25e-6, 0.0, 0.0), dict.fromkeys(SQUARENESS, 0.0))
    result = evaluate_test(seven_line_readings(errors, INSIDE, noise=False, runs=5))
    test = result.corrected.tests[0]
    assert (test.name, test.standard, test.runs) == ("X", "ISO 230-2", (5, 5))
    length = test.target[-1] - test.target[0]
    assert test.parameters["E"] == pytest.approx(25e-6 * length, rel=1e-3)
    assert test.parameters["B"] == pytest.approx(0.0, abs=1e-12)
    assert result.corrected.tests[-1].standard == "ISO 230-6"


def test_reversal_is_found_with_its_sign_also_where_the_axis_runs_down():
    for corner in (INSIDE, BOX.high):
        readings = seven_line_readings(PERFECT, corner, noise=False, runs=2)
        # The axis stops 2 µm before the target in the sense in which X grows.
        moved = []
        for one in readings:
            sense = 1 if one.direction == "forward" else -1
            upwards = sense if corner is INSIDE else -sense
            short = 2e-6 if one.line == "x" and upwards > 0 else 0.0
            away = 1 if corner is INSIDE else -1
            moved.append(replace(one, change=one.change - away * short))
        test = evaluate_test(moved).located.tests[0]
        assert np.all(np.diff(test.target) > 0)
        np.testing.assert_allclose(test.reversal, -2e-6, rtol=1e-3)


@pytest.mark.parametrize("corner", [INSIDE, BOX.high], ids=["up", "down"])
def test_deviations_count_along_the_axis_whichever_way_the_line_runs(corner):
    errors = straight_machine((25e-6, 0.0, 0.0), dict.fromkeys(SQUARENESS, 0.0))
    result = evaluate_test(seven_line_readings(errors, corner, noise=False, runs=1))
    test = result.corrected.tests[0]
    for mean in (test.mean_forward, test.mean_backward):
        slope = np.polyfit(test.target, mean, 1)[0]
        assert slope == pytest.approx(25e-6, rel=1e-3)
    assert result.corrected.slopes[0].slope == pytest.approx(25e-6, rel=1e-3)


def test_separation_from_one_line_agrees_with_the_truth_within_its_band():
    readings = seven_line_readings(straight_machine(), BESIDE, seed=3)
    result = evaluate_test(readings, chain="YXZ")
    along_x = result.separations["x"]
    u_scale, u_lean = along_x.standard_uncertainty
    np.testing.assert_allclose(along_x.towards, [0, 0, -1], atol=1e-3)
    assert abs(along_x.scale - SCALES[0]) < 3 * u_scale
    assert abs(along_x.lean) < 3 * u_lean
    assert "on the line" in result.separations["z"]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (
            lambda r: [x for x in r if not (x.line == "y" and x.stop == 3 and x.run == 2)],
            a_fault("missing", aspect="target"),
        ),
        (lambda r: [x for x in r if x.line == "locate"], a_fault("too_few", aspect="lines")),
        (
            lambda r: [x for x in r if x.line != "locate"],
            a_fault("missing", "locate", aspect="location"),
        ),
        (lambda r: [*r, r[-1]], a_fault("twice")),
        (
            lambda r: [
                replace(x, position=(9.0, *x.position[1:]))
                if x.line == "xy" and x.run == 2 and x.stop == 2 and x.direction == "forward"
                else x
                for x in r
            ],
            a_fault("mismatch", "xy", "2"),
        ),
    ],
)
def test_runs_that_do_not_belong_together_are_refused(damage, words):
    readings = seven_line_readings(PERFECT, INSIDE, runs=2)
    with refused(ValueError, words):
        evaluate_test(damage(list(readings)))


def test_a_tracker_beside_the_middle_of_a_line_is_no_iso_230_test():
    readings = [r for r in seven_line_readings(PERFECT, INSIDE, runs=1) if r.line == "x"]
    with refused(Refusal, "out_of_range", aspect="beam"):
        runs_of_line(readings, np.array([0.4, 0.2, 0.0]))


def test_what_is_expected_is_what_comes():
    expectation = expect(make_test(BOX, BESIDE, TRACKER), TRACKER, "YXZ")
    result = evaluate_test(seven_line_readings(PERFECT, BESIDE), chain="YXZ")
    # Expected for a usual machine; a perfect one is taken for a good one.
    ratio = result.joint.standard_uncertainty / np.array(list(expectation.joint.values()))
    assert np.all((ratio > 0.5) & (ratio < 1.1))
    for name in "xy":
        scale, lean, correlation = expectation.separations[name]
        one = result.separations[name]
        alone = one.adjustment.standard_uncertainty[:2]
        np.testing.assert_allclose([scale, lean], alone, rtol=0.02)
        assert np.all(np.array(one.standard_uncertainty) > 2.0 * alone)
        assert correlation == pytest.approx(one.correlation, abs=0.02)
    assert "on the line" in expectation.separations["z"]
