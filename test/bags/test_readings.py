"""Readings out of a bag, many at a time: the same as each decoded alone."""

from itertools import chain

import numpy as np
import pytest
from bags_for_tests import PERIOD, READING, START, description, header, reading
from hypothesis import given
from hypothesis import strategies as st

from stepdiag_ros import topics
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.readings import RunReadings, reading_batches
from stepdiag_ros.bags.runs import choose_run
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.wholeness import ReadingNumbers
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages import conversion

COUNT = 10_000


def write(path, messages):
    types = own_types()
    with BagWriter(path, header()) as bag:
        told = types.encode(topics.RUN_DESCRIPTION.type_name, description())
        bag.write("/run/description", topics.RUN_DESCRIPTION.type_name, told, START)
        for number, cdr in enumerate(messages):
            time = START + number * PERIOD
            bag.write(READING, topics.READING.type_name, cdr, time, sequence=number + 1)
            if number % 50 == 0:
                bag.flush()


def message(number, frame):
    types = own_types()
    made = conversion.from_reading(reading(number), frame, types.new)
    return types.encode(topics.READING.type_name, made)


def readings_of(path):
    with open_bag(path) as bag:
        return list(chain.from_iterable(reading_batches(bag, choose_run(bag))))


@pytest.mark.parametrize("frames", [("laser",), ("laser", "laser of the other bench")])
def test_readings_are_those_that_were_written(tmp_path, frames):
    write(
        tmp_path / "run.mcap",
        (message(number, frames[number // 3 % len(frames)]) for number in range(COUNT)),
    )
    assert readings_of(tmp_path / "run.mcap") == [reading(number) for number in range(COUNT)]


@pytest.mark.parametrize("cut", [1, 30])
def test_a_reading_that_cannot_be_decoded_is_refused_wherever_it_stands(tmp_path, cut):
    whole = [message(number, "laser") for number in range(100)]
    whole[70] = whole[70][:-cut]
    write(tmp_path / "run.mcap", whole)
    with pytest.raises(BagError):
        readings_of(tmp_path / "run.mcap")


@given(
    st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30)), max_size=40),
    st.lists(st.integers(1, 39), max_size=3),
)
def test_missing_and_misplaced_readings_are_counted_however_they_are_taken(pairs, cuts):
    """Compared with a count reading by reading."""
    times, sequences = (np.array([pair[i] for pair in pairs], int) for i in (0, 1))
    numbers = ReadingNumbers()
    for part in np.split(np.arange(len(pairs)), sorted(cuts)):
        numbers.take(times[part].astype(np.int64), sequences[part].astype(np.uint64))
    fallen = (np.diff(times) < 0) & (np.diff(sequences) < 0)
    assert numbers.misplaced() == np.count_nonzero(fallen)
    if not fallen.any():
        gaps = np.maximum(np.diff(sequences) - 1, 0)
        assert numbers.missing() == (gaps.sum(), np.count_nonzero(gaps))


@pytest.mark.parametrize("most", [0, COUNT - 1, COUNT])
def test_readings_of_a_run_are_the_same_each_time(tmp_path, monkeypatch, most):
    monkeypatch.setattr("stepdiag_ros.bags.readings._MOST_KEPT", most)
    write(tmp_path / "run.mcap", (message(number, "laser") for number in range(COUNT)))
    with open_bag(tmp_path / "run.mcap") as bag:
        readings = RunReadings(bag, choose_run(bag))
        next(readings.batches())  # whoever stops early leaves nothing half kept
        first, second = (list(chain.from_iterable(readings.batches())) for _ in range(2))
    assert first == second == [reading(number) for number in range(COUNT)]


def test_a_long_run_is_not_kept_in_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("stepdiag_ros.bags.readings._MOST_KEPT", COUNT - 1)
    write(tmp_path / "run.mcap", (message(number, "laser") for number in range(COUNT)))
    with open_bag(tmp_path / "run.mcap") as bag:
        readings = RunReadings(bag, choose_run(bag))
        one, other = (list(readings.batches()) for _ in range(2))
    assert not any(np.shares_memory(a.time, b.time) for a, b in zip(one, other, strict=True))
