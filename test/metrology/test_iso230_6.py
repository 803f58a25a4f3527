"""ISO 230-6 from simulated diagonals, and from step diagonals where that is the same."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell

from stepdiag_ros.metrology.plan import DIAGONAL, LINEAR, Plan
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.standards.axis_test import (
    NO_OVERRUN,
    ON_THE_DIAGONAL_BY_STEPS,
    STEPS_BEGIN_AT_THE_END,
    WITHOUT_OVERRUN,
    BidirectionalRuns,
    all_runs,
    completed_by,
)
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.metrology.standards.iso230_6 import (
    BODY,
    diagonal_groups,
    volumetric_warning,
)

BODIES = ["ppp", "npp", "pnp", "ppn"]


def plan_of(*groups, repeats=2, overrun=0.001):
    return Plan.from_mapping(
        {
            "step_m": [0.012, 0.009, 0.010],
            "origin_m": [0.01, 0.02, 0.0],
            "blocks": 5,
            "repeats": repeats,
            "directions": ["forward", "backward"],
            "overrun_m": overrun,
            "feed_m_per_s": 0.05,
            "lines": list(groups),
        },
        "test plan",
    )


def diagonal_test(name, up, down):
    up, down = np.array([up, up], float), np.array([down, down], float)
    runs = BidirectionalRuns(name, DIAGONAL, np.arange(up.shape[1]) * 1.0, up, down)
    return evaluate(runs)


def test_e_d_and_b_d_are_the_worst_of_the_four():
    tests = [
        diagonal_test("ppp", [0, 7.7e-6], [0, 4.0e-6]),
        diagonal_test("npp", [0, 6.3e-6], [0, 3.2e-6]),
        diagonal_test("pnp", [0, 4.5e-6], [0, 2.1e-6]),
        diagonal_test("ppn", [0, 3.8e-6], [0, 2.1e-6]),
    ]
    (group,) = diagonal_groups(tests[::-1])
    assert group.place == BODY
    assert group.labels == ("D1", "D2", "D3", "D4")
    assert [test.name for test in group.tests] == BODIES
    assert group.systematic_deviation == pytest.approx(7.7e-6)
    assert group.reversal_value == pytest.approx(3.7e-6)
    assert group.remarks == ()


def test_a_missing_diagonal_makes_the_machine_unknown():
    (group,) = diagonal_groups([diagonal_test(name, [0, 1e-6], [0, 1e-6]) for name in BODIES[:3]])
    assert np.isnan(group.systematic_deviation)
    assert np.isnan(group.reversal_value)
    assert "ppn not measured" in group.remarks[0]


def test_faces_are_judged_apart():
    tests = [
        diagonal_test("pp0", [0, 1e-6], [0, 1e-6]),
        diagonal_test("np0", [0, 2e-6], [0, 1e-6]),
        diagonal_test("0pp", [0, 5e-6], [0, 1e-6]),
        diagonal_test("0np", [0, 3e-6], [0, 1e-6]),
    ]
    first, second = diagonal_groups(tests)
    assert (first.place, second.place) == ("face diagonals XY", "face diagonals YZ")
    assert first.labels == ("F1", "F2")
    assert first.systematic_deviation == pytest.approx(2e-6)
    assert second.systematic_deviation == pytest.approx(5e-6)


def test_a_test_of_an_axis_is_no_diagonal():
    assert diagonal_groups([replace(diagonal_test("X", [0, 1], [0, 1]), kind=LINEAR)]) == ()


def truth_along(cell, plan, name):
    """Return the deviation of an aligned reading at the targets of a diagonal, from its start."""
    from stepdiag_ros.metrology.forward import tool_point
    from stepdiag_ros.metrology.geometry import beam_direction
    from stepdiag_ros.metrology.plan import Line

    places = Line(DIAGONAL, name, "", 0, "forward").stops(plan.volume)
    actual, _ = tool_point(places, cell.errors, cell.chain)
    deviation = (actual - places) @ beam_direction(name, np.asarray(plan.volume.step))
    return deviation - deviation[0]


@pytest.mark.parametrize("name", ["ppp", "npp", "pnp", "ppn", "pp0", "n0p", "0np"])
def test_the_deviations_are_the_true_ones_in_sign_and_size(name):
    plan = plan_of({"kind": "diagonal", "names": [name]})
    cell = make_cell(high=(0.1, 0.1, 0.1), noise=0.0, tilt=0.0)
    (runs,) = all_runs(simulate(plan, cell))
    assert runs.name == name
    assert len(runs.forward) == len(runs.backward) == 2
    assert not runs.remarks
    true = truth_along(cell, plan, name)
    for row in (*runs.forward, *runs.backward):
        np.testing.assert_allclose(row - row[0], true, atol=2e-10)


@pytest.mark.parametrize("name", BODIES)
def test_step_diagonals_tell_the_same_at_the_ends_of_their_blocks(name):
    """Also with a tilted mirror, which adds up to 10 µm to the stops between."""
    aligned = make_cell(high=(0.1, 0.1, 0.1), noise=0.0, tilt=0.0)
    tilted = make_cell(high=(0.1, 0.1, 0.1), noise=0.0, tilt=0.0, mirror=300e-6)
    at_once = plan_of({"kind": "diagonal", "names": [name]})
    by_steps = plan_of({"kind": "step_diagonal", "names": [name], "orders": ["YZX"]})
    (one,) = all_runs(simulate(at_once, aligned))
    (other,) = all_runs(simulate(by_steps, tilted))
    np.testing.assert_allclose(other.target, one.target)
    np.testing.assert_allclose(other.forward[0], one.forward[0] - one.forward[0][0], atol=3e-9)
    assert other.remarks == (ON_THE_DIAGONAL_BY_STEPS, STEPS_BEGIN_AT_THE_END)
    between = simulate(by_steps, tilted).lines[0]
    straight = simulate(by_steps, aligned).lines[0]
    assert np.max(np.abs(between.displacement - straight.displacement)) > 1e-6


@pytest.mark.parametrize("axis", "xyz")
def test_a_linear_line_is_a_test_of_its_axis(axis):
    plan = plan_of({"kind": "linear", "names": [axis]})
    cell = make_cell(high=(0.1, 0.1, 0.1), noise=0.0, tilt=0.0)
    (runs,) = all_runs(simulate(plan, cell))
    number = "xyz".index(axis)
    assert runs.name == axis.upper()
    np.testing.assert_allclose(runs.target, plan.volume.nodes(number))
    errors = cell.errors.at(number, runs.target)[:, number]
    np.testing.assert_allclose(runs.forward[0], errors - errors[0], atol=1e-12)


def test_a_run_with_a_rejected_stop_is_left_out_and_named():
    plan = plan_of({"kind": "diagonal", "names": ["ppp"]})
    measurement = simulate(plan, make_cell(high=(0.1, 0.1, 0.1)))
    broken = measurement.lines[2].displacement.copy()
    broken[3] = np.nan
    lines = list(measurement.lines)
    lines[2] = replace(lines[2], displacement=broken)
    (runs,) = all_runs(replace(measurement, lines=tuple(lines)))
    assert (len(runs.forward), len(runs.backward)) == (1, 2)
    assert runs.remarks == ("ppp diagonal forward, repeat 1 is left out: a stop has no value",)


def test_without_overrun_the_reversal_at_the_ends_is_in_doubt():
    plan = plan_of({"kind": "linear", "names": ["x"]}, overrun=0.0)
    measurement = simulate(plan, make_cell())
    (runs,) = all_runs(measurement)
    assert runs.remarks == (WITHOUT_OVERRUN,) and runs.ends_in_doubt
    # What is not known is not said to be known.
    lines = tuple(replace(line, overrun=np.nan) for line in measurement.lines)
    (unknown,) = all_runs(replace(measurement, lines=lines))
    assert unknown.remarks == (NO_OVERRUN,) and unknown.ends_in_doubt


def test_a_test_is_complete_with_its_last_pass_and_again_when_one_is_repeated():
    plan = plan_of({"kind": "diagonal", "names": ["ppp", "npp"]})
    lines = simulate(plan, make_cell(high=(0.1, 0.1, 0.1))).lines
    done = [completed_by(line, lines[: k + 1], plan) is not None for k, line in enumerate(lines)]
    assert done == [False, False, False, True] * 2
    again = replace(lines[1], attempt=2, displacement=lines[1].displacement + 1e-6)
    repeated = completed_by(again, (*lines, again), plan)
    before = completed_by(lines[3], lines[:4], plan)
    np.testing.assert_allclose(repeated.backward[0], before.backward[0] + 1e-6, atol=1e-15)
    np.testing.assert_array_equal(repeated.forward, before.forward)


def test_the_warning_names_the_linear_tests_that_are_missing():
    diagonal = diagonal_test("ppp", [0, 1e-6], [0, 1e-6])
    axis = replace(diagonal, kind=LINEAR, name="Y")
    warning = volumetric_warning([diagonal, axis])
    assert "B5.54-2005" in warning
    assert "Missing here: linear positioning of X, Z (ISO 230-2, lines x, z)" in warning
    everything = [replace(axis, name=letter) for letter in "XYZ"]
    assert "Missing" not in volumetric_warning(everything)
    assert "do not give the volumetric accuracy" in volumetric_warning(everything)
