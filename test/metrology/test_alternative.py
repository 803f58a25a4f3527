"""The alternative formulation (Ibaraki & Hata 2010, eqs. 20-22): it equals that of section 3.2."""

from dataclasses import replace

import numpy as np
import pytest
from case_tables import load_case, rms_error
from cells_for_tests import by_noise_alone, make_cell, make_plan
from hypothesis import given, settings
from hypothesis import strategies as st
from refused import refused

from stepdiag_ros.metrology.geometry import TRANSLATIONS, beam_direction, line_signs
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.alternative import (
    SINGLE_ROWS,
    UNKNOWNS,
    alternative_map,
    matrix_of_eq_20,
)
from stepdiag_ros.metrology.solvers.observations import block_means, observe
from stepdiag_ros.metrology.solvers.result import NotDeterminable
from stepdiag_ros.metrology.solvers.setup_robust import LAMBDAS, setup_robust_map

BLOCKS = 4
DIAGONALS = ("ppp", "npp", "pnp")
steps = st.tuples(*[st.floats(0.002, 0.05)] * 3)


def measured(step, seed=0, noise=0.0):
    plan = make_plan(blocks=BLOCKS, step=step, diagonals=DIAGONALS)
    high = tuple(BLOCKS * size for size in step)
    return simulate(plan, make_cell(high=high, noise=noise, seed=seed), seed=seed)


def first_order(measurement, curves, tilts):
    """Return the excess of the readings to the first order (``forward``)."""
    observations = observe(measurement)
    values = np.zeros(len(observations.displacement))
    for row, setup_index in enumerate(observations.setup):
        setup = observations.setups[setup_index]
        for axis in range(3):
            node = observations.node[row, axis]
            if setup.signs[axis]:
                values[row] += setup.direction @ curves[axis, :, node]
        if setup.diagonal:
            values[row] += tilts[DIAGONALS.index(setup.line)] @ observations.position[row]
    return observations, values


@settings(max_examples=25)
@given(steps, st.integers(0, 2**31))
def test_both_formulations_are_equal_on_any_errors_setups_and_steps(step, seed):
    """Random curves and tilts of some hundred µrad, read to the first order: equal to rounding."""
    rng = np.random.default_rng(seed)
    measurement = measured(step)
    curves = 1e-5 * rng.standard_normal((3, 3, BLOCKS + 1))
    curves[:, :, 0] = 0.0
    tilts = 3e-4 * rng.standard_normal((3, 3))
    for line, tilt in zip(DIAGONALS, tilts, strict=True):
        beam = beam_direction(line, np.asarray(step))
        tilt -= beam * (beam @ tilt)
    observations, excess = first_order(measurement, curves, tilts)
    alternative = alternative_map(observations).curves @ excess
    robust = setup_robust_map(observations).curves @ excess
    np.testing.assert_allclose(alternative, robust, atol=2e-18 + 1e-12 * np.abs(robust).max())
    assert np.abs(robust).max() > 1e-6


@settings(max_examples=25)
@given(steps, st.integers(0, 2**31))
def test_on_noise_they_differ_by_the_residuals_that_the_docstring_names(step, seed):
    observations = observe(measured(step))
    noise = 1e-6 * np.random.default_rng(seed).standard_normal(len(observations.displacement))
    alternative = (alternative_map(observations).curves @ noise).reshape(3, 3, -1)
    robust_map = setup_robust_map(observations)
    robust = (robust_map.curves @ noise).reshape(3, 3, -1)
    lambdas = dict(zip(LAMBDAS, robust_map.parameters @ noise, strict=True))
    ppp, npp, pnp = block_means(observations, DIAGONALS).weights @ noise
    linear = block_means(observations, ("x", "y", "z")).weights @ noise
    length = np.linalg.norm(step)
    cosine, gain = np.asarray(step) / length, length / (2 * np.asarray(step))
    r_x = ppp[0] + npp[0] - 2 * cosine[0] * linear[0, 0] - lambdas["xx"]
    r_y = ppp[1] + pnp[1] - 2 * cosine[1] * linear[1, 1] - lambdas["yy"]
    r_z = npp[2] + pnp[2] - 2 * cosine[2] * linear[2, 2] - lambdas["zz"]
    beyond = np.zeros((3, 3, BLOCKS))
    beyond[0, 2] = gain[2] * r_x
    beyond[1, 0] = -gain[0] * (r_x + r_y + r_z)
    beyond[1, 2] = gain[2] * (r_x + 2 * r_y + r_z)
    beyond[2, 0] = gain[0] * (r_y + r_z)
    beyond[2, 1] = -gain[1] * r_y
    size = np.abs(robust).max()
    np.testing.assert_allclose(np.diff(alternative - robust, axis=2), beyond, atol=1e-11 * size)
    np.testing.assert_allclose(alternative[:, :, -1], robust[:, :, -1], atol=1e-11 * size)
    np.testing.assert_allclose(alternative[0, 1], robust[0, 1], atol=1e-11 * size)
    assert np.abs(alternative - robust).max() > 1e-8


