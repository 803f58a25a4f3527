"""The one look of all figures: colours, lines, sizes, margins, legend and stamp.

Colours are those of Okabe and Ito, which people with any colour vision can tell apart; markers,
line styles and hatches differ too, so that a print in grey can be read. Figures are made without
pyplot, so that drawing one leaves no global state of matplotlib behind. Margins are in inches and
fixed: nothing is laid out by trial.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from textwrap import wrap
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.textpath import TextPath

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers import solvers
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.plots.panel import GRID, INK, LABEL_SIZE, TICK_SIZE, Panel
from stepdiag_ros.plots.places import here

DOTS_PER_INCH = 150
HEADING_SIZE = 9.5
TITLE_SIZE = 8.0
SMALL_SIZE = 6.5
NOT_DETERMINED = "not determined"
TRUTH_TITLE = "Truth (simulated cell)"

BLUE, VERMILION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, YELLOW, BLACK, GREY = "#E69F00", "#56B4E9", "#F0E442", "#000000", "#999999"
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, SKY, ORANGE, BLACK, GREY)


LineStyle = Literal["-", "--", "-.", ":", "none"]


@dataclass(frozen=True)
class Style:
    """How one kind of curve is drawn.

    Attributes:
        colour: as matplotlib names it.
        marker: of its points.
        line: style of its line.
    """

    colour: str
    marker: str
    line: LineStyle


_OF_METHODS = (
    Style(PURPLE, "s", "-."),
    Style(VERMILION, "o", "--"),
    Style(ORANGE, "v", "--"),
    Style(SKY, "P", "-."),
    Style(BLUE, "^", "-"),
    Style(GREEN, "D", "-"),
    Style(GREY, "X", ":"),
    Style(BLACK, "*", "--"),
)
"""Of the methods that solve measured lines, in their order; of further ones from the first on."""
OTHER = Style("#666666", "D", "-")
TRUTH = Style(BLACK, "x", ":")
DIRECT = Style(BLACK, "D", "-")
FORWARD = Style(BLUE, "^", "-")
BACKWARD = Style(VERMILION, "v", "--")
BEFORE = Style(VERMILION, "o", "--")
AFTER = Style(BLUE, "^", "-")


def style_of(method: str) -> Style:
    """Return how the curves of a method are drawn."""
    known = tuple(solvers())
    return _OF_METHODS[known.index(method) % len(_OF_METHODS)] if method in known else OTHER


_LINE_INCHES = 0.155
"""Height of a line of small print, and of a row of the legend."""
_LEGEND_SIZE = 7.5
_LETTERS_PER_INCH = 19.0
"""Of small print, at least; a sentence is broken so that it fits."""
_HEADING_LETTERS = 15.0
"""Of a heading, per inch."""
_CLEAR_INCHES = 0.1
"""Between the legend and the small print."""
_SAMPLE_INCHES = 0.55
"""Room that the sample of a legend's entry needs beside its words."""


class Picture(Figure):
    """A figure that a notebook shows by itself, without pyplot."""

    def _repr_png_(self) -> bytes:
        from stepdiag_ros.plots.saving import png_bytes

        return png_bytes(self)


