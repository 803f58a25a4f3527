"""The instants at which a device samples."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag_ros.devices.grid import SampleGrid

START = 1_700_000_000_000_000_123


@given(
    st.sampled_from([0.1, 3.0, 50.0, 100.0, 300.0, 1e4]),
    st.integers(-(10**9), 10**13),
    st.integers(0, 3),
)
def test_instants_of_a_span_are_those_that_would_be_taken(rate, begin, periods):
    begin += START
    end = begin + round(periods * 1e9 / rate)
    grid = SampleGrid(START, rate)
    first = grid.first(begin)
    assert first >= begin and (first == START or first - 1.0001e9 / rate < begin + 1)
    inside = grid.within(begin, end)
    assert all(begin <= instant < end for instant in inside)
    assert inside == [] or inside[0] == first
    if begin >= START:
        assert abs(len(inside) - periods) <= 1
    assert grid.count == 0


@pytest.mark.parametrize("rate", [3.0, 100.0])
def test_looking_ahead_takes_nothing(rate):
    grid, other = SampleGrid(START, rate), SampleGrid(START, rate)
    ahead = grid.within(START, START + 2 * 10**9 + 1)
    assert other.take(START + 2 * 10**9) == ahead
    assert grid.take(START + 2 * 10**9) == ahead
