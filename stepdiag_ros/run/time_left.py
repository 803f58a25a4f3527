"""How long the rest of a run takes, from the stops so far."""

import math

from stepdiag_ros.metrology.units import NANOSECONDS


class TimeLeft:
    """Counts the time in which stops were measured; while a run stands still, none is counted."""

    def __init__(self) -> None:
        self._time = 0
        self._stops = 0
        # When it was last looked at, if stops were being measured then.
        self._since: int | None = None

    def look(self, now: int, measuring: bool) -> None:
        """Take note of the time; to be called often.

        Args:
            now: ROS time, ns.
            measuring: the run goes on now, and neither waits for a person nor is held by a fault.
        """
        if self._since is not None:
            self._time += max(0, now - self._since)
        self._since = now if measuring else None

    def stop_measured(self) -> None:
        """Count a stop; one that is measured again counts again."""
        self._stops += 1

    def estimate(self, stops_left: int) -> float:
        """Return how long that many stops take, s; NaN before the first stop.

        What a person takes to set up laser and mirror is not in it.
        """
        if not self._stops:
            return math.nan
        return self._time / NANOSECONDS / self._stops * stops_left
