"""Measurements with a tracker: lines in space, deviations, ATLI Figs. 4 and 5."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stepdiag_ros.evaluation.tracker import TrackerReport
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.document_figures import FigureFive, FigureFour
from stepdiag_ros.metrology.tracker.readings import SEVEN_LINES
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.panel import LABEL_SIZE
from stepdiag_ros.plots.space import add_wires, box_edges, frame_box, project
from stepdiag_ros.plots.style import (
    BLACK,
    BLUE,
    COLOURS,
    VERMILION,
    Sheet,
    panel_title,
    scales,
    zero_line,
)
from stepdiag_ros.words.tracker import figure_sentences

_LINE_COLOURS = dict(zip(SEVEN_LINES, COLOURS, strict=False))
_COLUMNS = 4


def tracker_space(
    box: Box,
    stations: Sequence[Vector],
    locating: Vector,
    lines: Mapping[str, Vector],
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw volume, tracker, lines and places in space.

    Args:
        box: where the machine may go.
        stations: places of the tracker, m.
        locating: places from which it is located, or of a grid, m, shape (n, 3).
        lines: name → targets, m, shape (n, 3).
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.
    """
    sheet = Sheet(1, 1, 4.4, axes=axes, left=0.1, right=0.1, bottom=0.05)
    (panel,) = sheet.panels
    low, high = np.asarray(box.low), np.asarray(box.high)
    add_wires(panel, box_edges(low, high), colors="0.6", linewidths=0.8)
    for name, targets in lines.items():
        panel.plot(
            *project(targets).T,
            color=_LINE_COLOURS.get(name, "0.3"),
            marker=".",
            markersize=4,
            linewidth=1.3,
            label=f"line {name}",
        )
    if len(locating):
        panel.plot(
            *project(locating).T,
            marker="s",
            markersize=3.2,
            linestyle="none",
            color="0.35",
            label="places that locate the tracker" if lines else "places",
        )
    for number, station in enumerate(stations, start=1):
        at = project(np.asarray(station))
        label = "tracker" if number == 1 else "_tracker"
        panel.plot(*at, marker="*", markersize=11, linestyle="none", color=BLACK, label=label)
        if len(stations) > 1:
            panel.text(*at, f"  {number}", fontsize=LABEL_SIZE, va="bottom")
    frame_box(panel, low, high)
    heading = "Places of the reflector (machine coordinates)"
    return sheet.finish(heading if title is None else title, stamp=stamp)


def tracker_deviations(
    report: TrackerReport, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the mean deviations along each line, by both places of the tracker.

    Args:
        report: of a seven-line test.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each line, instead of a new figure.

    Raises:
        ValueError: there are no lines.
    """
    result = report.result
    if result is None:
        raise ValueError("there are no lines to draw")
    tests = result.located.tests
    sheet = Sheet(len(tests), _COLUMNS, 1.5, axes=axes, gap=(0.42, 0.6))
    for index, (panel, test) in enumerate(zip(sheet.panels, tests, strict=True)):
        for words, colour, marker, lines in (
            ("places alone", BLUE, "o", result.located),
            ("all readings", VERMILION, "^", result.corrected),
        ):
            if lines is None:
                continue
            own = lines.tests[index]
            for mean, style, sense in (
                (own.mean_forward, "-", "↑"),
                (own.mean_backward, ":", "↓"),
            ):
                if np.any(np.isfinite(mean)):
                    panel.plot(
                        own.target * IN_MILLI,
                        mean * IN_MICRO,
                        color=colour,
                        linestyle=style,
                        marker=marker,
                        markersize=2.6,
                        linewidth=1.1,
                        label=f"tracker from {words}, mean {sense}",
                    )
        panel_title(panel, f"line {test.name} ({test.standard})")
        scales(panel, "target / mm", "deviation / µm" if sheet.first_in_row(index) else "")
    heading = f"Seven-line test, station {report.station}"
    return sheet.finish(heading if title is None else title, stamp=stamp)


def tracker_residuals(
    report: TrackerReport, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the residuals of the places that located the tracker.

    Args:
        report: of a seven-line test.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.
    """
    fit = report.location.adjustment
    sheet = Sheet(1, 1, 2.4, axes=axes)
    (panel,) = sheet.panels
    places = np.arange(len(fit.residuals))
    band = COVERAGE_FACTOR * fit.uncertainty * np.sqrt(fit.redundancy) * IN_MICRO
    if np.all(np.isfinite(band)):
        label = "95 % of residuals"
        panel.bar(places, 2 * band, bottom=-band, width=0.8, color="0.85", label=label)
    panel.plot(
        places,
        fit.residuals * IN_MICRO,
        "o",
        color=BLUE,
        markersize=4.0,
        label="residual",
    )
    zero_line(panel)
    panel.set_xticks(places)
    scales(panel, "place", "length less fit / µm")
    heading = f"Location of the tracker, station {report.station}"
    return sheet.finish(heading if title is None else title, stamp=stamp)


def tracker_document(four: FigureFour, five: FigureFive) -> dict[str, Figure]:
    """Return the computed counterparts of ATLI Figs. 4a and 5a with captions, by name."""
    said = figure_sentences(four, five)
    return {
        "atli_figure_4": _document_figure(
            "ATLI Fig. 4, computed: squareness alone",
            [four.towards, four.away],
            "distance from the line's start / mm",
            said[:1],
        ),
        "atli_figure_5": _document_figure(
            "ATLI Fig. 5, computed: squareness and positioning, tracker located by the machine",
            [five.located, five.true_place],
            "distance from the tracker / mm",
            said[1:],
        ),
    }


def _document_figure(
    title: str, curves: Sequence[Any], along: str, caption: Sequence[str]
) -> Figure:
    sheet = Sheet(1, 1, 3.4)
    (panel,) = sheet.panels
    for one, colour, style in zip(curves, (VERMILION, BLUE), ("-", "--"), strict=True):
        panel.plot(
            one.distance * IN_MILLI,
            one.deviation * IN_MICRO,
            color=colour,
            linestyle=style,
            linewidth=1.5,
            label=one.label,
        )
    zero_line(panel)
    scales(panel, along, "length less ideal length / µm")
    return sheet.finish(title, small_print=caption)