def test_the_right_side_needs_the_direction_cosines():
    """From readings by eq. (1), R - l(a + Δe) gives the errors back, R - a - Δe does not."""
    step = np.array([0.01, 0.013, 0.007])
    errors = 1e-6 * np.arange(1.0, 10.0).reshape(3, 3)
    cosines = {line: beam_direction(line, step) for line in DIAGONALS}
    corrected, printed = [], []
    rows = [(line, (0, 1, 2)) for line in DIAGONALS]
    rows += [(line, (axis,)) for line, axis in SINGLE_ROWS]
    for line, axes in rows:
        reading = known = projected = 0.0
        for axis in axes:
            moved = step[axis] * np.eye(3)[axis] + errors[axis]
            reading += line_signs(line)[axis] * (cosines[line] @ moved)
            known += step[axis] + errors[axis, axis]
            projected += abs(cosines[line][axis]) * (step[axis] + errors[axis, axis])
        corrected.append(reading - projected)
        printed.append(reading - known)
    expected = [errors[axis, error] for error, axis in UNKNOWNS]
    found = np.linalg.solve(matrix_of_eq_20(step), corrected)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert np.abs(np.linalg.solve(matrix_of_eq_20(step), printed) - expected).max() > 1e-3


def test_the_matrix_is_that_of_the_paper():
    """IH eq. (20) for a cube: signs row by row."""
    matrix = matrix_of_eq_20(np.ones(3)) * np.sqrt(3)
    expected = [
        [1, 1, 1, 1, 1, 1],
        [-1, -1, -1, 1, -1, 1],
        [-1, 1, -1, -1, 1, -1],
        [-1, 1, 0, 0, 0, 0],
        [0, 0, 1, 1, 0, 0],
        [0, 0, 0, 0, 1, 1],
    ]
    np.testing.assert_allclose(matrix, expected, atol=1e-15)
    assert len(UNKNOWNS) == 6


def test_it_finds_the_truth_of_the_reference_case_within_its_uncertainty():
    measurement, truth = load_case("paper_like")
    result = solve(measurement, "alternative")
    assert rms_error(result, truth) < 0.15e-6
    inside = [
        np.abs(result.curves[name] - truth[name]) <= 2 * result.standard_uncertainty[name] + 1e-8
        for name in TRANSLATIONS
    ]
    assert np.mean(inside) > 0.85


def test_its_covariance_is_that_of_repeated_simulations():
    plan = make_plan(blocks=BLOCKS, diagonals=DIAGONALS)
    cell = make_cell(high=(0.04,) * 3)
    results = [
        solve(by_noise_alone(simulate(plan, cell, seed=s)), "alternative") for s in range(150)
    ]
    stacked = np.array([np.concatenate(list(r.curves.values())) for r in results])
    expected = np.sqrt(np.diag(results[0].covariance))
    moving = expected > 1e-12
    ratio = stacked.std(axis=0, ddof=1)[moving] / expected[moving]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.06)


def test_it_needs_the_linear_lines():
    measurement = measured((0.01,) * 3)
    lines = tuple(line for line in measurement.lines if line.line.name != "y")
    with refused(NotDeterminable, "missing", about="y", aspect="lines"):
        solve(replace(measurement, lines=lines), "alternative")
