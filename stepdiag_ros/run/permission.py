"""What a plan allows its commands to do: the bridge's check, whoever sends the command."""

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, Vector, beam_direction, line_signs
from stepdiag_ros.metrology.plan import DIAGONAL, FORWARD, Line, Plan

OFF_LINE = 1e-4
"""m: farther from its line no move of several axes begins or ends; far above any in-position window
and far below what could hit anything."""


def refusal_of_plan(
    plan: Plan,
    line_index: int,
    axes: str,
    position: tuple[float, float, float],
    target: tuple[float, float, float],
) -> str:
    """Say why a plan does not allow a move; empty if it does.

    A single axis may move anywhere within the soft limits. Several axes move at once only on lines
    of kind ``diagonal``, all axes of the line together, and from place to place on the line itself,
    at most the plan's overrun beyond its ends.

    Args:
        plan: of the present run.
        line_index: that the command names.
        axes: that are to move at once, such as X or XYZ.
        position: where the machine stands, m.
        target: where the move ends, m.
    """
    if len(axes) <= 1:
        return ""
    if not 0 <= line_index < len(plan.lines):
        return f"it is for line {line_index}, but the plan has {len(plan.lines)} lines"
    line = plan.lines[line_index]
    at_once = " and ".join(axes)
    if line.kind != DIAGONAL:
        return f"it moves {at_once} at once; on line '{line}' only one axis may move at a time"
    own = [axis for axis, sign in zip(AXES, line_signs(line.name), strict=True) if sign]
    if list(axes) != own:
        return f"it moves {at_once} at once, but line '{line}' is one of {' and '.join(own)}"
    for words, place in (("begins", position), ("ends", target)):
        if not _on_line(np.asarray(place, dtype=np.float64), line, plan):
            x, y, z = place
            return f"it {words} at {x:g}, {y:g}, {z:g} m, which is not on line '{line}'"
    return ""


def _on_line(place: Vector, line: Line, plan: Plan) -> bool:
    stops = line.stops(plan.volume)
    first, last = (stops[0], stops[-1]) if line.direction == FORWARD else (stops[-1], stops[0])
    direction = beam_direction(line.name, np.asarray(plan.volume.step))
    along = float(direction @ (place - first))
    beside = float(np.linalg.norm(place - first - along * direction))
    reach = plan.overrun + OFF_LINE
    length = float(direction @ (last - first))
    # Written so that a place that is no number is not on the line.
    return beside <= OFF_LINE and -reach <= along <= length + reach
