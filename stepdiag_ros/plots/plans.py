"""The measured box in the machine's travel, with every line that a plan measures."""

import re
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stepdiag_ros.metrology.geometry import AXES, FACE_DIAGONALS, LINEAR_LINES, Vector
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import DIAGONAL, LINEAR, STEP_DIAGONAL, Line, Plan
from stepdiag_ros.metrology.plan import FORWARD as FORWARD_SENSE
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.tracked_line import station_of, test_line_of
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.plots.places import here
from stepdiag_ros.plots.space import add_wires, box_edges, frame_box, project
from stepdiag_ros.plots.style import COLOURS, SMALL_SIZE, Sheet, panel_title
from stepdiag_ros.plots.tracker import tracker_space

_MARKERS = ("o", "^")
_SMALL = 0.5
"""A box whose diagonal is a smaller share of the travel's is drawn without the travel."""
_LEGEND_ROOM = 0.45
"""Left of a drawing, as a share of its size."""
_SHORT_LABEL, _LETTER_ROOM = 12, 0.03
"""Letters of a name in the legend that have room, and the room for each further one."""
_MOST_NAMED = 9
"""Lines of a panel that have their names beside them; more would hide each other's."""
_BESIDE, _WORD = 0.02, 0.12
"""Distance of a step diagonal's name from its end, and of the name's end, as shares of the box."""
_ON_LINE = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
_NO_BREAK = "\u00a0"
_TITLE_WIDTH = 78
"""Characters of a line of the heading."""


