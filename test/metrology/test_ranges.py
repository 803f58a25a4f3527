"""The range of estimated values is too large on average; its uncertainty contains by how much."""

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.ranges import range_excess

RUNS = 150


@pytest.mark.parametrize("size", [0.0, 1.0, 3.0, 30.0])
@pytest.mark.parametrize("wandering", [False, True])
def test_ranges_lie_inside_their_uncertainty_however_flat_the_true_curve_is(size, wandering):
    # An outsider's count: 95 % of 2000 estimates of one curve, noise independent or summed up.
    rng = np.random.default_rng(1)
    true = size * np.sin(np.linspace(0.0, 5.0, 9))
    covariance = np.minimum.outer(np.arange(9.0), np.arange(9.0)) if wandering else np.eye(9)
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(9))
    inside, functional = [], []
    for _ in range(2000):
        values = true + root @ rng.standard_normal(9)
        high, low = np.argmax(values), np.argmin(values)
        of_ends = covariance[high, high] + covariance[low, low] - 2.0 * covariance[high, low]
        error = abs(np.ptp(values) - np.ptp(true))
        spread = np.hypot(np.sqrt(of_ends), range_excess(values, covariance))
        inside.append(error <= 1.96 * spread)
        functional.append(error <= 1.96 * np.sqrt(of_ends))
    assert np.mean(inside) > 0.93
    if size == 0.0:
        # Without the excess it would be false by far.
        assert np.mean(functional) < 0.85


def test_nothing_is_added_where_the_curve_is_far_above_its_noise():
    values = np.array([0.0, 5.0, 9.0, 4.0, -3.0])
    assert range_excess(values, 1e-4 * np.eye(5)) < 1e-3
    assert range_excess(values, np.zeros((5, 5))) == 0.0


def test_an_unknown_covariance_makes_an_unknown_excess():
    assert np.isnan(range_excess(np.zeros(3), np.full((3, 3), np.nan)))


def test_the_shapes_of_angles_of_a_machine_that_does_not_turn_lie_inside_u():
    plan = make_plan(4, repeats=2, orders=("XYZ", "YZX", "ZXY"))
    inside = []
    for seed in range(RUNS):
        run = simulate(plan, make_cell(seed=seed), seed)
        result = solve(run, "soons")
        inside += [
            one.value <= 1.96 * one.standard_uncertainty
            for one in result.figures
            if one.name.startswith("shape")
        ]
    assert len(inside) == 5 * RUNS
    assert np.mean(inside) > 0.93
