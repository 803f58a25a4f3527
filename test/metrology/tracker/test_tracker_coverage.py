"""Every ± of a seven-line test holds on machines with every kind of error at once."""

from functools import cache

import numpy as np
import pytest
from random_machines import PLACES, any_measurement
from true_figures import figures

from stepdiag_ros.metrology.tracker.evaluation import evaluate_test
from stepdiag_ros.metrology.tracker.location import LEAST_POINTS

FEW = {"runs": 2, "targets": 7}


@cache
def standardised(machines):
    """Kind of figure → (value - truth)/u and u of all machines."""
    found = {}
    for seed in range(machines):
        one = any_measurement(seed, list(PLACES)[seed % len(PLACES)], **FEW)
        result = evaluate_test(one.readings, chain=one.cell.chain)
        for kind, value, spread, truth in figures(result, one):
            found.setdefault(kind, []).append(((value - truth) / spread, spread))
    return {kind: np.array(values) for kind, values in found.items()}


@pytest.mark.parametrize(
    ("machines", "least", "most"), [(6, 0.83, 1.5), (60, 0.90, 1.25)], ids=["few", "many"]
)
def test_no_band_is_false(machines, least, most):
    """Without curves in the model a fifth of the values was inside, with an rms of 5."""
    found = standardised(machines)
    assert len(found) == 10
    for kind, values in found.items():
        away = values[:, 0]
        assert np.all(np.isfinite(away)), kind
        assert np.mean(np.abs(away) < 1.96) > least, kind
        assert np.sqrt(np.mean(away**2)) < most, kind


def test_bands_are_not_so_wide_that_they_say_nothing():
    """Against 15 µrad of squareness and 2 µm of positioning over half a metre, or 0.1 m."""
    found = standardised(60)
    assert np.sqrt(np.mean(found["joint squareness"][:, 0] ** 2)) > 0.5
    assert np.median(found["joint squareness"][:, 1]) < 12e-6
    assert np.median(found["joint scale"][:, 1]) < 10e-6


def test_more_passes_over_the_same_places_do_not_make_curves_smaller():
    few = any_measurement(3, "corner", runs=1, targets=7)
    many = any_measurement(3, "corner", runs=12, targets=7)
    one, twelve = (
        evaluate_test(each.readings, chain=each.cell.chain).joint.standard_uncertainty
        for each in (few, many)
    )
    assert np.all(twelve[3:] > 0.6 * one[3:])


def test_without_the_chain_nothing_has_a_band():
    """Through which levers angular errors act decides; a wrong guess was wrong by 12 u."""
    one = any_measurement(7, "outside", **FEW)
    untold = evaluate_test(one.readings)
    assert np.all(np.isfinite(untold.joint.values))
    assert np.all(np.isnan([spread for _, _, spread, _ in figures(untold, one)]))


def test_what_no_joint_estimate_tells_is_unknown():
    """Six places and three more do not tell ten unknowns: no figure of the line has a band."""
    one = any_measurement(5, "outside", **FEW)
    readings = [
        r
        for r in one.readings
        if (r.line == "x" and r.stop < 3) or (r.line == "locate" and r.stop < LEAST_POINTS)
    ]
    result = evaluate_test(readings)
    assert result.joint is None
    assert all(np.isnan(slope.standard_uncertainty) for slope in result.located.slopes)
    separations = [each for each in result.separations.values() if not isinstance(each, str)]
    assert all(np.all(np.isnan(each.covariance)) for each in separations)
