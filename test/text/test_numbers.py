"""Rounding of values and uncertainties."""

import math

import numpy as np
import pytest
from refused import refused

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.text.numbers import plain, plus_minus, with_uncertainty


@pytest.mark.parametrize(
    ("value", "uncertainty", "expected"),
    [
        (1.23456, 0.0789, ("1.235", "0.079")),
        (-0.5, 0.123, ("-0.50", "0.12")),
        (1.23456, 0.0996, ("1.23", "0.10")),
        (9.996, 0.0099501, ("9.996", "0.010")),
        (12345.6, 234.0, ("12350", "230")),
        (-0.0001, 0.12, ("0.00", "0.12")),
        (5.0, 0.95, ("5.00", "0.95")),
        (5.0, 0.996, ("5.0", "1.0")),
        (1e-9, 2e-3, ("0.0000", "0.0020")),
        (3.14159, math.nan, ("3.14", "unknown")),
        (math.nan, 0.1, ("unknown", "0.10")),
        (math.inf, math.inf, ("unknown", "unknown")),
        (0.0, 0.0, ("0.00", "0")),
        (np.float64(0.25), np.float32(0.5), ("0.25", "0.50")),
    ],
)
def test_two_significant_digits_and_the_same_place(value, uncertainty, expected):
    assert with_uncertainty(value, uncertainty) == expected


def test_a_negative_uncertainty_is_refused():
    with refused(Refusal, "out_of_range", "-0.1"):
        with_uncertainty(1.0, -0.1)


def test_expanded_uncertainty_is_shown_in_the_unit():
    assert COVERAGE_FACTOR == 1.96
    assert plus_minus(-1.2345e-6, 0.1e-6, scale=1e6) == "-1.23 ± 0.20"


def test_unknown_is_never_a_number():
    assert plus_minus(math.nan, 1e-7, scale=1e6) == "unknown"
    assert plus_minus(1e-6, math.nan, scale=1e6) == "1.00 ± unknown"
    assert plain(math.nan) == "unknown"


def test_what_the_frame_fixes_is_a_bare_zero():
    assert plus_minus(0.0, 0.0, scale=1e6) == "0"
    assert plus_minus(3e-22, 1e-23, scale=1e6) == "0"
    assert plus_minus(1e-9, 0.0, scale=1e6) == "0.00"
    assert plus_minus(4e-9, 1e-9, scale=1e6) == "0.0040 ± 0.0020"
