"""Noise from the repeats: its size, memory and degrees of freedom, and what is left out."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_runs import NOISE, hidden_run, with_change

from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline
from stepdiag_ros.metrology.discrepancy.chance import LookElsewhere, tail
from stepdiag_ros.metrology.discrepancy.noise import DIRECTIONS, REPEATS, STATED, estimate_noise
from stepdiag_ros.metrology.effects.stops import stops_of

STOPS_OF_A_LINE, STOPS_OF_A_DIAGONAL = 8, 22


def noise_of(run, stated=float("nan")):
    stops = stops_of(run)
    baseline = fit_baseline(run, stops)
    return estimate_noise(baseline, baseline.gap, stops, stated)


def with_memory(run, memory, seed):
    """Return a run whose noise is replaced by one with a memory, the curves staying."""
    rng = np.random.default_rng(seed)
    quiet = []
    for line in run.lines:
        noise = rng.standard_normal(len(line.time))
        for stop in range(1, len(noise)):
            noise[stop] = memory * noise[stop - 1] + np.sqrt(1 - memory**2) * noise[stop]
        quiet.append(3.0 * NOISE * noise)
    return with_change(run, np.concatenate(quiet))


def test_size_and_freedom_are_those_of_the_repeats():
    noise = noise_of(hidden_run())
    assert noise.source == REPEATS
    # One difference a direction of 3 lines and 8 diagonals, less a parabola each.
    expected = 2 * (3 * (STOPS_OF_A_LINE - 3) + 8 * (STOPS_OF_A_DIAGONAL - 3))
    assert noise.freedom == expected
    assert noise.size == pytest.approx(NOISE, rel=4.0 / np.sqrt(2.0 * expected))


def test_three_repeats_give_two_independent_differences():
    two, three = hidden_run(repeats=2), hidden_run(repeats=3, seed=6)
    assert noise_of(three).freedom == 2 * noise_of(two).freedom
    sizes = [noise_of(hidden_run(repeats=3, blocks=4, seed=seed)).size for seed in range(12)]
    assert np.mean(sizes) == pytest.approx(NOISE, rel=0.03)


@pytest.mark.parametrize("memory", [0.0, 0.25])
def test_the_memory_from_stop_to_stop_is_told(memory):
    noises = [noise_of(with_memory(hidden_run(), memory, seed)) for seed in range(4)]
    # A tenth of the variance is the run's own noise, which has none.
    found = np.mean([noise.correlation for noise in noises])
    assert found == pytest.approx(0.9 * memory, abs=0.05)
    size = np.mean([noise.size for noise in noises])
    assert size == pytest.approx(np.sqrt(10.0) * NOISE, rel=0.05)


def test_what_changes_slowly_between_repeats_is_no_noise():
    def slow(stops):
        later = np.array([line.repeat for line in stops.lines])[stops.pass_index]
        return later * (1e-6 + 2e-6 * stops.number / 21.0 - 3e-6 * (stops.number / 21.0) ** 2)

    assert noise_of(hidden_run(shape=slow)).size == pytest.approx(NOISE, rel=0.1)


def test_a_pass_in_which_something_happened_is_left_out():
    def slip(stops):
        return 3e-6 * ((stops.pass_index == 20) & (stops.number >= 11))

    plain, loud = noise_of(hidden_run()), noise_of(hidden_run(shape=slip))
    assert loud.size == pytest.approx(plain.size, rel=0.05)
    assert loud.freedom == plain.freedom - (STOPS_OF_A_DIAGONAL - 3)


def test_without_repeats_the_directions_are_compared():
    noise = noise_of(hidden_run(repeats=1))
    assert noise.source == DIRECTIONS
    assert noise.size == pytest.approx(NOISE, rel=0.2)

    # Backlash and settling differ from axis to axis, not from place to place.
    def lost(stops):
        return 2e-6 * np.sum(stops.direction * stops.moved, axis=1)

    assert noise_of(hidden_run(repeats=1, shape=lost)).size == pytest.approx(noise.size, rel=0.05)


def test_with_neither_only_what_is_stated_is_known():
    run = hidden_run(repeats=1, directions=("forward",))
    assert noise_of(run, 0.2e-6).size == 0.2e-6
    assert noise_of(run, 0.2e-6).source == STATED
    assert np.isnan(noise_of(run).size)
    assert noise_of(run).freedom == 0.0


def test_rejected_stops_cost_freedom():
    run = hidden_run()
    line = run.lines[20]
    values = line.displacement.copy()
    values[[3, 7]] = np.nan
    less = replace(
        run, lines=(*run.lines[:20], replace(line, displacement=values), *run.lines[21:])
    )
    assert noise_of(less).freedom == noise_of(run).freedom - 2


def test_chances_of_the_luckiest_candidate():
    luck = LookElsewhere(trials=200.0, freedom=300.0)
    gain = luck.threshold(0.01)
    assert luck.corrected(float(tail(np.array(gain), 1.0, 300.0))) == pytest.approx(0.01, rel=1e-6)
    assert luck.corrected(1e-4) == pytest.approx(1.0 - np.exp(-0.02))
    assert luck.threshold(0.001) > gain
