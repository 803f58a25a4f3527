"""Points, stations and error curves from lengths alone."""

from itertools import product

import numpy as np
import pytest
from random_machines import LARGE, any_machine, wandering_grid
from refused import refused

from stepdiag_ros.configuration import load_cell
from stepdiag_ros.metrology.forward import ErrorCurves, rotation_matrices, tool_point
from stepdiag_ros.metrology.geometry import CHAINS, CURVES
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.noise_factor import widening
from stepdiag_ros.metrology.solvers.result import NotDeterminable
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.campaign import grid_readings, points_from, simulate_readings
from stepdiag_ros.metrology.tracker.curves import displacement_design, error_curves, grid_of
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.multilateration import multilaterate, rigid_motions

STATIONS = np.array([[-0.1, -0.1, -0.1], [0.9, -0.1, -0.15], [0.4, 0.6, -0.1], [-0.15, 0.6, 0.5]])
GRID = np.array(list(product([0, 0.4, 0.8], [0, 0.25, 0.5], [0, 0.2, 0.4])), dtype=float)
NOISE = 0.2e-6


def moved_points(seed=0, size=10e-6):
    return GRID + size * np.random.default_rng(seed).standard_normal(GRID.shape)


def changes_from(points, stations=STATIONS):
    lengths = np.linalg.norm(points[:, None] - stations[None], axis=2)
    return lengths - lengths[0], lengths[0]


def in_frame(displacement):
    turns = rigid_motions(GRID)
    return displacement - turns @ np.linalg.lstsq(turns, displacement, rcond=None)[0]


def test_points_are_exact_without_noise_and_rough_stations_do_no_harm():
    points = moved_points()
    changes, starts = changes_from(points)
    rough = STATIONS + 2e-3 * np.random.default_rng(1).standard_normal(STATIONS.shape)
    found = multilaterate(GRID, changes, NOISE, rough, starts + 1e-3)
    truth = in_frame((points - GRID).ravel())
    # The frame is fixed to first order of displacements of 10 µm.
    np.testing.assert_allclose(found.displacement.ravel(), truth, atol=2e-9)
    np.testing.assert_allclose(found.residuals, 0.0, atol=1e-13)
    assert found.degrees_of_freedom == 27 * 4 - (27 * 3 + 16 - 6)


def test_the_frame_does_not_depend_on_where_the_machine_stands():
    points = moved_points()
    turn = rotation_matrices(np.array([[1e-3, -2e-3, 1.5e-3]]))[0]
    changes, starts = changes_from(points)
    again, _ = changes_from(points @ turn.T + 0.01, STATIONS @ turn.T + 0.01)
    first = multilaterate(GRID, changes, NOISE, STATIONS, starts)
    second = multilaterate(GRID, again, NOISE, STATIONS, starts)
    np.testing.assert_allclose(first.position, second.position, atol=1e-12)


def test_bands_of_the_points_hold():
    points = moved_points()
    changes, starts = changes_from(points)
    truth = in_frame((points - GRID).ravel())
    rng = np.random.default_rng(3)
    inside, sums = [], []
    for _ in range(60):
        read = changes + NOISE * rng.standard_normal(changes.shape)
        found = multilaterate(GRID, read, NOISE, STATIONS, starts)
        error = found.displacement.ravel() - truth
        inside.append(np.abs(error) < 1.96 * found.standard_uncertainty.ravel())
        functional = (GRID[:, 0] - 0.4)[:, None] * [1.0, 0.0, 0.0]
        spread = np.sqrt(found.covariance_of(functional.reshape(1, -1))[0, 0])
        sums.append(functional.ravel() @ error / spread)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)
    assert np.std(sums) == pytest.approx(1.0, abs=0.25)


def test_noise_is_taken_from_the_residuals_where_it_is_not_known():
    changes, starts = changes_from(moved_points())
    read = changes + NOISE * np.random.default_rng(4).standard_normal(changes.shape)
    found = multilaterate(GRID, read, np.nan, STATIONS, starts)
    known = multilaterate(GRID, read, NOISE, STATIONS, starts)
    assert np.nanmean(found.uncertainty) == pytest.approx(NOISE, rel=0.4)
    ratio = found.standard_uncertainty / known.standard_uncertainty
    excess = max(known.chi_squared / known.degrees_of_freedom - 1.0, 0.0)
    widened = NOISE * np.sqrt(1.0 + 2.0 * excess)
    student = np.sqrt(widening(found.degrees_of_freedom))
    assert student > 1.0
    np.testing.assert_allclose(ratio, student * np.nanmean(found.uncertainty) / widened, rtol=1e-6)
    assert any("residuals" in text for text in found.remarks)


def test_points_lie_inside_u_where_the_noise_is_estimated_from_two_degrees_of_freedom():
    # k = 1.96 for u itself holds 80 %.
    points = np.array(list(product((0.0, 0.5), repeat=3)))
    stations = np.array(
        [[-0.3, 0.2, 0.1], [0.8, -0.2, 0.3], [0.2, 0.9, -0.2], [0.3, 0.2, 1.1], [-0.2, -0.3, 0.7]]
    )
    lengths = np.linalg.norm(points[:, None] - stations, axis=2)
    inside = []
    for seed in range(200):
        read = lengths - lengths[0] + NOISE * np.random.default_rng(seed).normal(size=lengths.shape)
        found = multilaterate(points, read, np.nan, stations, lengths[0])
        assert found.degrees_of_freedom == 2
        inside.append(np.abs(found.displacement) < 1.96 * found.standard_uncertainty)
    assert np.mean(inside) > 0.91


