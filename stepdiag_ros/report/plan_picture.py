"""The measured box in the machine's travel, with every line that a plan measures."""

from itertools import product
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, FACE_DIAGONALS, Vector
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import DIAGONAL, LINEAR, STEP_DIAGONAL, Line, Plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

_MILLI = 1e3
_DOTS_PER_INCH = 150


_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#999999")
_MARKERS = ("o", "^")
_SMALL = 0.5
"""A box whose diagonal is a smaller share of the travel's is drawn without the travel."""
_TITLE_WIDTH = 78
"""Characters of the title above one panel."""


def plan_picture(plan: Plan, machine: Machine) -> "Picture":
    """Draw the lines of a plan in the measured box, one panel for each kind of line, in mm.

    Args:
        plan: what is measured.
        machine: its travel is drawn around the box, unless the box is small in it.
    """
    from matplotlib.figure import Figure as Picture

    sides = [high - low for low, high in (_box(plan), _travel(machine))]
    whole = bool(np.linalg.norm(sides[0]) >= _SMALL * np.linalg.norm(sides[1]))
    panels: dict[str, list[Line]] = {}
    for line in plan.lines:
        panels.setdefault(_panel(line), []).append(line)
    picture = Picture(figsize=(6.2 * len(panels), 6.4), dpi=_DOTS_PER_INCH)
    for number, (title, lines) in enumerate(panels.items(), start=1):
        axes = picture.add_subplot(1, len(panels), number, projection="3d")
        if whole:
            _draw_box(axes, *_travel(machine), "0.75", "travel")
        _draw_box(axes, *_box(plan), "0.35", "measured box")
        for index, line in enumerate(_distinct(lines)):
            _draw_line(axes, plan, line, index)
        _tidy(axes, *(_travel(machine) if whole else _box(plan)))
        axes.set_title(title, fontsize=9.5)
        axes.legend(
            fontsize=7.5, loc="upper center", bbox_to_anchor=(0.5, 0.06), ncols=4, frameon=False
        )
    words = fill(plan.name, _TITLE_WIDTH * len(panels))
    picture.suptitle(f"{words}\nsquares: first stop of the forward sense", fontsize=10.5, y=0.985)
    picture.subplots_adjust(left=0.02, right=0.94, bottom=0.07, top=0.88, wspace=0.12)
    return picture


def _panel(line: Line) -> str:
    """Return the title of the panel that a line is drawn in."""
    if line.kind == LINEAR:
        return "Linear lines: one axis moves"
    if line.kind == STEP_DIAGONAL:
        return "Step diagonals: one axis at a time, dashed: the beam"
    where = "Face" if line.name in FACE_DIAGONALS else "Body"
    return f"{where} diagonals: all axes of a line at once"


def _distinct(lines: list[Line]) -> list[Line]:
    """Return one pass of each line at each place; move orders and repeats look alike."""
    found: dict[tuple[str, tuple[float, float, float]], Line] = {}
    for line in lines:
        found.setdefault((line.name, line.offset), line)
    return list(found.values())


def _travel(machine: Machine) -> tuple[Vector, Vector]:
    return np.array(machine.travel_low_m), np.array(machine.travel_high_m)


def _box(plan: Plan) -> tuple[Vector, Vector]:
    low = np.array(plan.volume.origin)
    return low, low + plan.volume.blocks * np.array(plan.volume.step)


def _draw_box(axes: Any, low: Vector, high: Vector, colour: str, label: str) -> None:
    corners = np.array([low, high]) * _MILLI
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        for ends in product((0, 1), repeat=2):
            edge = np.empty((2, 3))
            edge[:, axis] = corners[:, axis]
            for other, end in zip(others, ends, strict=True):
                edge[:, other] = corners[end, other]
            axes.plot(*edge.T, color=colour, linewidth=0.8, label=label)
            label = "_hidden"


def _draw_line(axes: Any, plan: Plan, line: Line, index: int) -> None:
    colour = _COLOURS[index % len(_COLOURS)]
    marker = _MARKERS[index // len(_COLOURS) % len(_MARKERS)]
    stops = line.stops(plan.volume) * _MILLI
    label = line.setup if line.kind == DIAGONAL else line.setup.replace(line.order, "").strip()
    axes.plot(*stops.T, color=colour, linewidth=1.1, marker=marker, markersize=2.2, label=label)
    if line.order:
        axes.plot(*stops[[0, -1]].T, color=colour, linewidth=0.9, linestyle="--")
    # The first stop of the forward sense, where the beam comes from.
    start = stops[0] if line.direction == "forward" else stops[-1]
    axes.plot(*start[:, np.newaxis], color=colour, marker="s", markersize=4.5, label="_hidden")


def _tidy(axes: Any, low: Vector, high: Vector) -> None:
    axes.set_box_aspect(tuple(high - low), zoom=0.92)
    for letter, first, last in zip(AXES, low, high, strict=True):
        getattr(axes, f"set_{letter.lower()}lim")(first * _MILLI, last * _MILLI)
        getattr(axes, f"set_{letter.lower()}label")(f"{letter} / mm", fontsize=8.5)
    axes.tick_params(labelsize=7)
    axes.view_init(elev=24.0, azim=-58.0)
    axes.grid(visible=False)
    for pane in (axes.xaxis, axes.yaxis, axes.zaxis):
        pane.set_pane_color((1.0, 1.0, 1.0, 0.0))
