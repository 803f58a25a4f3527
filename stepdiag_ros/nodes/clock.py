#!/usr/bin/env python3
"""Node: simulated time on /clock, running faster or slower than real time by a factor."""

import sys

from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage

from stepdiag_ros import topics
from stepdiag_ros.bags.peek import stamp_of
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.nodes.links import message_class
from stepdiag_ros.run.health import HealthFinding
from stepdiag_ros.run.pacing import RECORDER_LAG, GovernedTime
from stepdiag_ros.run.supervision import HEARD_UNTIL, Peer
from stepdiag_ros.run.work_health import Reached


class ClockNode(StepdiagNode):
    """Publishes /clock: starts at the real time of day and runs ``factor`` times as fast.

    It waits for the interferometer, whose readings come last in the chain of simulated devices, and
    for the recorder, which must take all of them.
    """

    role = "clock"

    def __init__(self) -> None:
        super().__init__("clock")
        factor = self.parameter("factor")
        period = self.parameter("period")
        start = Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds
        self._governed = GovernedTime(factor, origin=start, real_start=self.real_time())
        self._publisher = self.announce(topics.CLOCK)
        self._reached = Reached()
        self.health.add_task("pace", self._judge_pace, log=False)
        self.follow_run()
        # Only the newest reading matters, and none is worth a repetition.
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        reading = topics.READING
        self.create_subscription(
            message_class(reading), reading.name, self._on_reading, newest, raw=True
        )
        self.on_change("factor", lambda new: self._governed.run_at(new, self.real_time()))
        self.every(period, self._tick, real=True)

    def _on_reading(self, message: bytes) -> None:
        self._governed.heard(stamp_of(message), self.real_time(), "interferometer")

    def on_heartbeat(self, peer: Peer) -> None:
        """Wait for a recorder that is behind."""
        if HEARD_UNTIL in peer.facts:
            until = int(peer.facts[HEARD_UNTIL])
            self._governed.heard(until, self.real_time(), peer.role, RECORDER_LAG)

    def _judge_pace(self) -> HealthFinding:
        return self._reached.judge(self._governed, self.real_time())

    def _tick(self) -> None:
        seconds, nanoseconds = divmod(self._governed.advance(self.real_time()), 1_000_000_000)
        message = ClockMessage()
        message.clock.sec, message.clock.nanosec = seconds, nanoseconds
        self._publisher.publish(message)


def main() -> int:
    """Run the node."""
    return spin(ClockNode)


if __name__ == "__main__":
    sys.exit(main())
