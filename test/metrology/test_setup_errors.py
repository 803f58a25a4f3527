"""Setup errors (Ibaraki & Hata 2010, eqs. 4-15): found, and what they do."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.forward import perpendiculars
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.plausible import NOTHING, Plausible
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.setup_errors import (
    closure_of_conventional,
    conventional_errors,
    conventional_sensitivity,
    cosine_error,
    lambda_matrix,
    setup_errors,
    tilts_for_conventional_errors,
)
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.setup_robust import LAMBDAS

STEP = (0.01, 0.013, 0.007)
VOLUME = Volume((0.0, 0.0, 0.0), STEP, 6)
CUBE = Volume((0.0, 0.0, 0.0), (0.01,) * 3, 12)
MIRRORS = {"ppp": (1e-4, -2e-4), "npp": (-1e-5, 1.1e-4), "pnp": (5e-5, 6e-5)}
BEAMS = {"ppp": (4e-5, 0.0), "npp": (-3e-5, 1e-4), "pnp": (0.0, 0.0)}


def measured(noise=0.0, seed=0, size=0.0, squareness=(0.0, 0.0, 0.0)):
    lines = {
        line: [*BEAMS[line], *(np.array(MIRRORS[line]) - BEAMS[line]).tolist()] for line in MIRRORS
    }
    high = tuple(6 * step for step in STEP)
    cell = make_cell(high=high, noise=noise, size=size, squareness=squareness, lines=lines)
    plan = make_plan(step=STEP, blocks=6, diagonals=tuple(MIRRORS))
    return simulate(plan, cell, seed=seed)


def tilt(line, angles, step=STEP):
    return np.array(angles) @ np.array(perpendiculars(beam_direction(line, np.array(step))))


def test_the_angles_are_those_of_the_mirror_whatever_the_beam_does():
    for found in setup_errors(measured()):
        np.testing.assert_allclose(found.angles, MIRRORS[found.line], atol=1e-7)
        np.testing.assert_allclose(found.tilt, tilt(found.line, MIRRORS[found.line]), atol=1e-7)
        assert np.sum(found.displacement) == pytest.approx(0.0, abs=1e-15)
        assert found.setups == 1
    assert BEAMS["ppp"] != MIRRORS["ppp"]


def test_the_figures_lambda_follow_from_the_displacements():
    measurement = measured(noise=1e-7, size=1e-6)
    constants = np.concatenate([found.displacement for found in setup_errors(measurement)])
    result = solve(measurement, "setup_robust")
    expected = [result.figure(f"lambda {name}").value for name in LAMBDAS]
    np.testing.assert_allclose(lambda_matrix() @ constants, expected, atol=1e-18)


@pytest.mark.parametrize("chain", ["YXZ", ""])
def test_rotations_and_the_laser_s_scale_are_in_the_uncertainty_of_the_angles(chain):
    run = replace(measured(noise=1e-7), chain=chain)
    alone = setup_errors(replace(run, plausible=NOTHING))
    turning = setup_errors(replace(run, plausible=Plausible(rotation=50e-6)))
    double = setup_errors(replace(run, plausible=Plausible(rotation=100e-6)))
    for one, more, most in zip(alone, turning, double, strict=True):
        np.testing.assert_array_equal(one.angles, more.angles)
        added, twice = (
            np.square(other.angle_uncertainty) - np.square(one.angle_uncertainty)
            for other in (more, most)
        )
        np.testing.assert_allclose(twice, 4.0 * added, rtol=1e-3)
        assert np.all(more.angle_uncertainty > 2.0 * one.angle_uncertainty)


def test_the_uncertainty_of_the_angles_is_that_of_repeated_simulations():
    found = [
        setup_errors(replace(measured(noise=1e-7, seed=seed), plausible=NOTHING))
        for seed in range(150)
    ]
    for number, line in enumerate(MIRRORS):
        angles = np.array([setups[number].angles for setups in found])
        expected = found[0][number].angle_uncertainty
        np.testing.assert_allclose(angles.std(axis=0, ddof=1), expected, rtol=0.2, err_msg=line)


def test_the_conventional_result_errs_by_what_the_tilts_say():
    found = solve(measured(), "conventional")
    errors = conventional_errors(VOLUME, {line: tilt(line, MIRRORS[line]) for line in MIRRORS})
    for name, error in errors.items():
        # The second order, 1e-8 of 60 mm, is not in the equations.
        assert found.curves[name][-1] == pytest.approx(error, abs=2e-8), name
        middle = found.curves[name][3] / found.curves[name][-1]
        assert middle == pytest.approx(0.5, abs=0.01)
    first, *others = closure_of_conventional(VOLUME, errors)
    assert others == pytest.approx([first] * 3)


def test_no_tilt_of_that_size_is_worse_than_the_sensitivity_says():
    rng = np.random.default_rng(1)
    by_curve = {one.curve: one for one in conventional_sensitivity(VOLUME)}
    largest = dict.fromkeys(by_curve, 0.0)
    for _ in range(400):
        angle = rng.uniform(0, 2 * np.pi, 3)
        tilts = {
            line: tilt(line, 1e-4 * np.array([np.cos(a), np.sin(a)]))
            for line, a in zip(MIRRORS, angle, strict=True)
        }
        for name, error in conventional_errors(VOLUME, tilts).items():
            largest[name] = max(largest[name], abs(error))
    for name, one in by_curve.items():
        assert 0.9 * one.worst * 1e-4 < largest[name] <= one.worst * 1e-4 * (1 + 1e-12)
        assert sum(one.by_line.values()) == pytest.approx(one.worst)


def test_a_cube_errs_by_eight_micrometres_for_a_hundred_microradians():
    for one in conventional_sensitivity(CUBE):
        assert one.gain == pytest.approx(np.sqrt(3) / 2)
        for value in one.by_line.values():
            # N · ‖a‖/(2a) · a · √(2/3) = 12 · 10 mm · √2/2
            assert value * 1e-4 == pytest.approx(0.12 * np.sqrt(0.5) * 1e-4)


def test_setup_errors_explain_table_1_of_the_paper():
    """Conventional minus measured, over 120 mm: four sums that eq. (19) makes equal."""
    wanted = {"E_XX": 0.9e-6, "E_YY": -18.5e-6, "E_ZZ": 22.0e-6}
    angles = tilts_for_conventional_errors(CUBE, wanted)
    tilts = {line: tilt(line, pair, CUBE.step) for line, pair in angles.items()}
    errors = conventional_errors(CUBE, tilts)
    for name, value in wanted.items():
        assert errors[name] == pytest.approx(value)
    sums = closure_of_conventional(CUBE, errors)
    assert sums == pytest.approx([4.4e-6] * 4)
    printed = np.array([4.4, 5.5, 4.4, 6.6]) * 1e-6
    assert np.max(np.abs(printed - sums)) < 2.3e-6
    assert max(np.linalg.norm(pair) for pair in angles.values()) < 2e-4
    with refused(Refusal, "unknown", "E_QQ"):
        tilts_for_conventional_errors(CUBE, {"E_QQ": 1e-6})


def test_the_beam_alone_is_a_scale_of_the_second_order():
    both = np.array([3e-4, 0.0, 0.0])
    assert cosine_error(both, both) == pytest.approx(-4.5e-8)
    assert cosine_error(both, np.zeros(3)) == pytest.approx(4.5e-8)