def plan(
    plan: Plan,
    machine: Machine | None = None,
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw the lines of a plan in the measured box, one panel for each kind of line, in mm.

    Args:
        plan: what is measured.
        machine: its travel is drawn around the box, unless the box is small in it; None: the box
            alone.
        title: heading; None: name of the plan; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each kind of line, instead of a new figure.
    """
    if plan.tracker is not None:
        return _tracked(plan, title, stamp, axes)
    box: tuple[Vector, Vector] = (np.array(plan.volume.origin), _far_corner(plan))
    outer = box if machine is None else _outer(box, machine)
    kinds: dict[str, list[Line]] = {}
    for line in plan.lines:
        kinds.setdefault(_kind(line), []).append(line)
    columns = min(len(kinds), 2)
    narrow = here().narrow
    sheet = Sheet(
        len(kinds),
        columns,
        2.7 if columns > 1 else 3.9,
        axes=axes,
        left=0.25 if narrow else 0.1,
        right=0.1,
        gap=(0.25 if narrow else 0.1, 0.4),
        bottom=0.05,
    )
    for panel, (words, lines) in zip(sheet.panels, kinds.items(), strict=True):
        if outer is not box:
            add_wires(
                panel, box_edges(*outer), "travel", colors="0.7", linewidths=0.7, linestyles=":"
            )
        add_wires(panel, box_edges(*box), "measured box", colors="0.35", linewidths=0.8)
        distinct = _distinct(lines)
        for index, line in enumerate(distinct):
            _draw_line(panel, plan, line, index)
        named = len(distinct) <= _MOST_NAMED
        if named:
            _name_lines(panel, distinct, plan, box)
        # Where all is narrow, the names beside the lines have to do.
        keyed = not (named and narrow)
        longer = max(len(_label(line, plan)) for line in distinct) - _SHORT_LABEL
        room = _LEGEND_ROOM + _LETTER_ROOM * max(longer, 0)
        frame_box(panel, *outer, room=room if keyed else 0.0)
        panel_title(panel, words)
        if keyed:
            _draw_key(panel)
    heading = _heading(plan) if title is None else [title]
    return sheet.finish(
        heading[0] if heading else "",
        under=heading[1:],
        legend=False,
        small_print=[
            "Squares: first stop of the forward sense. Dashed: the beam of a step diagonal."
            " Places in mm."
        ],
        stamp=stamp,
    )


def _heading(plan: Plan) -> list[str]:
    """Return the name of a plan in lines; the sides of its box are read together."""
    name = re.sub(r"(?<=\d) (?=x \d|mm\b)|(?<=\d x) (?=\d)", _NO_BREAK, plan.name)
    return wrap(name, _TITLE_WIDTH)


def _outer(box: tuple[Vector, Vector], machine: Machine) -> tuple[Vector, Vector]:
    """Return the machine's travel, or the box itself where it is small in it."""
    travel = np.array(machine.travel_low_m), np.array(machine.travel_high_m)
    sizes = [float(np.linalg.norm(high - low)) for low, high in (box, travel)]
    return travel if sizes[0] >= _SMALL * sizes[1] else box


def _draw_key(axes: Axes) -> None:
    axes.legend(
        fontsize=SMALL_SIZE, loc="upper left", frameon=False, handlelength=1.6, borderaxespad=0.0
    )


def _tracked(plan: Plan, title: str | None, stamp: str, axes: Any) -> Figure:
    """Draw the places of a tracker's plan as ``stepdiag tracker plan`` does."""
    lines: dict[str, Vector] = {}
    places: list[Vector] = []
    stations: dict[str, Vector] = {}
    for line in plan.lines:
        assert line.tracked is not None
        stations[station_of(line.name)] = np.array(line.tracked.station)
        if line.tracked.straight:
            lines[test_line_of(line.name)] = line.tracked.stops(forward=True)
        else:
            places.append(line.tracked.stops(forward=True))
    single = np.unique(np.concatenate(places), axis=0) if places else np.empty((0, 3))
    return tracker_space(
        Box(*plan.corners),
        list(stations.values()),
        single,
        lines,
        title=plan.name if title is None else title,
        stamp=stamp,
        axes=axes,
    )


def _far_corner(plan: Plan) -> Vector:
    return np.array([plan.volume.nodes(axis)[-1] for axis in range(3)])


def _kind(line: Line) -> str:
    """Return the title of the panel that a line is drawn in."""
    if line.kind == LINEAR:
        return "Linear lines:\none axis moves"
    if line.kind == STEP_DIAGONAL:
        return "Step diagonals:\none axis at a time"
    where = "Face" if line.name in FACE_DIAGONALS else "Body"
    return f"{where} diagonals:\nall axes of a line at once"


def _distinct(lines: list[Line]) -> list[Line]:
    """Return one pass of each line at each place; move orders and repeats look alike."""
    found: dict[tuple[str, tuple[float, float, float]], Line] = {}
    for line in lines:
        found.setdefault((line.name, line.offset), line)
    return list(found.values())


def _name_lines(axes: Axes, lines: list[Line], plan: Plan, box: tuple[Vector, Vector]) -> None:
    """Write the name of each line beside it, so that a print in grey tells them apart.

    A step diagonal is named beside the end of its forward sense, a straight line on itself.
    """
    corners = project(box_edges(*box)).reshape(-1, 2)
    middle, size = float(np.mean(corners[:, 0])), float(np.ptp(corners, axis=0).max())
    for line in lines:
        stops = line.stops(plan.volume)
        if line.direction != FORWARD_SENSE:
            stops = stops[::-1]
        look: dict[str, Any] = {"ha": "center", "bbox": _ON_LINE}
        at = project(stops[(3 * len(stops)) // 4])
        if line.kind == STEP_DIAGONAL:
            at = project(stops[-1])
            sense = 1.0 if at[0] >= middle else -1.0
            look = {"ha": "left" if sense > 0.0 else "right", "bbox": _ON_LINE | {"pad": 0.2}}
            # Room for the word.
            axes.update_datalim([at + np.array([sense * _WORD * size, 0.0])])
            at = at + np.array([sense * _BESIDE * size, 0.0])
        axes.text(float(at[0]), float(at[1]), line.name, va="center", fontsize=SMALL_SIZE, **look)


def _label(line: Line, plan: Plan) -> str:
    """Return which line it is, and where, in mm of machine coordinates as the drawing is."""
    words = line.setup if line.kind == DIAGONAL else line.setup.replace(line.order, "").strip()
    if not any(line.offset):
        return words
    start = line.stops(plan.volume)[0] * IN_MILLI
    moved = LINEAR_LINES.index(line.name) if line.kind == LINEAR else None
    places = (f"{name} {start[axis]:.4g}" for axis, name in enumerate(AXES) if axis != moved)
    return f"{words.partition('@')[0]} at {', '.join(places)}{line.mount}"


def _draw_line(axes: Axes, plan: Plan, line: Line, index: int) -> None:
    colour = COLOURS[index % len(COLOURS)]
    marker = _MARKERS[index // len(COLOURS) % len(_MARKERS)]
    stops = line.stops(plan.volume)
    drawn = project(stops)
    look: dict[str, Any] = {"color": colour, "linewidth": 1.0, "marker": marker, "markersize": 1.8}
    axes.plot(*drawn.T, **look, label=_label(line, plan))
    if line.order:
        add_wires(axes, [stops[[0, -1]]], colors=colour, linewidths=0.8, linestyles="--")
    # The first stop of the forward sense, where the beam comes from.
    start = drawn[0] if line.direction == FORWARD_SENSE else drawn[-1]
    axes.plot(*start, color=colour, marker="s", markersize=4.0, linestyle="none", label="_start")