class Sheet:
    """A figure in the making: panels in rows and columns, then heading, legend and small print.

    With ``axes`` nothing but the panels is drawn, in the axes of whoever calls.

    Attributes:
        panels: the axes, row by row.
        figure: that they are in.
        free: height of the free room at the lower end of the finished figure, inches.
    """

    def __init__(
        self,
        count: int,
        columns: int,
        panel_height: float | Sequence[float],
        *,
        axes: Any = None,
        width: float | None = None,
        left: float = 0.62,
        right: float = 0.15,
        gap: tuple[float, float | Sequence[float]] = (0.5, 0.52),
        bottom: float = 0.42,
        share_across: bool = False,
        share_up: bool = False,
        share_rows: bool = False,
    ) -> None:
        """Make the panels.

        Args:
            count: number of panels.
            columns: most panels in a row.
            panel_height: inches in a figure by itself; of each row, or of all.
            axes: the axes to draw in instead of a new figure; as many as there are panels.
            width: of the figure, inches; None: that of its place in a page.
            left: margin for numbers and label, inches.
            right: margin, inches.
            gap: between panels, across and up, inches; up: below each row but the last, or all.
            bottom: below the last row, for numbers and label, inches.
            share_across: panels of a column have one scale across, with numbers below the last.
            share_up: all panels have one scale up, with numbers at the left.
            share_rows: panels of a row have one scale up, with numbers at the left.

        Raises:
            ValueError: another number of axes than panels.
        """
        self._own = axes is None
        self.free = 0.0
        self._columns = max(1, min(columns, count))
        self._rows = max(1, -(-count // self._columns))
        if axes is not None:
            self.panels: list[Any] = list(np.ravel(np.asarray(axes, dtype=object)))
            if len(self.panels) != count:
                raise Refusal(
                    f"this figure has {count} panels, but {len(self.panels)} axes were given",
                    fault="mismatch",
                )
            self.figure: Any = self.panels[0].figure if self.panels else None
            for panel in self.panels:
                tidy(panel)
            return
        heights = np.asarray(panel_height, dtype=np.float64)
        if width is None:
            width, heights = here().width, here().flatness * heights
        self._heights = np.broadcast_to(heights, self._rows)
        self._between = np.broadcast_to(np.asarray(gap[1], dtype=np.float64), self._rows - 1)
        self._width, self._left, self._right = width, left, right
        self._across, self._bottom = gap[0], bottom
        self.figure = Picture(figsize=(width, 4.0), dpi=DOTS_PER_INCH, facecolor="white")
        self.panels = []
        for number in range(count):
            above = self.panels[number - self._columns] if number >= self._columns else None
            first = 0 if share_up else number - number % self._columns
            shared = {
                "sharex": above if share_across else None,
                "sharey": self.panels[first]
                if (share_up or share_rows) and number > first
                else None,
            }
            panel = self.figure.add_axes(
                (0.1, 0.1, 0.8, 0.8), axes_class=Panel, facecolor="white", **shared
            )
            tidy(panel)
            panel.xaxis.numbered = not share_across or number + self._columns >= count
            panel.yaxis.numbered = not (share_up or share_rows) or self.first_in_row(number)
            self.panels.append(panel)

    def first_in_row(self, number: int) -> bool:
        """Say whether a panel is the first of its row."""
        return number % self._columns == 0

    def last_in_column(self, number: int) -> bool:
        """Say whether no panel is below this one."""
        return number + self._columns >= len(self.panels)

    def finish(
        self,
        title: str = "",
        *,
        under: Sequence[str] = (),
        legend: bool = True,
        small_print: Sequence[str] = (),
        stamp: str = "",
        more: Sequence[tuple[Any, str]] = (),
        tail: float = 0.0,
        page_height: float = 0.0,
    ) -> Figure:
        """Put heading, legend, small print and stamp around the panels, and return the figure.

        Args:
            title: heading; empty: none.
            under: further lines below the heading.
            legend: one legend of all panels, each label once.
            small_print: sentences below the panels.
            stamp: what the figure was made from, at the lower right.
            more: further entries of the legend, artist and label.
            tail: room that is left free at the lower end, inches.
            page_height: least height of the figure, inches; what is more than needed is free, too.
        """
        figure: Figure = self.figure
        if not self._own:
            return figure
        heading = self._broken((title, *under))
        entries = {**legend_entries(self.panels), **{label: one for one, label in more}}
        rows = _legend_rows(list(entries), self._width - 0.3) if legend else []
        letters = int(_LETTERS_PER_INCH * (self._width - 0.3))
        prints = [line for sentence in small_print for line in wrap(sentence, letters)]
        titles = [panel.get_title().count("\n") for panel in self.panels if panel.get_title()]
        top = 0.12 + 0.19 * len(heading) + (0.24 + 0.13 * max(titles) if titles else 0.0)
        clear = _CLEAR_INCHES if rows and prints else 0.0
        below = _LINE_INCHES * (1.15 * len(rows) + len(prints) + bool(stamp)) + clear + 0.1
        height = top + float(self._heights.sum() + self._between.sum()) + self._bottom + below
        self.free = max(tail, page_height - height, 0.0)
        height += self.free
        figure.set_size_inches(self._width, height)
        self._place(height, top)
        for number, line in enumerate(heading):
            figure.text(
                0.5,
                1.0 - (0.09 + 0.19 * number) / height,
                line,
                ha="center",
                va="top",
                color=INK,
                fontsize=HEADING_SIZE if number == 0 else LABEL_SIZE,
            )
        at = below + self.free
        for row in rows:
            _draw_legend_row(figure, [(entries[label], label) for label in row], at, height)
            at -= 1.15 * _LINE_INCHES
        at -= clear
        for line in prints:
            figure.text(
                0.5, at / height, line, ha="center", va="top", fontsize=SMALL_SIZE, color="0.3"
            )
            at -= _LINE_INCHES
        if stamp:
            figure.text(
                1.0 - 0.08 / self._width,
                0.04 / height,
                stamp,
                ha="right",
                va="bottom",
                fontsize=SMALL_SIZE,
                color="0.4",
            )
        return figure

    def _broken(self, lines: Sequence[str]) -> list[str]:
        """Break the lines of a heading so that they fit; leave empty ones out."""
        letters = int(_HEADING_LETTERS * self._width)
        return [part for line in lines for part in wrap(line, letters)]

    def _place(self, height: float, top: float) -> None:
        inner = self._width - self._left - self._right - self._across * (self._columns - 1)
        across = inner / self._columns
        for number, panel in enumerate(self.panels):
            row, column = divmod(number, self._columns)
            down = top + float(self._heights[: row + 1].sum() + self._between[:row].sum())
            left = self._left + (across + self._across) * column
            panel.set_position(
                (
                    left / self._width,
                    1.0 - down / height,
                    across / self._width,
                    float(self._heights[row]) / height,
                )
            )


def tidy(axes: Axes) -> None:
    """Give a panel the look of the house: a light grid and no frame above and to the right."""
    axes.set_axisbelow(True)
    if isinstance(axes, Panel):
        axes.scale_steps()
        # The scales draw the edges themselves.
        axes.spines[:].set_visible(False)
        return
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.tick_params(labelsize=TICK_SIZE)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["bottom", "left"]].set_linewidth(0.7)


def panel_title(axes: Axes, words: str) -> None:
    """Write what a panel shows above it."""
    axes.set_title(words, fontsize=TITLE_SIZE, y=1.0, pad=4.0, color=INK)


def scales(axes: Axes, across: str = "", up: str = "") -> None:
    """Name the quantities of both scales, with their units."""
    if across:
        axes.set_xlabel(across, fontsize=LABEL_SIZE)
    if up:
        axes.set_ylabel(up, fontsize=LABEL_SIZE)


def zero_line(axes: Axes) -> None:
    """Draw where nothing is wrong."""
    axes.axhline(0.0, color="0.55", linewidth=0.7, zorder=1)


def curve(
    axes: Axes, across: Vector, values: Vector, style: Style, label: str, **more: Any
) -> Line2D:
    """Draw one curve in the look of its kind."""
    (line,) = axes.plot(
        across,
        values,
        color=style.colour,
        linestyle=more.pop("linestyle", style.line),
        marker=more.pop("marker", style.marker),
        markersize=more.pop("markersize", 3.0),
        linewidth=more.pop("linewidth", 1.1),
        label=label,
        **more,
    )
    return line


def band(
    axes: Axes,
    across: Vector,
    values: Vector,
    standard_uncertainty: Vector,
    style: Style,
    coverage: float = COVERAGE_FACTOR,
) -> None:
    """Draw the band of a curve, all in the units of the panel; nothing where it is unknown.

    Its border has the style of the curve's line: in grey, that says whose band it is.
    """
    half = coverage * standard_uncertainty
    axes.fill_between(
        across,
        values - half,
        values + half,
        facecolor=to_rgba(style.colour, 0.2),
        edgecolor=to_rgba(style.colour, 0.6),
        linewidth=0.4,
        linestyle=style.line,
    )


def say_unknown(axes: Axes, words: str = NOT_DETERMINED) -> None:
    """Hatch an empty panel and say why nothing is drawn in it."""
    axes.patch.set(hatch="///", edgecolor="0.85", linewidth=0)
    axes.text(
        0.5,
        0.5,
        words,
        transform=axes.transAxes,
        ha="center",
        va="center",
        color="0.25",
        fontsize=LABEL_SIZE,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.9, "pad": 2.0},
        zorder=5,
    )


