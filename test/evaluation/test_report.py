"""Equality of results to the last bit, and the order in which they are shown."""

from dataclasses import replace

import numpy as np
import pytest
from results_by_hand import make_report, make_result, with_unknown

from stepdiag_ros.evaluation.report import same_but_for_rounding, same_to_the_last_bit
from stepdiag_ros.metrology.solvers.result import Figure


def test_a_result_equals_itself_with_unknown_values():
    assert same_to_the_last_bit(with_unknown(make_result()), with_unknown(make_result()))


def test_the_covariance_is_not_compared():
    assert same_to_the_last_bit(make_result(), replace(make_result(), covariance=np.eye(2)))


def _last_bit(values):
    return np.r_[values[:-1], np.nextafter(values[-1], np.inf)]


@pytest.mark.parametrize(
    "changes",
    [
        {"curves": {**make_result().curves, "E_YX": _last_bit(make_result().curves["E_YX"])}},
        {"curves": {**make_result().curves, "E_YX": -make_result().curves["E_YX"] * 0.0}},
        {
            "standard_uncertainty": {
                **make_result().standard_uncertainty,
                "E_ZZ": _last_bit(make_result().standard_uncertainty["E_ZZ"]),
            }
        },
        {"nodes": (*make_result().nodes[:2], _last_bit(make_result().nodes[2]))},
        {"chi_squared": float(np.nextafter(42.0, 43.0))},
        {"figures": (Figure("C0Y", 1.0, 0.0, "rad"), *make_result().figures[1:])},
        {"figures": make_result().figures[:-1]},
        {"remarks": ()},
        {"lines": 11},
    ],
)
def test_the_smallest_difference_is_found(changes):
    assert not same_to_the_last_bit(make_result(), replace(make_result(), **changes))


def _scaled(name, factor):
    result = make_result()
    return {"curves": {**result.curves, name: result.curves[name] * factor}}


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        (_scaled("E_YX", 1.0 + 1e-14), True),
        (_scaled("E_YX", 1.0 + 1e-4), False),
        ({"chi_squared": 42.0 * (1.0 + 1e-14)}, True),
        ({"chi_squared": 42.1}, False),
        ({"figures": make_result().figures[:-1]}, False),
        ({"figures": (Figure("C0Y", 1.0, 0.0, "rad"), *make_result().figures[1:])}, False),
        ({"curves": with_unknown(make_result()).curves}, False),
        ({"standard_uncertainty": with_unknown(make_result()).standard_uncertainty}, False),
    ],
)
def test_what_processors_round_otherwise_is_no_other_result(changes, same):
    for first in (make_result(), with_unknown(make_result())):
        assert same_but_for_rounding(first, first)
    assert same_but_for_rounding(make_result(), replace(make_result(), **changes)) is same


def test_minus_zero_is_not_zero():
    first = replace(make_result(), chi_squared=0.0)
    assert not same_to_the_last_bit(first, replace(first, chi_squared=-0.0))


def test_least_squares_is_the_result_to_rely_on():
    report = make_report(results=make_report().results[::-1])
    assert [result.method for result in report.ordered_results()] == [
        "conventional",
        "setup_robust",
        "least_squares",
    ]
    assert report.preferred().method == "least_squares"
    assert make_report(results=()).preferred() is None
