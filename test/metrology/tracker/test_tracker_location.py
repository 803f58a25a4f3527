"""The tracker's place from six or more lengths (ATLI eq. 1 and its refinement)."""

import numpy as np
import pytest
from refused import a_fault, refused
from trackers_for_tests import PLACES

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.location import (
    dilution_of,
    linear_location,
    locate,
    station_model,
)

STATION = np.array([-0.2, 0.3, -0.1])
NOISE = 0.2e-6


def changes(points=PLACES, station=STATION, zero=0.123):
    return np.linalg.norm(points - station, axis=1) - zero


def test_eq_1_alone_finds_place_and_start_length_exactly():
    found = linear_location(PLACES[:6], changes(PLACES[:6]))
    np.testing.assert_allclose(found, [*STATION, 0.123], atol=1e-12)


@pytest.mark.parametrize("spread", [1e-7, 5e-6])
def test_on_a_large_machine_the_place_is_found_to_rounding(spread):
    """Metres in units of a micrometre round χ², but not the place: no step is left to be made."""
    left = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        points, station = rng.uniform(0.0, 8.0, (30, 3)), np.array([12.0, 9.0, 0.7])
        read = np.linalg.norm(points - station, axis=1) - 7.0 + spread * rng.standard_normal(30)
        found = locate(points, read, spread)
        predicted, rows = station_model(points, np.append(found.position, found.start_length))
        step = np.linalg.lstsq(rows, read - predicted, rcond=None)[0]
        left.append(np.linalg.norm(rows @ step))
    assert max(left) < 4 * 2.0**-52 * np.linalg.norm(read + 7.0)


def test_eq_1_is_the_pseudo_inverse_as_the_document_writes_it():
    points, read = PLACES[:6], changes(PLACES[:6])
    design = np.column_stack([2 * points, 2 * read, -np.ones(6)])
    right = np.sum(points**2, axis=1) - read**2
    printed = np.linalg.pinv(design) @ right
    np.testing.assert_allclose(linear_location(points, read), printed[:4], atol=1e-10)
    assert printed[4] == pytest.approx(STATION @ STATION - 0.123**2, abs=1e-10)


def test_derivatives_are_those_of_the_lengths():
    at = np.append(STATION, 0.123)
    _, rows = station_model(PLACES, at)
    for column in range(4):
        step = np.zeros(4)
        step[column] = 1e-6
        slope = (station_model(PLACES, at + step)[0] - station_model(PLACES, at - step)[0]) / 2e-6
        np.testing.assert_allclose(rows[:, column], slope, atol=1e-9)


def test_the_band_holds_the_truth_at_its_rate_and_the_refined_place_is_the_better():
    rng = np.random.default_rng(1)
    inside, linear, refined = [], [], []
    for _ in range(250):
        read = changes() + NOISE * rng.standard_normal(len(PLACES))
        found = locate(PLACES, read, NOISE)
        error = np.append(found.position - STATION, found.start_length - 0.123)
        inside.append(np.abs(error) < 1.96 * found.standard_uncertainty)
        refined.append(error[:3])
        linear.append(found.linear[:3] - STATION)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)
    assert np.std(refined) < np.std(linear)


def test_students_factor_where_the_residuals_tell_the_noise():
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(250):
        found = locate(PLACES, changes() + NOISE * rng.standard_normal(len(PLACES)))
        error = np.append(found.position - STATION, found.start_length - 0.123)
        factor = found.adjustment.coverage_factor
        inside.append(np.abs(error) < factor * found.standard_uncertainty)
    assert found.adjustment.degrees_of_freedom == 4
    assert factor == pytest.approx(2.776, abs=1e-3)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def test_four_redundant_readings_fewer_leave_the_uncertainty_unknown():
    found = locate(PLACES[:6], changes(PLACES[:6]) + 1e-7 * np.array([1, -1, 1, 1, -1, 1]))
    assert np.all(np.isfinite(found.standard_uncertainty))
    assert found.adjustment.degrees_of_freedom == 2


def test_points_on_a_sphere_about_the_tracker_do_no_harm():
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((8, 3))
    points = STATION + 0.4 * directions / np.linalg.norm(directions, axis=1)[:, None]
    found = locate(points, np.zeros(8), NOISE)
    np.testing.assert_allclose(found.position, STATION, atol=1e-9)
    assert found.start_length == pytest.approx(0.4, abs=1e-9)


def test_fewer_than_six_places_are_refused_also_when_one_is_there_twice():
    points = PLACES[[0, 1, 2, 3, 4, 4]]
    with refused(PoorGeometry, "too_few", "5", aspect="places"):
        locate(points, changes(points), NOISE)


