"""How many times smaller a figure is, in as many digits as somebody can use."""

import pytest

from stepdiag_ros.words.changes import ratio


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (0.5, "0.50"),
        (1.04, "1.04"),
        (1.06, "1.1"),
        (2.94, "2.9"),
        (99.96, "100.0"),
        (104.04, "104"),
        (1000.0, "1000"),
    ],
)
def test_a_factor_has_two_decimals_near_one_and_none_from_a_hundred_on(factor, words):
    assert ratio(factor) == words


def test_a_factor_beyond_a_thousand_is_no_figure():
    assert ratio(1234.5) == "> 1000"
