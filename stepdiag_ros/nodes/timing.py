"""A node's two clocks: ROS time, which simulations and replays set, and one that never steps."""

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer


class TimedNode(Node):
    """A node that keeps ROS time and real time apart; takes the arguments of ``Node``."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._real_clock = Clock(clock_type=ClockType.STEADY_TIME)
        # The embedded client can look for the simulated time when it is asked for, where rclpy
        # wakes a node at each tick.
        look_when_asked = getattr(self._time_source, "look_when_asked", None)
        if look_when_asked is not None:
            look_when_asked()

    def now(self) -> int:
        """Return the ROS time in ns."""
        nanoseconds: int = self.get_clock().now().nanoseconds
        return nanoseconds

    def real_time(self) -> float:
        """Return the time in s of a clock that neither steps nor follows the simulation."""
        return float(self._real_clock.now().nanoseconds) * 1e-9

    def every(self, seconds: float, callback: Callable[[], None], real: bool = False) -> Timer:
        """Call back periodically, in ROS time or (``real``) on the clock that never steps."""
        return self.create_timer(seconds, callback, clock=self._real_clock if real else None)