def test_bands_of_curves_hold_where_zero_and_air_differ_from_row_to_row():
    """Random machines; without the residuals' word an eighth of the values was outside."""
    away = []
    for seed in range(10):
        rng = np.random.default_rng([seed, 9])
        cell = any_machine(rng, LARGE)
        points = points_from(wandering_grid(rng, cell))
        found = error_curves(points, cell.chain)
        truth = cell.truth(grid_of(points.commanded))
        for name in CURVES:
            spread = found.standard_uncertainty[name]
            free = np.isfinite(spread) & (spread > 1e-15)
            away.extend((found.curves[name] - truth[name])[free] / spread[free])
    assert len(away) > 300
    assert np.mean(np.abs(away) < 1.96) > 0.92
    assert 0.6 < np.sqrt(np.mean(np.square(away))) < 1.1


def test_a_point_that_one_station_does_not_see_is_found_from_the_rest():
    points = moved_points()
    stations = np.vstack([STATIONS, [0.9, 0.6, 0.3]])
    changes, starts = changes_from(points, stations)
    changes[5, 2] = np.nan
    found = multilaterate(GRID, changes, NOISE, stations, starts)
    truth = in_frame((points - GRID).ravel())
    np.testing.assert_allclose(found.displacement.ravel(), truth, atol=2e-9)
    assert np.isnan(found.residuals[5, 2])


def test_too_little_is_refused_in_words():
    changes, starts = changes_from(GRID)
    with refused(PoorGeometry, "too_few", "3", aspect="stations"):
        multilaterate(GRID, changes[:, :3], NOISE, STATIONS[:3], starts[:3])
    with refused(PoorGeometry, "too_few", "37", aspect="lengths"):
        multilaterate(GRID[:9], changes[:9], NOISE, STATIONS, starts)
    flat = STATIONS * [1, 1, 0] - [0, 0, 0.1]
    flat_changes, flat_starts = changes_from(GRID, flat)
    with refused(PoorGeometry, "undetermined"):
        multilaterate(GRID, flat_changes, NOISE, flat, flat_starts)
    gaps = changes.copy()
    gaps[3, :2] = np.nan
    with refused(PoorGeometry, "too_few", "4", aspect="point"):
        multilaterate(GRID, gaps, NOISE, STATIONS, starts)


@pytest.mark.parametrize("chain", CHAINS)
def test_the_design_is_the_exact_model_to_first_order(chain):
    volume = grid_of(GRID)
    nodes = volume.all_nodes
    design = displacement_design(GRID, volume, chain).reshape(len(GRID), 3, len(CURVES), -1)
    for index, name in enumerate(CURVES):
        values = np.array([0.0, 1e-7, -2e-7])
        errors = ErrorCurves.from_curves(nodes, {name: values})
        exact = tool_point(GRID, errors, chain)[0] - GRID
        np.testing.assert_allclose(design[:, :, index] @ values, exact, atol=1e-13, err_msg=name)


@pytest.fixture(scope="module")
def campaign():
    cell, _ = load_cell("angular")
    tracker = Tracker(minimum_range=0.02, length_noise=20e-9, length_proportional=0.0)
    stations = [
        np.array(place)
        for place in (
            [-0.2, -0.2, -0.1],
            [0.3, -0.2, -0.15],
            [0.05, 0.35, -0.1],
            [0.05, -0.3, 0.35],
        )
    ]
    box = Box(np.zeros(3), np.full(3, 0.12))
    return cell, tracker, stations, grid_readings(box, stations, tracker, 4)


def test_error_curves_within_their_bands_and_the_rest_unknown(campaign):
    cell, tracker, stations, grid = campaign
    scores = []
    for seed in range(4):
        points = points_from(simulate_readings(grid, stations, tracker, cell, seed))
        result = error_curves(points, cell.chain)
        truth = cell.truth(grid_of(points.commanded))
        for name in CURVES:
            spread = result.standard_uncertainty[name]
            known = np.isfinite(spread) & (spread > 1e-13)
            scores += list(((result.curves[name] - truth[name])[known] / spread[known]).ravel())
    # YXZ with one reflector: all but E_CX and the rotations of Z.
    unknown = {n for n in CURVES if not np.all(np.isfinite(result.curves[n]))}
    assert unknown == {"E_CX", "E_AZ", "E_BZ", "E_CZ"}
    assert all(name in result.not_determined[0] for name in unknown)
    assert np.mean(np.abs(scores) < 1.96) == pytest.approx(0.95, abs=0.04)
    slopes = [np.polyfit(np.linspace(0, 0.12, 4), truth[n], 1)[0] for n in ("E_XY", "E_YX")]
    figure = result.figure("C0Y")
    assert abs(figure.value + sum(slopes)) < 3 * figure.standard_uncertainty


def test_points_on_no_grid_have_no_curves():
    changes, starts = changes_from(GRID + 0.0)
    points = multilaterate(GRID[:-1] + 0.0, changes[:-1], NOISE, STATIONS, starts)
    assert error_curves(points, "YXZ").curves["E_XX"].shape == (3,)
    shifted = GRID.copy()
    shifted[3] += [0.0, 0.0, 0.03]
    changes, starts = changes_from(shifted)
    points = multilaterate(shifted, changes, NOISE, STATIONS, starts)
    with refused(NotDeterminable, "too_few", aspect="grid"):
        error_curves(points, "YXZ")


def test_another_number_of_stations_is_refused(campaign):
    cell, tracker, stations, grid = campaign
    with refused(Refusal, "mismatch", "4"):
        simulate_readings(grid, stations[:3], tracker, cell)


def test_a_station_that_sees_too_little_is_refused(campaign):
    _, tracker, stations, _ = campaign
    box = Box(np.zeros(3), np.full(3, 0.12))
    with refused(PoorGeometry, "too_few", "2", "0"):
        grid_readings(box, [stations[0], np.array([200.0, 0, 0])], tracker, 4)
