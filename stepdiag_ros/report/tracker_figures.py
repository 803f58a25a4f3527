"""Pictures of measurements with a tracker: lines in space, deviations, ATLI Figs. 4 and 5."""

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.tracker.document_figures import FigureFive, FigureFour
from stepdiag_ros.metrology.tracker.readings import SEVEN_LINES
from stepdiag_ros.metrology.tracker.seven_lines import Box
from stepdiag_ros.report.figures import legend_below, new_picture, tidy
from stepdiag_ros.report.numbers import MICRO
from stepdiag_ros.report.tracker import TrackerReport, figure_sentences

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

_MILLI = 1e3
_PLACES = "#0072B2"
_ALL = "#D55E00"
_LINE_COLOURS = dict(
    zip(
        SEVEN_LINES,
        ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"),
        strict=True,
    )
)
_CAPTION_WIDTH = 115


def space_picture(
    box: Box,
    stations: Sequence[Vector],
    locating: Vector,
    lines: "dict[str, Vector]",
) -> "Picture":
    """Draw volume, tracker, lines and places in space.

    Args:
        box: where the machine may go.
        stations: places of the tracker, m.
        locating: places from which it is located, or of a grid, m, shape (n, 3).
        lines: name → targets, m, shape (n, 3).
    """
    picture = new_picture(8.0, 6.6)
    axes: Any = picture.add_subplot(projection="3d")
    for axis in range(3):
        for edge in _edges(box, axis):
            axes.plot(*(edge.T * _MILLI), color="0.6", linewidth=0.8)
    for name, targets in lines.items():
        axes.plot(
            *(targets.T * _MILLI),
            color=_LINE_COLOURS.get(name, "0.3"),
            marker=".",
            markersize=4,
            linewidth=1.4,
            label=f"line {name}",
        )
    if len(locating):
        axes.scatter(
            *(locating.T * _MILLI),
            marker="s",
            s=14,
            color="0.35",
            depthshade=False,
            label="places that locate the tracker" if lines else "places",
        )
    for number, station in enumerate(stations, start=1):
        axes.scatter(
            *(np.asarray(station) * _MILLI),
            marker="*",
            s=140,
            color="black",
            depthshade=False,
            label="tracker" if number == 1 else None,
        )
        if len(stations) > 1:
            axes.text(*(np.asarray(station) * _MILLI), f"  {number}", fontsize=9)
    axes.set_xlabel("X / mm", fontsize=8)
    axes.set_ylabel("Y / mm", fontsize=8)
    axes.set_zlabel("Z / mm", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.set_box_aspect(_spans(axes), zoom=0.9)
    picture.suptitle("Places of the reflector (machine coordinates)", fontsize=11)
    legend_below(picture, [axes])
    return picture


def _spans(axes: Any) -> list[float]:
    return [float(np.ptp(limits)) for limits in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())]


def _edges(box: Box, axis: int) -> Vector:
    """Return the four edges of a box along one axis, m, shape (4, 2, 3)."""
    others = [other for other in range(3) if other != axis]
    edges = []
    for first in (box.low[others[0]], box.high[others[0]]):
        for second in (box.low[others[1]], box.high[others[1]]):
            edge = np.empty((2, 3))
            edge[:, axis] = box.low[axis], box.high[axis]
            edge[:, others[0]], edge[:, others[1]] = first, second
            edges.append(edge)
    return np.array(edges)


