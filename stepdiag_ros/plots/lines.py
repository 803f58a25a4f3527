"""What the lines say: blocks, readings in time with their windows, repeatability, whole lines."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import (
    BlockDisplacement,
    MeasuredLine,
    Measurement,
    Reading,
    SettledStop,
)
from stepdiag_ros.metrology.plan import FORWARD as FORWARD_SENSE
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.repeats import line_errors as errors_of_lines
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI, NANO
from stepdiag_ros.plots.panel import Panel
from stepdiag_ros.plots.style import (
    BACKWARD,
    BLUE,
    COLOURS,
    FORWARD,
    GREY,
    VERMILION,
    Sheet,
    Style,
    panel_title,
    scales,
    zero_line,
)

_COLUMNS = 4
_PANEL_HEIGHT = 1.3
_AXIS_STYLES = {
    "X": Style(BLUE, "o", "-"),
    "Y": Style(VERMILION, "s", "-"),
    "Z": Style("#009E73", "^", "-"),
}
_OTHER_MOVES = Style(COLOURS[6], "D", "-")
_MOST_POINTS = 4000
"""Readings that are drawn one by one; of more, the range in each slice of time."""


def add_lines(axes: Axes, curves: Sequence[Vector], style: Style, width: float = 0.8) -> None:
    """Draw many curves of one look as one artist; each an array of shape (n, 2).

    Gaps are left at NaN.
    """
    if not curves:
        return
    axes.add_collection(
        LineCollection(
            curves, colors=style.colour, linestyles=style.line, linewidths=width, alpha=0.85
        ),
        autolim=False,
    )
    points = np.concatenate(curves)
    axes.update_datalim(points[np.all(np.isfinite(points), axis=1)])
    axes.autoscale_view()


def sample(style: Style, width: float = 1.2) -> Line2D:
    """Return a line for the legend."""
    line = Line2D([], [], color=style.colour, linewidth=width)
    line.set_linestyle(style.line)
    return line


def block_displacements(
    blocks: Sequence[BlockDisplacement],
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw what each move reads beyond its nominal displacement, a panel for each line.

    Args:
        blocks: of a run (``RecordedRun.blocks``).
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each line, instead of a new figure.

    Raises:
        ValueError: there is no block.
    """
    names = list(dict.fromkeys(one.line.name for one in blocks))
    if not names:
        raise Refusal(
            "there is no block, so no displacement can be drawn", fault="too_few", aspect="block"
        )
    sheet = Sheet(len(names), _COLUMNS, _PANEL_HEIGHT, axes=axes, share_up=True, gap=(0.2, 0.55))
    drawn: dict[str, Any] = {}
    for number, (panel, name) in enumerate(zip(sheet.panels, names, strict=True)):
        own = [one for one in blocks if one.line.name == name]
        for axis in dict.fromkeys(one.axis for one in own):
            style = _AXIS_STYLES.get(axis, _OTHER_MOVES)
            label = f"moves of {axis}" if axis in _AXIS_STYLES else "moves of several axes at once"
            moves = [one for one in own if one.axis == axis]
            (line,) = panel.plot(
                [one.block for one in moves],
                [excess_of(one) * IN_MICRO for one in moves],
                color=style.colour,
                marker=style.marker,
                markersize=2.2,
                linestyle="none",
                alpha=0.8,
                label=label,
            )
            drawn.setdefault(label, line)
        zero_line(panel)
        panel_title(panel, name)
        if isinstance(panel, Panel):
            panel.count_across()
        up = "excess / µm" if sheet.first_in_row(number) else ""
        scales(panel, "block" if sheet.last_in_column(number) else "", up)
    heading = "By how much every move reads longer than its nominal displacement, all passes"
    return sheet.finish(heading if title is None else title, stamp=stamp)


def excess_of(block: BlockDisplacement) -> float:
    """Return by how much longer a move reads than nominal, m, whichever way it was run."""
    return (block.displacement - block.nominal_displacement) * float(
        np.sign(block.nominal_displacement)
    )


