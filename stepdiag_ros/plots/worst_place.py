"""The machine's volume with its largest error: where it is, how large, and which way it points."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy, of_result
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.metrology.volumetric_map import VolumetricMap
from stepdiag_ros.plots.space import add_wires, box_edges, frame_box, project
from stepdiag_ros.plots.style import VERMILION, Sheet
from stepdiag_ros.text.numbers import (
    place_in_mm,
    plain,
    two_digits,
    with_expanded,
)

_SHARE = 0.3
"""The arrow is drawn as this share of the box's longest side."""
_MOST_NODES = 21
"""Nodes of an axis at which the error is computed for the walls; of more, evenly spread ones."""
_LETTERS = 9.0
"""Points: readable where the picture is shown 600 pixels wide."""
_WALLS = LinearSegmentedColormap.from_list("walls", ["#ffffff", "#6aaed6"])
_BEHIND = (0, -1, 0)
"""Index of the node of X, Y and Z at which the wall behind the volume stands."""


def worst_error(
    result: VolumetricErrors,
    chain: str = "",
    *,
    expanded_uncertainty: float | None = None,
    which: str = "",
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure | None:
    """Draw the longest error vector in the measured box, with its size, U and place.

    Each wall behind the box shows the longest error vector in front of it, so that the volume can
    be read as a whole. None where a curve is not determined.

    Args:
        result: of a solver.
        chain: order of the axes from workpiece to tool; needed where the result has rotations.
        expanded_uncertainty: of the longest error vector (95 %), m; None: that of the readings.
        which: what the heading says of this uncertainty, such as "U is a lower bound".
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.

    Raises:
        ValueError: the result has rotations and no chain is given.
    """
    worst = of_result(result, chain)
    if not np.isfinite(worst.value):
        return None
    if expanded_uncertainty is None:
        expanded_uncertainty = COVERAGE_FACTOR * worst.standard_uncertainty
        which = which or "of the readings"
    error_map = VolumetricMap.of_result(result, chain)
    low, high = error_map.low, error_map.high
    sheet = Sheet(1, 1, 2.5, axes=axes, width=5.0, left=0.1, right=1.1, bottom=0.05)
    (panel,) = sheet.panels
    wall = _walls(panel, error_map, worst.value)
    add_wires(panel, box_edges(low, high), colors="0.55", linewidths=0.8)
    _arrow(panel, worst, low, high)
    frame_box(panel, low, high, letters=_LETTERS)
    size = with_expanded(worst.value, expanded_uncertainty, IN_MICRO)
    note = f"95 %, {which}" if which else "95 %"
    heading = f"Largest error: {size} µm ({note})" if title is None else title
    figure = sheet.finish(
        heading,
        under=[f"at {place_in_mm(worst.position)}"] if title is None else [],
        legend=False,
        small_print=[
            "Colour of a wall: largest error on the line perpendicular to it.",
            f"Arrow: enlarged {two_digits(_enlarged(worst, low, high))} times."
            f" {method_title(result.method)}.",
        ],
        stamp=stamp,
    )
    if axes is None:
        _scale(figure, panel, wall, worst.value)
    return figure


def _scale(figure: Figure, beside: Axes, wall: PolyCollection, largest: float) -> None:
    """Draw the scale of the walls' colours beside the box."""
    place = beside.get_position()
    width = float(figure.get_figwidth())
    axes = figure.add_axes(
        (place.x1 + 0.4 / width, place.y0 + 0.15 * place.height, 0.13 / width, 0.7 * place.height)
    )
    bar = figure.colorbar(wall, cax=axes)
    ends = (0.0, 0.5 * largest, largest)
    bar.set_ticks(ends, labels=[plain(end * IN_MICRO, 1) for end in ends])
    bar.set_label("error / µm", fontsize=_LETTERS)
    axes.tick_params(labelsize=_LETTERS)


def _walls(panel: Axes, error_map: VolumetricMap, largest: float) -> PolyCollection:
    """Colour the three walls behind the box by the longest error vector in front of each place.

    Returns:
        the last wall; all have one scale of colours.
    """
    nodes = [_spread(one) for one in error_map.nodes]
    grid = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    lengths = np.linalg.norm(error_map.errors(grid.reshape(-1, 3)), axis=1).reshape(grid.shape[:3])
    for axis in range(3):
        wall = np.take(grid, _BEHIND[axis], axis=axis)
        seen = np.max(lengths, axis=axis)
        corners = [wall[:-1, :-1], wall[1:, :-1], wall[1:, 1:], wall[:-1, 1:]]
        places = project(np.stack(corners, axis=2)).reshape(-1, 4, 2)
        cells = (seen[:-1, :-1] + seen[1:, :-1] + seen[1:, 1:] + seen[:-1, 1:]) / 4.0
        shown = PolyCollection(
            list(places),
            array=cells.ravel(),
            cmap=_WALLS,
            clim=(0.0, largest),
            edgecolors="face",
            linewidths=0.3,
            label=f"wall {AXES[axis]}",
        )
        panel.add_collection(shown, autolim=False)
    return shown


def _spread(nodes: Vector) -> Vector:
    count = min(len(nodes), _MOST_NODES)
    chosen: Vector = nodes[np.unique(np.rint(np.linspace(0, len(nodes) - 1, count)).astype(int))]
    return chosen


def _enlarged(worst: VolumetricAccuracy, low: Vector, high: Vector) -> float:
    """Return how many times longer than to the scale of the box the error vector is drawn."""
    return _SHARE * float(np.max(high - low)) / worst.value


def _arrow(panel: Axes, worst: VolumetricAccuracy, low: Vector, high: Vector) -> None:
    """Draw the error vector at its place, and the way from the place to each wall."""
    place, vector = np.asarray(worst.position), np.asarray(worst.vector)
    walls = (low[0], high[1], low[2])
    ways = []
    for axis, wall in enumerate(walls):
        foot = place.copy()
        foot[axis] = wall
        ways.append(np.stack([place, foot]))
    add_wires(panel, ways, colors="0.3", linewidths=0.9, linestyles=":")
    feet = project(np.stack([way[1] for way in ways]))
    panel.plot(*feet.T, marker="s", markersize=3.5, color="0.3", linestyle="none")
    end = place + _enlarged(worst, low, high) * vector
    start, tip = project(place), project(end)
    panel.annotate(
        "",
        xy=(float(tip[0]), float(tip[1])),
        xytext=(float(start[0]), float(start[1])),
        arrowprops={
            "arrowstyle": "-|>,head_width=0.35,head_length=0.7",
            "color": VERMILION,
            "linewidth": 3.0,
            "shrinkA": 0.0,
            "shrinkB": 0.0,
        },
        zorder=6,
    )
    panel.plot(*start, marker="o", markersize=6.0, color=VERMILION, linestyle="none", zorder=6)
    panel.update_datalim(np.stack([start, tip]))
