"""Places in the machine's space drawn on paper: one parallel projection for all figures.

X runs to the lower right, Y to the upper right, Z upwards; lengths along each axis are to scale. A
drawing of lines in a plane costs a tenth of a turnable one.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.text import Text

from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.plots.panel import INK
from stepdiag_ros.plots.style import SMALL_SIZE

_TURN = np.radians(32.0)
"""Of the machine about Z, seen from above."""
_LIFT = np.radians(24.0)
"""Of the eye above the horizon."""
PROJECTION = np.array(
    [
        [np.cos(_TURN), -np.sin(_TURN) * np.sin(_LIFT)],
        [np.sin(_TURN), np.cos(_TURN) * np.sin(_LIFT)],
        [0.0, np.cos(_LIFT)],
    ]
)
"""From X Y Z to right and up, shape (3, 2)."""
_BEYOND = 0.05
"""Distance of a scale's name from the box, as a share of the drawing."""


def project(positions: Vector) -> Vector:
    """Return where places are drawn, mm on the scale of the machine.

    Args:
        positions: m, shape (..., 3).

    Returns:
        Right and up, shape (..., 2).
    """
    drawn: Vector = np.asarray(positions, dtype=np.float64) @ PROJECTION * IN_MILLI
    return drawn


def box_edges(low: Vector, high: Vector) -> Vector:
    """Return the twelve edges of a box, m, shape (12, 2, 3)."""
    corners = np.array([low, high], dtype=np.float64)
    edges = []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        for ends in product((0, 1), repeat=2):
            edge = np.empty((2, 3))
            edge[:, axis] = corners[:, axis]
            for other, end in zip(others, ends, strict=True):
                edge[:, other] = corners[end, other]
            edges.append(edge)
    return np.array(edges)


def add_wires(
    axes: Axes, polylines: Sequence[Vector] | Vector, label: str = "", **look: Any
) -> LineCollection:
    """Draw lines in space as one artist.

    Args:
        axes: to draw in.
        polylines: of places, m, each shape (n, 3).
        label: for the legend.
        look: colours, linewidths, linestyles and so on, as ``LineCollection`` takes them.
    """
    drawn = [project(one) for one in polylines]
    wires = LineCollection(drawn, label=label or "_wires", **look)
    axes.add_collection(wires, autolim=False)
    axes.update_datalim(np.concatenate(drawn))
    return wires


_ROUNDS = 4
"""In which limits are widened: each makes the drawing smaller, and by that needs some more."""
_SHORT = 0.45
"""An edge of a box below this share of the drawing is short."""


def frame_box(
    axes: Axes, low: Vector, high: Vector, room: float = 0.0, letters: float = SMALL_SIZE
) -> None:
    """Name the three axes at the edges of a box, with their ends in mm, and hide the scales.

    Call it when everything else is drawn.

    Args:
        axes: to draw in.
        low: first corner, m, shape (3,).
        high: last corner, m, shape (3,).
        room: that is kept free to the left, as a share of the drawing's size.
        letters: size of the numbers at the ends, points.
    """
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    x, y, z = high
    edges = (
        (np.array([low[0], low[1], low[2]]), np.array([x, low[1], low[2]])),
        (np.array([x, low[1], low[2]]), np.array([x, y, low[2]])),
        (np.array([low[0], low[1], low[2]]), np.array([low[0], low[1], z])),
    )
    size = float(np.ptp(project(box_edges(low, high)).reshape(-1, 2), axis=0).max())
    below, right = 0.1, 0.03
    # Larger numbers of two edges that meet need more room between them.
    ends = 0.03 * (1.0 + letters - SMALL_SIZE)
    outwards = (np.array([-0.35, -0.6]), np.array([0.35, -0.4]), np.array([-0.5, 0.0]))
    sides: tuple[Any, ...] = (("center", "top"), ("left", "top"), ("right", "center"))
    written = []
    for axis, (start, end) in enumerate(edges):
        first, last = project(start), project(end)
        step = _BEYOND * size * outwards[axis]
        across, up = sides[axis]
        # Along a short edge the name has no room between the numbers.
        short = np.linalg.norm(last - first) < _SHORT * size
        beside, below = (4.0, 0.2) if short else (1.8, below)
        # Y is named to the right of its edge, where a short one leaves no room.
        right = 0.12 if short and axis == 1 else right
        # The end of X meets the begin of Y: two numbers side by side must not become one.
        ending = "right" if axis == 0 else across
        words = (
            (0.5, f"{AXES[axis]} / mm", beside, letters + 0.5, across),
            (ends, f"{low[axis] * IN_MILLI:g}", 1.0, letters, across),
            (1.0 - ends, f"{high[axis] * IN_MILLI:g}", 1.0, letters, ending),
        )
        for share, word, away, size_of_word, side in words:
            at = first + share * (last - first) + away * step
            text = axes.text(
                float(at[0]), float(at[1]), word, ha=side, va=up, fontsize=size_of_word, color=INK
            )
            written.append(text)
    reach = project(box_edges(low, high)).reshape(-1, 2)
    first = reach.min(axis=0) - np.array([0.1 + room, below]) * size
    axes.update_datalim(np.array([first, reach.max(axis=0) + np.array([right, 0.03]) * size]))
    axes.margins(0.01)
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()
    _make_room(axes, written)


def _make_room(axes: Axes, written: Sequence[Text]) -> None:
    """Widen the limits until all words are within; words do not shrink with the drawing."""
    for _ in range(_ROUNDS):
        axes.apply_aspect()
        to_data = axes.transData.inverted()
        for text in written:
            axes.update_datalim(to_data.transform(text.get_window_extent().get_points()))
        axes.autoscale_view()
