"""Figures of a machine over its years: runs, line, control limits, tolerance and changes."""

from datetime import datetime, timedelta
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Picture

from stepdiag_ros.archive.histories import FigureHistory, MachineHistory, date_of
from stepdiag_ros.plots.style import (
    AFTER,
    BEFORE,
    GREEN,
    GREY,
    Sheet,
    band,
    curve,
    panel_title,
    scales,
    zero_line,
)
from stepdiag_ros.words.diagnosis import readable_unit
from stepdiag_ros.words.trends import crossing_words, history_sentence

_YEAR = timedelta(days=365.2425)
_NARROW = 0.5
"""Years: a shorter history gets a time axis of its own."""
_LEAST = 0.1
"""Years on both sides of the middle of such an axis, at least."""


def years_of_machine(
    machine: MachineHistory, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Picture:
    """Draw each figure of a machine over the date, with U, line, limits and changes.

    Args:
        machine: any.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: one for each figure instead of a new figure.
    """
    sheet = Sheet(len(machine.figures), 2, 1.5, axes=axes, gap=(0.6, 0.75))
    for panel, figure in zip(sheet.panels, machine.figures, strict=True):
        _draw(panel, figure)
    prints = [
        "Bars: U (95 %) of each run; band: U of the level. Dashed: control limits (99.73"
        " %). Vertical: changes; a cross is a run that stands alone. Dotted: tolerance.",
        "Values as measured, in grey; in colour without the influence of temperature, season and"
        " instrument.",
    ]
    heading = history_sentence(machine) if title is None else title
    return sheet.finish(heading, legend=False, small_print=prints, stamp=stamp)


def _draw(panel: Any, figure: FigureHistory) -> None:
    unit, factor = readable_unit(figure.unit)
    trend = figure.trend
    years = np.array([_year_of(one) for one in figure.times])
    values = np.array(figure.values) * factor
    known = trend.unknown == ""
    shown = trend.adjusted * factor if known else values
    zero_line(panel)
    panel.plot(years, values, ".", color=GREY, markersize=3.0)
    panel.errorbar(
        years,
        shown,
        yerr=np.nan_to_num(figure.expanded) * factor,
        fmt=AFTER.marker,
        color=AFTER.colour,
        markersize=2.5,
        linewidth=0.7,
    )
    for limit in (-figure.tolerance, figure.tolerance):
        if np.isfinite(limit) and np.any(np.abs(shown) > 0.5 * figure.tolerance * factor):
            panel.axhline(limit * factor, color=GREEN, linestyle=":", linewidth=1.0)
    if known:
        line = trend.line * factor
        curve(panel, years, line, BEFORE, "", marker="", linestyle="-")
        band(panel, years, line, trend.line_expanded * factor, BEFORE, coverage=1.0)
        for limit in trend.limits:
            beside = line + (limit - trend.level) * factor
            panel.plot(years, beside, color=GREY, linestyle="--", linewidth=0.8)
    for change in trend.changes:
        if change.kind == "alone":
            panel.plot(years[change.run], shown[change.run], "x", color=BEFORE.colour)
        else:
            ends = [_year_of(date_of(one)) for one in (change.earliest, change.latest)]
            panel.axvspan(*ends, color=BEFORE.colour, alpha=0.25, linewidth=0.0)
    middle, wide = 0.5 * (years[0] + years[-1]), years[-1] - years[0]
    if wide < _NARROW:
        # Runs of one day would stand in a scale of centuries.
        half = max(0.55 * wide, _LEAST)
        panel.set_xlim(middle - half, middle + half)
        panel.ticklabel_format(axis="x", useOffset=False)
        panel.locator_params(axis="x", nbins=4)
    told = "too few runs" if trend.unknown else crossing_words(trend)
    panel_title(panel, f"{figure.name}\noutside: {told}")
    scales(panel, "year", f"{figure.name.split(':')[0]} / {unit}" if unit else figure.name)


def _year_of(date: datetime) -> float:
    begins = date.replace(month=1, day=1, hour=0, minute=0, second=0, microsecond=0)
    return date.year + (date - begins) / _YEAR
