"""Readings made of samples: response of the filter, means, stamps, and what it must not hide."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refused import a_fault, refused

from stepdiag_ros.metrology.decimation import Decimator, coefficients, decimation_factor
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.samples import SampleBlock

START = 1_700_000_000_000_000_123
AIR = Environment(20.0, 101325.0, 0.5, 20.0)
FACTORS = st.sampled_from((2, 3, 10, 50))


def block(values, sequence=0, rate=50_000.0, zero=1, status=0, signal=1.0, time=None, **changes):
    count = len(values)
    fields = {
        "time": START + round(sequence * 1e9 / rate) if time is None else time,
        "sequence": sequence,
        "period": 1.0 / rate,
        "zero": zero,
        "scale": 1.0,
        "offset": 0.0,
        "environment": AIR,
        "raw_displacement": np.asarray(values, dtype=np.float64),
        "signal_strength": np.full(1, signal, dtype=np.float32),
        "status": np.broadcast_to(np.asarray(status, dtype=np.uint8), (count,)),
    }
    return SampleBlock(**{**fields, **changes})


def cut(values, places, **options):
    """Cut samples into blocks at some places."""
    edges = sorted({0, len(values), *places})
    return [block(values[a:b], sequence=a, **options) for a, b in itertools.pairwise(edges)]


def readings_of(blocks, factor):
    decimator = Decimator(factor)
    return [reading for one in blocks for reading in decimator.add(one)]


@pytest.mark.parametrize("factor", [2, 3, 7, 50, 64])
def test_the_filter_passes_slow_and_stops_what_would_be_folded_into_it(factor):
    taps = coefficients(factor)
    assert np.array_equal(taps, taps[::-1])
    size = 1 << 17
    frequency = np.arange(size // 2 + 1) / size * factor
    gain = np.abs(np.fft.rfft(taps, size))
    passed = 20.0 * np.log10(gain[frequency <= 0.25])
    assert np.abs(passed).max() < 1e-3
    assert 20.0 * np.log10(gain[frequency >= 0.75].max()) < -90.0
    number = np.arange(len(taps)) - len(taps) // 2
    for remainder in range(factor):
        assert taps[number % factor == remainder].sum() == pytest.approx(1.0 / factor, rel=1e-14)


@settings(max_examples=40)
@given(
    factor=FACTORS,
    seed=st.integers(0, 2**32 - 1),
    cuts=st.lists(st.integers(1, 2999), max_size=12),
)
def test_readings_do_not_depend_on_how_samples_are_cut_into_blocks(factor, seed, cuts):
    values = 0.5 + 1e-7 * np.random.default_rng(seed).standard_normal(3000)
    whole = readings_of([block(values)], factor)
    assert readings_of(cut(values, cuts), factor) == whole
    assert [reading.sequence for reading in whole] == list(
        range(whole[0].sequence, whole[0].sequence + len(whole))
    )
    # Linear phase: each stands at the time of its middle sample.
    middles = np.array([reading.sequence * factor for reading in whole])
    assert [r.time for r in whole] == [START + round(m * 1e9 / 50_000.0) for m in middles.tolist()]
    assert middles[0] - factor < len(coefficients(factor)) // 2 <= middles[0]


@settings(max_examples=60)
@given(
    factor=FACTORS,
    readings=st.integers(20, 60),
    seed=st.integers(0, 2**32 - 1),
    shape=st.sampled_from(("noise", "drift", "vibration", "spikes")),
)
def test_the_mean_of_a_settled_stop_is_that_of_its_samples(factor, readings, seed, shape):
    random = np.random.default_rng(seed)
    half = len(coefficients(factor)) // 2
    count = readings * factor + 2 * half
    deviation = {
        "noise": lambda: random.standard_normal(count),
        "drift": lambda: np.linspace(-1.0, 1.0, count),
        "vibration": lambda: np.sin(np.arange(count) * random.uniform(0.0, np.pi)),
        "spikes": lambda: (random.random(count) < 0.01) * 10.0,
    }[shape]()
    values = 0.3 + 1e-7 * deviation
    made = readings_of([block(values)], factor)[:readings]
    begin = made[0].sequence * factor - factor // 2
    samples = values[begin : begin + len(made) * factor] - 0.3
    distance = np.abs(values - 0.3 - samples.mean()).max()
    found = np.mean([reading.raw_displacement - 0.3 for reading in made])
    assert abs(found - samples.mean()) <= distance / len(made) + 1e-16


def test_what_would_be_folded_onto_a_stop_is_gone_and_what_is_slow_stays():
    rate, factor = 50_000.0, 50
    time = np.arange(60_000) / rate
    # 20 Hz of a machine, and 1,010 Hz of its spindle, which every 50th sample would show as 10 Hz.
    slow, fast = 1e-6 * np.sin(2 * np.pi * 20.0 * time), 1e-6 * np.sin(2 * np.pi * 1010.0 * time)
    made = readings_of([block(slow + fast)], factor)
    middles = [reading.sequence * factor for reading in made]
    left = np.array([reading.raw_displacement for reading in made]) - slow[middles]
    assert np.abs((slow + fast)[middles] - slow[middles]).max() > 9e-7
    assert np.abs(left).max() < 1e-10


@settings(max_examples=40)
@given(bad=st.integers(0, 2999), status=st.integers(1, 4), factor=FACTORS)
def test_a_bad_sample_makes_every_reading_bad_that_is_made_of_it_and_no_other(bad, status, factor):
    states = np.zeros(3000, dtype=np.uint8)
    states[bad] = status
    signal = np.ones(3000, dtype=np.float32)
    signal[bad] = 0.125
    made = readings_of([block(np.zeros(3000), status=states, signal_strength=signal)], factor)
    half = len(coefficients(factor)) // 2
    for reading in made:
        reached = abs(reading.sequence * factor - bad) <= half
        assert reading.status == (status if reached else 0)
        assert reading.signal_strength == (0.125 if reached else 1.0)


def test_a_missing_sample_leaves_readings_out_so_that_their_numbers_are_missing():
    values, factor = np.zeros(4000), 10
    early, _, late = cut(values, (2000, 2001))
    made = readings_of([early, late], factor)
    numbers = [reading.sequence for reading in made]
    assert numbers == [n for n in range(7, 394) if not abs(n * 10 - 2000) <= 65]


def test_a_new_zero_is_not_mixed_with_the_old_one():
    factor = 10
    made = readings_of([block(np.zeros(2000)), block(np.ones(2000), sequence=2000, zero=2)], factor)
    assert [reading.sequence for reading in made] == list(range(7, 394))
    for reading in made:
        middle = reading.sequence * factor
        if middle - 65 < 2000 <= middle + 65:
            assert math.isnan(reading.raw_displacement) and reading.status == 2
        else:
            assert (reading.raw_displacement, reading.status) == (float(middle >= 2000), 0)


def test_a_new_zero_that_begins_in_a_gap_is_reported_by_the_first_reading_after_it():
    blocks = [
        block(np.zeros(2000)),
        block(np.ones(2000), sequence=2001, zero=2),
        block(np.ones(2000), sequence=4002, zero=2),
    ]
    made = readings_of(blocks, 10)
    first, *others = (reading for reading in made if reading.sequence * 10 > 2000)
    assert math.isnan(first.raw_displacement) and math.isnan(first.compensated_displacement)
    assert first.status == 2
    assert {(reading.raw_displacement, reading.status) for reading in others} == {(1.0, 0)}


def test_an_instrument_that_counts_anew_begins_anew():
    factor = 10
    late = block(np.zeros(1000), sequence=5000)
    again = block(np.ones(1000), sequence=0, time=START + 10**9)
    made = readings_of([late, again], factor)
    assert [reading.sequence for reading in made] == [*range(507, 594), *range(7, 94)]
    assert [reading.raw_displacement for reading in made] == [0.0] * 87 + [1.0] * 87


def test_each_reading_is_compensated_for_the_air_of_its_middle_sample():
    warm = Environment(25.0, 101325.0, 0.5, 20.0)
    blocks = [
        block(np.full(1000, 0.1), scale=0.9997, offset=1e-6),
        block(np.full(1000, 0.1), sequence=1000, scale=0.9998, offset=0.0, environment=warm),
        block(np.full(1000, 0.1), sequence=2000, scale=math.nan, offset=math.nan),
    ]
    for reading in readings_of(blocks, 10):
        which = reading.sequence // 100
        expected = (0.1 * 0.9997 + 1e-6, 0.1 * 0.9998, math.nan)[which]
        assert reading.compensated_displacement == pytest.approx(expected, rel=1e-15, nan_ok=True)
        assert reading.environment == (AIR, warm, AIR)[which]


def test_the_factor_keeps_readings_below_the_limit():
    rates = (1000.0, 1000.1, 2000.0, 50_000.0, 30.0)
    assert [decimation_factor(rate, 1000.0) for rate in rates] == [1, 2, 2, 50, 1]
    assert readings_of([block(np.arange(3.0))], 1)[1].raw_displacement == 1.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"raw_displacement": np.empty(0)}, a_fault("too_few", "0", "2e-05")),
        ({"period": 0.0}, a_fault("too_few", "3", "0")),
        ({"status": np.zeros(2, dtype=np.uint8)}, a_fault("mismatch", "2")),
        (
            {"signal_strength": np.zeros(4, dtype=np.float32)},
            a_fault("mismatch", "4", "signal_strength"),
        ),
    ],
)
def test_a_block_that_is_none_is_refused(changes, words):
    with refused(Refusal, words):
        replace(block(np.zeros(3)), **changes)