def legend_entries(panels: Sequence[Any]) -> dict[str, Any]:
    """Return label → artist of all panels, each label once."""
    entries: dict[str, Any] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    return entries


def _legend_rows(labels: Sequence[str], width: float) -> list[list[str]]:
    """Break a legend into rows that fit."""
    rows: list[list[str]] = []
    room = 0.0
    for label in labels:
        needs = _SAMPLE_INCHES + _printed_inches(label)
        if not rows or needs > room:
            rows.append([])
            room = width
        rows[-1].append(label)
        room -= needs
    return rows


def _draw_legend_row(
    figure: Figure, entries: Sequence[tuple[Any, str]], at: float, height: float
) -> None:
    """Draw a row of the legend, its top ``at`` inches above the lower edge of the figure.

    ``Figure.legend`` measures all words to place them, which takes as long as drawing two panels.
    """
    width = float(figure.get_figwidth())
    sizes = [_SAMPLE_INCHES + _printed_inches(label) for _, label in entries]
    left = (width - sum(sizes)) / 2.0
    middle = at - 0.5 * _LINE_INCHES
    for (handle, label), size in zip(entries, sizes, strict=True):
        ends = np.array([left + 0.08, left + 0.36]) / width
        _draw_sample(figure, handle, ends, middle / height, height)
        figure.text(
            (left + 0.42) / width,
            middle / height,
            label,
            fontsize=_LEGEND_SIZE,
            va="center_baseline",
            ha="left",
            color=INK,
        )
        left += size


