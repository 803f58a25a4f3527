"""The lack-of-fit test: right chances on noise alone, and power for shapes that have no name."""

import numpy as np
import pytest
from hidden_runs import NOISE, hidden_run
from scipy.special import betainc

from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline, whitened
from stepdiag_ros.metrology.discrepancy.lack_of_fit import ALL, LackOfFitTest
from stepdiag_ros.metrology.discrepancy.noise import REPEATS, STATED, Noise, estimate_noise
from stepdiag_ros.metrology.effects.stops import stops_of

KNOWN = Noise(NOISE, 1e7, 0.0, STATED, 0.0)
SENSE = "the sense in which an axis came, with its place"
SMOOTH, SLOW = "smooth over the volume", "slow changes with time"
PASSES = "whole passes shifted or inclined"
BOTH_WAYS = "forward against backward, place by place"


@pytest.fixture(scope="module")
def run():
    return hidden_run()


@pytest.fixture(scope="module")
def stops(run):
    return stops_of(run)


@pytest.fixture(scope="module")
def problem(run, stops):
    return whitened(fit_baseline(run, stops), NOISE, 0.0)


def draws(problem, count, seed=1):
    """Return gaps of runs that lack nothing, one a column."""
    rng = np.random.default_rng(seed)
    return problem.projected(rng.standard_normal((len(problem.gap), count)))


def nothing(problem):
    return np.zeros((len(problem.gap), 0))


def judged(problem, stops, noise, gap, span=None):
    """Test one gap, with the span of what was found in it."""
    found = nothing(problem) if span is None else span
    return LackOfFitTest(problem, stops, noise)((gap, found))[0]


def chance_of_a_larger_ratio(ratio, upper, lower):
    """Return the upper tail of the F distribution, by its incomplete beta function."""
    return betainc(0.5 * lower, 0.5 * upper, lower / (lower + upper * ratio))


def test_chances_are_right_on_noise_alone(problem, stops):
    test = LackOfFitTest(problem, stops, KNOWN)
    results = test(*((gap, nothing(problem)) for gap in draws(problem, 400).T))
    for words in results[0].by_shape:
        chances = np.array([result.by_shape[words] for result in results])
        # 400 chances: a tenth of them, give or take 1.5 % (one standard deviation).
        assert 0.05 < np.mean(chances < 0.1) < 0.155, words
        assert 0.4 < np.mean(chances) < 0.6, words
    together = np.array([result.p_value for result in results])
    assert 0.02 < np.mean(together < 0.1) < 0.13


def test_chances_are_right_where_the_noise_comes_from_the_run_itself():
    chances, totals = [], []
    for seed in range(40):
        run = hidden_run(seed=seed, blocks=4, orders=("XYZ",))
        stops = stops_of(run)
        baseline = fit_baseline(run, stops)
        noise = estimate_noise(baseline, baseline.gap, stops, float("nan"))
        problem = whitened(baseline, noise.size, noise.correlation)
        result = judged(problem, stops, noise, problem.gap)
        chances.append(result.p_value)
        totals.append(result.by_shape[ALL])
    assert min(chances) > 2e-4
    assert 0.35 < np.mean(totals) < 0.65
    # A total that counts the differences in, from which the noise was taken, is never far off.
    assert np.mean(np.array(totals) < 0.2) > 0.08
    assert np.mean(np.array(totals) > 0.8) > 0.08


def test_the_total_is_tested_without_what_told_the_noise(problem, stops):
    freedom, known = problem.freedom, 200.0
    gap = draws(problem, 1)[:, 0]
    repeats, stated = (Noise(NOISE, known, 0.0, *one) for one in ((REPEATS, 1.0), (STATED, 0.0)))
    squares = (float(gap @ gap) - known) / (freedom - known)
    expected = chance_of_a_larger_ratio(squares, freedom - known, known)
    by_shape = judged(problem, stops, repeats, gap).by_shape
    assert by_shape[ALL] == pytest.approx(expected, rel=1e-9)
    expected = chance_of_a_larger_ratio(float(gap @ gap) / freedom, freedom, known)
    by_shape = judged(problem, stops, stated, gap).by_shape
    assert by_shape[ALL] == pytest.approx(expected, rel=1e-9)


