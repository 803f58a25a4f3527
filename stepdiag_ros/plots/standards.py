"""Tests by ISO 230-2 and ISO 230-6 as the standards draw them: graphs, and the diagonals' page."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest
from stepdiag_ros.metrology.standards.iso230_6 import DiagonalGroup
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.panel import INK, LABEL_SIZE
from stepdiag_ros.plots.style import (
    BACKWARD,
    FORWARD,
    SMALL_SIZE,
    Sheet,
    band,
    curve,
    panel_title,
    say_unknown,
    scales,
    zero_line,
)
from stepdiag_ros.text.numbers import UNKNOWN
from stepdiag_ros.words.positioning import cell_below, decimals_of, head_of, written

_WIDTH_OF_BAND = 2.0
"""The standards draw x̄ ± 2 s."""
_SHOWN = ("A", "R", "E", "M", "B")
_A4 = (8.27, 11.69)
"""Inches."""
_PAGE_MARGIN = 0.7
_PAGE_LETTERS = 125
_ROW_INCHES = 0.21
_LINE_INCHES = 0.145


def _graph(axes: Axes, test: PositioningTest) -> None:
    """Draw mean deviations of both directions with ±2 s, from the first forward mean's zero."""
    zero = test.mean_forward[0] if np.isfinite(test.mean_forward[0]) else test.mean_backward[0]
    known = False
    for style, mean, spread, label in (
        (FORWARD, test.mean_forward, test.deviation_forward, "mean forward ↑, band ±2 s"),
        (BACKWARD, test.mean_backward, test.deviation_backward, "mean backward ↓, band ±2 s"),
    ):
        if not np.any(np.isfinite(mean)):
            continue
        known = True
        place, values = test.target * IN_MILLI, (mean - zero) * IN_MICRO
        if np.all(np.isfinite(spread)):
            band(axes, place, values, spread * IN_MICRO, style, _WIDTH_OF_BAND)
        curve(axes, place, values, style, label, markersize=3.5)
    if not known:
        say_unknown(axes)
    zero_line(axes)


