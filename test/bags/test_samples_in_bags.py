"""Samples in a bag: counted, missed, and the readings made of them compared to the last bit."""

from dataclasses import replace

import numpy as np
import pytest
from bags_for_tests import START, description, header, put
from refused import refused

from stepdiag_ros import schemas, topics
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.info import bag_info
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.samples import from_sample_block, to_sample_block
from stepdiag_ros.metrology.decimation import Decimator
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.samples import SampleBlock

NEW = own_types().new
RATE, FACTOR, SIZE = 10_000.0, 10, 200


def blocks(count=20, first=0):
    random = np.random.default_rng(3)
    for number in range(first, first + count):
        yield SampleBlock(
            time=START + number * SIZE * 100_000,
            sequence=number * SIZE,
            period=1.0 / RATE,
            zero=1,
            scale=0.9997,
            offset=1e-7 * number,
            environment=Environment(20.0, 101325.0, 0.5, float("nan")),
            raw_displacement=0.1 + 1e-7 * random.standard_normal(SIZE),
            signal_strength=np.ones(1, dtype=np.float32),
            status=np.full(1, number == 7, dtype=np.uint8),
        )


def write(path, chosen, change=lambda reading: reading, decimation=FACTOR):
    """Write some blocks, and behind each the readings that follow from it."""
    decimator = Decimator(FACTOR)
    with BagWriter(path, header()) as bag:
        put(bag, topics.RUN_DESCRIPTION, description(), START)
        for block in chosen:
            put(bag, topics.SAMPLES, from_sample_block(block, "laser", decimation, NEW), block.time)
            for reading in decimator.add(block):
                message = conversion.from_reading(change(reading), "laser", NEW)
                put(bag, topics.READING, message, reading.time)
    return path


def test_a_block_comes_back_as_it_was():
    for block in blocks(9):
        message = from_sample_block(block, "laser", 50, NEW)
        data = own_types().encode(topics.SAMPLES.type_name, message)
        again = to_sample_block(own_types().decode(topics.SAMPLES.type_name, data))
        assert (again.time, again.sequence, again.period) == (
            block.time,
            block.sequence,
            block.period,
        )
        assert (again.zero, again.scale, again.offset) == (block.zero, block.scale, block.offset)
        for name in ("raw_displacement", "signal_strength", "status"):
            assert getattr(again, name).dtype == getattr(block, name).dtype
            assert np.array_equal(getattr(again, name), getattr(block, name))
        assert np.array_equal(again.environment, block.environment, equal_nan=True)


def test_readings_follow_from_the_samples_to_the_last_bit(tmp_path):
    info = bag_info(write(tmp_path / "a.mcap", blocks()))
    check = info.samples["/"]
    assert (check.blocks, check.samples, check.missing) == (20, 4000, 0)
    assert (check.made, check.different) == (info.topics["/interferometer/reading"][1], 0)
    assert check.rate == pytest.approx(RATE)
    (told,) = schemas.plain(info.document())["samples"]
    assert (told["readings_made_again"], told["readings_different"]) == (check.made, 0)


def test_a_reading_that_does_not_follow_is_told(tmp_path):
    def change(reading):
        value = np.nextafter(reading.raw_displacement, 1.0)
        return reading._replace(raw_displacement=value) if reading.sequence == 100 else reading

    check = bag_info(write(tmp_path / "a.mcap", blocks(), change)).samples["/"]
    assert check.different == 1 < check.made


def test_missing_samples_are_told(tmp_path):
    kept = [block for block in blocks() if block.sequence // SIZE not in (3, 4, 11)]
    check = bag_info(write(tmp_path / "a.mcap", kept)).samples["/"]
    assert (check.blocks, check.missing, check.different) == (17, 3 * SIZE, 0)


def test_an_instrument_that_was_started_again_is_followed(tmp_path):
    again = [replace(block, time=block.time + 20 * SIZE * 100_000) for block in blocks(10)]
    check = bag_info(write(tmp_path / "a.mcap", [*blocks(20), *again])).samples["/"]
    assert (check.blocks, check.missing, check.different) == (30, 0, 0)
    assert check.made > 280


def test_samples_of_which_no_readings_are_made(tmp_path):
    check = bag_info(write(tmp_path / "a.mcap", blocks(), decimation=0)).samples["/"]
    assert (check.samples, check.made) == (4000, 0)


def test_a_block_that_is_none_is_named(tmp_path):
    with BagWriter(tmp_path / "a.mcap", header()) as bag:
        put(bag, topics.RUN_DESCRIPTION, description(), START)
        put(bag, topics.SAMPLES, NEW(topics.SAMPLES.type_name), START)
    with refused(BagError, "too_few", "interferometer/samples"):
        bag_info(tmp_path / "a.mcap")
