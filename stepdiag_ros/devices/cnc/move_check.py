"""What every driver refuses before a move is sent to a controller."""

from collections.abc import Sequence
from math import isfinite

from stepdiag_ros.devices.cnc import MoveRefused, Point
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.text.controls import one_line

ROUNDING = 1e-9
"""m: what decimal fractions of a millimetre lose in binary ones of a metre."""


def far_axes(position: Point, target: Point, near: Sequence[float]) -> str:
    """Return the axes that are farther from a target than ``near`` (m), or not known."""
    return "".join(
        axis
        for axis, a, b, window in zip(AXES, target, position, near, strict=True)
        if not abs(a - b) <= window + ROUNDING
    )


def check_target(
    position: Point,
    target: Point,
    feed: float,
    axes: str,
    *,
    limits: tuple[Point, Point],
    feed_limit: float,
    near: Sequence[float],
) -> str:
    """Refuse a move that must not be made; return the axes that it moves.

    Args:
        position: where the machine is, m.
        target: after the move, m.
        feed: m/s.
        axes: that may move, such as ``XY``; each is part of what is sent.
        limits: lower and upper soft limits, m.
        feed_limit: m/s.
        near: of each axis, m: as far as this from the target is not a move.

    Raises:
        MoveRefused: the text says why.
    """
    if not set(axes) <= set(AXES) or len(set(axes)) < len(axes):
        raise MoveRefused(
            f"'{one_line(axes)[:20]}' is not some of the axes X, Y and Z, each once",
            fault="malformed",
            aspect="axes",
        )
    if not all(map(isfinite, (*target, *position))):
        raise MoveRefused(
            f"the target {target} is not a position, or no position is known",
            fault="malformed",
            aspect="target",
        )
    if not 0.0 < feed <= feed_limit:
        raise MoveRefused(
            f"the feed {feed:g} m/s is not above 0 and up to {feed_limit:g} m/s",
            fault="out_of_range",
            aspect="feed",
        )
    for name, value, low, high in zip(AXES, target, *limits, strict=True):
        if not low <= value <= high:
            raise MoveRefused(
                f"{name} = {value:g} m lies beyond the soft limits {low:g} m to {high:g} m",
                fault="out_of_range",
                aspect="limits",
            )
    far = far_axes(position, target, near)
    if not set(far) <= set(axes):
        asked = f"one of {' and '.join(axes)}" if axes else "none"
        raise MoveRefused(
            f"the move is of {' and '.join(far)}, but was asked for as {asked}",
            fault="mismatch",
            aspect="axes",
        )
    return far