def iso230_2(
    test: PositioningTest, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the test of one axis (ISO 230-2) with its parameters.

    Args:
        test: of the axis.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.
    """
    sheet = Sheet(1, 1, 2.7, axes=axes)
    (panel,) = sheet.panels
    _graph(panel, test)
    scales(panel, f"{test.name} / mm", "positional deviation / µm, 0 at the first target")
    decimals = decimals_of([test])
    head = head_of(test.expanded_uncertainty[name] for name in _SHOWN)
    words = []
    for name in _SHOWN:
        value, uncertainty = test.parameters[name], test.expanded_uncertainty[name]
        words.append(f"{name} = {cell_below(value, uncertainty, decimals, head)}")
    of_what = f"U {UNKNOWN}" if UNKNOWN in head else "U for k = 2"
    heading = (
        f"ISO 230-2: positioning of {test.name}, {test.runs[0]} runs forward,"
        f" {test.runs[1]} backward"
    )
    return sheet.finish(
        heading if title is None else title,
        small_print=[f"µm, {of_what}:  " + ";  ".join(words)],
        stamp=stamp,
    )


def iso230_2_graphs(
    tests: Sequence[PositioningTest], *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the graphs of the tests of several axes (ISO 230-2), in one scale.

    Args:
        tests: of the axes.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each test, instead of a new figure.
    """
    sheet = Sheet(len(tests), 3, 1.75, axes=axes, share_up=True, gap=(0.25, 0.55), bottom=0.42)
    for number, (panel, test) in enumerate(zip(sheet.panels, tests, strict=True)):
        _graph(panel, test)
        panel_title(panel, f"axis {test.label}")
        up = "deviation / µm" if sheet.first_in_row(number) else ""
        scales(panel, f"{test.name} / mm", up)
    heading = "ISO 230-2: positioning of the axes, 0 at the first target"
    return sheet.finish(heading if title is None else title, stamp=stamp)


def iso230_6_graphs(
    group: DiagonalGroup,
    *,
    source: str = "",
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw the graphs of a group of diagonals (ISO 230-6), in one scale.

    Args:
        group: body diagonals, or those of a face.
        source: file that the data came from.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each diagonal, instead of a new figure.
    """
    sheet = Sheet(
        len(group.tests), 2, 1.75, axes=axes, share_up=True, gap=(0.25, 0.55), bottom=0.42
    )
    _graphs(sheet, group)
    under = [source] if source and title is None else []
    heading = f"ISO 230-6: {group.place}" if title is None else title
    return sheet.finish(heading, under=under, stamp=stamp)


def _graphs(sheet: Sheet, group: DiagonalGroup) -> None:
    for number, (panel, test) in enumerate(zip(sheet.panels, group.tests, strict=False)):
        _graph(panel, test)
        panel_title(panel, f"{group.labels[number]}: {test.label}")
        up = "deviation / µm" if sheet.first_in_row(number) else ""
        across = "position / mm" if sheet.last_in_column(number) else ""
        scales(panel, across, up)


def iso230_6(
    group: DiagonalGroup,
    *,
    source: str = "",
    warnings: Sequence[str] = (),
    title: str | None = None,
    stamp: str = "",
) -> Figure:
    """Draw the ISO 230-6 page of a group: a graph for each diagonal, E_d and B_d, the table.

    Args:
        group: body diagonals, or those of a face.
        source: file that the data came from.
        warnings: what the page must say beside its numbers.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
    """
    rows = _table_rows(group)
    remarks = dict.fromkeys(remark for test in group.tests for remark in test.remarks)
    said = [f"{one[:1].upper()}{one[1:]}." for one in (*group.remarks, *remarks)]
    text = [line for one in (*said, *warnings) for line in wrap(one, _PAGE_LETTERS)]
    table = _ROW_INCHES * len(rows)
    width, page = _A4
    sheet = Sheet(
        len(group.tests),
        2,
        2.2,
        width=width,
        left=_PAGE_MARGIN + 0.1,
        right=_PAGE_MARGIN,
        gap=(0.25, 0.55),
        share_up=True,
    )
    _graphs(sheet, group)
    figure = sheet.finish(
        f"ISO 230-6: {group.place}" if title is None else title,
        under=[source] if source else [],
        stamp=stamp,
        tail=0.6 + table + _LINE_INCHES * len(text),
        page_height=page,
    )
    height = float(figure.get_figheight())
    top = sheet.free - 0.15
    left, across = _PAGE_MARGIN / width, 1.0 - 2.0 * _PAGE_MARGIN / width
    table_axes = figure.add_axes((left, (top - table) / height, across, table / height))
    _draw_table(table_axes, rows)
    figure.text(
        left,
        (top - table - 0.15) / height,
        "\n".join(text),
        fontsize=SMALL_SIZE,
        va="top",
        ha="left",
        color=INK,
    )
    return figure


def _table_rows(group: DiagonalGroup) -> list[tuple[str, str, str]]:
    decimals = decimals_of(group.tests)
    whole = (
        ("Sys dev (E_d)", group.systematic_deviation, group.systematic_uncertainty),
        ("Reversal (B_d)", group.reversal_value, group.reversal_uncertainty),
    )
    rows = [("Name", "", "Value ± U (k = 2) / µm")]
    rows += [(name, "", written(value, size, decimals)) for name, value, size in whole]
    rows.append(("Test", "Reversal (B) / µm", "Sys dev (E) / µm"))
    for label, test in zip(group.labels, group.tests, strict=True):
        reversal, deviation = (
            written(test.parameters[name], test.expanded_uncertainty[name], decimals)
            for name in ("B", "E")
        )
        rows.append((f"{test.label} ({label})", reversal, deviation))
    return rows


def _draw_table(axes: Axes, rows: Sequence[tuple[str, str, str]]) -> None:
    axes.set_axis_off()
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(float(len(rows)), 0.0)
    for number, row in enumerate(rows):
        head = row[0] in ("Name", "Test")
        if head:
            axes.axhspan(number, number + 1, color="0.92", linewidth=0)
        axes.axhline(number + 1, color="0.8", linewidth=0.5)
        for place, word in zip((0.01, 0.37, 0.69), row, strict=True):
            axes.text(
                place,
                number + 0.5,
                word,
                va="center",
                fontsize=LABEL_SIZE,
                weight="bold" if head else "normal",
                color=INK,
            )
