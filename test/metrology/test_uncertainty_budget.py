"""Budgets: single sources with known effects, the linear budget against Monte Carlo, coverage."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.forward import ErrorCurves, tool_point
from stepdiag_ros.metrology.geometry import ROTATIONS, TRANSLATIONS
from stepdiag_ros.metrology.plausible import FEWEST_MODES, modes
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.observations import observe
from stepdiag_ros.metrology.solvers.result import NotDeterminable
from stepdiag_ros.metrology.solvers.rotations import SHOWN, turned
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.uncertainty.budget import (
    coverage_factor,
    effective_degrees_of_freedom,
    make_budget,
)
from stepdiag_ros.metrology.uncertainty.instrument import Instrument, Spread, perfect
from stepdiag_ros.metrology.uncertainty.largest_error import budget_of_largest_error
from stepdiag_ros.metrology.uncertainty.monte_carlo import check_budget
from stepdiag_ros.metrology.uncertainty.sensitivity import sensitivity
from stepdiag_ros.metrology.uncertainty.source import ANGULAR, MODEL

METHODS = ("conventional", "setup_robust", "alternative", "least_squares")


@pytest.fixture(scope="module")
def measurement():
    plan = make_plan(repeats=2, directions=("forward", "backward"))
    return by_noise_alone(simulate(plan, make_cell(), seed=4))


@pytest.fixture(scope="module")
def exact():
    """A machine without errors, aligned and read without noise."""
    cell = make_cell(noise=0.0, tilt=0.0, size=0.0, squareness=(0.0, 0.0, 0.0))
    return by_noise_alone(simulate(make_plan(repeats=2), cell, seed=4))


def only(**known):
    return replace(perfect(), dead_path=0.3, **known)


def contribution(budget, source, quantity):
    names = [s.name for s in budget.sources]
    return budget.contributions[names.index(source), budget.row(quantity)]


@pytest.fixture(scope="module", params=[0.0, 2.0, 20.0])
def turning(request):
    """A machine whose axes turn, in multiples of the plausible size, beyond doubt or not at all."""
    plan = make_plan(repeats=2, directions=("forward", "backward"))
    cell = make_cell(rotation=request.param * 10e-6)
    return simulate(plan, cell, seed=4)


@pytest.mark.parametrize("method", METHODS)
def test_a_budget_is_of_the_values_that_the_method_gives(turning, method):
    budget = make_budget(turning, perfect(), method)
    result = solve(turning, method)
    for row, quantity in enumerate(budget.sensitivity.quantities):
        value = budget.sensitivity.values[row]
        if quantity.curve:
            expected = result.curves[quantity.curve][quantity.node]
        else:
            expected = result.figure(quantity.name).value
        assert value == pytest.approx(expected, rel=1e-9, abs=1e-15), quantity.name


def test_rotations_that_the_readings_show_are_no_lack_of_fit_and_as_large_as_shown(turning):
    both = turned(turning, observe(turning))
    nothing = replace(perfect(), angular_errors=Spread())
    budget, result = make_budget(turning, nothing), solve(turning)
    assert not any(source.group == MODEL for source in budget.sources)
    sizes = {one.standard_uncertainty for one in budget.sources if one.group == ANGULAR}
    shown = both.rotations.chance < SHOWN
    assert sizes == {both.rotations.size if shown else turning.plausible.rotation}
    # What the readings themselves leave open of the rotations is in both.
    for name in ("C0Y", "diagonal ppp", "positioning E_XX"):
        own = result.figure(name).standard_uncertainty
        assert budget.standard_uncertainty[budget.row(name)] > 0.5 * own, name
        if shown:
            assert budget.standard_uncertainty[budget.row(name)] < 2.0 * own, name


@pytest.mark.parametrize("method", METHODS)
def test_sensitivity_is_the_derivative_of_the_solver(measurement, method):
    found = sensitivity(measurement, method)
    before = solve(measurement, method)
    rng = np.random.default_rng(1)
    moved, place = np.zeros(len(found.observations.displacement)), 0
    lines = []
    for line in measurement.lines:
        change = 20e-9 * rng.standard_normal(len(line.displacement))
        moved[place : place + len(change)] = change
        place += len(change)
        lines.append(replace(line, displacement=line.displacement + change))
    after = solve(replace(measurement, lines=tuple(lines)), method)
    # Least squares differs by tilts times noise between the nominal matrix and its own minimum.
    near = {"rel": 1e-3, "abs": 1e-11 if method == "least_squares" else 1e-14}
    expected = found.matrix @ moved
    for row, quantity in enumerate(found.quantities):
        if quantity.curve:
            change = after.curves[quantity.curve] - before.curves[quantity.curve]
            assert expected[row] == pytest.approx(change[quantity.node], **near)
            value = before.curves[quantity.curve][quantity.node]
        else:
            value = before.figure(quantity.name).value
            if not quantity.name.startswith("straightness"):
                change = after.figure(quantity.name).value - value
                scale = 30.0 if quantity.unit == "rad" else 1.0
                assert expected[row] / scale == pytest.approx(change / scale, **near)
        assert found.values[row] == pytest.approx(value, rel=1e-12, abs=1e-18)
    covered = {quantity.name for quantity in found.quantities}
    assert {"C0Y", "positioning E_ZZ", "straightness E_XY", "diagonal npp"} <= covered


@pytest.mark.parametrize("method", METHODS)
def test_the_readings_alone_give_the_uncertainty_of_the_solver(measurement, method):
    # Where the noise is that which the solver was told, the budget of it alone is the solver's own.
    budget = make_budget(measurement, perfect(), method)
    names = [source.name for source in budget.sources]
    row = names.index("repeatability of a reading")
    scale = 0.1e-6 / budget.sources[row].standard_uncertainty
    result = solve(measurement, method)
    share = 1.0
    if method == "least_squares" and any("multiplied" in text for text in result.remarks):
        share = np.sqrt(result.chi_squared / result.degrees_of_freedom)
    for place, quantity in enumerate(budget.sensitivity.quantities):
        own = (
            result.standard_uncertainty[quantity.curve][quantity.node]
            if quantity.curve
            else result.figure(quantity.name).standard_uncertainty
        )
        found = budget.contributions[row, place] * scale * share
        if quantity.name.startswith("straightness"):
            # The solver's own contains the excess of a range too (solvers.ranges).
            assert 0.8 * own < found < own * 1.001
        else:
            assert found == pytest.approx(own, rel=1e-3)


@pytest.mark.parametrize("method", METHODS)
def test_a_millionth_of_the_wavelength_is_a_micrometre_a_metre_and_no_squareness(exact, method):
    budget = make_budget(exact, only(wavelength=Spread(1e-6)), method)
    for axis in "XYZ":
        found = contribution(budget, "laser wavelength", f"positioning E_{axis}{axis}")
        assert found == pytest.approx(1e-6 * 0.06, rel=1e-5)
    assert contribution(budget, "laser wavelength", "diagonal ppp") == pytest.approx(
        1e-6 * 0.06 * np.sqrt(3.0), rel=1e-5
    )
    for name in ("C0Y", "B0Z", "A0Z", "straightness E_YX", "E_ZY at 3"):
        assert contribution(budget, "laser wavelength", name) < 1e-14
    assert contribution(budget, "laser wavelength", "E_YY at 3") == pytest.approx(3e-8, rel=1e-5)


def test_material_and_air_have_their_textbook_size(exact):
    for line in exact.lines:
        line.environment[:] = (20.0, 101325.0, 0.5, 22.0)
    instrument = only(
        air_temperature=Spread(1.0),
        air_pressure=Spread(100.0),
        expansion=Spread(1e-6),
        material_temperature=Spread(0.1),
    )
    budget = make_budget(exact, instrument, expansion=11.5e-6)
    # 0.93e-6 a kelvin, 0.27e-6 a hPa; 2 K · 1e-6/K; 0.1 K · 11.5e-6/K.
    for source, relative in (
        ("air temperature", 0.93e-6),
        ("air pressure", 0.268e-6),
        ("expansion coefficient", 2e-6),
        ("material temperature", 1.15e-6),
        ("coefficient × temperature", 1e-7),
    ):
        found = contribution(budget, source, "positioning E_YY")
        assert found == pytest.approx(0.06 * relative, rel=0.03), source


def test_the_conventional_method_has_the_whole_setup_error(exact):
    tilt = 150e-6
    instrument = only(alignment=Spread(tilt))
    blind = make_budget(exact, instrument, "conventional")
    # IH section 3.1: E_XX is (ppp + npp of X)·‖a‖/(2a); a tilt d of a line adds d_x·L to it.
    # Two lines with |d_x| = tilt·sqrt(2/3) each: L·√3/2·√2·√(2/3)·tilt = L·tilt.
    found = contribution(blind, "beam and mirror off the line", "positioning E_XX")
    assert found == pytest.approx(0.06 * tilt, rel=1e-3)
    for method in ("setup_robust", "alternative"):
        robust = make_budget(exact, instrument, method)
        for name in ("positioning E_XX", "C0Y", "straightness E_YX"):
            assert contribution(robust, "beam and mirror off the line", name) < 1e-12
        assert contribution(
            robust, "cosine of beam and mirror on the line", "positioning E_XX"
        ) == pytest.approx(0.06 * np.sqrt(2.0) * tilt**2, rel=1e-3)


def test_unknown_sources_are_named_and_make_lower_bounds(measurement):
    budget = make_budget(measurement, Instrument(angular_errors=Spread(0.0)))
    assert np.all(budget.at_least)
    assert "laser wavelength" in budget.remarks[0]
    row = budget.row("positioning E_XX")
    names = [source.name for source in budget.sources]
    assert np.isnan(budget.contributions[names.index("laser wavelength"), row])
    assert budget.standard_uncertainty[row] > 0.0
    whole = make_budget(measurement, only())
    assert not np.any(whole.at_least)
    assert whole.standard_uncertainty[row] == pytest.approx(budget.standard_uncertainty[row])


def test_angular_errors_of_unknown_size_are_as_large_as_is_plausible(measurement):
    told = make_budget(measurement, only(angular_errors=Spread(4e-6)), "setup_robust")
    unknown = make_budget(measurement, only(angular_errors=Spread()), "setup_robust")
    assert not np.any(unknown.at_least)
    for row, (source, other) in enumerate(zip(told.sources, unknown.sources, strict=True)):
        if source.name.startswith("angular errors"):
            assert source.standard_uncertainty == 4e-6
            assert other.standard_uncertainty == measurement.plausible.rotation
            share = measurement.plausible.rotation / 4e-6
            assert unknown.contributions[row] == pytest.approx(share * told.contributions[row])
            assert np.max(told.contributions[row]) > 1e-9
            assert "plausible" in other.note and not source.note


@pytest.mark.parametrize("method", ["setup_robust", "least_squares"])
def test_a_diagonal_contains_the_rotations_and_does_not_err_by_them(measurement, method):
    budget = make_budget(measurement, only(angular_errors=Spread(20e-6)), method)
    angular = budget.groups()["angular errors"]
    # 20 µrad over 60 mm: micrometres of squareness, nothing of a length that was read itself.
    assert angular[budget.row("C0Y")] > 5e-6
    assert angular[budget.row("diagonal npp")] < 0.2 * 20e-6 * 0.06
    check = check_budget(budget, most_trials=50_000)
    row = budget.row("diagonal npp")
    found = check.outcome.standard_uncertainty[row]
    assert found == pytest.approx(budget.standard_uncertainty[row], rel=0.1)


def test_an_unknown_source_that_does_not_act_leaves_a_result_whole(exact):
    # A wavelength that nobody knows does not touch what is zero in every reading's scale.
    budget = make_budget(exact, replace(only(), wavelength=Spread()))
    assert budget.at_least[budget.row("positioning E_XX")]
    assert not budget.at_least[budget.row("C0Y")]
    assert contribution(budget, "laser wavelength", "C0Y") == 0.0


def test_contributions_make_the_covariance(measurement):
    known = only(
        wavelength=Spread(1e-6),
        air_gradient=Spread(0.2),
        return_angle=Spread(3e-4),
        resolution=Spread(1e-8),
    )
    budget = make_budget(measurement, known)
    squares = np.sum(budget.contributions**2, axis=0)
    exactly = {"rel": 1e-9, "abs": 0.0}
    assert np.diag(budget.covariance) == pytest.approx(squares, rel=1e-6, abs=0.0)
    grouped = np.sum([v**2 for v in budget.groups().values()], axis=0)
    assert grouped == pytest.approx(squares, **exactly)
    assert np.min(np.linalg.eigvalsh(budget.covariance)) > -1e-20
    # A common scale correlates the positioning of two axes, on top of what the readings do.
    exact = make_budget(measurement, replace(known, wavelength=Spread(0.0)))
    one, other = budget.row("positioning E_XX"), budget.row("positioning E_YY")
    more = budget.covariance[one, other] - exact.covariance[one, other]
    assert more == pytest.approx((0.06e-6) ** 2, rel=1e-3, abs=0.0)
    assert np.all(budget.coverage_factor >= 1.9599)


def test_welch_and_satterthwaite():
    # GUM H.1.6: end gauge: contributions in nm and their degrees of freedom: ν_eff = 16, k = 2.92.
    u = np.array([[25.0], [9.7], [2.9], [16.6]])
    freedom = np.array([18.0, 25.6, 50.0, 2.0])
    effective = effective_degrees_of_freedom(u, freedom)
    assert np.floor(effective[0]) == 16
    assert coverage_factor(effective, 0.99)[0] == pytest.approx(2.92, abs=0.005)
    known = effective_degrees_of_freedom(np.ones((2, 1)), np.array([np.inf, np.inf]))
    assert np.isinf(known[0])
    assert coverage_factor(known, 0.95)[0] == pytest.approx(1.959964, abs=1e-6)


@pytest.mark.parametrize("method", ["conventional", "least_squares"])
def test_linear_budget_and_monte_carlo_agree(measurement, method):
    instrument = only(
        wavelength=Spread(0.5e-6, "rectangular"),
        alignment=Spread(50e-6),
        return_angle=Spread(100e-6),
        air_gradient=Spread(0.2),
    )
    budget = make_budget(measurement, instrument, method)
    check = check_budget(budget, most_trials=50_000, seed=1)
    # An input with few degrees of freedom is drawn from a t-distribution, which is wider than its u
    # (JCGM 101, 6.4.9). A straightness whose nodes change from trial to trial scatters otherwise.
    freedom = np.array([source.degrees_of_freedom for source in budget.sources])
    wider = np.where(np.isfinite(freedom), freedom / (np.minimum(freedom, 1e12) - 2.0), 1.0)
    expected = np.sqrt(np.sum(budget.contributions**2 * wider[:, None], axis=0))
    for row, quantity in enumerate(budget.sensitivity.quantities):
        if not quantity.name.startswith("straightness"):
            assert check.outcome.standard_uncertainty[row] == pytest.approx(expected[row], rel=0.02)
    for name in ("C0Y", "positioning E_XX", "E_YZ at 3"):
        assert check.validation.passed[budget.row(name)]
    assert np.mean(check.validation.passed) > 0.85


def test_monte_carlo_finds_what_the_linear_budget_misses():
    # The straightness of a perfect machine: its linear uncertainty is that between two nodes taken
    # from rounding; the largest of many deviations is never negative and larger.
    noisy = simulate(
        make_plan(repeats=2),
        make_cell(tilt=0.0, size=0.0, squareness=(0.0, 0.0, 0.0)),
        seed=4,
    )
    budget = make_budget(noisy, only())
    check = check_budget(budget, most_trials=50_000)
    assert not check.validation.passed[budget.row("straightness E_YX")]
    assert check.validation.passed[budget.row("C0Y")]


def test_the_expanded_uncertainty_holds_the_truth_as_often_as_promised():
    # 40 machines measured with another wavelength, other air gradients and other setups each.
    plan = make_plan(blocks=4, repeats=2)
    known = only(wavelength=Spread(3e-6), return_angle=Spread(20e-6), alignment=Spread(150e-6))
    rng = np.random.default_rng(9)
    inside, total = 0, 0
    for number in range(40):
        cell = make_cell(seed=number, mirror=20e-6)
        truth = cell.truth(plan.volume)
        made = simulate(plan, cell, seed=number)
        scale = 1.0 + 3e-6 * rng.standard_normal()
        made = replace(
            made,
            lines=tuple(replace(x, displacement=x.displacement * scale) for x in made.lines),
        )
        budget = make_budget(made, known)
        for row, quantity in enumerate(budget.sensitivity.quantities):
            if quantity.curve in ("E_XX", "E_XY", "E_ZZ"):
                error = budget.sensitivity.values[row] - truth[quantity.curve][quantity.node]
                inside += abs(error) <= budget.expanded[row]
                total += 1
    # Nodes of a curve move together: the spread of this share is that of some 150 values.
    assert 0.90 < inside / total < 0.99


def test_rigid_body_has_a_budget_of_its_rotations_too():
    plan = make_plan(orders=("XYZ", "YZX", "ZXY"), repeats=2, blocks=4)
    measurement = simulate(plan, make_cell(rotation=10e-6, high=(0.04, 0.04, 0.04)), seed=3)
    budget = make_budget(measurement, only(wavelength=Spread(1e-6)), "rigid_body")
    units = {quantity.unit for quantity in budget.sensitivity.quantities if quantity.curve}
    assert units == {"m", "rad"}
    angles = [q.name for q in budget.sensitivity.quantities if q.name.startswith("angular")]
    assert angles
    result = solve(measurement, "rigid_body")
    found = budget.sensitivity.values[budget.row(angles[0])]
    assert found == pytest.approx(result.figure(angles[0]).value, rel=1e-6)


def test_what_cannot_be_is_refused(measurement):
    with refused(Refusal, "unknown", "wang", aspect="replicated method"):
        make_budget(measurement, perfect(), "wang")
    with refused(Refusal, "out_of_range", "95"):
        make_budget(measurement, perfect(), coverage=95.0)
    with refused(NotDeterminable, "missing", aspect="chain"):
        make_budget(replace(measurement, chain=""), perfect(), "rigid_body")
    linear_only = replace(measurement, lines=measurement.lines[:12])
    with refused(NotDeterminable, "missing", aspect="lines"):
        make_budget(linear_only, perfect(), "setup_robust")


def _turning_cells(chain, size, draws, noise=0.0):
    """Return cells in which nothing acts but rotations of a size, and noise."""
    rng = np.random.default_rng(8)
    cell = make_cell(
        *(3, chain), noise=noise, tilt=0.0, size=0.0, squareness=(0.0, 0.0, 0.0), held=0.0
    )
    nodes, shapes = [np.linspace(0.0, 0.06, 7)] * 3, modes(np.linspace(0.0, 1.0, 7), FEWEST_MODES)
    for _ in range(draws):
        drawn = shapes @ rng.standard_normal((FEWEST_MODES, len(ROTATIONS))) * size
        errors = ErrorCurves.from_curves(nodes, dict(zip(ROTATIONS, drawn.T, strict=True)))
        yield replace(cell, errors=errors)


def _rms_error_at_the_worst_place(plan, chain, size, found, draws):
    """Return how far the length there is off, rms, where nothing acts but rotations of a size."""
    along = np.array(found.vector) / found.value
    nodes = [np.linspace(0.0, 0.06, 7)] * 3
    place, squares = np.array([found.position]), []
    for cell in _turning_cells(chain, size, draws):
        errors = cell.errors
        solved = solve(by_noise_alone(simulate(plan, cell, seed=1)), METHOD)
        curves = {name: solved.curves[name] for name in TRANSLATIONS}
        without = tool_point(place, ErrorCurves.from_curves(nodes, curves), chain)[0]
        squares.append(((without - tool_point(place, errors, chain)[0])[0] @ along) ** 2)
    return float(np.sqrt(np.mean(squares)))


METHOD = "least_squares"


@pytest.mark.parametrize("chain", ["YXZ", "XZY"])
def test_rotations_act_on_the_largest_error_by_curves_and_by_levers(chain):
    plan = make_plan()
    lines = by_noise_alone(simulate(plan, make_cell(chain=chain), seed=2))
    result = solve(lines, METHOD)
    found = of_result(result, chain)
    instrument = only(angular_errors=Spread(5e-6))
    made = budget_of_largest_error(result, found, make_budget(lines, instrument, METHOD), chain)
    alone = [
        size
        for source, size in zip(
            make_budget(lines, instrument, METHOD).sources, made.contributions, strict=True
        )
        if "angular" in source.name
    ]
    seen = _rms_error_at_the_worst_place(plan, chain, 5e-6, found, 300)
    # 300 draws leave 4 % (one standard deviation).
    assert float(np.linalg.norm(alone)) == pytest.approx(seen, rel=0.13)


def test_a_run_without_rotations_has_the_budget_of_what_plausible_ones_would_do():
    # Readings that show no rotation leave little to the solver's prediction of them. Readings of
    # axes that turn as is plausible would not: what they do to the result must not depend on that.
    size, noise = 10e-6, 0.02e-6
    plan = make_plan(repeats=2, directions=("forward", "backward"))
    calm = simulate(plan, make_cell(noise=noise), seed=2)
    assert (
        calm.plausible.rotation == size and not turned(calm, observe(calm)).rotations.chance < 0.1
    )
    budget = make_budget(calm, only(angular_errors=Spread(size)), METHOD)
    errors = []
    for seed, cell in enumerate(_turning_cells(calm.chain, size, 100, noise)):
        solved, truth = solve(simulate(plan, cell, seed=seed), METHOD), cell.truth(plan.volume)
        errors.append({name: solved.curves[name] - truth[name] for name in TRANSLATIONS})
    for row, quantity in enumerate(budget.sensitivity.quantities):
        if quantity.curve:
            seen = np.sqrt(np.mean([one[quantity.curve][quantity.node] ** 2 for one in errors]))
            # 100 draws leave 7 % (one standard deviation) of each of some 50 values.
            assert 0.75 < budget.standard_uncertainty[row] / seen < 1.35, quantity.name


def test_the_budget_of_the_largest_error_is_that_of_its_sources(measurement):
    result = solve(measurement, METHOD)
    found = of_result(result, measurement.chain)
    whole = make_budget(measurement, perfect(), METHOD)
    made = budget_of_largest_error(result, found, whole, measurement.chain)
    assert not made.at_least and made.value == found.value
    assert made.expanded.value == made.coverage_factor * made.standard_uncertainty > 0.0
    unknown = make_budget(measurement, Instrument(), METHOD)
    open_ended = budget_of_largest_error(result, found, unknown, measurement.chain)
    assert open_ended.at_least
    stated = np.isnan(open_ended.contributions)
    assert {source.name for source, one in zip(unknown.sources, stated, strict=True) if one} == set(
        unknown.unknown_sources
    )
