"""Pictures of tests by ISO 230-2 and ISO 230-6: the graph of an axis, the page of the diagonals."""

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest
from stepdiag_ros.metrology.standards.iso230_6 import DiagonalGroup
from stepdiag_ros.report.figures import Style, legend_below, new_picture, tidy
from stepdiag_ros.report.numbers import MICRO
from stepdiag_ros.report.positioning import PositioningReport, decimals_of, written

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture
    from matplotlib.figure import SubFigure

_FORWARD = Style("#0072B2", "^", "-")
_BACKWARD = Style("#D55E00", "v", "--")
_PAGE = (8.27, 11.69)
"""A4, inches."""
_LINE_LENGTH = 135


def _graph(axes: "Axes", test: PositioningTest) -> None:
    """Draw mean deviations of both directions with ±2 s, from the first forward mean's zero."""
    zero = test.mean_forward[0] if np.isfinite(test.mean_forward[0]) else test.mean_backward[0]
    for style, mean, spread, label in (
        (_FORWARD, test.mean_forward, test.deviation_forward, "mean forward ↑, band ±2 s"),
        (_BACKWARD, test.mean_backward, test.deviation_backward, "mean backward ↓, band ±2 s"),
    ):
        if not np.any(np.isfinite(mean)):
            continue
        place, values = test.target * 1e3, (mean - zero) * MICRO
        width = 2.0 * spread * MICRO
        if np.all(np.isfinite(width)):
            axes.fill_between(
                place, values - width, values + width, color=style.colour, alpha=0.15, linewidth=0
            )
        axes.plot(
            place,
            values,
            color=style.colour,
            marker=style.marker,
            linestyle=style.line,
            markersize=4.0,
            linewidth=1.2,
            label=label,
        )
    axes.axhline(0.0, color="0.55", linewidth=0.7, zorder=1)
    tidy(axes)


def axis_picture(test: PositioningTest) -> "Picture":
    """Draw the test of one axis (ISO 230-2) with its parameters."""
    picture = new_picture(9.0, 5.2)
    axes = picture.subplots()
    _graph(axes, test)
    axes.set_xlabel(f"{test.name} / mm", fontsize=9)
    axes.set_ylabel("positional deviation / µm, 0 at the first target", fontsize=9)
    decimals = decimals_of([test])
    words = [
        f"{name} = {written(test.parameters[name], test.expanded_uncertainty[name], decimals)}"
        for name in ("A", "R", "E", "M", "B")
    ]
    picture.suptitle(
        f"ISO 230-2: positioning of {test.name}, {test.runs[0]} runs forward,"
        f" {test.runs[1]} backward",
        fontsize=11,
    )
    legend_below(picture, [axes], ["µm, U for k = 2:  " + ";  ".join(words)])
    return picture


def diagonals_page(group: DiagonalGroup, report: PositioningReport) -> "Picture":
    """Draw the ISO 230-6 page of a group: a graph for each diagonal, E_d and B_d, the table."""
    picture = new_picture(*_PAGE)
    engine = picture.get_layout_engine()
    if engine is not None:
        engine.set(w_pad=0.2, h_pad=0.2)  # type: ignore[call-arg]  # margins of the page, inches
    count = len(group.tests)
    columns = 1 if count == 1 else 2
    rows = -(-count // columns)
    halves = picture.subfigures(2, 1, height_ratios=(1.0, 0.5), squeeze=False)
    upper, lower = halves[0, 0], halves[1, 0]
    panels = np.ravel(upper.subplots(rows, columns, squeeze=False, sharey=True))
    for number, axes in enumerate(panels):
        if number >= count:
            axes.set_visible(False)
            continue
        test = group.tests[number]
        _graph(axes, test)
        axes.set_title(f"{group.labels[number]}: {test.setup or test.name}", fontsize=10)
        axes.set_xlabel("position along the diagonal / mm", fontsize=8)
        if number % columns == 0:
            axes.set_ylabel("deviation / µm", fontsize=8)
    upper.suptitle(f"ISO 230-6: {group.place}\n{report.source}", fontsize=12)
    legend_below(upper, panels)
    _tables(lower, group, report)
    return picture


def _tables(lower: "SubFigure", group: DiagonalGroup, report: PositioningReport) -> None:
    decimals = decimals_of(group.tests)
    axes = lower.subplots()
    axes.set_axis_off()
    whole = [
        ("Sys dev (E_d)", group.systematic_deviation, group.systematic_uncertainty),
        ("Reversal (B_d)", group.reversal_value, group.reversal_uncertainty),
    ]
    rows = [[name, "", written(value, uncertainty, decimals)] for name, value, uncertainty in whole]
    rows.append(["Test", "Reversal (B) / µm", "Sys dev (E) / µm"])
    for label, test in zip(group.labels, group.tests, strict=True):
        cells = [
            written(test.parameters[name], test.expanded_uncertainty[name], decimals)
            for name in ("B", "E")
        ]
        rows.append([f"{test.setup or test.name} ({label})", *cells])
    table = axes.table(
        cellText=rows,
        colLabels=["Name", "", "Value ± U (k = 2) / µm"],
        loc="upper center",
        cellLoc="left",
        colWidths=[0.36, 0.32, 0.32],
    )
    table.auto_set_font_size(False)
    table.set_fontsize(8.5)
    table.scale(1.0, 1.15)
    for (row, _), cell in table.get_celld().items():
        cell.set_linewidth(0.4)
        if row in (0, len(whole) + 1):
            cell.set_facecolor("0.92")
            cell.set_text_props(weight="bold")
    remarks = dict.fromkeys(remark for test in group.tests for remark in test.remarks)
    said = [*group.remarks, *remarks]
    text = [fill(f"{one[:1].upper()}{one[1:]}.", _LINE_LENGTH) for one in said]
    text.extend(fill(one, _LINE_LENGTH) for one in report.warnings)
    axes.text(
        0.0, 0.0, "\n".join(text), transform=axes.transAxes, fontsize=7.5, va="bottom", ha="left"
    )


def draw_positioning(report: PositioningReport) -> "dict[str, Picture]":
    """Return all pictures of a report by the name of their file without ending."""
    pictures: dict[str, Picture] = {}
    for test in report.tests:
        if not is_diagonal(test.kind):
            name = "".join(c if c.isalnum() else "_" for c in test.setup or test.name)
            pictures[f"iso230_2_{name}"] = axis_picture(test)
    for group in report.groups:
        name = group.place.replace(" ", "_")
        pictures[f"iso230_6_{name}"] = diagonals_page(group, report)
    return pictures