def test_places_in_one_plane_need_a_rough_place_and_say_so():
    points = PLACES * [1, 1, 0] + np.arange(8)[:, None] * [0.01, 0.02, 0.0]
    with refused(PoorGeometry, "ambiguous"):
        locate(points, changes(points), NOISE)
    below = locate(points, changes(points), NOISE, near=STATION + 0.02)
    np.testing.assert_allclose(below.position, STATION, atol=1e-9)
    above = locate(points, changes(points), NOISE, near=STATION * [1, 1, -1])
    np.testing.assert_allclose(above.position, STATION * [1, 1, -1], atol=1e-9)
    assert any("which side" in text for text in below.warnings)


def test_places_and_tracker_in_one_plane_are_refused():
    points = PLACES * [1, 1, 0] + np.arange(8)[:, None] * [0.01, 0.02, 0.0]
    station = STATION * [1, 1, 0]
    with pytest.raises(PoorGeometry):
        locate(points, changes(points, station), NOISE, near=station)
    # Begun beside the plane, the height is found from a quadratic alone.
    beside = locate(points, changes(points, station), NOISE, near=np.append(station[:2], 1e-3))
    assert any("rough one" in text for text in beside.warnings)
    assert any("nearly in one plane, square to Z" in text for text in beside.warnings)
    assert beside.standard_uncertainty[2] > abs(beside.position[2])


def test_a_narrow_view_is_warned_of_with_its_reason():
    points = PLACES * 0.15 + [2.0, 0.0, 0.0]
    found = locate(points, changes(points), NOISE)
    text = next(text for text in found.warnings if "Poor geometry" in text)
    assert "of one direction" in text
    assert found.dilution > 10
    assert not any("Poor geometry" in text for text in locate(PLACES, changes(), NOISE).warnings)


def test_directions_on_a_cone_are_warned_of():
    angle = np.linspace(0, 2 * np.pi, 9)[:-1]
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.full(8, 0.8)])
    points = STATION + ring * np.array([0.3, 0.5] * 4)[:, None]
    points[0, 2] += 0.02
    found = locate(points, changes(points), NOISE)
    assert any("at the same angle" in text for text in found.warnings)


def test_dilution_is_what_a_unit_of_length_makes_of_the_position():
    found = locate(PLACES, changes(), 1e-6)
    by_covariance = np.sqrt(np.trace(found.covariance[:3, :3])) / 1e-6
    assert dilution_of(PLACES, STATION) == pytest.approx(by_covariance, rel=1e-6)


def test_an_outlier_is_named_and_widens_the_uncertainty():
    read = changes()
    read[3] += 20e-6
    found = locate(PLACES, read, NOISE, names=[f"p{i}" for i in range(8)])
    assert any(text.startswith("p3: the residual") for text in found.warnings)
    assert any("times as large" in text for text in found.warnings)
    clean = locate(PLACES, changes(), NOISE)
    assert not clean.warnings
    ratio = found.standard_uncertainty[0] / clean.standard_uncertainty[0]
    expected = np.sqrt(found.adjustment.chi_squared / found.adjustment.degrees_of_freedom)
    assert ratio == pytest.approx(expected, rel=1e-3)


def test_few_good_sets_are_suspected_and_a_moderate_outlier_is():
    rng = np.random.default_rng(6)
    suspected, found = 0, 0
    for _ in range(250):
        read = changes() + NOISE * rng.standard_normal(len(PLACES))
        fit = locate(PLACES, read, NOISE).adjustment
        suspected += bool(fit.suspicious())
        worst = int(np.argmax(fit.redundancy))
        read[worst] += 7 * NOISE / np.sqrt(fit.redundancy[worst])
        found += locate(PLACES, read, NOISE).adjustment.suspicious()[:1] == [worst]
    assert suspected < 9
    assert found > 225


def test_a_place_nearer_than_the_shortest_length_is_named():
    found = locate(PLACES, changes(), NOISE, names=[f"p{i}" for i in range(8)], minimum_range=0.4)
    assert any("nearer than its shortest length" in text for text in found.warnings)


@pytest.mark.parametrize(
    ("points", "read", "uncertainty", "words"),
    [
        (PLACES, np.full(8, np.nan), NOISE, a_fault("out_of_range", aspect="value")),
        (PLACES, np.zeros(7), NOISE, a_fault("mismatch", aspect="shape")),
        (
            PLACES,
            np.zeros(8),
            np.array([NOISE] * 7 + [np.nan]),
            a_fault("mismatch", aspect="uncertainty"),
        ),
        (PLACES, changes(), 0.0, a_fault("out_of_range", aspect="uncertainty")),
    ],
)
def test_readings_that_make_no_sense_are_refused(points, read, uncertainty, words):
    with refused(Refusal, words):
        locate(points, read, uncertainty)
