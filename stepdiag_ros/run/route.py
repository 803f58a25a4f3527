"""The way of the machine in a run: to the first stop of a line, along the line, back for a stop."""

from collections import deque
from enum import Enum

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.plan import Line, Plan


class _Approach(Enum):
    """How far the machine has come on its way to a line."""

    TO_FIRST_STOP = 1
    BEYOND_IT = 2
    ON_LINE = 3


class MachineRoute:
    """Says where the machine goes next, one straight move after the other.

    A move is one of a single axis, except along a line whose axes move at once.

    Args:
        plan: the test plan.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._approach = _Approach.TO_FIRST_STOP
        self._back: deque[Vector] = deque()
        # Stop of a tracker's line that the way in ``_back`` leads to; None: it is not laid yet.
        self._leads_to: int | None = None

    def begin_line(self, line_index: int) -> None:
        """Go to a line next; from the line before on a way that keeps the mirror in the beam."""
        self._approach = _Approach.TO_FIRST_STOP
        tracked = self._plan.tracker is not None
        self._back = deque(() if tracked else self._plan.way_back(line_index))

    def restart_line(self) -> None:
        """Go to the first stop of the line again, from wherever the machine stands."""
        self._approach = _Approach.TO_FIRST_STOP
        self._back.clear()
        self._leads_to = None

    def repeat(self, line: Line, stop: int) -> None:
        """Come to a stop of the line again, in the same direction as before."""
        if stop and (line.tracked is None or line.tracked.straight):
            self._back.append(line.stops(self._plan.volume)[stop - 1])
        else:
            self._approach = _Approach.TO_FIRST_STOP

    def next(self, line: Line, stop: int, position: Vector) -> tuple[Vector, bool]:
        """Return where the machine goes next, m, and whether that is the stop itself.

        Args:
            line: that is to be measured.
            stop: of the line.
            position: where the machine stands, m.

        Raises:
            ValueError: a tracker sees no way to the stop.
        """
        if line.tracked is not None and self._leads_to != stop and not self._back:
            first = self._approach is _Approach.TO_FIRST_STOP
            if first or not line.tracked.straight:
                self._back = deque(self._plan.way_to(line, stop, position))
            self._leads_to = stop
        if self._back:
            return self._back.popleft(), False
        stops = line.stops(self._plan.volume)
        if line.tracked is not None:
            self._approach, self._leads_to = _Approach.ON_LINE, None
            return stops[stop], True
        if self._approach is _Approach.TO_FIRST_STOP:
            # One axis at a time, so that the machine never leaves the edges of its box.
            away = [axis for axis in range(3) if position[axis] != stops[0][axis]]
            if away:
                target = position.copy()
                target[away[0]] = stops[0][away[0]]
                return target, False
            self._approach = _Approach.BEYOND_IT
            beyond = self._plan.run_up(line)
            if beyond is not None:
                return beyond, False
        # Back from beyond the first stop along the line itself, so that the beam is kept.
        self._approach = _Approach.ON_LINE
        return stops[stop], True
