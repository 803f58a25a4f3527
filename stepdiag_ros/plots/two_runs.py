"""Two measurements of one machine: each curve before and after, and E_n at every node."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stepdiag_ros.evaluation.report import ZERO_BY_DEFINITION
from stepdiag_ros.metrology.agreement import CurveChange, MachineChanges
from stepdiag_ros.metrology.geometry import ROTATIONS, TRANSLATIONS
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.curves import curve_words, grid_of, shown_unit
from stepdiag_ros.plots.panel import Panel
from stepdiag_ros.plots.style import (
    AFTER,
    BEFORE,
    BLACK,
    Sheet,
    Style,
    band,
    curve,
    panel_title,
    say_unknown,
    scales,
    zero_line,
)

COVERAGE = 2.0
"""k of the bands and of E_n (ISO 13528)."""
_AGREES = Style(BLACK, "o", "-")
_DIFFERS = Style(BEFORE.colour, "X", "none")
_CURVE_HEIGHT, _E_N_HEIGHT = 1.25, 0.5
_TO_E_N, _TO_NEXT = 0.1, 0.45
"""Gap below a curve and below its E_n, inches."""


def changes(
    changes: MachineChanges,
    names: Sequence[str] | None = None,
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw every curve before and after with U (k = 2), and below it E_n with its limits ±1.

    Args:
        changes: of two measurements.
        names: ISO 230-1 names of curves; the nine translations if not given.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure: a row of curves, the row of their E_n, and so on.

    Raises:
        ValueError: the two have none of these curves in common.
    """
    known = {one.name: one for one in changes.curves}
    shown = grid_of(TRANSLATIONS if names is None else names)
    if not any(name in known for name in shown):
        raise Refusal(
            f"the two measurements have none of {', '.join(shown)} in common", fault="mismatch"
        )
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    heights = [_CURVE_HEIGHT, _E_N_HEIGHT] * rows
    count = 2 * columns * (rows - 1) + columns + (len(shown) - columns * (rows - 1))
    between = ([_TO_E_N, _TO_NEXT] * rows)[:-1]
    sheet = Sheet(count, columns, heights, axes=axes, gap=(0.5, between), bottom=0.4)
    for number, name in enumerate(shown):
        row, column = divmod(number, columns)
        upper = sheet.panels[2 * columns * row + column]
        lower = sheet.panels[2 * columns * row + columns + column]
        panel_title(upper, curve_words(name))
        if column == 0:
            scales(upper, up=f"error / {shown_unit(name)}")
            scales(lower, up="E_n")
        if row == rows - 1:
            scales(lower, f"{name[3]} / mm")
        if isinstance(upper, Panel):
            upper.xaxis.numbered = False
        _draw(upper, lower, known.get(name))
    turned = set(shown) <= set(ROTATIONS)
    heading = f"{'Rotations' if turned else 'Translational errors'} before and after"
    said = [
        "Bands: U (k = 2). E_n: difference by its U; within ±1 (grey) the two agree. One node in"
        " twenty is outside by chance."
    ]
    return sheet.finish(heading if title is None else title, small_print=said, stamp=stamp)


def _draw(upper: Axes, lower: Axes, one: CurveChange | None) -> None:
    lower.axhspan(-1.0, 1.0, color="0.88", zorder=0)
    lower.sharex(upper)
    zero_line(upper)
    zero_line(lower)
    if one is None:
        say_unknown(upper, "not in both")
        say_unknown(lower, "")
        return
    place = one.positions * IN_MILLI
    drawn = False
    for values, uncertainty, style, label in (
        (one.before, one.before_uncertainty, BEFORE, "before"),
        (one.after, one.after_uncertainty, AFTER, "after"),
    ):
        if np.any(np.isfinite(values) & ~(uncertainty <= ZERO_BY_DEFINITION)):
            drawn = True
            band(upper, place, values * IN_MICRO, uncertainty * IN_MICRO, style, COVERAGE)
            curve(upper, place, values * IN_MICRO, style, label)
    if not drawn:
        say_unknown(upper)
    error = one.normalised_error
    if not np.any(np.isfinite(error)):
        say_unknown(lower, "unknown")
        return
    outside = np.abs(error) > 1.0
    curve(lower, place, error, _AGREES, "E_n", markersize=2.0, linewidth=0.8)
    if np.any(outside):
        label = "E_n beyond ±1"
        curve(lower, place[outside], error[outside], _DIFFERS, label, markersize=4.5)
    reach = 1.15 * max(1.3, float(np.nanmax(np.abs(error))))
    lower.set_ylim(-reach, reach)
