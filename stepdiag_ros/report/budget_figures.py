"""The pictures of an uncertainty budget: what each group of sources adds to each result.

Contributions add in squares. A bar is as long as the combined standard uncertainty, and is divided
in proportion to the squares: a colour's share of a bar is its share of the variance.
"""

from typing import TYPE_CHECKING

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.solvers.observations import Integers
from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.source import GROUPS
from stepdiag_ros.report.budget import BudgetReport, figure_groups, short_name, unit_of
from stepdiag_ros.report.content import method_title
from stepdiag_ros.report.figures import legend_below, new_picture, tidy
from stepdiag_ros.report.numbers import MICRO

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

_COLOURS = dict(
    zip(
        GROUPS,
        (
            "#0072B2",
            "#56B4E9",
            "#999999",
            "#D55E00",
            "#E69F00",
            "#009E73",
            "#F0E442",
            "#000000",
            "#CC79A7",
        ),
        strict=True,
    )
)
_SMALL_PRINT = (
    "The whole is the combined standard uncertainty; a colour's share of it is its share of the"
    " variance."
)
_LOWER = "≥: a source that acts here is not known."


def figures_picture(report: BudgetReport) -> "Picture":
    """Draw the contributions to all figures: one panel a kind, one bar a figure."""
    budget = report.budget
    groups = figure_groups(budget)
    heights = [len(rows) for rows in groups.values()]
    picture = new_picture(11.0, 2.2 + 0.33 * sum(heights) + 0.55 * len(heights))
    panels = picture.subplots(
        len(heights), 1, squeeze=False, gridspec_kw={"height_ratios": heights}
    )[:, 0]
    shares = _shares(budget)
    combined = budget.standard_uncertainty * MICRO
    for axes, (title, rows) in zip(panels, groups.items(), strict=True):
        places = np.arange(len(rows))
        left = np.zeros(len(rows))
        for group, share in shares.items():
            length = share[rows] * combined[rows]
            axes.barh(places, length, left=left, color=_COLOURS[group], height=0.7, label=group)
            left = left + length
        for place, row in zip(places, rows, strict=True):
            bound = "≥ " if budget.at_least[row] else ""
            text = f" {bound}{combined[row]:#.3g}"
            axes.text(left[place], place, text, va="center", fontsize=8)
        quantity = budget.sensitivity.quantities[rows[0]]
        names = [short_name(budget.sensitivity.quantities[row].name) for row in rows]
        axes.set_yticks(places, names, fontsize=8)
        axes.invert_yaxis()
        axes.set_xlim(0.0, 1.12 * max(float(np.max(left)), 1e-12))
        tidy(axes)
        unit = unit_of(quantity.name, quantity.unit)
        axes.set_title(f"{title}: standard uncertainty / {unit}", fontsize=9, loc="left")
    picture.suptitle(_title(report, "Uncertainty budget"), fontsize=11)
    legend_below(picture, panels, _print(budget))
    return picture


def curves_picture(report: BudgetReport) -> "Picture":
    """Draw the contributions to the curves over the nodes: a panel a curve."""
    budget = report.budget
    names = budget.sensitivity.estimator.names
    rows = len(names) // len(AXES)
    picture = new_picture(11.0, 1.6 + 2.3 * rows)
    grid = picture.subplots(rows, len(AXES), sharex="col", squeeze=False)
    shares = _shares(budget)
    combined = budget.standard_uncertainty * MICRO
    volume = budget.sensitivity.observations.volume
    for axis, letter in enumerate(AXES):
        mine = [name for name in names if name[3] == letter]
        nodes = volume.nodes(axis) * 1e3
        for row, name in enumerate(mine):
            axes = grid[row][axis]
            unit = "µrad" if name[2] in "ABC" else "µm"
            places = _places(budget, name, len(nodes))
            known = np.flatnonzero(places >= 0)
            if len(known):
                layers = [
                    _over_nodes(share * combined, places, len(nodes)) for share in shares.values()
                ]
                axes.stackplot(
                    nodes,
                    layers,
                    colors=[_COLOURS[group] for group in shares],
                    labels=list(shares),
                    linewidth=0,
                )
            else:
                axes.text(0.5, 0.5, "not determined", transform=axes.transAxes, ha="center")
            tidy(axes)
            axes.set_ylim(bottom=0.0)
            lower = " (≥)" if np.any(budget.at_least[places[known]]) else ""
            axes.set_title(f"{name}: standard uncertainty / {unit}{lower}", fontsize=9)
            if row == rows - 1:
                axes.set_xlabel(f"{letter} / mm", fontsize=9)
    picture.suptitle(_title(report, "Uncertainty budget of the error curves"), fontsize=11)
    legend_below(picture, grid.ravel(), _print(budget))
    return picture


def draw_budget(report: BudgetReport) -> "dict[str, Picture]":
    """Return all pictures of a budget by the name of their file without ending."""
    return {"budget": figures_picture(report), "budget_curves": curves_picture(report)}


def _title(report: BudgetReport, title: str) -> str:
    budget = report.budget
    lines = [f"{title}: {method_title(budget.method)}", budget.instrument]
    return "\n".join(line for line in lines if line)


def _print(budget: Budget) -> list[str]:
    return [_SMALL_PRINT, *([_LOWER] if np.any(budget.at_least) else [])]


def _shares(budget: Budget) -> dict[str, Vector]:
    """Return the share of each group in the variance; of groups that act at all."""
    variance = np.diag(budget.covariance)
    found: dict[str, Vector] = {}
    for group in GROUPS:
        mine = [row for row, source in enumerate(budget.sources) if source.group == group]
        squares = np.sum(np.nan_to_num(budget.contributions[mine]) ** 2, axis=0)
        if np.any(squares > 0.0):
            found[group] = squares / np.where(variance > 0.0, variance, 1.0)
    return found


def _places(budget: Budget, name: str, count: int) -> Integers:
    places = np.full(count, -1, dtype=np.int64)
    for row, quantity in enumerate(budget.sensitivity.quantities):
        if quantity.curve == name:
            places[quantity.node] = row
    return places


def _over_nodes(values: Vector, places: Integers, count: int) -> Vector:
    """Return values at the nodes, zero where the frame or the data leave nothing."""
    found = np.zeros(count)
    found[places >= 0] = values[places[places >= 0]]
    return found