@cache
def _printed_inches(words: str) -> float:
    """Return how long the words of a legend are in print, inches."""
    path = TextPath((0.0, 0.0), words, size=_LEGEND_SIZE, prop=FontProperties())
    return float(np.max(path.vertices[:, 0], initial=0.0)) / 72.0


def _draw_sample(figure: Figure, handle: Any, ends: Vector, middle: float, height: float) -> None:
    if not isinstance(handle, Line2D) and getattr(handle, "lines", None):
        handle = handle.lines[0]
    elif getattr(handle, "patches", None):
        handle = handle.patches[0]
    sample: Line2D | Rectangle
    if isinstance(handle, LineCollection):
        sample = Line2D(ends, [middle] * 2)
        sample.set_color(np.atleast_2d(handle.get_color())[0])
        sample.set_linewidth(float(np.atleast_1d(handle.get_linewidth())[0]))
        dashes: Any = handle.get_linestyle()[0]
        sample.set_linestyle(dashes)
    elif isinstance(handle, Line2D):
        sample = Line2D([ends[0], ends.mean(), ends[1]], [middle] * 3)
        sample.update_from(handle)
        sample.set_markevery([1])
        sample.set_markersize(max(handle.get_markersize(), 3.0))
    else:
        tall = 0.09 / height
        sample = Rectangle(
            (ends[0], middle - tall / 2),
            ends[1] - ends[0],
            tall,
            facecolor=np.atleast_2d(handle.get_facecolor())[0],
            edgecolor=np.atleast_2d(handle.get_edgecolor())[0],
            hatch=handle.get_hatch(),
            linewidth=0.5,
        )
    sample.set_transform(figure.transFigure)
    sample.set_clip_on(False)
    figure.add_artist(sample)
