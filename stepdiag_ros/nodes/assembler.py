#!/usr/bin/env python3
"""Node: makes settled stops, block displacements and lines from commands, arrivals and readings."""

import sys
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.messages.conversion import (
    axis_positions,
    from_block,
    from_measured_line,
    from_settled_stop,
    to_arrival,
    to_reading,
    to_stop_command,
)
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.metrology.assembly import Assembler, Event
from stepdiag_ros.metrology.measurement import BlockDisplacement, SettledStop
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.run.health import Gaps, HealthFinding, Level
from stepdiag_ros.run.timing import LiveTiming
from stepdiag_ros.run.work_health import StopCount, StreamArrival
from stepdiag_ros.topics import Topic


class AssemblerNode(StepdiagNode):
    """Publishes what the readings say about every stop, move and line; depends on stamps alone."""

    role = "assembler"

    def __init__(self) -> None:
        super().__init__("assembler")
        self._assembler: Assembler | None = None
        self._timing: LiveTiming | None = None
        # Commands and arrivals of a run whose description has not come yet.
        self._early: deque[tuple[Topic, Callable[[Any], None], Any]] = deque(maxlen=1000)
        self._stops = self.announce(topics.STOP)
        self._blocks = self.announce(topics.BLOCK)
        self._lines = self.announce(topics.LINE)
        self._gaps = Gaps()
        self._coming = StreamArrival("reading", self.parameter("reading_timeout"))
        self.on_change("reading_timeout", partial(setattr, self._coming, "stale_after"))
        self._decided = StopCount()
        self.health.add_task("readings", self._judge_readings)
        self.health.add_task("sequence", self._judge_sequence)
        self.health.add_task("stops", lambda: self._decided.judge(), log=False)
        self.health.add_task("timing", self._judge_timing)
        self.follow_run()
        # A fast replay on a busy computer may be seconds ahead of this node.
        self.listen(topics.MACHINE_COMMAND, self._on_command, keep_all=True)
        self.listen(topics.COMMAND_STATUS, self._on_status, keep_all=True)
        self.listen(topics.READING, self._on_reading, keep_all=True)
        self.listen(topics.JOINT_STATES, self._on_joints, keep_all=True)

    def on_run(self, description: Any) -> None:
        """Start again with the plan of the run."""
        plan = plan_from_text(description.plan, "plan of the run")
        start = to_nanoseconds(description.header.stamp)
        self._assembler = Assembler(plan, start)
        self._timing = LiveTiming(plan, start)
        self.run_id = description.run_id
        self._gaps.begin()
        self._coming.begin(self.now(), self.real_time())
        self._decided = StopCount()
        for _ in range(len(self._early)):
            topic, callback, message = self._early.popleft()
            self.try_with(topic.name, callback, message)

    def _on_command(self, message: Any) -> None:
        if self._assembler is None or message.run_id != self.run_id:
            self._early.append((topics.MACHINE_COMMAND, self._on_command, message))
            return
        command = to_stop_command(message)
        if command is not None:
            self._publish(self._assembler.add_command(command))

    def _on_status(self, message: Any) -> None:
        if self._assembler is None or message.run_id != self.run_id:
            self._early.append((topics.COMMAND_STATUS, self._on_status, message))
            return
        arrival = to_arrival(message)
        if arrival is not None:
            self._publish(self._assembler.add_arrival(arrival))

    def _on_reading(self, message: Any) -> None:
        reading, real = to_reading(message), self.real_time()
        self._coming.take(reading.time, real)
        self._gaps.take(reading.sequence, reading.time, real)
        if self._assembler is not None:
            self._publish(self._assembler.add_reading(reading))
        if self._timing is not None:
            self._timing.take_reading(reading)

    def _on_joints(self, message: Any) -> None:
        position = axis_positions(message)
        if position is None:
            return
        time = to_nanoseconds(message.header.stamp)
        if self._assembler is not None:
            self._publish(self._assembler.add_position(time, position))
        if self._timing is not None:
            self._timing.take_position(time, position)

    def _judge_readings(self) -> HealthFinding:
        return self._coming.judge(not self.run_over, self.now(), self.real_time())

    def _judge_timing(self) -> HealthFinding:
        if self._timing is None:
            return HealthFinding(Level.OK, "no run was begun yet")
        return self._timing.judge()

    def _judge_sequence(self) -> HealthFinding:
        return self._gaps.judge(not self.run_over, self.real_time())

    def _publish(self, events: Iterable[Event]) -> None:
        for event in events:
            if isinstance(event, SettledStop):
                where = f"{event.line}, stop {event.command.stop}"
                self._decided.take("" if event.settled else f"{where}: {event.reason}")
                if not event.settled:
                    self.get_logger().warning(f"{where} rejected: {event.reason}")
                self._stops.publish(from_settled_stop(event, self.run_id))
            elif isinstance(event, BlockDisplacement):
                self._blocks.publish(from_block(event, self.run_id))
            else:
                self._decided.lines += 1
                if self._timing is not None:
                    self._timing.take_line(event)
                self._lines.publish(from_measured_line(event, self.run_id))


def main() -> int:
    """Run the node."""
    return spin(AssemblerNode)


if __name__ == "__main__":
    sys.exit(main())
