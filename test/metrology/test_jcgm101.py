"""The Monte Carlo method against the examples of JCGM 101:2008 and against known distributions."""

import numpy as np
import pytest
from refused import a_fault, refused

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.uncertainty.jcgm101 import (
    BLOCK,
    FEWEST_BLOCKS,
    VALIDATION_SHARE,
    coverage_intervals,
    monte_carlo,
    numerical_tolerance,
    validate,
)


def gum(estimate, uncertainty, outcome, digits, factor=1.96):
    one = np.array([uncertainty])
    return validate(np.array([estimate]), factor * one, outcome, one, digits)


@pytest.mark.parametrize(
    ("uncertainty", "digits", "tolerance"),
    [
        # JCGM 101, 7.9.2, examples 1 and 2.
        (0.00035e-3, 2, 0.005e-6),
        (2.0, 1, 0.5),
        (2.0, 2, 0.05),
        (10.1, 2, 0.5),
        (0.0996, 2, 0.005),
        (9.96, 1, 5.0),
        (0.0, 2, 0.0),
    ],
)
def test_numerical_tolerance(uncertainty, digits, tolerance):
    assert numerical_tolerance(uncertainty, digits) == pytest.approx(tolerance, rel=1e-12)


def test_additive_model_normal():
    # 9.2.2: four standard normal inputs: y = 0, u = 2.0, [-3.92, 3.92], validated.
    outcome = monte_carlo(
        lambda n, rng: rng.standard_normal((n, 4)).sum(axis=1, keepdims=True), digits=2, seed=1
    )
    assert outcome.settled[0]
    assert outcome.standard_uncertainty[0] == pytest.approx(2.0, abs=0.05)
    assert outcome.low[0] == pytest.approx(-3.92, abs=0.05)
    assert outcome.high[0] == pytest.approx(3.92, abs=0.05)
    assert gum(0.0, 2.0, outcome, 2).passed[0]


def test_additive_model_rectangular():
    # 9.2.3: four rectangular inputs of unit standard deviation: [-3.88, 3.88] against the GUM's
    # [-3.92, 3.92]; validated for δ = 0.05 (table 3), not for a tolerance a tenth of that.
    side = np.sqrt(3.0)
    outcome = monte_carlo(
        lambda n, rng: rng.uniform(-side, side, (n, 4)).sum(axis=1, keepdims=True),
        digits=2,
        seed=2,
        share=VALIDATION_SHARE,
    )
    assert outcome.low[0] == pytest.approx(-3.88, abs=0.02)
    assert outcome.high[0] == pytest.approx(3.88, abs=0.02)
    checked = gum(0.0, 2.0, outcome, 2)
    assert checked.tolerance[0] == pytest.approx(0.05)
    assert checked.passed[0]
    assert checked.low_difference[0] == pytest.approx(0.04, abs=0.02)


def test_additive_model_with_one_dominant_rectangular_input():
    # 9.2.4: the fourth has ten times the standard deviation: u = 10.1, [-17.0, 17.0] against the
    # GUM's [-19.9, 19.9]; d = 2.8 and δ = 0.5: not validated.
    width = np.sqrt(3.0) * np.array([1.0, 1.0, 1.0, 10.0])
    outcome = monte_carlo(
        lambda n, rng: rng.uniform(-width, width, (n, 4)).sum(axis=1, keepdims=True),
        digits=2,
        seed=3,
    )
    uncertainty = np.sqrt(103.0)
    assert outcome.standard_uncertainty[0] == pytest.approx(10.15, abs=0.05)
    assert outcome.low[0] == pytest.approx(-17.0, abs=0.1)
    assert outcome.high[0] == pytest.approx(17.0, abs=0.1)
    checked = gum(0.0, uncertainty, outcome, 2)
    assert checked.low_difference[0] == pytest.approx(2.9, abs=0.15)
    assert not checked.passed[0]


