"""Readings noted with too few digits: the step is seen, and what repeats hide of it is known."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import rounded
from hidden_runs import hidden_run
from hypothesis import given
from hypothesis import strategies as some

from stepdiag_ros.metrology.discrepancy import diagnose
from stepdiag_ros.metrology.discrepancy.findings import CONSISTENT
from stepdiag_ros.metrology.rounding import reading_step, shared_rounding
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.observations import observe

NAN = float("nan")


@given(
    some.sets(some.integers(-(10**6), 10**6), min_size=8, max_size=40),
    some.sampled_from([1e-8, 1e-7, 2e-7, 5e-7, 1e-6, 1e-5]),
)
def test_the_step_is_the_coarsest_of_which_all_readings_are_multiples(counts, step):
    # 1 and 7 keep a coarser step out.
    found = reading_step([NAN, *(step * count for count in (*counts, 1, 7))])
    assert found == pytest.approx(step, rel=1e-12)


def test_readings_that_are_not_rounded_have_no_step():
    values = np.random.default_rng(0).uniform(-0.5, 0.5, 400)
    assert reading_step(values) == 0.0
    assert reading_step([*np.round(values, 6), 0.1 + 2.3e-10]) == 0.0
    assert reading_step([0.0, 0.1, 0.2, 0.3, NAN]) == 0.0


@pytest.mark.parametrize("scatter", [0.0, 0.05, 0.1, 0.2, 0.3, 0.6])
def test_what_repeats_share_is_what_a_simulation_shows(scatter):
    rng = np.random.default_rng(1)
    place = rng.uniform(0.0, 100.0, 200_000)
    one, two = (np.round(place + scatter * rng.standard_normal(len(place))) for _ in range(2))
    shown = np.sqrt(0.5 * np.mean((one - two) ** 2))
    shared = np.mean((one - place) * (two - place))
    assert shared_rounding(float(shown), 1.0) ** 2 == pytest.approx(shared, abs=3e-3)


def test_a_reading_that_is_not_rounded_shares_nothing():
    assert shared_rounding(1e-7, 0.0) == 0.0
    assert shared_rounding(1e-6, 1e-7) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("step", [5e-7, 1e-6, 2e-6])
def test_rounding_is_not_taken_for_an_effect(step):
    # Without what repeats hide, 2 of 8, 8 of 8 and 8 of 8 such runs were UNEXPLAINED.
    found = [
        diagnose(rounded(hidden_run(seed=seed, repeats=2 + seed % 2), step)) for seed in (1, 2)
    ]
    assert [one.verdict for one in found] == [CONSISTENT] * 2
    assert all(one.noise > step / np.sqrt(12.0) for one in found)


def test_an_uncertainty_is_not_smaller_than_the_rounding_of_a_mean():
    run = hidden_run(repeats=3)
    fine, coarse = solve(run, "setup_robust"), solve(rounded(run, 2e-6), "setup_robust")
    least = 2e-6 / np.sqrt(12.0)
    for name, wide in coarse.standard_uncertainty.items():
        known = fine.standard_uncertainty[name] > 0.0
        assert np.all(wide[known] > fine.standard_uncertainty[name][known])
    assert observe(rounded(run, 1e-7)).rounding_remarks == []
    # Where the scatter shows all of the rounding, nothing is taken for known that was not.
    unknown = [
        replace(line, standard_uncertainty=np.full(len(line.time), NAN))
        for line in rounded(run, 1e-7).lines
    ]
    shown = observe(replace(run, lines=tuple(unknown)))
    assert (shown.step, shown.rounding, shown.noise_known) == (1e-7, 0.0, False)
    assert len(observe(rounded(run, 1e-6)).rounding_remarks) == 1
    observed = observe(rounded(run, 2e-6))
    passes = len(observed.passes) / len(observed.groups()[1])
    assert observed.step == 2e-6
    # A scatter of a twentieth of the step shows a third of the rounding's variance.
    assert observed.rounding == pytest.approx(least, rel=0.25)
    assert np.all(observed.uncertainty >= np.sqrt(passes) * observed.rounding)
