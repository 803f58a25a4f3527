"""An effect of all axes is not taken for that of one where a run does not separate them."""

from types import SimpleNamespace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.discrepancy import siblings
from stepdiag_ros.metrology.discrepancy.diagnose import diagnose
from stepdiag_ros.metrology.discrepancy.findings import AMBIGUOUS, NAMED
from stepdiag_ros.metrology.simulation import simulate

STEP, TRAVEL = (0.1, 0.08, 0.06), (0.5, 0.4, 0.3)
ALL = {f"backlash of {axis}" for axis in "XYZ"}


def run_of(axes, linear=(), noise=0.3e-6):
    """Return a run on one diagonal, of a machine with 0.6 µm of backlash on some axes."""
    worn = [
        {"effect": "backlash", "setting": {"axis": axis}, "sizes": {"lost_motion": 0.6e-6}}
        for axis in axes
    ]
    plan = make_plan(
        blocks=5,
        step=STEP,
        diagonals=("ppp",),
        linear=linear,
        repeats=5,
        directions=("forward", "backward"),
    )
    return simulate(plan, make_cell(high=TRAVEL, noise=noise, effects=worn), seed=5)


def names_of(diagnosis):
    return {name for one in diagnosis.findings for name in (one.label, *one.ambiguous)}


def test_backlash_of_all_axes_on_one_diagonal_is_not_that_of_one():
    diagnosis = diagnose(run_of("XYZ"))
    assert diagnosis.verdict == AMBIGUOUS and names_of(diagnosis) == ALL


def test_a_line_along_each_axis_separates_them():
    diagnosis = diagnose(run_of("XYZ", linear=("x", "y", "z"), noise=0.1e-6))
    assert diagnosis.verdict == NAMED
    assert {finding.label for finding in diagnosis.findings} == ALL
    for finding in diagnosis.findings:
        low, high = finding.band["lost_motion"]
        assert low < 0.6e-6 < high


def test_backlash_of_one_axis_keeps_its_name_where_lines_show_it():
    diagnosis = diagnose(run_of("Y", linear=("x", "y", "z")))
    assert diagnosis.verdict == NAMED and names_of(diagnosis) == {"backlash of Y"}


def chance_of(values, covariance):
    sizes = SimpleNamespace(
        values={number: np.array([value]) for number, value in enumerate(values)},
        in_order=lambda _: np.array(covariance),
    )
    return siblings._chance(sizes, range(len(values)), 1e6)


def test_the_chance_of_sizes_is_that_of_their_squares():
    # The tail of chi squared with two degrees of freedom is exp(-x/2).
    chance = chance_of([2e-6, 1e-6], np.diag([1e-12, 1e-12]))
    assert chance == pytest.approx(np.exp(-2.5), rel=1e-3)


def test_axes_on_which_an_effect_does_the_same_count_once():
    twice = chance_of([1e-6, 1e-6], np.full((2, 2), 1e-12))
    assert twice == pytest.approx(chance_of([1e-6], [[1e-12]]), rel=1e-6)


def test_sizes_that_are_not_determined_may_be_noise():
    assert chance_of([1e-6], [[np.nan]]) == 1.0
