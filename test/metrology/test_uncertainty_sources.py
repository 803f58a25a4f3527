"""What each source does to the readings, against the exact physics, and what repeats tell."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.air import (
    compensated_displacement,
    raw_displacement,
    refractive_index,
)
from stepdiag_ros.metrology.forward import Alignment, ErrorCurves, reading, tilted
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, TRANSLATIONS, beam_direction
from stepdiag_ros.metrology.plausible import FEWEST_MODES, modes
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers.monte_carlo import estimator
from stepdiag_ros.metrology.solvers.observations import observe
from stepdiag_ros.metrology.uncertainty.instrument import (
    ARCSINE,
    NORMAL,
    RECTANGULAR,
    TRIANGULAR,
    Instrument,
    Spread,
    perfect,
)
from stepdiag_ros.metrology.uncertainty.length_sources import readings_of
from stepdiag_ros.metrology.uncertainty.repeats import repeats_of
from stepdiag_ros.metrology.uncertainty.source import PRODUCT, SQUARED_ANGLE, Source
from stepdiag_ros.metrology.uncertainty.sources import sources_of

DEAD_PATH = 0.4


def readings(plan=None, cell=None, **corrections):
    measurement = simulate(plan or make_plan(), cell or make_cell(noise=0.0), seed=2)
    for line in measurement.lines:
        # Air that changes while a line is measured.
        line.environment[:, 0] = 20.0 + 0.3 * np.sin(line.time / 50.0)
        line.environment[:, 1] = 100_000.0 + line.time
        line.environment[:, 2] = 0.45
        line.environment[:, 3] = 23.0
    return readings_of(measurement, observe(measurement), **corrections)


def ready(found, method):
    return estimator(found.measurement, found.observations, method)


def source(found, name, method="least_squares", **known):
    """Return the source of a name, with its uncertainties taken as one."""
    spreads = {key: Spread(1.0) for key in known}
    instrument = replace(perfect(), dead_path=DEAD_PATH, **spreads)
    return next(s for s in sources_of(found, instrument, ready(found, method)) if s.name == name)


def zero_of(found):
    _, first = np.unique(found.observations.setup, return_index=True)
    return first[found.observations.setup]


@pytest.mark.parametrize(
    ("name", "column", "change"),
    [("air temperature", 0, 0.05), ("air pressure", 1, 20.0), ("relative humidity", 2, 0.02)],
)
def test_a_wrong_sensor_does_to_the_readings_what_its_source_says(name, column, change):
    found = readings()
    displacement = found.observations.displacement
    zero = zero_of(found)
    index = refractive_index(*found.air.T)
    count = raw_displacement(displacement, DEAD_PATH, index, index[zero])
    believed = found.air.copy()
    believed[:, column] += change
    wrong = refractive_index(*believed.T)
    exact = compensated_displacement(count, DEAD_PATH, wrong, wrong[zero]) - displacement
    assert np.max(np.abs(exact)) > 1e-10
    assert source(found, name).slopes[0] * change == pytest.approx(exact, rel=5e-3, abs=2e-12)


def test_a_wrong_dead_path_acts_through_the_change_of_the_air():
    found = readings()
    displacement = found.observations.displacement
    zero = zero_of(found)
    index = refractive_index(*found.air.T)
    count = raw_displacement(displacement, DEAD_PATH, index, index[zero])
    exact = compensated_displacement(count, DEAD_PATH + 0.05, index, index[zero]) - displacement
    slope = source(found, "length of the dead path").slopes[0]
    assert slope * 0.05 == pytest.approx(exact, rel=1e-3, abs=1e-15)
    assert np.max(np.abs(exact)) > 1e-9


def test_expansion_acts_as_the_correction_does():
    found = readings(coefficient=11.5e-6)
    # The displacements of ``found`` stand for those at 20 degC already.
    measured = found.observations.displacement * (1.0 + 11.5e-6 * 3.0)
    by_coefficient = measured / (1.0 + 12.5e-6 * 3.0) - found.observations.displacement
    by_temperature = measured / (1.0 + 11.5e-6 * 3.2) - found.observations.displacement
    slope = source(found, "expansion coefficient").slopes[0]
    assert slope * 1e-6 == pytest.approx(by_coefficient, rel=1e-4, abs=1e-18)
    slope = source(found, "material temperature").slopes[0]
    assert slope * 0.2 == pytest.approx(by_temperature, rel=1e-4, abs=1e-18)
    assert "material temperature" not in {
        s.name
        for s in sources_of(
            readings(),
            Instrument(),
            ready(found, "conventional"),
        )
    }


@pytest.mark.parametrize("line", ["ppp", "npp", "x"])
def test_beam_and_mirror_act_as_the_exact_reading_does(line):
    found = readings()
    seen = found.observations
    here = np.array([seen.setups[number].line == line for number in seen.setup])
    direction = beam_direction(line, np.full(3, 0.01))
    turned, against = (0.8e-3, -0.5e-3), (0.3e-3, 0.4e-3)
    mirror = tilted(direction, turned)
    beam = tilted(direction, tuple(t - r for t, r in zip(turned, against, strict=True)))
    nodes = [np.array([-1.0, 1.0])] * 3
    still = ErrorCurves.from_curves(
        nodes, {name: np.zeros(2) for name in (*TRANSLATIONS, *ROTATIONS)}
    )
    way = seen.way[here]
    origin = -DEAD_PATH * beam
    exact = reading(way, Alignment(beam, mirror, origin), still, "XYZ")
    exact = exact - exact[0] - way @ direction
    first, second = (
        source(found, name, "conventional", alignment=1).slopes
        for name in ("beam and mirror off the line", "cosine of beam and mirror on the line")
    )
    cosine = source(found, "cosine of beam against mirror", "conventional").slopes[0]
    # seen.displacement has the errors of the machine in it, way·n has not: 1e-4 of a cosine.
    linear = turned[0] * first[0] + turned[1] * first[1]
    squares = 0.5 * (np.sum(np.square(turned)) * second[0] + np.sum(np.square(against)) * cosine)
    assert np.max(np.abs(exact)) > 1e-9
    assert (linear + squares)[here] == pytest.approx(exact, rel=2e-3, abs=2e-11)


def test_least_squares_leaves_the_cosine_of_linear_lines_only():
    found = readings()
    seen = found.observations
    diagonal = np.array([setup.diagonal for setup in seen.setups])[seen.setup]
    slope = source(found, "cosine of beam and mirror on the line").slopes[0]
    assert np.all(slope[diagonal] == 0.0)
    assert np.array_equal(slope[~diagonal], -seen.displacement[~diagonal])
    names = {s.name for s in sources_of(found, perfect(), ready(found, "least_squares"))}
    assert "beam and mirror off the line" not in names


@pytest.mark.parametrize("chain", ["YXZ", "XYZ", "ZYX"])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("mode", [0, 3])
def test_angular_errors_act_as_in_the_exact_model(chain, axis, mode):
    found = readings(cell=make_cell(noise=0.0, chain=chain))
    seen = found.observations
    size = np.array([20e-6, -15e-6, 10e-6])
    nodes = [np.linspace(0.0, 0.06, 7)] * 3
    shape = modes(nodes[0] / 0.06, FEWEST_MODES)[:, mode]
    curves = {name: np.zeros(7) for name in (*TRANSLATIONS, *ROTATIONS)}
    for turn, letter in enumerate("ABC"):
        curves[f"E_{letter}{AXES[axis]}"] = size[turn] * shape
    errors = ErrorCurves.from_curves(nodes, curves)
    expected = np.zeros(len(seen.setup))
    for number, setup in enumerate(seen.setups):
        here = np.flatnonzero(seen.setup == number)
        origin = setup.start - DEAD_PATH * setup.direction
        aligned = Alignment(setup.direction, setup.direction, origin)
        exact = reading(seen.position[here], aligned, errors, chain)
        expected[here] = exact - seen.way[here] @ setup.direction - DEAD_PATH
    slopes = source(found, f"angular errors of {AXES[axis]}").slopes
    assert np.max(np.abs(expected)) > 1e-8
    assert size @ slopes[mode::FEWEST_MODES] == pytest.approx(expected, abs=5e-11)


def test_unknown_axes_leave_angular_errors_unknown():
    found = readings()
    found = replace(found, measurement=replace(found.measurement, chain=""))
    made = source(found, "angular errors of X")
    assert not made.known
    assert "order of the machine's axes is not known" in made.note


@pytest.mark.parametrize(
    "distribution", [NORMAL, RECTANGULAR, TRIANGULAR, ARCSINE, PRODUCT, SQUARED_ANGLE]
)
def test_draws_have_the_stated_size(distribution):
    made = Source(
        "x", "air", 2.0, "K", "B", distribution, np.inf, "", np.array([[3.0]]), np.array([0])
    )
    drawn, _ = made.draw(200_000, np.random.default_rng(1))
    assert np.sqrt(np.mean(drawn**2)) == pytest.approx(6.0, rel=0.02)
    if distribution == SQUARED_ANGLE:
        assert np.min(drawn) >= 0.0
        assert np.mean(drawn) == pytest.approx(6.0 / np.sqrt(2.0), rel=0.02)
    else:
        assert np.mean(drawn) == pytest.approx(0.0, abs=0.06)
    limits = {RECTANGULAR: 3**0.5, TRIANGULAR: 6**0.5, ARCSINE: 2**0.5}
    if distribution in limits:
        assert np.max(np.abs(drawn)) == pytest.approx(6.0 * limits[distribution], rel=0.02)


def test_few_degrees_of_freedom_draw_a_student_distribution():
    made = Source("x", "air", 1.0, "K", "A", NORMAL, 5.0, "", np.ones((1, 2)), np.array([0, 1]))
    drawn, _ = made.draw(200_000, np.random.default_rng(1))
    assert np.var(drawn[:, 0]) == pytest.approx(5.0 / 3.0, rel=0.05)
    # One scale for all values: they are uncorrelated, but not independent.
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.0, abs=0.02)
    assert np.corrcoef(np.abs(drawn.T))[0, 1] > 0.1


def test_draws_are_shared_as_the_correlation_says():
    rng = np.random.default_rng(3)
    member = np.array([0, 0, 1, 1])
    made = Source("x", "air", 1.0, "K", "B", NORMAL, np.inf, "", np.ones((1, 4)), member)
    drawn, _ = made.draw(50_000, rng)
    assert np.array_equal(drawn[:, 0], drawn[:, 1])
    assert np.corrcoef(drawn[:, 0], drawn[:, 2])[0, 1] == pytest.approx(0.0, abs=0.02)
    factors = made.factors(np.eye(4))
    assert factors @ factors.T == pytest.approx(np.cov(drawn.T), abs=0.03)


def test_repeats_tell_scatter_and_drift_apart():
    plan = make_plan(repeats=12, directions=("forward", "backward"))
    measurement = simulate(plan, make_cell(noise=0.2e-6), seed=5)
    quiet = repeats_of(measurement, observe(measurement))
    assert quiet.reading == pytest.approx(0.2e-6, rel=0.05)
    assert quiet.pass_freedom == 14 * 11
    assert quiet.offset < 0.04e-6
    rng = np.random.default_rng(8)
    for line in measurement.lines:
        line.displacement[:] *= 1.0 + 5e-6 * rng.standard_normal()
        line.displacement[:] += 0.5e-6 * rng.standard_normal()
    drifting = repeats_of(measurement, observe(measurement))
    assert drifting.reading == pytest.approx(0.2e-6, rel=0.05)
    assert drifting.slope == pytest.approx(5e-6, rel=0.2)
    # A scale about the zero moves the middle of a line of 60 or 104 mm too: 0.15 or 0.26 µm.
    assert drifting.offset == pytest.approx(np.hypot(0.5e-6, 0.23e-6), rel=0.2)


def test_two_repeats_are_one_degree_of_freedom_each():
    # The mean of two passes takes half of their scatter with it.
    plan = make_plan(blocks=12, step=(0.005, 0.005, 0.005), repeats=2)
    measurement = simulate(plan, make_cell(noise=0.2e-6), seed=6)
    found = repeats_of(measurement, observe(measurement))
    assert found.reading == pytest.approx(0.2e-6, rel=0.15)
    assert found.reading_freedom == 3 * 11 + 4 * 35
    assert found.pass_freedom == 7


def test_hysteresis_is_no_drift():
    plan = make_plan(repeats=6, directions=("forward", "backward"))
    measurement = simulate(plan, make_cell(noise=0.1e-6), seed=5)
    for line in measurement.lines:
        if line.line.direction == "backward":
            line.displacement[:] += 3e-6
    found = repeats_of(measurement, observe(measurement))
    assert found.reading == pytest.approx(0.1e-6, rel=0.1)
    assert found.offset < 0.05e-6


def test_without_repeats_drift_is_unknown_and_the_scatter_that_of_each_stop():
    found = readings(cell=make_cell(noise=0.1e-6))
    by_name = {s.name: s for s in sources_of(found, perfect(), ready(found, "least_squares"))}
    assert not by_name["drift of the zero"].known
    assert not by_name["drift along the line"].known
    scatter = by_name["repeatability of a reading"]
    assert scatter.standard_uncertainty == pytest.approx(0.1e-6)
    assert "no pass was repeated" in scatter.note


def shifted_at_places(found, size):
    """Return readings that are off at each place of each setup, in all repeats alike."""
    rng, known = np.random.default_rng(5), {}
    lines = []
    for line in found.measurement.lines:
        places = [(line.setup, *np.round(target, 9)) for target in line.target]
        off = [known.setdefault(place, size * rng.standard_normal()) for place in places]
        lines.append(replace(line, displacement=line.displacement + np.array(off)))
    measurement = replace(found.measurement, lines=tuple(lines))
    return readings_of(measurement, observe(measurement))


def test_a_misfit_of_the_model_is_a_source_and_chance_and_rotations_are_not():
    plan = make_plan(repeats=3)
    good = readings(plan, make_cell(noise=0.1e-6))
    turning = readings(plan, make_cell(noise=0.1e-6, rotation=30e-6))
    bad = shifted_at_places(turning, 1e-6)
    names = [
        {s.name: s for s in sources_of(r, perfect(), ready(r, "least_squares"))}
        for r in (good, turning, bad)
    ]
    assert not any("misfit of the model" in one for one in names[:2])
    left = names[2]["misfit of the model"]
    assert 0.5e-6 < left.standard_uncertainty < 2e-6
    # The method that estimates the rotations has neither a misfit nor angular errors left out.
    whole_model = ready(turning, "rigid_body")
    whole = {s.name for s in sources_of(turning, perfect(), whole_model)}
    assert "misfit of the model" not in whole
    assert not any(name.startswith("angular") for name in whole)
