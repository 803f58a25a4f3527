"""Probabilities in words: no evidence makes anything certain."""

from hypothesis import given
from hypothesis import strategies as st

from stepdiag_ros.words.diagnosis import chance


@given(st.floats(0.0, 1.0))
def test_a_chance_reads_as_its_number_and_is_never_0_or_1(probability):
    sign, _, number = chance(probability).rpartition(" ")
    assert 0.0 < float(number) < 1.0
    if sign:
        low, high = (0.0, float(number)) if sign == "<" else (float(number), 1.0)
        assert low <= probability <= high
    else:
        assert abs(float(number) - probability) <= max(5.1e-5, 0.051 * min(probability, 0.01))
