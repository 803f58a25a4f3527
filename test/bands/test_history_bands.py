"""What differs from run to run is told from what stays, on worst plausible machines."""

import numpy as np
import pytest
from plausible_machines import draw

from stepdiag_ros.evaluation.scatter import (
    layout_digest,
    scatter_of_figures,
    scatter_of_largest,
)
from stepdiag_ros.metrology.geometry import SQUARENESS
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.trends.series import Series
from stepdiag_ros.metrology.trends.trend import trend_of

DAYS = 20
LARGEST = "largest"


def followed(machine, method):
    """Return figure → value, standard uncertainty and scatter of each day; (days, 3)."""
    plan, found = machine.steps(), {}
    for day in range(DAYS):
        measured = machine.measure(plan, day=day)
        result = solve(measured, method)
        scatter = scatter_of_figures(result, machine.chain)
        for one in result.figures:
            if one.name in SQUARENESS or one.name.startswith("straightness"):
                row = one.value, one.standard_uncertainty, scatter[one.name]
                found.setdefault(one.name, []).append(row)
        largest = of_result(result, machine.chain, measured.plausible)
        row = largest.value, largest.standard_uncertainty
        scattering = scatter_of_largest(result, machine.chain)
        found.setdefault(LARGEST, []).append((*row, scattering))
    return {name: np.array(rows) for name, rows in found.items()}


def level_of(rows, separated):
    """Return the trend of a figure, with the systematic part of its uncertainty apart or not."""
    value, whole, scatter = rows.T
    unknown = np.full(len(value), np.nan)
    stays = np.sqrt(np.maximum(whole**2 - scatter**2, 0.0)) * separated
    return trend_of(
        Series(
            np.linspace(0.0, 1.0, len(value)),
            value,
            scatter if separated else whole,
            unknown,
            unknown,
            ["laser"] * len(value),
            systematic=stays,
        )
    )


@pytest.mark.parametrize("method", ["setup_robust", "least_squares"])
@pytest.mark.parametrize("machines", [4, 16], ids=["few", "many"])
def test_levels_contain_what_stays_and_runs_scatter_as_is_stated(machines, method):
    ratios, inside, before, changed = [], [], [], []
    for seed in range(machines):
        machine = draw(seed)
        truth = machine.truth(machine.steps().volume).figures
        for name, rows in followed(machine, method).items():
            ratios.append(np.var(rows[:, 0], ddof=1) / np.mean(rows[:, 2] ** 2))
            assert np.all(rows[:, 2] < rows[:, 1])
            changed.append(bool(level_of(rows, True).changes))
            if name == LARGEST:
                continue
            for levels, separated in ((inside, True), (before, False)):
                trend = level_of(rows, separated)
                levels.append(abs(trend.level - truth[name]) <= trend.level_expanded)
    assert 0.75 < np.sqrt(np.mean(ratios)) < 1.25
    assert np.mean(inside) >= 0.95
    assert np.mean(changed) <= 0.05
    # Taken as another error each day, rotations make a level seem better known with every run.
    assert np.mean(before) < 0.9


def test_a_step_that_the_stated_uncertainty_would_hide_is_found():
    rows = followed(draw(1), "least_squares")["C0Y"]
    many = np.tile(rows, (2, 1))
    many[DAYS:, 0] += 6.0 * np.sqrt(np.mean(rows[:, 2] ** 2))
    assert [one.run for one in level_of(many, True).changes] == [DAYS]


def test_a_layout_is_that_of_box_and_lines_and_of_nothing_else():
    machine = draw(2)
    steps, orders = machine.steps(), machine.orders()
    first, later = (machine.measure(steps, day=day) for day in (0, 1))
    assert layout_digest(first) == layout_digest(later)
    assert layout_digest(first) == layout_digest(machine.measure(machine.steps(passes=3)))
    assert layout_digest(first) != layout_digest(machine.measure(orders))