def test_mass_calibration():
    # 9.3: y = 1.2341 mg, u = 0.0754 mg, shortest 95 % interval [1.0834, 1.3825] mg (table 6), where
    # the GUM to first order has 0.0539 and [1.1285, 1.3395].
    def mass(count, rng):
        reference = rng.normal(100_000.000, 0.050, count)
        difference = rng.normal(1.234, 0.020, count)
        air = rng.uniform(1.10, 1.30, count)
        weight = rng.uniform(7000.0, 9000.0, count)
        standard = rng.uniform(7950.0, 8050.0, count)
        value = (reference + difference) * (
            1.0 + (air - 1.2) * (1.0 / weight - 1.0 / standard)
        ) - 100_000.0
        return value[:, None]

    outcome = monte_carlo(mass, digits=2, seed=4)
    assert outcome.estimate[0] == pytest.approx(1.2341, abs=0.0005)
    assert outcome.standard_uncertainty[0] == pytest.approx(0.0754, abs=0.0005)
    assert outcome.shortest_low[0] == pytest.approx(1.0834, abs=0.005)
    assert outcome.shortest_high[0] == pytest.approx(1.3825, abs=0.005)
    assert not gum(1.2340, 0.0539, outcome, 1).passed[0]


def test_comparison_loss_at_zero():
    # 9.4.2.1: Y = X1² + X2² with both 0 ± 0.005: mean and standard deviation 50e-6, shortest 95 %
    # interval [0, 150e-6]; the GUM to first order says u = 0.
    outcome = monte_carlo(
        lambda n, rng: np.sum(rng.normal(0.0, 0.005, (n, 2)) ** 2, axis=1, keepdims=True),
        digits=1,
        seed=5,
    )
    assert outcome.estimate[0] == pytest.approx(50e-6, rel=0.02)
    assert outcome.standard_uncertainty[0] == pytest.approx(50e-6, rel=0.02)
    assert outcome.shortest_low[0] == pytest.approx(0.0, abs=1e-6)
    assert outcome.shortest_high[0] == pytest.approx(-np.log(0.05) * 50e-6, rel=0.03)
    # The symmetric interval of an exponential distribution is another one.
    assert outcome.low[0] == pytest.approx(-np.log(0.975) * 50e-6, rel=0.1)
    assert outcome.high[0] == pytest.approx(-np.log(0.025) * 50e-6, rel=0.03)


def test_more_digits_need_more_trials_and_the_limit_is_kept():
    def normal(count, rng):
        return rng.standard_normal((count, 2))

    coarse, fine = monte_carlo(normal, digits=1), monte_carlo(normal, digits=2, share=0.2)
    assert coarse.trials == FEWEST_BLOCKS * BLOCK < fine.trials
    assert np.all(fine.settled)
    cut = monte_carlo(normal, digits=2, most_trials=60_000, share=0.01)
    assert cut.trials == 60_000
    assert not np.all(cut.settled)
    assert monte_carlo(normal, seed=7).low[0] == monte_carlo(normal, seed=7).low[0]
    assert monte_carlo(normal, seed=7).low[0] != monte_carlo(normal, seed=8).low[0]


def test_a_high_coverage_probability_needs_larger_blocks():
    outcome = monte_carlo(lambda n, rng: rng.standard_normal((n, 1)), coverage=0.999)
    assert outcome.trials % 100_000 == 0
    assert outcome.high[0] == pytest.approx(3.29, abs=0.1)


def test_intervals_of_trials_that_are_known():
    values = np.arange(1000.0)[:, None]
    low, high, shortest_low, shortest_high = coverage_intervals(values, 0.95)
    assert (low[0], high[0]) == (25.0, 975.0)
    assert shortest_high[0] - shortest_low[0] == 950.0
    with refused(Refusal, "too_few", aspect="trials"):
        coverage_intervals(values[:5], 0.95)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"coverage": 95.0}, a_fault("out_of_range", "95")),
        ({"digits": 3}, a_fault("out_of_range", "3")),
        ({"most_trials": 100}, a_fault("too_few", "5", "10000", aspect="limit")),
    ],
)
def test_wrong_arguments_are_refused(wrong, words):
    with refused(Refusal, words):
        monte_carlo(lambda n, rng: rng.standard_normal((n, 1)), **wrong)
