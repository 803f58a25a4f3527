"""Directly measured angles, straightness and squareness as input to the solve."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.direct import (
    ANYWHERE,
    DirectCurve,
    DirectMeasurement,
    DirectPlace,
    DirectSquareness,
)
from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES, tool_point
from stepdiag_ros.metrology.geometry import AXES, CHAINS, ROTATIONS, TRANSLATIONS, moving_axis
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import NotDeterminable, solve
from stepdiag_ros.metrology.solvers.monte_carlo import replicate
from stepdiag_ros.metrology.solvers.observations import observe
from stepdiag_ros.metrology.solvers.rotations import translations_design
from stepdiag_ros.metrology.uncertainty.budget import make_budget
from stepdiag_ros.metrology.uncertainty.instrument import Instrument, Spread
from stepdiag_ros.metrology.uncertainty.source import ANGULAR, DIRECT

PLAN = make_plan(6, step=(0.02, 0.02, 0.02), repeats=2, directions=("forward", "backward"))
VOLUME = PLAN.volume
TRAVEL = (0.12, 0.12, 0.12)
ANGLE, LENGTH = 0.3e-6, 0.1e-6
"""Standard uncertainties of an autocollimator (rad) and a straightedge (m)."""


def machine(seed=3, chain="YXZ", noise=0.1e-6, tilt=150e-6):
    return make_cell(seed, chain, high=TRAVEL, noise=noise, tilt=tilt, rotation=3e-6)


def measured_directly(cell, names, seed=0, noise=1.0, repeats=1, zero=1e-5, slope=1e-4):
    """Return curves as an instrument gives them: any zero, a straightedge lying askew, noise."""
    rng = np.random.default_rng(seed)
    truth = cell.truth(VOLUME)
    curves = {}
    for name in names:
        way = VOLUME.nodes(moving_axis(name))
        size = ANGLE if name in ROTATIONS else LENGTH
        askew = slope if name in TRANSLATIONS and name[2] != name[3] else 0.0
        values = [
            truth[name]
            + rng.normal(0.0, zero)
            + rng.normal(0.0, askew) * way
            + noise * size * rng.standard_normal(len(way))
            for _ in range(repeats)
        ]
        curves[name] = DirectCurve(name, way, np.array(values), np.full(len(way), size))
    return DirectMeasurement(curves, {})


def uncertain(lines, uncertainty):
    for line in lines.lines:
        line.standard_uncertainty[:] = uncertainty
    return lines


def true_squareness(truth):
    slope = {n: np.polyfit(VOLUME.nodes(moving_axis(n)), truth[n], 1)[0] for n in TRANSLATIONS}
    return {name: f * (slope[a] + slope[b]) for name, (f, (a, b)) in SQUARENESS_SLOPES.items()}


def deviations(result, truth, names):
    """Return errors and standard uncertainties of what is known and not fixed by the frame."""
    error = np.concatenate([result.curves[name] - truth[name] for name in names])
    spread = np.concatenate([result.standard_uncertainty[name] for name in names])
    free = np.isfinite(error) & (spread > 1e-15)
    return error[free], spread[free]


@pytest.mark.parametrize(
    ("machines", "least", "most"), [(10, 0.91, 1.0), (200, 0.93, 0.97)], ids=["few", "many"]
)
def test_with_measured_angles_the_bands_hold_and_the_errors_fall(machines, least, most):
    """Positioning, straightness, nine angles of 3 µrad, squareness and tilts, all at once."""
    errors, spreads, without, squareness, squareness_without = [], [], [], [], []
    for run in range(machines):
        cell = machine(seed=run)
        lines = simulate(PLAN, cell, seed=1000 + run)
        truth = cell.truth(VOLUME)
        names = (*ROTATIONS, "E_YX", "E_XZ")
        result = solve(replace(lines, direct=measured_directly(cell, names, run)))
        plain = solve(lines)
        error, spread = deviations(result, truth, result.curves)
        errors.append(error)
        spreads.append(spread)
        here = [deviations(one, truth, TRANSLATIONS)[0] for one in (result, plain)]
        without.append([np.mean(one**2) for one in here])
        for name, value in true_squareness(truth).items():
            figure = result.figure(name)
            squareness.append((figure.value - value) / figure.standard_uncertainty)
            squareness_without.append(
                [(one.figure(name).value - value) ** 2 for one in (result, plain)]
            )
    inside = np.abs(np.concatenate(errors)) <= 1.96 * np.concatenate(spreads)
    assert inside.size > machines * 95
    assert least <= np.mean(inside) <= most
    assert least <= np.mean(np.abs(squareness) <= 1.96) <= most
    rms, rms_without = np.sqrt(np.mean(without, axis=0))
    assert rms < rms_without / 2.5
    rms, rms_without = np.sqrt(np.mean(squareness_without, axis=0))
    assert rms < rms_without / 4.0


def test_all_nine_angles_make_both_methods_one():
    cell = machine()
    lines = replace(simulate(PLAN, cell, seed=1), direct=measured_directly(cell, ROTATIONS))
    results = [solve(lines, method) for method in ("least_squares", "rigid_body")]
    for name in (*TRANSLATIONS, *ROTATIONS):
        assert np.all(np.isfinite(results[0].curves[name]))
        np.testing.assert_allclose(results[0].curves[name], results[1].curves[name], atol=1e-12)
    assert results[0].degrees_of_freedom == results[1].degrees_of_freedom


def test_what_was_not_measured_directly_is_no_curve_of_least_squares():
    cell = machine()
    direct = measured_directly(cell, ("E_BX", "E_CX"))
    result = solve(replace(simulate(PLAN, cell), direct=direct))
    assert tuple(result.curves) == (*TRANSLATIONS, "E_BX", "E_CX")
    rigid = solve(replace(simulate(PLAN, cell), direct=direct), "rigid_body")
    assert np.all(np.isfinite(rigid.curves["E_BX"]))
    assert np.all(np.isnan(rigid.curves["E_BY"][1:]))


def test_degrees_of_freedom_count_positions_less_what_is_free():
    cell = machine()
    lines = simulate(PLAN, cell, seed=1)
    plain = solve(lines)
    # Seven positions of an angle: a zero is free, six values at nodes are unknowns of their own.
    angle = solve(replace(lines, direct=measured_directly(cell, ("E_BX",))))
    assert angle.degrees_of_freedom == plain.degrees_of_freedom + (7 - 1) - 6
    edge = solve(replace(lines, direct=measured_directly(cell, ("E_YX",))))
    assert edge.degrees_of_freedom == plain.degrees_of_freedom + (7 - 2)
    way = solve(replace(lines, direct=measured_directly(cell, ("E_XX",))))
    assert way.degrees_of_freedom == plain.degrees_of_freedom + (7 - 1)


def test_a_direct_measurement_that_contradicts_the_readings_raises_chi_squared():
    cell = make_cell(high=TRAVEL)
    # Rotations, if there may be any, would explain a bend that only the straightedge shows.
    lines = by_noise_alone(simulate(PLAN, cell, seed=1))
    direct = measured_directly(cell, ("E_YX",))
    bent = direct.curves["E_YX"]
    bent = replace(bent, values=bent.values + 2e-6 * np.array([0, 1, 2, 3, 2, 1, 0]) / 3)
    good = solve(replace(lines, direct=direct))
    bad = solve(replace(lines, direct=DirectMeasurement({"E_YX": bent}, {})))
    assert bad.chi_squared > good.chi_squared + 50
    uncertainty = [one.standard_uncertainty["E_YX"][3] for one in (good, bad)]
    assert uncertainty[1] > uncertainty[0]


@pytest.mark.parametrize("repeats", [1, 3])
def test_zeros_and_slopes_of_repeats_do_not_matter(repeats):
    cell = machine()
    lines = simulate(PLAN, cell, seed=1)
    names = (*ROTATIONS, "E_YX")
    still = measured_directly(cell, names, 5, repeats=repeats, zero=0.0, slope=0.0)
    askew = {
        name: replace(
            curve,
            values=curve.values
            + np.arange(1, repeats + 1)[:, None]
            * (1e-5 + 1e-4 * (curve.positions * (name[1:] == "_YX"))),
        )
        for name, curve in still.curves.items()
    }
    one = solve(replace(lines, direct=still))
    other = solve(replace(lines, direct=DirectMeasurement(askew, {})))
    for name, curve in one.curves.items():
        np.testing.assert_allclose(other.curves[name], curve, atol=2e-12)
        np.testing.assert_allclose(
            other.standard_uncertainty[name], one.standard_uncertainty[name], rtol=1e-6, atol=1e-15
        )


def displaced(cell, name, place):
    """Return by the exact model how a point of the tool moves across as one axis moves."""
    axis = moving_axis(name)
    positions = np.tile(np.asarray(place.standing), (VOLUME.blocks + 1, 1))
    positions[:, axis] = VOLUME.nodes(axis)
    offset = np.asarray(cell.mirror_offset) + np.asarray(place.reflector)
    moved, _ = tool_point(positions, cell.errors, cell.chain, offset)
    way = moved - positions
    return way[:, AXES.index(name[2])]


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("name", ["E_YX", "E_XY", "E_XZ", "E_ZX", "E_YY"])
def test_the_place_of_a_straightedge_counts_by_the_levers_of_the_rotations(chain, name):
    cell = make_cell(7, chain, high=TRAVEL, noise=0.0, tilt=0.0, rotation=20e-6)
    place = DirectPlace((0.05, 0.08, 0.11), (0.03, -0.02, 0.07))
    direct = measured_directly(cell, ROTATIONS, noise=0.0)
    values = displaced(cell, name, place)[None, :]
    way = VOLUME.nodes(moving_axis(name))
    edge = DirectCurve(name, way, values, np.full(len(way), 1e-8), place)
    lines = uncertain(simulate(PLAN, cell), 0.1e-6)

    def squares(curve):
        curves = {**direct.curves, name: curve}
        return solve(replace(lines, direct=DirectMeasurement(curves, {}))).chi_squared

    assert squares(edge) < 0.1
    assert squares(replace(edge, place=ANYWHERE)) > 10.0


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("name", SQUARENESS_SLOPES)
def test_the_place_of_a_square_counts_by_levers_and_by_what_stands_before_its_axes(chain, name):
    cell = make_cell(7, chain, high=TRAVEL, noise=0.0, tilt=0.0, rotation=20e-6)
    # At nodes: between them the cell's curves are not straight.
    place = DirectPlace((0.04, 0.08, 0.1), (0.03, -0.02, 0.07))
    factor, pair = SQUARENESS_SLOPES[name]
    slopes = [
        np.polyfit(VOLUME.nodes(moving_axis(one)), displaced(cell, one, place), 1)[0]
        for one in pair
    ]
    square = DirectSquareness(name, np.array([factor * sum(slopes)]), 1e-7, place)
    angles = measured_directly(cell, ROTATIONS, noise=0.0).curves
    lines = uncertain(simulate(PLAN, cell), 0.1e-6)

    def squares(one):
        return solve(replace(lines, direct=DirectMeasurement(angles, {name: one}))).chi_squared

    assert squares(square) < 0.1
    assert squares(replace(square, place=ANYWHERE)) > 2.0
    with refused(Refusal, "out_of_range", name):
        squares(replace(square, place=DirectPlace((9.0, 9.0, 9.0))))


def test_positions_between_nodes_are_told_by_both_and_those_outside_are_left_out():
    cell = make_cell(7, high=TRAVEL, noise=0.0, tilt=0.0, rotation=2e-6)
    truth = cell.truth(VOLUME)
    nodes = VOLUME.nodes(0)
    positions = np.array([-0.04, *np.arange(0.0, 0.1201, 0.005), 0.2])
    values = np.interp(positions, nodes, truth["E_BX"]) + 4e-6
    values[[0, -1]] = 1.0
    angle = DirectCurve("E_BX", positions, values[None, :], np.full(len(positions), 1e-7))
    lines = uncertain(simulate(PLAN, cell), 0.1e-6)
    lines = replace(lines, direct=DirectMeasurement({"E_BX": angle}, {}))
    result = solve(lines, "rigid_body")
    np.testing.assert_allclose(result.curves["E_BX"], truth["E_BX"], atol=1e-9)
    assert any("E_BX at 2" in remark for remark in result.remarks)


def test_angles_measured_too_far_apart_are_used_where_all_rotations_are_free_alone():
    cell = machine()
    full = measured_directly(cell, ("E_BX",)).curves["E_BX"]
    sparse = replace(
        full,
        positions=full.positions[::2],
        values=full.values[:, ::2],
        stated_uncertainty=full.stated_uncertainty[::2],
    )
    lines = replace(simulate(PLAN, cell, seed=1), direct=DirectMeasurement({"E_BX": sparse}, {}))
    result = solve(lines)
    assert tuple(result.curves) == TRANSLATIONS
    assert np.all(np.isfinite(result.curves["E_XX"]))
    assert any("E_BX" in remark and "rigid_body" in remark for remark in result.remarks)
    rigid = solve(lines, "rigid_body")
    assert np.all(np.isfinite(rigid.curves["E_BX"][::2]))


def test_a_measured_squareness_is_weighed_in():
    cell = make_cell(high=TRAVEL)
    plan = make_plan(6, step=(0.02,) * 3, diagonals=("ppp",))
    lines = simulate(plan, cell, seed=1)
    alone = solve(lines).figure("C0Y")
    true = true_squareness(cell.truth(VOLUME))["C0Y"]
    square = DirectSquareness("C0Y", np.array([true]), 0.5e-6)
    told = solve(replace(lines, direct=DirectMeasurement({}, {"C0Y": square}))).figure("C0Y")
    assert not np.isfinite(alone.value)
    assert told.value == pytest.approx(true, abs=1e-9)
    assert told.standard_uncertainty == pytest.approx(0.5e-6, rel=1e-6)


@pytest.mark.parametrize("runs", [20, 60], ids=["few", "many"])
def test_readings_without_uncertainty_get_the_one_that_a_fit_without_direct_values_leaves(runs):
    inside = []
    for run in range(runs):
        cell = machine(seed=run)
        lines = uncertain(simulate(PLAN, cell, seed=run), np.nan)
        lines = replace(lines, direct=measured_directly(cell, ROTATIONS, run))
        design = translations_design(observe(lines), lines.chain)
        assert design.noise_estimated == pytest.approx(0.1e-6, rel=0.15)
        error, spread = deviations(solve(lines), cell.truth(VOLUME), TRANSLATIONS)
        inside.append(np.mean(np.abs(error) <= 1.96 * spread))
    assert 0.93 <= np.mean(inside) <= 0.97

    saturated = make_plan(6, step=(0.02,) * 3, diagonals=("ppp",), linear=())
    few = uncertain(simulate(saturated, cell), np.nan)
    with pytest.raises(NotDeterminable):
        solve(replace(few, direct=lines.direct))


def test_readings_that_repeat_exactly_are_taken_as_no_better_than_an_interferometer():
    cell = make_cell(7, high=TRAVEL, noise=0.0, tilt=0.0)
    lines = replace(simulate(PLAN, cell), direct=measured_directly(cell, ROTATIONS))
    result = solve(uncertain(lines, np.nan))
    truth = cell.truth(VOLUME)
    error, spread = deviations(result, truth, TRANSLATIONS)
    assert np.all(spread > 1e-10)
    assert np.all(np.abs(error) < 5 * spread)


def test_without_an_uncertainty_nothing_can_be_weighed():
    cell = machine()
    direct = measured_directly(cell, ("E_BX",))
    curve = direct.curves["E_BX"]
    unknown = replace(curve, stated_uncertainty=np.full(len(curve.positions), np.nan))
    outside = replace(curve, positions=curve.positions + 1.0)
    for wrong, fault in ((unknown, "undetermined"), (outside, "too_few")):
        with refused(Refusal, fault, "E_BX"):
            solve(replace(simulate(PLAN, cell), direct=DirectMeasurement({"E_BX": wrong}, {})))
    square = DirectSquareness("C0Y", np.array([1e-6]), float("nan"))
    with refused(Refusal, "undetermined", "C0Y"):
        solve(replace(simulate(PLAN, cell), direct=DirectMeasurement({}, {"C0Y": square})))


def test_more_repeats_of_an_angle_make_it_more_certain():
    cell = machine()
    lines = simulate(PLAN, cell, seed=1)
    spread = []
    for repeats in (2, 8):
        direct = measured_directly(cell, ROTATIONS, 3, noise=10.0, repeats=repeats)
        spread.append(solve(replace(lines, direct=direct)).standard_uncertainty["E_BY"][3])
    assert spread[0] > 1.4 * spread[1]
    assert spread[1] > 1e-6


def test_the_budget_has_what_was_measured_directly_among_its_sources():
    cell = machine()
    lines = by_noise_alone(uncertain(simulate(PLAN, cell, seed=1), 0.1e-6))
    lines = replace(lines, direct=measured_directly(cell, ROTATIONS))
    result = solve(lines)
    budget = make_budget(lines, Instrument())
    found = budget.sensitivity
    noise = found.matrix * 0.1e-6
    known = found.by_direct @ found.by_direct.T + noise @ noise.T
    for row, quantity in enumerate(found.quantities):
        if quantity.curve:
            stated = result.standard_uncertainty[quantity.curve][quantity.node]
            assert np.sqrt(known[row, row]) == pytest.approx(stated, rel=2e-3)
    assert np.all(budget.groups()[DIRECT][: budget.row("E_AX at 1")] > 0.0)
    assert not [source for source in budget.sources if source.group == ANGULAR]


def test_replicates_draw_what_was_measured_directly_too():
    cell = machine()
    lines = by_noise_alone(uncertain(simulate(PLAN, cell, seed=1), 0.1e-6))
    lines = replace(lines, direct=measured_directly(cell, ROTATIONS))
    result = solve(lines)
    spread = np.std(replicate(lines, 4000, seed=1), axis=0)
    stated = np.concatenate(list(result.standard_uncertainty.values()))
    free = stated > 1e-15
    np.testing.assert_allclose(spread[free], stated[free], rtol=0.06)


def test_only_rotations_that_the_model_leaves_out_are_a_source_of_the_budget():
    cell = machine()
    instrument = replace(Instrument(), angular_errors=Spread(3e-6))
    lines = uncertain(simulate(PLAN, cell, seed=1), 0.1e-6)

    def angular(names):
        direct = measured_directly(cell, names) if names else None
        return make_budget(replace(lines, direct=direct), instrument).groups().get(ANGULAR)

    nothing, some, every = (angular(names) for names in ((), ROTATIONS[:6], ROTATIONS))
    assert every is None
    assert np.max(some) < np.max(nothing)
