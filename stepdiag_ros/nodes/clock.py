#!/usr/bin/env python3
"""Node: simulated time on /clock, running faster or slower than real time by a factor."""

import sys

from rclpy.clock import Clock, ClockType
from rosgraph_msgs.msg import Clock as ClockMessage

from stepdiag_ros import topics
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.run.pacing import Pace


class ClockNode(StepdiagNode):
    """Publishes /clock: starts at the real time of day and runs ``factor`` times as fast."""

    role = "clock"

    def __init__(self) -> None:
        super().__init__("clock")
        factor = self.parameter("factor", 1.0, "simulated seconds in a real second", 0.001, 1000.0)
        period = self.parameter("period", 0.002, "real seconds between two ticks", 0.0005, 1.0)
        start = Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds
        self._pace = Pace(factor, origin=start, real_start=self.real_time())
        self._publisher = self.announce(topics.CLOCK)
        self.every(period, self._tick, real=True)

    def _tick(self) -> None:
        seconds, nanoseconds = divmod(self._pace.time(self.real_time()), 1_000_000_000)
        message = ClockMessage()
        message.clock.sec, message.clock.nanosec = seconds, nanoseconds
        self._publisher.publish(message)


def main() -> int:
    """Run the node."""
    return spin(ClockNode)


if __name__ == "__main__":
    sys.exit(main())
