"""Two measurements beside each other: E_n and chi squared keep what they promise."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.agreement import (
    SAME_INSTRUMENT,
    SAME_MACHINE,
    ComparedMeasurement,
    CurveChange,
    JointJudgement,
    JointTest,
    compare,
    joint_test,
)
from stepdiag_ros.metrology.agreement.joint import significant_of_many
from stepdiag_ros.metrology.agreement.reversal import reversals
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.forward import ErrorCurves, in_result_frame
from stepdiag_ros.metrology.plausible import NOTHING
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.uncertainty.budget import make_budget
from stepdiag_ros.metrology.uncertainty.instrument import Spread, perfect
from stepdiag_ros.metrology.uncertainty.source import COMMON

PAIRS = 60
PLAN = make_plan(5, (0.012,) * 3, repeats=2, directions=("forward", "backward"))
BEND, TURN = 0.8e-6, 2.4e-6
"""m: change of E_YY and of E_XY at the end of the travel of Y, 60 mm."""
INSIDE = 0.9545
"""Share of |E_n| <= 1 with k = 2, normal distribution."""


def measured(
    cell: SimulatedCell, number: int, method="setup_robust", plan=PLAN
) -> ComparedMeasurement:
    """Measure a machine with a laser that was set up anew, and new noise."""
    measurement = by_noise_alone(simulate(plan, replace(cell, seed=1000 + number), seed=number))
    return ComparedMeasurement(solve(measurement, method), measurement.chain, measurement)


def with_change(cell: SimulatedCell) -> SimulatedCell:
    """Return the machine with another E_YY and another squareness of Y to X."""
    x, y, z = cell.errors.nodes
    way = (y - y[0]) / (y[-1] - y[0])
    values = cell.errors.values[1].copy()
    values[:, 1] += BEND * way**2
    values[:, 0] += TURN * way
    errors = ErrorCurves((x, y, z), (cell.errors.values[0], values, cell.errors.values[2]))
    return replace(cell, errors=errors)


@pytest.fixture(scope="module")
def unchanged():
    """Return what many machines say that were measured twice and did not change."""
    made = []
    for seed in range(PAIRS):
        cell = make_cell(seed=seed, held=0.0)
        made.append(compare(measured(cell, 2 * seed), measured(cell, 2 * seed + 1)))
    return made


def test_of_an_unchanged_machine_e_n_is_within_one_as_often_as_it_promises(unchanged):
    inside = np.array([np.mean(np.abs(one.normalised_errors) <= 1.0) for one in unchanged])
    assert sum(one.normalised_errors.size for one in unchanged) > 2000
    # Nodes of one pair of runs go together: the pairs are the independent draws.
    spread = float(np.std(inside)) / np.sqrt(PAIRS)
    assert spread < 0.008
    assert abs(np.mean(inside) - INSIDE) < 3.3 * spread


@pytest.mark.parametrize("method", ["setup_robust", "least_squares"])
def test_rotations_that_stay_the_same_are_no_change_and_hide_none(method):
    """What rotations make wrong in both is the same: only the readings' noise is left."""
    inside = []
    for seed in range(PAIRS // 2):
        cell = make_cell(seed=seed, rotation=10e-6)
        runs = [
            simulate(PLAN, replace(cell, seed=1000 + number), seed=number)
            for number in (2 * seed, 2 * seed + 1)
        ]
        one = compare(*(ComparedMeasurement(solve(run, method), run.chain, run) for run in runs))
        inside.append(np.mean(np.abs(one.normalised_errors) <= 1.0))
    spread = float(np.std(inside)) / np.sqrt(len(inside))
    assert abs(np.mean(inside) - INSIDE) < 3.3 * spread + 0.005


def test_of_an_unchanged_machine_chi_squared_is_what_chance_makes(unchanged):
    squares = sum(one.joint.chi_squared for one in unchanged)
    freedom = sum(one.joint.degrees_of_freedom for one in unchanged)
    assert freedom == PAIRS * 42
    assert abs(squares - freedom) < 3.5 * np.sqrt(2.0 * freedom)
    # No more than 9 of 60 at 5 % each: 99.9 % of the binomial distribution.
    assert sum(one.joint.significant for one in unchanged) <= 9
    # Every number counts, and yet it holds the same limit.
    assert all(one.judgement.numbers == 1 + 9 + 42 + 20 for one in unchanged)
    assert sum(one.judgement.significant for one in unchanged) <= 9
    for one in unchanged:
        named = [*one.changed, *(figure for figure in one.every_figure if figure.changed)]
        assert one.judgement.significant or not named
    figures = [
        [figure.normalised_error for figure in (*one.figures, one.rms, one.worst)]
        for one in unchanged
    ]
    sizes = np.std(np.array(figures), axis=0)
    assert np.all((sizes > 0.33) & (sizes < 0.67)), sizes


def test_a_change_is_seen_at_its_size():
    hits = []
    for seed in range(12):
        cell = make_cell(seed=seed, held=0.0)
        found = compare(measured(cell, 2 * seed), measured(with_change(cell), 2 * seed + 1))
        true = {
            name: with_change(cell).truth(PLAN.volume)[name] - values
            for name, values in cell.truth(PLAN.volume).items()
        }
        assert found.joint.probability < 1e-6
        named = {one.name for one in found.changed}
        assert {"E_YY", "E_XY"} <= named
        most = found.most_changed()
        assert most.name == "E_XY" and most.largest == 5
        for one in found.curves:
            free = one.difference_uncertainty > 1e-15
            error = (one.difference - true[one.name])[free] / one.difference_uncertainty[free]
            hits.extend(np.abs(error) <= 2.0)
        figure = next(one for one in found.figures if one.name == "C0Y")
        assert abs(figure.difference + TURN / 0.06) < 4.0 * figure.difference_uncertainty
        assert figure.normalised_error < -3.0
        assert found.moved is not None and found.moved.position[1] == pytest.approx(0.06)
        size = np.hypot(TURN, BEND)
        # The largest of many differences: chance adds to it.
        assert -2.0 < (found.moved.length - size) / found.moved.length_uncertainty < 5.0
    assert 0.9 < np.mean(hits) < 0.99


def test_e_n_and_its_sign():
    cell = make_cell(seed=1, held=0.0)
    before, after = measured(cell, 1), measured(with_change(cell), 2)
    found, back = compare(before, after), compare(after, before)
    for one, other in zip(found.curves, back.curves, strict=True):
        u = 2.0 * np.hypot(one.before_uncertainty, one.after_uncertainty)
        free = u > 1e-14
        expected = (one.after - one.before)[free] / u[free]
        np.testing.assert_allclose(one.normalised_error[free], expected, rtol=1e-12)
        assert np.all(np.isnan(one.normalised_error[~free])) and not free[0]
        np.testing.assert_allclose(other.normalised_error, -one.normalised_error)
    first, second = (of_result(one.result, "YXZ", NOTHING) for one in (before, after))
    assert (found.worst.before, found.worst.after) == (first.value, second.value)
    assert (found.rms.before, found.rms.after) == (first.rms, second.rms)
    assert found.worst.before_uncertainty == pytest.approx(first.at_the_place, rel=1e-3)
    np.testing.assert_allclose(found.worst_places, [first.position, second.position])


def test_the_uncertainty_of_the_rms_is_what_draws_of_the_curves_have():
    one = measured(make_cell(seed=1), 1)
    found = compare(one, measured(make_cell(seed=1), 2))
    stacked = np.concatenate(list(one.result.curves.values()))
    drawn = np.random.default_rng(0).multivariate_normal(stacked, one.result.covariance, 150)
    rms = []
    for values in drawn:
        parts = dict(zip(one.result.curves, np.split(values, 9), strict=True))
        rms.append(of_result(replace(one.result, curves=parts)).rms)
    assert np.std(rms) == pytest.approx(found.rms.before_uncertainty, rel=0.25)


def test_near_zero_the_size_of_the_vectors_is_as_uncertain_as_they_are():
    """A length has no first order there: of a machine without errors it is never negative."""
    perfect_cell = make_cell(seed=1, positioning=0.0, size=0.0, squareness=(0.0,) * 3)
    found = compare(measured(perfect_cell, 1), measured(perfect_cell, 2))
    assert found.rms.before < found.rms_noise[0]
    assert found.rms.before_uncertainty > 0.4 * found.rms_noise[0]
    assert found.rms.before + 2.0 * found.rms.before_uncertainty > found.rms_noise[0]
    large = compare(measured(make_cell(seed=1), 1), measured(make_cell(seed=1), 2))
    assert large.rms.before > 20.0 * large.rms_noise[0]
    assert large.rms.before_uncertainty < large.rms_noise[0]


def test_what_both_share_cancels_in_the_difference():
    cell = make_cell(seed=1, held=0.0)
    both = [measured(cell, number) for number in (1, 2)]

    def budgets(wavelength):
        known = replace(perfect(), wavelength=Spread(wavelength))
        # The method is linear, so that a budget depends on the plan alone.
        budget = make_budget(both[0].measurement, known, "setup_robust")
        return [replace(one, budget=budget) for one in both]

    exact, calibrated = budgets(0.0), budgets(5e-6)
    apart, together = compare(*calibrated), compare(*calibrated, same_instrument=True)
    readings = compare(*exact)
    assert apart.shared == () and "laser wavelength" in together.shared
    for one, other, third in zip(apart.curves, together.curves, readings.curves, strict=True):
        np.testing.assert_allclose(
            other.difference_uncertainty, third.difference_uncertainty, rtol=1e-3, atol=1e-15
        )
        if one.name == "E_XX":
            expected = np.hypot(third.difference_uncertainty[-1], np.sqrt(2.0) * 5e-6 * 0.06)
            assert one.difference_uncertainty[-1] == pytest.approx(expected, rel=1e-3)
            budget = calibrated[0].budget
            row = budget.row("E_XX at 5")
            assert one.before_uncertainty[-1] == budget.standard_uncertainty[row]
    wide, narrow, least = (
        next(figure for figure in one.figures if figure.name == "positioning E_XX")
        for one in (apart, together, readings)
    )
    assert wide.difference_uncertainty > 2.0 * narrow.difference_uncertainty
    assert narrow.difference_uncertainty == pytest.approx(least.difference_uncertainty, rel=1e-3)
    assert together.rms.difference_uncertainty < apart.rms.difference_uncertainty


def test_the_sources_that_are_shared_are_sources_of_the_budget():
    measurement = simulate(PLAN, make_cell(seed=1))
    budget = make_budget(
        measurement, perfect(), "setup_robust", expansion=11.5e-6, material_temperature=23.0
    )
    common = {source.name for source in budget.sources if source.correlation == COMMON}
    assert {*SAME_INSTRUMENT, *SAME_MACHINE} <= common


def test_grids_of_one_box_are_compared_where_they_meet():
    cell = make_cell(seed=1, held=0.0)
    fine = measured(cell, 1, plan=make_plan(6, (0.01,) * 3))
    coarse = measured(cell, 2, plan=make_plan(3, (0.02,) * 3))
    found = compare(fine, coarse)
    assert any("7 and 4 nodes" in one for one in found.remarks)
    for one in found.curves:
        np.testing.assert_allclose(one.positions, [0.0, 0.02, 0.04, 0.06], atol=1e-12)
        np.testing.assert_array_equal(one.before, fine.result.curves[one.name][::2])
    np.testing.assert_array_equal(
        found.before.covariance[:4, :4], fine.result.covariance[:7:2, :7:2]
    )
    assert found.joint.degrees_of_freedom == 24 and found.joint.probability > 1e-3
    other = compare(measured(cell, 1), measured(cell, 2, plan=make_plan(6, (0.01,) * 3)))
    assert len(other.before.nodes[0]) == 2 and np.isfinite(other.joint.probability)


def test_frames_that_differ_are_brought_together():
    cell = make_cell(seed=1, tilt=0.0)
    one, other = measured(cell, 1), measured(cell, 2, "conventional")
    assert one.result.frame != other.result.frame
    found = compare(one, other)
    assert any("turned into one" in remark for remark in found.remarks)
    turned = in_result_frame(other.result.nodes, other.result.curves)
    for curve in found.curves:
        np.testing.assert_allclose(curve.after, turned[curve.name], atol=1e-18)
        if curve.name in ("E_YX", "E_ZX", "E_YZ"):
            assert curve.after_uncertainty[-1] < 1e-15
    assert found.joint.probability > 1e-3


def test_what_the_frame_fixes_is_no_largest_change():
    nan = float("nan")

    def curve(difference, uncertainty):
        known = np.array(difference, dtype=float)
        u = np.array(uncertainty, dtype=float)
        zeros = np.zeros(len(known))
        return CurveChange("E_YX", "m", zeros, zeros, u, known, u, u, JointTest())

    # Both ends are zero by definition, and nothing else was measured.
    assert curve([0.0, nan, nan, 0.0], [0.0, nan, nan, 0.0]).largest == -1
    assert curve([0.0, 1e-6, -3e-6, 0.0], [0.0, 1e-7, 1e-7, 0.0]).largest == 2
    # Where no uncertainty is known the size still is.
    assert curve([0.0, -2e-6, 1e-6], [nan, nan, nan]).largest == 1


def test_what_is_not_known_is_not_judged():
    cell = make_cell(seed=1, held=0.0)
    plan = make_plan(5, (0.012,) * 3, diagonals=())
    found = compare(*(measured(cell, number, "least_squares", plan) for number in (1, 2)))
    known = {one.name for one in found.curves if one.changed is not None}
    assert known == {"E_XX", "E_YY", "E_ZZ"}
    assert np.isnan(found.rms.before) and np.isnan(found.rms.normalised_error)
    assert found.moved is None and found.joint.degrees_of_freedom == 15
    squareness = next(one for one in found.figures if one.name == "C0Y")
    assert np.isnan(squareness.before) and np.isnan(squareness.normalised_error)
    # Without covariance (a document) single nodes can be judged, a whole curve cannot.
    full = [measured(cell, number) for number in (1, 2)]
    bare = [
        replace(one, result=replace(one.result, covariance=np.empty((0, 0)), figures=()))
        for one in full
    ]
    expected, told = compare(*full), compare(*bare)
    np.testing.assert_allclose(told.normalised_errors, expected.normalised_errors)
    assert not told.joint.known and all(one.changed is None for one in told.curves)
    assert told.rms.before == expected.rms.before and np.isnan(told.rms.normalised_error)
    assert all(np.isnan(spread) for spread in told.rms_noise)


def test_other_machines_and_other_boxes_are_refused():
    one = measured(make_cell(seed=1), 1)
    with refused(Refusal, "mismatch", "YXZ", "XYZ", aspect="machine"):
        compare(one, measured(make_cell(seed=1, chain="XYZ"), 2))
    with refused(Refusal, "mismatch", "X", "0", "60", "50", aspect="box"):
        compare(one, measured(make_cell(seed=1), 2, plan=make_plan(5, (0.01,) * 3)))
    nothing = replace(one.result, curves={}, standard_uncertainty={})
    with refused(Refusal, "mismatch", aspect="curves"):
        compare(one, replace(one, result=nothing))


def test_differences_that_hang_together_count_once():
    difference = np.array([1.0, -2.0, 0.5])
    found = joint_test(difference, np.diag([1.0, 4.0, 0.25]))
    assert found.chi_squared == pytest.approx(3.0) and found.degrees_of_freedom == 3
    assert found.probability == pytest.approx(0.39163, abs=1e-5)
    doubled = np.repeat(np.arange(3), 2)
    again = joint_test(difference[doubled], np.diag([1.0, 4.0, 0.25])[np.ix_(doubled, doubled)])
    assert again.degrees_of_freedom == 3
    assert again.chi_squared == pytest.approx(3.0)
    # Correlated: dᵀ C⁻¹ d by hand.
    covariance = np.array([[2.0, 1.0], [1.0, 2.0]])
    assert joint_test(np.array([1.0, -1.0]), covariance).chi_squared == pytest.approx(2.0)
    part = joint_test(np.array([0.0, np.nan, 2.0]), np.diag([0.0, 1.0, 1.0]))
    assert (part.chi_squared, part.degrees_of_freedom) == (pytest.approx(4.0), 1)
    assert not joint_test(np.array([np.nan]), np.eye(1)).known
    unknown = joint_test(difference[:2], np.array([[1.0, np.nan], [np.nan, 1.0]]))
    assert unknown == JointTest() or not unknown.known


def test_of_many_curves_only_what_is_improbable_among_many_is_named():
    tests = {"a": 0.004, "b": 0.03, "c": 1e-6, "d": np.nan}
    # Three are known: 1e-6 · 3 and 0.004 · 2 are below 0.05, and so is 0.03 · 1.
    assert significant_of_many(tests) == ("c", "a", "b")
    tests["e"] = 0.5
    assert significant_of_many(tests) == ("c", "a")


def test_a_number_that_chance_does_not_make_among_so_many_is_always_named():
    generator = np.random.default_rng(5)
    hits = 0
    for _ in range(200):
        sizes = generator.integers(1, 40, generator.integers(1, 9))
        members = {
            str(row): {f"{row} {n}": float(p) for n, p in enumerate(generator.uniform(size=size))}
            for row, size in enumerate(sizes)
        }
        row = str(generator.integers(len(sizes)))
        limit = 0.05 / (len(sizes) * len(members[row]))
        members[row][f"{row} 0"] = float(limit * generator.uniform(0.0, 2.0))
        found = JointJudgement.of(members)
        expected = min(1.0, min(len(sizes) * len(m) * min(m.values()) for m in members.values()))
        assert found.probability == pytest.approx(expected)
        assert found.significant == (expected < 0.05) == any(one.changed for one in found.families)
        if members[row][f"{row} 0"] < limit:
            assert found.significant and f"{row} 0" in found.named(row)
            hits += 1
    assert 60 < hits < 140
    nothing = JointJudgement.of({"a": {"b": np.nan}})
    assert not nothing.known and not nothing.significant and np.isnan(nothing.probability)


def with_lost_motion(one: ComparedMeasurement, size: float, overrun: float) -> ComparedMeasurement:
    """Return a measurement of a machine whose X stays behind by half of it, either way.

    Without overrun the first stop of a run is where the run before, the other way, has ended.
    """
    lines = []
    for line in one.measurement.lines:
        displacement = line.displacement.copy()
        if (line.line.kind, line.line.name) == ("linear", "x"):
            behind = -0.5 * size if line.line.direction == "forward" else 0.5 * size
            displacement += behind
            if not overrun:
                displacement[0] -= 2.0 * behind
        lines.append(replace(line, displacement=displacement, overrun=overrun))
    measurement = replace(one.measurement, lines=tuple(lines))
    return ComparedMeasurement(solve(measurement, one.result.method), one.chain, measurement)


def reversal_of(found, axis="X"):
    return next(one for one in found.figures if one.name == f"mean reversal {axis}")


def test_a_change_of_the_reversal_alone_is_a_change():
    cell = make_cell(seed=1, held=0.0)
    for overrun in (0.0, 0.002):
        before, after = (
            with_lost_motion(measured(cell, number), size, overrun)
            for number, size in ((1, 0.8e-6), (2, 0.0))
        )
        found = compare(before, after)
        assert found.judgement.significant
        named = [one.name for one in found.every_figure if one.changed]
        if overrun:
            # The mean of both senses has no lost motion in it: the curves are as they were.
            assert named == ["mean reversal X"] and not found.changed
            assert not found.joint.significant
        assert "mean reversal X" in named
        row = reversal_of(found)
        assert abs(row.before + 0.8e-6) < 3.0 * row.before_uncertainty
        assert abs(row.after) < 3.0 * row.after_uncertainty
        # Of six targets the four between the ends tell it where there is no overrun.
        assert row.before_uncertainty == pytest.approx(0.1e-6 / np.sqrt(6 if overrun else 4))
        assert any("without the end targets, in both" in one for one in found.remarks) != overrun


def test_to_measure_with_and_without_overrun_is_no_change():
    cell = make_cell(seed=1, held=0.0)
    first, second = (measured(cell, number) for number in (1, 2))
    for size in (2e-6, 0.0):
        without, beyond = (
            with_lost_motion(first, size, 0.0),
            with_lost_motion(second, size, 0.002),
        )
        found = compare(without, beyond)
        assert not found.judgement.significant and not found.changed
        assert any("before do not begin beyond their ends" in one for one in found.remarks)
        back = compare(beyond, without)
        assert back.joint.chi_squared == pytest.approx(found.joint.chi_squared, rel=1e-6)
        assert any("after do not begin beyond their ends" in one for one in back.remarks)
        # If the overrun were the same in both, it would be a change where there is lost motion.
        lines = tuple(replace(line, overrun=0.002) for line in without.measurement.lines)
        told = replace(without, measurement=replace(without.measurement, lines=lines))
        same = compare(told, beyond)
        assert same.judgement.significant == (size > 0.0)
        wide, narrow = (
            next(one for one in each.figures if one.name == "positioning E_XX")
            for each in (found, same)
        )
        assert wide.before_uncertainty > narrow.before_uncertainty
        if not size:
            # A reversal error near zero hides nothing.
            assert wide.before_uncertainty < 2.0 * narrow.before_uncertainty


def test_where_the_reversal_is_not_measured_the_overrun_may_be_all():
    cell = make_cell(seed=1, held=0.0)
    plan = make_plan(5, (0.012,) * 3)
    one, other = (measured(cell, number, plan=plan) for number in (1, 2))
    found = compare(with_lost_motion(one, 2e-6, 0.0), with_lost_motion(other, 2e-6, 0.002))
    assert not found.judgement.significant
    assert any("X, Y, Z it was not measured, and 10 µm is taken" in one for one in found.remarks)
    assert not any(one.family == "mean reversal" for one in found.figures)
    # The shape of the curve beyond its first node does not depend on it.
    shape = next(one for one in found.figures if one.name == "straightness E_YX")
    assert shape.difference_uncertainty < 1e-6


def test_runs_that_do_not_repeat_are_no_change_of_the_reversal():
    generator = np.random.default_rng(3)
    one = measured(make_cell(seed=1), 1).measurement

    def unsteady():
        offsets = generator.normal(scale=1e-6, size=len(one.lines))
        lines = tuple(
            replace(line, displacement=line.displacement + offset, overrun=0.002)
            for line, offset in zip(one.lines, offsets, strict=True)
        )
        return replace(one, lines=lines)

    chances = []
    for _ in range(100):
        figures, remarks = reversals(unsteady(), unsteady())
        assert len(figures) == 3 and not remarks
        chances.extend(figure.probability for figure in figures)
        assert all(2.0 <= figure.degrees_of_freedom <= 4.0001 for figure in figures)
    # By the stops alone nine of ten would be beyond; 24 of 300 is 99 % of the binomial.
    assert 2 <= np.count_nonzero(np.array(chances) < 0.05) <= 24


def test_a_reversal_is_compared_at_the_targets_that_tell_it_in_both():
    cell = make_cell(seed=1, held=0.0)
    ways = ("forward", "backward")
    fine = measured(cell, 1, plan=make_plan(6, (0.01,) * 3, directions=ways)).measurement
    coarse = measured(cell, 2, plan=make_plan(3, (0.02,) * 3, directions=ways)).measurement
    figures, remarks = reversals(fine, coarse)
    assert [one.name for one in figures] == [
        "mean reversal X",
        "mean reversal Y",
        "mean reversal Z",
    ]
    # At 20 and 40 mm: two targets, one run each way.
    assert any("X, Y, Z: there is one run each way" in one for one in remarks)
    assert figures[0].before_uncertainty == pytest.approx(0.1e-6)
    assert any("X, Y, Z: at the targets that determine it in both" in one for one in remarks)
    ends = measured(
        cell, 3, plan=make_plan(1, (0.06,) * 3, directions=ways), method="least_squares"
    )
    figures, remarks = reversals(fine, ends.measurement)
    assert figures == [] and any("no target determines it in both" in one for one in remarks)
    figures, remarks = reversals(None, fine)
    assert figures == [] and "the lines of both are needed" in remarks[0]
    one_way = measured(cell, 4, plan=make_plan(6, (0.01,) * 3)).measurement
    figures, remarks = reversals(fine, one_way)
    assert figures == [] and "X, Y, Z: in both directions in one measurement only" in remarks[0]
