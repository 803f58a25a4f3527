"""Effects over the dates of the runs: the size of each, with its band, and what explains it."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure as Picture

from stepdiag_ros.evaluation.history import MONTH, HistoryReport
from stepdiag_ros.metrology.discrepancy.history import EffectHistory
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.plots.style import (
    AFTER,
    GREY,
    Sheet,
    panel_title,
    say_unknown,
    scales,
    zero_line,
)
from stepdiag_ros.words.diagnosis import readable

_EXPLAINS = {"color": GREY, "linestyle": "--", "marker": "_", "linewidth": 0.8}
_WHOLE_TITLE = 60
"""Letters of a label that fit above a panel."""


def sizes_over_dates(
    report: HistoryReport, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Picture | None:
    """Draw the size of each effect over the date, with its 95 % coverage interval.

    A line shows what explains them: one size, one size in some runs, or a steady change. None where
    no run names or describes an effect.

    Args:
        report: of runs at several times.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: one for each effect instead of a new figure.
    """
    if not report.effects:
        return None
    first = report.runs[0].start
    months = np.array([(run.start - first) / MONTH for run in report.runs])
    sheet = Sheet(len(report.effects), 2, 1.6, axes=axes, gap=(0.7, 0.75))
    for panel, effect in zip(sheet.panels, report.effects, strict=True):
        _draw(panel, effect, months)
        label = effect.label
        short = label if len(label) <= _WHOLE_TITLE else f"{label[: _WHOLE_TITLE - 1]}…"
        panel_title(panel, f"{short}\n{effect.course.kind}")
        unit, _ = readable(effect.figure)
        shown = f"({unit})" if "/" in unit else unit
        scales(panel, f"months since {first:%Y-%m-%d}", f"size / {shown}" if unit else "size")
    heading = "Effects from run to run" if title is None else title
    prints = ["Bars are 95 % coverage intervals; grey: what explains the sizes."]
    return sheet.finish(heading, legend=False, small_print=prints, stamp=stamp)


def _draw(panel: Any, effect: EffectHistory, months: Vector) -> None:
    _, factor = readable(effect.figure)
    course = effect.course
    values = np.array([one.value for one in course.sizes]) * factor
    known = np.isfinite(values)
    if not np.any(known):
        say_unknown(panel)
        return
    half = np.array([0.5 * (one.band[1] - one.band[0]) for one in course.sizes]) * factor
    zero_line(panel)
    panel.plot(months, np.array(course.explained) * factor, **_EXPLAINS)
    panel.errorbar(
        months[known],
        values[known],
        yerr=half[known],
        fmt=AFTER.marker,
        color=AFTER.colour,
        markersize=3.0,
        linewidth=1.0,
        capsize=2.0,
    )
