"""Whether errors explain the readings, and stand out from noise: over many simulated machines."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell
from tracker_runs import tracker_run

from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.metrology.credibility import Misfit, is_noise, misfit
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plausible import NOTHING
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers.least_squares import solve_least_squares
from stepdiag_ros.metrology.solvers.noise_factor import exceeds_chance

SEEDS = range(20)
NOISE = 0.05e-6
PLAN = """\
name: test
step_m: [0.02, 0.03, 0.01]
blocks: 4
repeats: {repeats}
directions: [forward, backward]
overrun_m: 0.002
feed_m_per_s: 0.05
lines:
  - {{kind: linear, names: [x, y, z]}}
  - {{kind: step_diagonal, names: [ppp, npp, pnp, ppn]}}
"""


def run_of(seed, size=2e-6, rotation=0.0, repeats=2, stated=1.0):
    """Return lines of a machine and their result; the stops say ``stated`` times their noise.

    The machine is said not to turn, so that rotations are what the result lacks.
    """
    cell = make_cell(
        seed,
        high=(0.08, 0.12, 0.04),
        positioning=size,
        size=size,
        rotation=rotation,
        squareness=(10.0 * size,) * 3,
        tilt=1e-4,
        noise=NOISE,
        held=0.0,
    )
    plan = plan_from_text(PLAN.format(repeats=repeats), "test plan")
    measurement = simulate(plan, cell, seed=seed)
    lines = [
        replace(line, standard_uncertainty=stated * line.standard_uncertainty)
        for line in measurement.lines
    ]
    measurement = replace(measurement, lines=tuple(lines), plausible=NOTHING)
    return measurement, solve_least_squares(measurement)


@pytest.fixture(scope="module")
def fits():
    return [run_of(seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def perfect():
    return [run_of(seed, size=0.0) for seed in SEEDS]


def test_errors_that_are_all_there_is_explain_the_readings(fits):
    assert [misfit(result, measurement) for measurement, result in fits] == [Misfit.NONE] * 20


def test_readings_that_repeat_worse_than_their_windows_tell_are_no_misfit():
    for seed in SEEDS:
        measurement, result = run_of(seed, stated=0.5)
        assert exceeds_chance(result.chi_squared, result.degrees_of_freedom)
        assert misfit(result, measurement) is Misfit.NONE
        # With the result alone it cannot be told from an effect that the result lacks.
        assert misfit(result, None) is Misfit.UNCLEAR


def test_rotations_that_are_not_in_the_result_are_a_misfit():
    for seed in SEEDS:
        measurement, result = run_of(seed, rotation=30e-6)
        assert misfit(result, measurement) is Misfit.SHOWN
        assert misfit(*reversed(run_of(seed, rotation=30e-6, stated=0.5))) is Misfit.SHOWN


def test_readings_that_repeat_exactly_are_judged_too():
    """As of a display of few digits: no scatter is no division by zero."""
    measurement, _ = run_of(1, rotation=30e-6)
    once = {one.setup: one for one in measurement.lines if one.line.direction == "forward"}
    lines = []
    for line in measurement.lines:
        shown = once[line.setup].displacement
        back = line.line.direction == "backward"
        # A power of two, so that the mean of four is exactly each of them.
        uncertainty = np.full(len(shown), 2.0**-24)
        shown = shown[::-1] if back else shown
        lines.append(replace(line, displacement=shown, standard_uncertainty=uncertainty))
    measurement = replace(measurement, lines=tuple(lines))
    result = solve_least_squares(measurement)
    assert exceeds_chance(result.chi_squared, result.degrees_of_freedom)
    assert misfit(result, measurement) is Misfit.SHOWN


def test_without_repeats_nobody_can_tell():
    measurement, result = run_of(1, rotation=30e-6, repeats=1)
    forward = [line for line in measurement.lines if line.line.direction == "forward"]
    measurement = replace(measurement, lines=tuple(forward))
    result = solve_least_squares(measurement)
    assert misfit(result, measurement) is Misfit.UNCLEAR


def test_a_machine_without_errors_has_only_noise(perfect):
    # Each of the two tests is right in 95 of 100 cases; 4 or more of 20 would be one in 40.
    assert sum(is_noise(result) for _, result in perfect) > 16


def test_errors_larger_than_noise_are_never_called_noise(fits):
    assert not any(is_noise(result) for _, result in fits)


def test_one_value_far_off_is_no_noise(perfect):
    result = next(result for _, result in perfect if is_noise(result))
    curve = np.array(result.curves["E_XX"])
    curve[-1] += 6.0 * result.standard_uncertainty["E_XX"][-1]
    assert not is_noise(replace(result, curves={**result.curves, "E_XX": curve}))


def test_a_result_without_covariance_is_never_called_noise(perfect):
    _, result = perfect[0]
    assert not is_noise(replace(result, covariance=np.empty((0, 0))))


def test_a_diagonal_that_stands_out_is_no_noise(perfect):
    """Rotations show over the diagonals, and in no curve."""
    result = next(result for _, result in perfect if is_noise(result))
    figures = tuple(
        replace(one, value=8.0 * one.standard_uncertainty) if one.name == "diagonal ppp" else one
        for one in result.figures
    )
    assert not is_noise(replace(result, figures=figures))


def test_lengths_of_a_tracker_leave_a_misfit_unclear(perfect):
    _, result = perfect[0]
    plan, lines = tracker_run()
    off = replace(result, chi_squared=10.0 * result.degrees_of_freedom)
    assert misfit(off, Measurement(plan.volume, lines)) is Misfit.UNCLEAR
