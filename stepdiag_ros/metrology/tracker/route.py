"""Ways between places that keep clear of the tracker and in its sight.

A machine goes from one line to the next one axis after the other. The straight way may lead through
the tracker; then another order of the axes, or a detour by corners of the volume, is taken.
"""

from collections import deque
from itertools import pairwise, permutations, product

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.instrument import Tracker

_SAME = 1e-9


class TrackerRoute:
    """Finds ways on one machine with one tracker.

    Args:
        box: where the machine may go.
        station: of the tracker, m, shape (3,).
        tracker: its limits.
    """

    def __init__(self, box: Box, station: Vector, tracker: Tracker) -> None:
        self._station, self._tracker = np.asarray(station, dtype=np.float64), tracker
        middle = 0.5 * (box.low + box.high)
        sides = [np.array(side) for side in zip(box.low, middle, box.high, strict=True)]
        self._detours = [
            place
            for place in (np.array(corner) for corner in product(*sides))
            if not tracker.unseen(place, self._station)
        ]

    def way(self, start: Vector, end: Vector) -> list[Vector]:
        """Return the places from a start to an end, one axis moving at a time, without the start.

        Raises:
            ValueError: there is no way in sight of the tracker.
        """
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        queue: deque[tuple[Vector, list[Vector]]] = deque([(start, [])])
        open_places = list(self._detours)
        while queue:
            place, before = queue.popleft()
            direct = self._axis_by_axis(place, end)
            if direct is not None:
                return before + direct
            still_open = []
            for detour in open_places:
                leg = self._axis_by_axis(place, detour)
                if leg is None:
                    still_open.append(detour)
                else:
                    queue.append((detour, before + leg))
            open_places = still_open
        raise Refusal(
            "there is no way from "
            f"({', '.join(f'{value:.4g}' for value in start)}) m to "
            f"({', '.join(f'{value:.4g}' for value in end)}) m on which the tracker keeps the"
            " reflector in sight; place the tracker elsewhere",
            fault="not_found",
        )

    def reach(self, start: Vector, end: Vector) -> Vector:
        """Return the places from a start to an end, one axis moving at a time, m, shape (n, 3).

        From a start that the tracker does not see no way is in its sight: the axes go one after
        the other, X before Y before Z, and the tracker has to be locked on where they end.

        Args:
            start: m, shape (3,).
            end: the same.

        Raises:
            ValueError: the tracker sees the start, and there is no way to the end in its sight.
        """
        if self._tracker.unseen(start, self._station):
            corners = [np.where(np.arange(3) < count, end, start) for count in (1, 2, 3)]
        else:
            corners = self.way(start, end)
        moves = pairwise([start, *corners])
        return np.array([there for here, there in moves if np.any(there != here)]).reshape(-1, 3)

    def _axis_by_axis(self, start: Vector, end: Vector) -> list[Vector] | None:
        """Return the corners of a way in one of six orders of the axes; None if all are barred."""
        for order in permutations(range(3)):
            here, corners = start, []
            for axis in order:
                if abs(end[axis] - here[axis]) < _SAME:
                    continue
                there = here.copy()
                there[axis] = end[axis]
                if self._tracker.unseen_on_the_way(here, there, self._station):
                    break
                corners.append(there)
                here = there
            else:
                return corners
        return None
