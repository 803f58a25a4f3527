"""The axes that figures are drawn in: those of matplotlib, with scales that cost little to draw.

Matplotlib makes five artists of each tick, and lays them out more than once: of a figure with nine
panels that is more than half of the time. Here a scale is drawn at once, its grid as one collection
of lines. Locators, formatters, limits, labels and sharing work as they do everywhere in matplotlib.
"""

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.collections import LineCollection
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, MaxNLocator, ScalarFormatter

GRID = "0.88"
INK = "0.15"
TICK_SIZE = 7.0
LABEL_SIZE = 8.0
_PAD = 3.0
"""Between a panel and the numbers at its scale, points."""
_MARGIN = 1e-9


class _Scale:
    """What both scales share: numbers and grid, drawn at once.

    Attributes:
        numbered: the numbers are shown; panels above others with the same scale leave them out.
        gridded: grid lines are shown.
        turned: the numbers (or words) run upwards.
        label_distance: from the panel's edge to the label, inches; None: beside the numbers.
        number_size: points.
    """

    numbered = True
    gridded = True
    turned = False
    label_distance: float | None = None
    number_size = TICK_SIZE

    def set_tick_params(self, which: str = "major", reset: bool = False, **kwargs: Any) -> None:
        """Take ``labelbottom`` and ``labelleft``, which sharing uses, and ``labelsize``."""
        del which, reset
        for name in ("labelbottom", "labelleft"):
            if name in kwargs:
                self.numbered = bool(kwargs[name])
        self.number_size = kwargs.get("labelsize", self.number_size)
        if "labelrotation" in kwargs:
            self.turned = bool(kwargs["labelrotation"])

    def set_clip_path(self, path: Any, transform: Any = None) -> None:
        """Set the clip path of the scale itself; it has no ticks that need one."""
        Artist.set_clip_path(self, path, transform)  # type: ignore[arg-type]  # a part of one

    def get_tightbbox(self, renderer: Any = None, *, for_layout_only: bool = False) -> Any:  # noqa: ARG002
        """Return None: the place of a scale is given by the margins of the figure."""
        return None

    def places(self) -> tuple[Any, list[str]]:
        """Return the values that are in view, and what is written at them."""
        axis: Any = self
        values = np.asarray(axis.get_majorticklocs(), dtype=np.float64)
        words = axis.get_major_formatter().format_ticks(values)
        low, high = sorted(axis.get_view_interval())
        slack = _MARGIN * (high - low)
        seen = (values >= low - slack) & (values <= high + slack)
        return values[seen], [word for word, shown in zip(words, seen, strict=True) if shown]


class _Across(_Scale, XAxis):
    """The scale below a panel."""

    def draw(self, renderer: Any) -> None:
        """Draw grid, numbers and label."""
        if not self.get_visible():
            return
        axes = self.axes
        values, words = self.places()
        box = axes.bbox
        to_pixels = axes.transData.transform
        low = axes.get_ylim()[0]
        across = to_pixels(np.column_stack([values, np.full(len(values), low)]))[:, 0]
        grid = [[(x, box.y0), (x, box.y1)] for x in across] if self.gridded else []
        _lines(axes, renderer, grid, [(box.x0, box.y0), (box.x1, box.y0)])
        point = renderer.points_to_pixels(1.0)
        if self.numbered:
            how = ("right", "center") if self.turned else ("center", "top")
            for x, word in zip(across, words, strict=True):
                _write(self, renderer, x, box.y0 - _PAD * point, word, how, self.turned)
        if self.label.get_text():
            away = _PAD + (1.25 * self.number_size + 1.0 if self.numbered else 0.0)
            if self.label_distance is not None:
                away = 72.0 * self.label_distance
            text = self.label.get_text()
            _label(self, renderer, (box.x0 + box.x1) / 2, box.y0 - away * point, text, 0.0)


class _Up(_Scale, YAxis):
    """The scale to the left of a panel."""

    def draw(self, renderer: Any) -> None:
        """Draw grid, numbers and label."""
        if not self.get_visible():
            return
        axes = self.axes
        values, words = self.places()
        box = axes.bbox
        left = axes.get_xlim()[0]
        up = axes.transData.transform(np.column_stack([np.full(len(values), left), values]))[:, 1]
        grid = [[(box.x0, y), (box.x1, y)] for y in up] if self.gridded else []
        _lines(axes, renderer, grid, [(box.x0, box.y0), (box.x0, box.y1)])
        point = renderer.points_to_pixels(1.0)
        if self.numbered:
            for y, word in zip(up, words, strict=True):
                _write(self, renderer, box.x0 - _PAD * point, y, word, ("right", "center"))
        if self.label.get_text():
            longest = max((len(word) for word in words), default=0) if self.numbered else 0
            away = _PAD + 2.0 + 0.62 * self.number_size * longest
            if self.label_distance is not None:
                away = 72.0 * self.label_distance
            text = self.label.get_text()
            _label(self, renderer, box.x0 - away * point, (box.y0 + box.y1) / 2, text, 90.0)


def _lines(axes: Axes, renderer: Any, grid: list[Any], edge: Any) -> None:
    """Draw grid lines and the edge of the panel, all in pixels."""
    lines = LineCollection(
        [*grid, edge],
        colors=[GRID] * len(grid) + [INK],
        linewidths=[0.6] * len(grid) + [0.7],
    )
    lines.set_figure(axes.figure)
    lines.draw(renderer)


def _write(
    scale: Any,
    renderer: Any,
    x: float,
    y: float,
    word: str,
    how: tuple[Any, Any],
    turned: bool = False,
) -> None:
    text = Text(
        x,
        y,
        word,
        color=INK,
        fontsize=scale.number_size,
        horizontalalignment="center" if turned else how[0],
        verticalalignment="top" if turned else how[1],
        rotation=90.0 if turned else 0.0,
    )
    text.set_figure(scale.axes.figure)
    text.draw(renderer)


def _label(scale: Any, renderer: Any, x: float, y: float, words: str, angle: float) -> None:
    text = Text(
        x,
        y,
        words,
        color=INK,
        fontsize=LABEL_SIZE,
        horizontalalignment="right" if angle else "center",
        verticalalignment="center" if angle else "top",
        rotation=angle,
    )
    text.set_figure(scale.axes.figure)
    text.draw(renderer)


class Panel(Axes):
    """One panel of a figure; used as any axes of matplotlib."""

    xaxis: _Across
    yaxis: _Up

    def _init_axis(self) -> None:
        """Make the scales; the place where matplotlib's own projections make theirs."""
        self.xaxis = _Across(self)
        self.yaxis = _Up(self)

    def scale_steps(self) -> None:
        """Have about five steps on each scale, where no places were given."""
        for axis in (self.xaxis, self.yaxis):
            if not isinstance(axis.get_major_locator(), FixedLocator):
                axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
                # Numbers are written in full: there is no place for an offset or a power of ten.
                numbers = ScalarFormatter(useOffset=False)
                numbers.set_scientific(False)
                axis.set_major_formatter(numbers)

    def count_across(self) -> None:
        """Have whole numbers on the scale below."""
        self.xaxis.set_major_locator(MaxNLocator(4, integer=True))
