"""The simulated interferometer as a fast one: samples as arrays, the same as its readings."""

import math

import numpy as np
import pytest
from test_simulated_interferometer import (
    MS,
    NOISY,
    ORIGIN,
    SECOND,
    START,
    STEP,
    feed,
    laser,
    stepping,
    weather,
)

from stepdiag_ros.devices.grid import SampleGrid
from stepdiag_ros.devices.interferometer import InterferometerDevice, StreamsSamples
from stepdiag_ros.metrology.samples import MOST_IN_BLOCK


def run(device, poll, spans=(700, 1300, 2000, 2600, 3000)):
    """Set up twice, break the beam once, let the weather fall silent; return what was polled."""
    got = []
    device.inject_beam_break(START + 2500 * MS, START + 2501 * MS)
    feed(device, START + 3000 * MS, stepping, weather(NOISY, rate_hz=50), every=5 * MS)
    for span in spans:
        now = START + span * MS
        if span == 700:
            device.align(START + 100 * MS, "ppp XYZ", "ppp", STEP, ORIGIN)
        if span == 2000:
            device.align(START + 1300 * MS, "x", "x", STEP, ORIGIN)
        got += getattr(device, poll)(now)
    return got


def test_the_samples_are_the_readings():
    options = {"rate_hz": 10_000.0, "weather_age_s": 0.5, "seed": 3}
    readings = run(laser(NOISY, **options), "poll")
    blocks = run(laser(NOISY, **options), "poll_samples")
    assert max(map(len, blocks)) <= MOST_IN_BLOCK
    assert [block.sequence for block in blocks[1:]] == [block.end for block in blocks[:-1]]
    for block in blocks:
        same = readings[block.sequence : block.end]
        assert [reading.time for reading in same] == [
            block.time_of(reading.sequence) for reading in same
        ]
        raw = np.array([reading.raw_displacement for reading in same])
        compensated = np.array([reading.compensated_displacement for reading in same])
        assert np.array_equal(block.raw_displacement, raw, equal_nan=True)
        found = block.scale * block.raw_displacement + block.offset
        assert np.allclose(found, compensated, rtol=0.0, atol=1e-16, equal_nan=True)
        assert np.array_equal(
            np.broadcast_to(block.status, len(same)), [reading.status for reading in same]
        )
        assert np.array_equal(
            np.broadcast_to(block.signal_strength, len(same)),
            [reading.signal_strength for reading in same],
        )
        assert all(
            np.array_equal(reading.environment, block.environment, equal_nan=True)
            for reading in same
        )
    assert {block.zero for block in blocks} == {0, 1, 2}
    assert {int(block.status[-1]) for block in blocks} == {0, 2}
    assert blocks[-1].end == len(readings) == 30_001


def test_who_is_behind_comes_after_in_turns_and_loses_nothing():
    device = laser(rate_hz=50_000.0)
    device.align(START, "ppp XYZ", "ppp", STEP, ORIGIN)
    feed(device, START + 10 * SECOND, ORIGIN, every=100 * MS)
    turns = [device.poll_samples(START + 10 * SECOND) for _ in range(7)]
    assert sum(bool(turn) for turn in turns) > 3
    assert max(sum(map(len, turn)) for turn in turns) <= 105_000
    blocks = [block for turn in turns for block in turn]
    assert [block.sequence for block in blocks[1:]] == [block.end for block in blocks[:-1]]
    assert blocks[-1].end == 500_001


def test_every_device_of_the_table_fits_its_protocols():
    device = laser(rate_hz=50_000.0)
    assert isinstance(device, StreamsSamples) and device.sample_rate == 50_000.0
    checked: InterferometerDevice = device
    checked.close()


@pytest.mark.parametrize("rate", [300.0, 7919.0, 50_000.0])
def test_instants_taken_as_an_array_are_those_taken_one_by_one(rate):
    one, other = SampleGrid(START, rate), SampleGrid(START, rate)
    for until in (START - 1, START, START + 17 * MS, START + 18 * MS):
        expected = one.take(until)
        taken: list[int] = []
        while len(part := other.take_array(until, 37)):
            taken += part.tolist()
        assert (taken, other.count) == (expected, one.count)


def test_stamps_that_are_late_and_drift():
    late = {"transport_delay_s": 0.004, "clock_offset_s": -0.0015, "clock_drift": 1e-4}
    plain, shifted = laser(rate_hz=1000.0), laser(rate_hz=1000.0, **late)
    fast = laser(rate_hz=1000.0, **late)
    for device in (plain, shifted, fast):
        device.align(START, "ppp XYZ", "ppp", STEP, ORIGIN)
        feed(device, START + 2 * SECOND, stepping)
    expected = plain.poll(START + 2 * SECOND)
    found = shifted.poll(START + 2 * SECOND)
    # What is under way for 4 ms has not come in yet.
    assert len(found) == len(expected) - 4
    for true, stamped in zip(expected, found, strict=False):
        gained = round((true.time - START) * 1e-4)
        assert stamped.time == true.time + 2_500_000 + gained
        assert stamped.raw_displacement == true.raw_displacement
    blocks = fast.poll_samples(START + 2 * SECOND)
    for block in blocks:
        for number in range(block.sequence, block.end):
            assert abs(block.time_of(number) - found[number].time) <= 1
    assert math.isclose(blocks[0].period, 1.0001e-3)
