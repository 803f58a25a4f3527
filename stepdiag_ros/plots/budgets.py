"""An uncertainty budget: what each group of sources adds to each result.

Contributions add in squares. A bar is as long as the combined standard uncertainty, and is divided
in proportion to the squares: a colour's share of a bar is its share of the variance.
"""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.metrology.geometry import CURVES, Vector, moving_axis
from stepdiag_ros.metrology.solvers.observations import Integers
from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.source import GROUPS
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.curves import grid_of, shown_unit
from stepdiag_ros.plots.panel import LABEL_SIZE
from stepdiag_ros.plots.places import here
from stepdiag_ros.plots.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    YELLOW,
    Sheet,
    panel_title,
    say_unknown,
    scales,
)
from stepdiag_ros.words.budget import figure_groups, short_name, unit_of

_LOOKS = dict(
    zip(
        GROUPS,
        (
            (BLUE, ""),
            (SKY, "//"),
            (GREY, ""),
            (VERMILION, "\\\\"),
            (ORANGE, "..."),
            (GREEN, "||"),
            (YELLOW, ""),
            (BLACK, ""),
            (PURPLE, "++"),
            (GREY, "xx"),
        ),
        strict=True,
    )
)
"""Group of sources → colour and hatch."""
_SMALL_PRINT = (
    "The whole is the combined standard uncertainty u; a colour's share of it is its share of the"
    " variance."
)
_LOWER = "≥: a source that acts here is not known."
_BAR_INCHES = 0.2
_LEAST_BAR_INCHES = 0.11
"""In print, for the words beside a bar."""
_PANEL_TITLE_INCHES = 0.05


def budget(
    budget: Budget, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the contributions to all figures: one panel a kind, one bar a figure.

    Args:
        budget: of a result.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each kind, instead of a new figure.
    """
    groups = figure_groups(budget)
    bar = max(_BAR_INCHES, _LEAST_BAR_INCHES / here().flatness)
    heights = [_PANEL_TITLE_INCHES + bar * len(rows) for rows in groups.values()]
    sheet = Sheet(len(groups), 1, heights, axes=axes, gap=(0.5, 0.5), bottom=0.28)
    shares = shares_of(budget)
    combined = budget.standard_uncertainty * IN_MICRO
    for panel, (words, rows) in zip(sheet.panels, groups.items(), strict=True):
        places = np.arange(len(rows))
        left = np.zeros(len(rows))
        for group, share in shares.items():
            length = share[rows] * combined[rows]
            colour, hatch = _LOOKS[group]
            panel.barh(
                places,
                length,
                left=left,
                color=colour,
                hatch=hatch,
                edgecolor="white",
                linewidth=0.3,
                height=0.72,
                label=group,
            )
            left = left + length
        for place, row in zip(places, rows, strict=True):
            bound = "≥ " if budget.at_least[row] else ""
            text = f" {bound}{combined[row]:#.2g}"
            panel.text(left[place], place, text, va="center", fontsize=LABEL_SIZE - 1.0)
        quantity = budget.sensitivity.quantities[rows[0]]
        names = [short_name(budget.sensitivity.quantities[row].name) for row in rows]
        panel.set_yticks(places, names)
        panel.set_ylim(len(rows) - 0.4, -0.6)
        panel.set_xlim(0.0, 1.14 * max(float(np.max(left)), 1e-12))
        unit = unit_of(quantity.name, quantity.unit)
        panel_title(panel, f"{words}: u / {unit}")
    return _finish(sheet, budget, "Uncertainty budget", title, stamp)


def budget_curves(
    budget: Budget, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the contributions to the curves over the nodes: a panel a curve.

    Args:
        budget: of a result.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each curve, instead of a new figure.
    """
    estimated = budget.sensitivity.estimator.names
    names = [
        name
        for part in (CURVES[:9], CURVES[9:])
        for name in grid_of([one for one in part if one in estimated])
    ]
    sheet = Sheet(len(names), 3, 1.3, axes=axes, gap=(0.45, 0.55))
    shares = shares_of(budget)
    combined = budget.standard_uncertainty * IN_MICRO
    volume = budget.sensitivity.observations.volume
    for panel, name in zip(sheet.panels, names, strict=True):
        nodes = volume.nodes(moving_axis(name)) * IN_MILLI
        places = _places(budget, name, len(nodes))
        known = np.flatnonzero(places >= 0)
        low = np.zeros(len(nodes))
        for group, share in shares.items():
            if not len(known):
                break
            high = low + _over_nodes(share * combined, places, len(nodes))
            colour, hatch = _LOOKS[group]
            panel.fill_between(
                nodes,
                low,
                high,
                facecolor=colour,
                hatch=hatch,
                edgecolor="white",
                linewidth=0.3,
                label=group,
            )
            low = high
        if not len(known):
            say_unknown(panel)
        panel.set_ylim(bottom=0.0)
        lower = " (≥)" if np.any(budget.at_least[places[known]]) else ""
        panel_title(panel, f"{name}: standard uncertainty / {shown_unit(name)}{lower}")
        scales(panel, f"{name[3]} / mm")
    return _finish(sheet, budget, "Uncertainty budget of the error curves", title, stamp)


def _finish(sheet: Sheet, budget: Budget, words: str, title: str | None, stamp: str) -> Figure:
    said = [_SMALL_PRINT] * (title != "") + [_LOWER] * bool(np.any(budget.at_least))
    heading = f"{words}: {method_title(budget.method)}" if title is None else title
    under = [budget.instrument] if budget.instrument and title is None else []
    return sheet.finish(heading, under=under, small_print=said, stamp=stamp)


def shares_of(budget: Budget) -> dict[str, Vector]:
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