def readings(
    readings: Iterable[Reading],
    stops: Sequence[SettledStop],
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw the readings of a line in time, with the windows that the stops were taken from.

    Args:
        readings: of the run, in order of time (``RecordedRun.readings()``); those from a little
            before the first window to a little after the last are drawn.
        stops: of one line.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.

    Raises:
        ValueError: there is no stop, or no reading at the time of the stops.
    """
    begin, time, length, compensated = _around(readings, stops)
    sheet = Sheet(1, 1, 2.6, axes=axes)
    (panel,) = sheet.panels
    _draw_readings(panel, time, length * IN_MILLI)
    for one in stops:
        _mark_window(panel, one, begin)
    settled = [one for one in stops if one.settled]
    panel.plot(
        [0.5 * ((one.window_start - begin) + (one.window_end - begin)) * NANO for one in settled],
        [(one.displacement if compensated else one.raw_displacement) * IN_MILLI for one in settled],
        color=VERMILION,
        marker="_",
        markersize=5.0,
        linestyle="none",
        label="value of the stop",
    )
    what = "displacement / mm" if compensated else "displacement in vacuum wavelengths / mm"
    scales(panel, "time since the first window / s", what)
    heading = f"Readings of {_of_line(stops)}, with the settled windows"
    rejected = len(stops) - len(settled)
    said = [f"{rejected} of {len(stops)} stops were rejected."] if rejected else []
    return sheet.finish(heading if title is None else title, small_print=said, stamp=stamp)


def settling(
    readings: Iterable[Reading],
    stops: Sequence[SettledStop],
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw a few stops in time: first all of them, then each enlarged about its own value.

    Args:
        readings: of the run, in order of time; those around the stops are drawn.
        stops: some of one line that follow each other.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one more than there are stops, instead of a new figure.

    Raises:
        ValueError: there is no stop, or no reading at the time of the stops.
    """
    approach = max((one.window_end - one.window_start for one in stops), default=0)
    begin, time, length, compensated = _around(readings, stops, approach)
    sheet = Sheet(1 + len(stops), _COLUMNS, 1.5, axes=axes, gap=(0.5, 0.55))
    whole, *enlarged = sheet.panels
    _draw_readings(whole, time, length * IN_MILLI)
    for one in stops:
        _mark_window(whole, one, begin)
    panel_title(whole, f"{len(stops)} stops")
    scales(whole, "time / s", "displacement / mm")
    spreads = []
    for number, (panel, one) in enumerate(zip(enlarged, stops, strict=True)):
        value = one.displacement if compensated else one.raw_displacement
        first, last = ((moment - begin) * NANO for moment in (one.window_start, one.window_end))
        start, end = first - 1.2 * (last - first), last + 0.3 * (last - first)
        near = (time >= start) & (time <= end)
        # A rejected stop has no value: it is shown from the mean of its window.
        inside = (time >= first) & (time <= last)
        if not np.isfinite(value) and np.any(inside):
            value = float(np.mean(length[inside]))
        less = (length - value) * IN_MICRO
        panel.plot(time[near], less[near], color="0.3", linewidth=0.7, label="reading")
        spreads.append(float(np.max(np.abs(less[inside]), initial=0.0)))
        _mark_window(panel, one, begin)
        panel.set_xlim(start, end)
        zero_line(panel)
        panel_title(panel, f"stop {one.command.stop}")
        scales(panel, "time / s", "from its value / µm" if number == 0 else "")
    reach = 4.0 * max(spreads)
    for panel in enlarged if reach > 0.0 else ():
        panel.set_ylim(-reach, reach)
    heading = f"{_of_line(stops)}: readings around a few stops"
    said = "Time since the first window. Line at 0: mean of the window, the value of the stop."
    return sheet.finish(heading if title is None else title, small_print=[said], stamp=stamp)


def _around(
    readings: Iterable[Reading], stops: Sequence[SettledStop], least_margin: int = 1
) -> tuple[int, Vector, Vector, bool]:
    """Return the readings from a little before the first window to a little after the last.

    Returns:
        Begin of the first window, ns; time since then, s; displacement, m; whether that is
        compensated for the air.
    """
    if not stops:
        raise Refusal(
            "there is no stop, so it is not known which readings to draw",
            fault="too_few",
            aspect="stop",
        )
    begin = min(one.window_start for one in stops)
    end = max(one.window_end for one in stops)
    margin = max((end - begin) // 50, least_margin)
    found = [
        (one.time, one.raw_displacement, one.compensated_displacement)
        for one in readings
        if begin - margin <= one.time <= end + margin
    ]
    if not found:
        raise Refusal("the run holds no reading at the time of these stops", fault="missing")
    time = np.array([one[0] - begin for one in found], dtype=np.float64) * NANO
    values = np.array([one[1:] for one in found], dtype=np.float64)
    compensated = bool(np.all(np.isfinite(values[:, 1])))
    return begin, time, values[:, 1] if compensated else values[:, 0], compensated


def _mark_window(axes: Axes, stop: SettledStop, begin: int) -> None:
    colour, hatch = (BLUE, None) if stop.settled else (VERMILION, "///")
    axes.axvspan(
        (stop.window_start - begin) * NANO,
        (stop.window_end - begin) * NANO,
        facecolor=colour,
        edgecolor=colour,
        hatch=hatch,
        alpha=0.25,
        linewidth=0.0,
        label="window of a settled stop" if stop.settled else "rejected stop",
    )


def _of_line(stops: Sequence[SettledStop]) -> str:
    line = stops[0].line
    words = " ".join(part for part in (line.name, line.order, line.direction) if part)
    return f"line {words}, repeat {line.repeat + 1}"


def _draw_readings(axes: Axes, time: Vector, values: Vector) -> None:
    if len(time) <= _MOST_POINTS:
        axes.plot(time, values, color="0.3", linewidth=0.7, label="reading")
        return
    slices = np.array_split(np.arange(len(time)), _MOST_POINTS // 4)
    middle = np.array([time[one].mean() for one in slices])
    low = np.array([values[one].min() for one in slices])
    high = np.array([values[one].max() for one in slices])
    axes.fill_between(
        middle, low, high, color="0.3", linewidth=0.7, label="readings, range in each slice of time"
    )


def repeatability(
    measurement: Measurement,
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure | None:
    """Draw how well the passes of each line repeat; None without lines.

    Each panel is one setup (one alignment and zero): every pass less the mean of all passes at the
    same stop, so that noise, drift, and the difference between forward and backward show alone.

    Args:
        measurement: of a run.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each setup, instead of a new figure.
    """
    setups = list(dict.fromkeys(line.setup for line in measurement.lines))
    if not setups:
        return None
    sheet = Sheet(len(setups), _COLUMNS, _PANEL_HEIGHT, axes=axes, share_up=True, gap=(0.2, 0.55))
    for number, (panel, setup) in enumerate(zip(sheet.panels, setups, strict=True)):
        _draw_setup(panel, [line for line in measurement.lines if line.setup == setup])
        panel_title(panel, setup)
        if isinstance(panel, Panel):
            panel.count_across()
        up = "from mean / µm" if sheet.first_in_row(number) else ""
        scales(panel, "stop" if sheet.last_in_column(number) else "", up)
    heading = "Repeatability: every pass less the mean of all passes of its setup"
    return sheet.finish(
        heading if title is None else title,
        more=[(sample(FORWARD), "forward"), (sample(BACKWARD), "backward")],
        stamp=stamp,
    )


def passes_from_mean(lines: Sequence[MeasuredLine]) -> Vector:
    """Return passes of one setup less their mean at each stop, m, shape (passes, stops).

    Backward passes are turned round, so that a column is a place; NaN where nothing was measured.
    """
    passes = [
        line.displacement if line.line.direction == FORWARD_SENSE else line.displacement[::-1]
        for line in lines
    ]
    table = np.full((len(passes), max(len(values) for values in passes)), np.nan)
    for row, values in zip(table, passes, strict=True):
        row[: len(values)] = values
    known = np.isfinite(table)
    mean = np.where(known, table, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    less: Vector = table - mean
    return less


def _draw_setup(axes: Axes, lines: Sequence[MeasuredLine]) -> None:
    table = passes_from_mean(lines) * IN_MICRO
    stops = np.arange(table.shape[1], dtype=np.float64)
    for style, sense in ((FORWARD, True), (BACKWARD, False)):
        own = [
            np.column_stack([stops, row])
            for line, row in zip(lines, table, strict=True)
            if (line.line.direction == FORWARD_SENSE) == sense
        ]
        add_lines(axes, own, style)
    zero_line(axes)


def line_errors(
    measurement: Measurement,
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw what every line reads beyond its nominal displacement, as KIMM Fig. 2 does.

    Args:
        measurement: of a run.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each line, instead of a new figure.
    """
    lines = errors_of_lines(measurement)
    sheet = Sheet(len(lines), _COLUMNS, _PANEL_HEIGHT, axes=axes, gap=(0.42, 0.55))
    each = Style(GREY, "o", "-")
    for number, (panel, line) in enumerate(zip(sheet.panels, lines, strict=True)):
        path = line.path * IN_MILLI
        add_lines(panel, [np.column_stack([path, one * IN_MICRO]) for one in line.errors], each)
        panel.plot(
            path,
            np.mean(line.errors, axis=0) * IN_MICRO,
            color="black",
            linewidth=1.2,
            label="mean of all passes",
        )
        zero_line(panel)
        panel_title(panel, line.name)
        up = "error / µm" if sheet.first_in_row(number) else ""
        scales(panel, "along the beam / mm" if sheet.last_in_column(number) else "", up)
    under = ["(KIMM, Fig. 2; each pass from its first stop)"]
    heading = "What each line reads beyond its nominal displacement, setup errors included"
    return sheet.finish(
        heading if title is None else title,
        under=under if title is None else (),
        more=[(sample(each), "each pass")],
        stamp=stamp,
    )
