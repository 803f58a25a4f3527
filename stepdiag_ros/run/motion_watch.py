"""Whether a move goes where it should, and ends there: judged from actual positions alone."""

from dataclasses import dataclass
from math import isnan

import numpy as np

from stepdiag_ros.devices.cnc import Point
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.units import MICRO

ASTRAY = 1e-3
"""m: farther from the straight way to its target no axis may be; servo lag keeps an axis on it."""
SETTLE_LIMIT = 1.0
"""s after the controller has said that it is done, within which the axes must be in position."""


@dataclass(frozen=True)
class Ending:
    """How a move has ended.

    Attributes:
        time: ns.
        position: actual one then, m.
        trouble: why it has failed; empty if the machine is in position.
    """

    time: int
    position: Point
    trouble: str = ""


class MotionWatch:
    """Follows one move after another by the actual positions.

    A move has ended in position when the controller says that it is done *and* the actual position
    of every axis has stayed within the machine's window of its target for the hold time, seen at
    two samples at least. The window is widened by the resolution of the positions.

    Args:
        machine: window and hold time.
        resolution: of the actual positions, m; NaN if unknown.
    """

    def __init__(self, machine: Machine, resolution: Point) -> None:
        steps = [0.0 if isnan(step) else step for step in resolution]
        self._window = machine.position_window_m + np.array(steps)
        self._hold = round(machine.position_hold_s * 1e9)
        self._start: Vector = np.zeros(3)
        self._target: Vector | None = None
        self._done: int | None = None
        self._inside_since: int | None = None
        self._last: tuple[int, Point] | None = None

    def begin(self, start: Point, target: Point) -> None:
        """Expect a straight move from one place to another, m."""
        self._start, self._target = np.asarray(start), np.asarray(target)
        self._done = self._inside_since = self._last = None

    def end(self) -> None:
        """Expect nothing any more."""
        self._target = None

    def done(self, time: int) -> Ending | None:
        """Take the controller's word that the move is done (ns)."""
        if self._target is None:
            return None
        self._done = time
        if self._last is not None and self._has_held(self._last[0]):
            return self._ended(time, self._last[1])
        return None

    def take(self, time: int, position: Point) -> Ending | None:
        """Take an actual position (m) of a time (ns); return how the move has ended, if it has."""
        if self._target is None or (self._last is not None and time <= self._last[0]):
            return None
        off = np.abs(np.asarray(position) - self._target)
        within = bool(np.all(off <= self._window))
        if not within:
            self._inside_since = None
        elif self._inside_since is None:
            self._inside_since = time
        self._last = (time, position)
        if self._done is None:
            astray = self._astray(np.asarray(position))
            return self._ended(time, position, astray) if astray else None
        if within and self._has_held(time):
            return self._ended(max(time, self._done), position)
        # Written so that a position that is not a number is off.
        if not within and time - self._done > SETTLE_LIMIT * 1e9:
            return self._ended(time, position, self._not_there(off))
        return None

    def _has_held(self, time: int) -> bool:
        since = self._inside_since
        return since is not None and time > since and time - since >= self._hold

    def _ended(self, time: int, position: Point, trouble: str = "") -> Ending:
        self._target = None
        return Ending(time, position, trouble)

    def _astray(self, position: Vector) -> str:
        assert self._target is not None
        way = self._target - self._start
        length = float(way @ way)
        share = float((position - self._start) @ way) / length if length else 0.0
        nearest = self._start + min(max(share, 0.0), 1.0) * way
        off = np.abs(position - nearest)
        if np.all(off <= ASTRAY):
            return ""
        worst = int(np.argmax(off))
        return (
            f"{AXES[worst]} is {off[worst] * 1e3:.2f} mm off the straight way to its target: "
            "the machine does not go where it was sent"
        )

    def _not_there(self, off: Vector) -> str:
        worst = int(np.argmax(off - self._window))
        return (
            f"the controller says that the move is done, but {AXES[worst]} is "
            f"{off[worst] / MICRO:.3g} µm off its target; within "
            f"{self._window[worst] / MICRO:.3g} µm it would be in position"
        )