def test_slow_shapes_suffer_from_a_memory_that_is_not_well_known(problem, stops):
    test = LackOfFitTest(problem, stops, Noise(NOISE, 300.0, 0.0, REPEATS, 1.0))
    freedom = test.noise_freedom
    # What is constant along a pass has (1+ρ)/(1-ρ) times the variance: ν/3 at least.
    assert 100.0 <= freedom[PASSES] < 150.0
    assert freedom[BOTH_WAYS] > 250.0
    # With a memory that the whitening overlooks, slow shapes grow and others do not.
    memory, follows = 0.1, np.diff(stops.pass_index, prepend=-1) == 0
    noise = np.random.default_rng(4).standard_normal((len(problem.gap), 300))
    for row in np.flatnonzero(follows):
        noise[row] = memory * noise[row - 1] + np.sqrt(1.0 - memory**2) * noise[row]
    sharp = LackOfFitTest(problem, stops, KNOWN)
    results = sharp(*((gap, nothing(problem)) for gap in problem.projected(noise).T))
    chances = [result.by_shape for result in results]
    assert np.mean([chance[PASSES] < 0.05 for chance in chances]) > 0.15
    assert np.mean([chance[BOTH_WAYS] < 0.05 for chance in chances]) < 0.1


def test_what_findings_explain_does_not_count_again(problem, stops):
    rng = np.random.default_rng(2)
    named = np.column_stack(
        [stops.direction[:, 2] * stops.share[:, 0] * stops.share[:, 1], rng.normal(size=800)]
    )
    span = np.linalg.qr(problem.projected(problem.of(named * NOISE)))[0]
    gap = draws(problem, 1)[:, 0]
    left = gap - span @ (span.T @ gap)
    result = judged(problem, stops, KNOWN, left, span)
    assert result.freedom == problem.freedom - 2
    # The shape beyond the findings, by brute force; the first finding is one of its columns.
    u = 2.0 * stops.share - 1.0
    degrees = [(i, j, k) for i in range(3) for j in range(3) for k in range(3)]
    columns = [
        stops.direction[:, axis] * np.prod(u ** np.array(some), axis=1)
        for some in degrees
        for axis in range(3)
        if 2 <= sum(some) <= 3 and np.count_nonzero(some) > 1
    ]
    shape = problem.projected(problem.of(np.column_stack(columns) * NOISE))
    shape = shape - span @ (span.T @ shape)
    left_of_shape, values, _ = np.linalg.svd(shape, full_matrices=False)
    real = left_of_shape[:, values > 1e-4 * values[0]]
    squares = float(np.sum((real.T @ left) ** 2))
    expected = chance_of_a_larger_ratio(squares / real.shape[1], real.shape[1], 1e7)
    assert result.by_shape[SMOOTH] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        (lambda s: s.direction[:, 2] * s.share[:, 0] ** 2 * s.share[:, 1], SMOOTH),
        (
            lambda s: s.direction[:, 0] * s.last_sense[:, 0] * s.share[:, 1],
            SENSE,
        ),
        (lambda s: s.share[:, 0] * np.cos(9.0 * s.time / s.duration), SLOW),
    ],
)
def test_a_shape_of_half_the_noise_is_seen_where_it_is(problem, stops, shape, words):
    values = shape(stops)
    values = NOISE * values / np.std(values)
    gap = draws(problem, 1)[:, 0] + problem.projected(problem.of(values[:, None]))[:, 0]
    result = judged(problem, stops, KNOWN, gap)
    assert result.p_value < 1e-3
    assert result.shape == words
    if words == SENSE:
        # Nothing of it is lost: the sense of the last move counts, not that of this move alone.
        assert result.by_shape[words] < 1e-125
