"""Figures as weights on the curves, also where two nodes compete for the end of a range."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.agreement.measured import (
    ComparedMeasurement,
    figure_weights,
    with_curves,
)
from stepdiag_ros.metrology.agreement.shared import cross_covariance, shared_sources
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve


@pytest.fixture(scope="module")
def result():
    return solve(simulate(make_plan(), make_cell()), "least_squares")


def tied(result):
    """Return the result with two nodes of E_ZX that are largest to within a picometre."""
    curves = {name: values.copy() for name, values in result.curves.items()}
    curves["E_ZX"] = np.array([0.0, 1.0, -1.0, 1.0 + 1e-6, -1.0, 1.0, 0.0]) * 1e-6
    return with_curves(result, np.concatenate(list(curves.values())))


def test_weights_of_a_range_are_those_of_two_nodes_however_close_others_are(result):
    (weights,) = figure_weights(tied(result), ["straightness E_ZX"], "YXZ")
    before = list(result.curves).index("E_ZX")
    start = sum(len(one) for one in list(result.curves.values())[:before])
    own = weights[start : start + len(result.curves["E_ZX"])]
    # A shift or a tilt of the curve changes no straightness.
    assert np.sum(own) == pytest.approx(0.0, abs=1e-12)
    assert own @ np.arange(len(own)) == pytest.approx(0.0, abs=1e-12)
    assert np.count_nonzero(weights) == np.count_nonzero(own)


def test_weights_times_curves_are_the_figures(result):
    names = [one.name for one in result.figures if not one.name.startswith(("tilt", "diagonal"))]
    weights = figure_weights(result, names, "YXZ")
    told = [result.figure(name).value for name in names]
    assert weights @ np.concatenate(list(result.curves.values())) == pytest.approx(told)


def test_unknown_curves_leave_no_weights(result):
    curves = {**result.curves, "E_ZX": np.full_like(result.curves["E_ZX"], np.nan)}
    weights = figure_weights(replace(result, curves=curves), ["straightness E_ZX", "C0Y"], "YXZ")
    assert not np.any(weights[0]) and np.any(weights[1])


def test_no_difference_of_two_measurements_is_certain(result):
    measured = simulate(make_plan(), make_cell())
    rng = np.random.default_rng(0)
    size = len(result.covariance)
    both = []
    for scale in (1.0, 9.0):
        root = 1e-7 * np.sqrt(scale) * rng.standard_normal((size, 4))
        whole = result.readings_covariance + root @ root.T
        both.append(ComparedMeasurement(replace(result, covariance=whole), "YXZ", measured))
    shared = cross_covariance(both[0], both[1], shared_sources(both[0], both[1], True))
    assert np.any(shared)
    for _ in range(50):
        one, other = rng.standard_normal((2, size))
        left, right = (
            row @ each.result.covariance @ row for row, each in zip((one, other), both, strict=True)
        )
        assert left + right - 2.0 * one @ shared @ other > 0.0
