"""Where lines were measured, in words: along which axes, and where the others stood."""

from collections.abc import Iterable

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, line_signs
from stepdiag_ros.metrology.plan import Line, Plan
from stepdiag_ros.metrology.tracker.tracked_line import TRACKER
from stepdiag_ros.metrology.units import IN_MILLI


def moved_axes(lines: Iterable[Line]) -> tuple[str, ...]:
    """Return the axes that move along some lines, in the order X, Y, Z; all for a tracker."""
    moved = np.zeros(len(AXES), dtype=bool)
    for line in lines:
        moved |= line.kind == TRACKER or line_signs(line.name) != 0
    return tuple(axis for axis, moves in zip(AXES, moved, strict=True) if moves)


def extent_words(plan: Plan) -> str:
    """Return the ranges of the axes that a plan moves, and where the others stand, in mm.

    The box of a plan has three sides even where its lines move one axis alone; the sides that no
    line measures are not stated.
    """
    moved = moved_axes(plan.lines) or AXES
    ranges, places = [], []
    for place, (axis, nodes) in enumerate(zip(AXES, plan.volume.all_nodes, strict=True)):
        if axis in moved:
            ranges.append(f"{axis} {nodes[0] * IN_MILLI:.6g} to {nodes[-1] * IN_MILLI:.6g}")
            continue
        stood = dict.fromkeys(
            f"{(nodes[0] + line.offset[place]) * IN_MILLI:.6g}" for line in plan.lines
        )
        places.append(f"{axis} {' and '.join(stood)}")
    at = f", at {', '.join(places)} mm" if places else ""
    return f"{', '.join(ranges)} mm{at}"
