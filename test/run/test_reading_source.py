"""Readings from an instrument that gives them, and from one that gives samples."""

import math

import numpy as np

from stepdiag_ros.metrology.air import index_of
from stepdiag_ros.metrology.air.compensator import Compensator
from stepdiag_ros.metrology.beam import FixedBeam
from stepdiag_ros.metrology.decimation import Decimator
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.samples import SampleBlock
from stepdiag_ros.run.reading_source import BLOCK_PERIOD, ReadingSource

AIR = Environment()
SECOND = 1_000_000_000


class Slow:
    """Gives one reading each time it is asked."""

    def poll(self, time):
        return [Reading(time, 0, 1.0, 1.0, 1.0, 0, AIR)]


class Fast(Slow):
    """Gives samples at 50 kHz up to the time at which it is asked."""

    sample_rate = 50_000.0

    def __init__(self):
        self.given = 0

    def poll_samples(self, time):
        count = time // 20_000 + 1 - self.given
        values = np.full(count, 0.25)
        block = SampleBlock(
            self.given * 20_000, self.given, 2e-5, 1, 1.0, 0.0, AIR, values,
            np.ones(1, dtype=np.float32), np.zeros(1, dtype=np.uint8),
        )  # fmt: skip
        self.given += count
        return [block]


def test_readings_pass_with_what_they_are_late_taken_off():
    for late, expected in ((0.0, SECOND), (0.25, SECOND * 3 // 4), (-0.5, SECOND * 3 // 2)):
        source = ReadingSource(Slow(), 1000.0, late)
        blocks, readings = source.poll(SECOND, 0.0)
        assert (blocks, [reading.time for reading in readings]) == ([], [expected])
        assert source.factor == 0 and math.isnan(source.rate)


def test_a_fast_instrument_is_asked_for_readings_where_these_are_not_too_many():
    source = ReadingSource(Fast(), 50_000.0, 0.0)
    blocks, readings = source.poll(SECOND, 0.0)
    assert (blocks, len(readings), source.factor) == ([], 1, 0)


def test_samples_are_fetched_in_blocks_and_decimated_with_what_they_are_late_taken_off():
    device = Fast()
    source = ReadingSource(device, 1000.0, 0.125)
    assert (source.factor, source.rate) == (50, 1000.0)
    assert source.mixing == round(Decimator(50).half * 20_000)
    got, read = [], []
    for tick in range(1, 501):
        now = tick * 2_000_000
        blocks, readings = source.poll(now, now * 1e-9)
        got += blocks
        read += readings
    # Asked 500 times in a second, it is looked at about 100 times.
    assert 0.8 / BLOCK_PERIOD < len(got) <= 1.0 / BLOCK_PERIOD + 1
    assert [block.sequence for block in got[1:]] == [block.end for block in got[:-1]]
    assert got[0].time == -125_000_000
    assert [reading.time for reading in read] == [
        reading.sequence * 1_000_000 - 125_000_000 for reading in read
    ]
    assert {reading.raw_displacement for reading in read} == {0.25}
    assert len(read) > 970


def test_readings_and_samples_are_compensated_by_the_air_that_is_given():
    air = Environment(20.0, 101325.0, 0.5, 20.3)
    found = {}
    for device in (Slow(), Fast()):
        compensator = Compensator("own")
        source = ReadingSource(device, 1000.0, 0.0, compensator)
        compensator.align(-1, FixedBeam(np.array([1.0, 0.0, 0.0])), np.zeros(3))
        # The zero is that of the first sample; from then on the index counts.
        source.poll(1, 0.0, air)
        compensator._raw_at_zero = 0.0
        for tick in range(1, 30):
            blocks, readings = source.poll(tick * SECOND // 50, tick / 50, air)
            found.setdefault(type(device), []).extend(readings)
            assert all(block.scale == 1.0 / index_of(air) for block in blocks)
    for readings, raw in ((found[Slow], 1.0), (found[Fast], 0.25)):
        values = {reading.compensated_displacement for reading in readings}
        assert all(abs(value - raw / index_of(air)) < 1e-12 for value in values) and values
        assert {reading.environment for reading in readings} == {air}