def deviations_picture(report: TrackerReport) -> "Picture":
    """Draw the mean deviations along each line, by both places of the tracker."""
    result = report.result
    if result is None:
        raise ValueError("there are no lines to draw")
    count = len(result.located.tests)
    columns = min(4, count)
    rows = -(-count // columns)
    picture = new_picture(11.0, 1.6 + 2.7 * rows)
    grid = picture.subplots(rows, columns, squeeze=False)
    for index, axes in enumerate(grid.ravel()):
        if index >= count:
            axes.set_visible(False)
            continue
        for title, colour, marker, lines in (
            ("places alone", _PLACES, "o", result.located),
            ("all readings", _ALL, "^", result.corrected),
        ):
            if lines is None:
                continue
            test = lines.tests[index]
            for mean, style, sense in (
                (test.mean_forward, "-", "↑"),
                (test.mean_backward, ":", "↓"),
            ):
                if np.any(np.isfinite(mean)):
                    axes.plot(
                        test.target * _MILLI,
                        mean * MICRO,
                        color=colour,
                        linestyle=style,
                        marker=marker,
                        markersize=3,
                        linewidth=1.2,
                        label=f"tracker from {title}, mean {sense}",
                    )
        tidy(axes)
        test = result.located.tests[index]
        axes.set_title(f"line {test.name} ({test.standard})", fontsize=9)
        axes.set_xlabel("target / mm", fontsize=8)
        if index % columns == 0:
            axes.set_ylabel("deviation / µm", fontsize=9)
    picture.suptitle(f"Seven-line test, station {report.station}", fontsize=11)
    legend_below(picture, grid.ravel())
    return picture


def residuals_picture(report: TrackerReport) -> "Picture":
    """Draw the residuals of the places that located the tracker."""
    fit = report.location.adjustment
    picture = new_picture(7.0, 3.8)
    axes = picture.subplots()
    places = np.arange(len(fit.residuals))
    band = 1.96 * fit.uncertainty * np.sqrt(fit.redundancy) * MICRO
    if np.all(np.isfinite(band)):
        axes.bar(places, 2 * band, bottom=-band, width=0.8, color="0.85", label="95 % of residuals")
    axes.plot(places, fit.residuals * MICRO, "o", color=_PLACES, label="residual")
    axes.axhline(0.0, color="0.55", linewidth=0.7)
    tidy(axes)
    axes.set_xticks(places)
    axes.set_xlabel("place", fontsize=9)
    axes.set_ylabel("length less fit / µm", fontsize=9)
    picture.suptitle(f"Location of the tracker, station {report.station}", fontsize=11)
    legend_below(picture, [axes])
    return picture


def draw_tracker(report: TrackerReport) -> "dict[str, Picture]":
    """Return all pictures of a report by the name of their file without ending."""
    pictures = {"tracker_location": residuals_picture(report)}
    if report.result is not None:
        pictures["seven_lines"] = deviations_picture(report)
    return pictures


def document_pictures(four: FigureFour, five: FigureFive) -> "dict[str, Picture]":
    """Return the computed counterparts of ATLI Figs. 4a and 5a with captions."""
    said = figure_sentences(four, five)
    return {
        "atli_figure_4": _figure(
            "ATLI Fig. 4, computed: squareness alone",
            [four.towards, four.away],
            "distance from the line's start / mm",
            said[:1],
        ),
        "atli_figure_5": _figure(
            "ATLI Fig. 5, computed: squareness and positioning, tracker located by the machine",
            [five.located, five.true_place],
            "distance from the tracker / mm",
            said[1:],
        ),
    }


def _figure(title: str, curves: Sequence[Any], along: str, caption: Sequence[str]) -> "Picture":
    picture = new_picture(8.6, 5.6)
    axes: Axes = picture.subplots()
    for curve, colour, style in zip(curves, (_ALL, _PLACES), ("-", "--"), strict=True):
        axes.plot(
            curve.distance * _MILLI,
            curve.deviation * MICRO,
            color=colour,
            linestyle=style,
            linewidth=1.6,
            label=curve.label,
        )
    tidy(axes)
    axes.axhline(0.0, color="0.55", linewidth=0.7, zorder=1)
    axes.set_xlabel(along, fontsize=9)
    axes.set_ylabel("length less ideal length / µm", fontsize=9)
    axes.legend(fontsize=8.5, frameon=False)
    picture.suptitle(title, fontsize=11)
    picture.supxlabel(
        "\n".join(fill(sentence, _CAPTION_WIDTH) for sentence in caption), fontsize=7.5, x=0.5
    )
    return picture
