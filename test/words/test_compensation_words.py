"""What tables leave, in words."""

import pytest

from stepdiag_ros.text.numbers import UNKNOWN
from stepdiag_ros.words.compensation import size_words


@pytest.mark.parametrize(
    ("value", "unit", "written"),
    [
        (1.2342e-6, "m", "1.234 µm"),
        (1.0e-9, "m", "0.001 µm"),
        (0.9e-9, "m", "< 0.001 µm"),
        (0.0, "m", "< 0.001 µm"),
        (0.02e-6, "rad", '0.02 µm/m (< 0.01")'),
        (1e-12, "rad", '< 0.01 µm/m (< 0.01")'),
        (float("nan"), "m", UNKNOWN),
    ],
)
def test_what_is_below_the_last_digit_is_not_written_as_zero(value, unit, written):
    assert size_words(value, unit) == written
