"""The value of a curve that is farthest from zero, and whether it grows from result to result."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag_ros.viewers.page.results import CurveSection

NAME = "E_YX"


def changed(result, lines, values, spread):
    return replace(
        result,
        lines=lines,
        curves={**result.curves, NAME: np.array(values) * 1e-6},
        standard_uncertainty={**result.standard_uncertainty, NAME: np.array(spread) * 1e-6},
    )


def worst(*results):
    section = CurveSection()
    for result in results:
        section.take(result)
    (curve,) = (one for one in section.document()["curves"] if one["name"] == NAME)
    return curve["worst"]


@pytest.fixture(scope="module")
def result(run):
    return [one for one in run.results if one.method == "least_squares"][-1]


SPREAD = [0.0, 0.1, 0.1, 0.1, 0.1]


def test_it_is_the_one_farthest_from_zero_with_its_own_uncertainty(result):
    told = worst(changed(result, 3, [0.0, 1.0, -2.0, 1.5, 0.5], [0.0, 0.1, 0.2, 0.3, 0.4]))
    node = result.nodes[0][2]
    assert told == {
        "text": "-2.00 ± 0.39 µm",
        "at": pytest.approx(node * 1e3),
        "trend": None,
    }


@pytest.mark.parametrize(
    ("later", "trend"),
    [
        # U of the earlier value is 0.196 µm.
        ([0.0, 1.0, -2.2, 0.0, 0.0], "grows"),
        ([0.0, 2.2, 0.0, 0.0, 0.0], "grows"),
        ([0.0, 1.0, -2.19, 0.0, 0.0], "steady"),
        ([0.0, 1.0, -1.81, 0.0, 0.0], "steady"),
        ([0.0, 1.0, -1.8, 0.0, 0.0], "shrinks"),
    ],
)
def test_it_grows_where_that_is_no_chance(result, later, trend):
    earlier = changed(result, 3, [0.0, 1.0, -2.0, 0.0, 0.0], SPREAD)
    assert worst(earlier, changed(result, 4, later, SPREAD))["trend"] == trend


def test_the_same_result_once_more_is_no_earlier_one(result):
    first = changed(result, 3, [0.0, 1.0, -2.0, 0.0, 0.0], SPREAD)
    second = changed(result, 4, [0.0, 1.0, -3.0, 0.0, 0.0], SPREAD)
    assert worst(first, second, second)["trend"] == "grows"


def test_what_is_not_known_is_not_zero_and_has_no_trend(result):
    nothing = changed(result, 3, [0.0, *[np.nan] * 3, 0.0], [0.0, *[np.nan] * 3, 0.0])
    assert worst(nothing) is None
    part = changed(result, 4, [0.0, 1.0, np.nan, np.nan, 0.0], [0.0, 0.1, np.nan, np.nan, 0.0])
    whole = changed(result, 5, [0.0, 1.0, 5.0, 0.0, 0.0], SPREAD)
    assert worst(part)["text"] == "1.00 ± 0.20 µm"
    assert worst(part, whole)["trend"] is None
    unsure = changed(result, 4, [0.0, 1.0, 2.0, 0.0, 0.0], [0.0, 0.1, np.nan, 0.1, 0.0])
    assert worst(unsure, whole)["trend"] is None
    assert worst(unsure)["text"] == "2.000 µm"


def test_another_method_or_another_run_is_not_compared(result):
    first = changed(result, 3, [0.0, 1.0, -2.0, 0.0, 0.0], SPREAD)
    other = replace(first, method="conventional")
    later = changed(result, 4, [0.0, 1.0, -3.0, 0.0, 0.0], SPREAD)
    assert worst(other, later)["trend"] is None
    section = CurveSection()
    section.take(first)
    section.begin(None)
    section.take(later)
    assert all(one["worst"]["trend"] is None for one in section.document()["curves"])
