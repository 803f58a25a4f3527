#!/usr/bin/env python3
"""Node: records each run into one MCAP file that survives a crash."""

import sys
from collections import deque
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.utilities import get_rmw_implementation_identifier

from stepdiag_ros import topics
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.conversion import to_nanoseconds
from stepdiag_ros.embedded import client
from stepdiag_ros.nodes.base import StepdiagNode, message_class, spin
from stepdiag_ros.nodes.parameters import ParameterCollector
from stepdiag_ros.run.sequence import STORE_LIMIT
from stepdiag_ros.run.supervision import HEARD_UNTIL, fact_of_run
from stepdiag_ros.topics import Topic

ASK_PERIOD = 0.2
LINGER = 1.0
"""Real seconds of silence on lines and results after a run, before its bag is closed."""


class RecorderNode(StepdiagNode):
    """Opens a bag when a run begins, flushes it at every stop, closes it when the run has ended."""

    role = "recorder"
    _newest_reading = b""

    def __init__(self) -> None:
        super().__init__("recorder")
        folder = self.parameter("folder", ".", "folder in which bags are written, RUN.mcap each")
        self._folder = Path(folder).expanduser()
        self._folder.mkdir(parents=True, exist_ok=True)
        self._writer: BagWriter | None = None
        self._close_at: float | None = None
        self._close_latest = 0.0
        # Stops whose readings are still on their way: on a busy computer the many readings come
        # seconds after the few stops that were made from them.
        self._incomplete: deque[Any] = deque()
        self._failure = ""
        self._collector = ParameterCollector(self)
        self.follow_run()
        for topic in topics.RECORDED:
            if topic is not topics.RUN_DESCRIPTION:
                self.listen(topic, partial(self._record, topic), keep_all=True, raw=True)
        self.every(0.2, self._close_when_over, real=True)
        self.every(ASK_PERIOD, self._ask_parameters, real=True)

    def on_run(self, description: Any) -> None:
        """Open the bag of the run; a run that is taken up again gets a bag of its own."""
        self._close()
        header = RunHeader(
            run_id=description.run_id,
            plan_name=plan_from_text(description.plan, "plan of the run").name,
            software_version=description.software_version,
            schema_version=description.schema_version,
            middleware=f"{client()}, {get_rmw_implementation_identifier()}",
            start_time=to_nanoseconds(description.header.stamp),
            plan=description.plan,
            machine=description.machine,
            simulated_cell=description.simulated_cell,
            parameters=yaml.safe_dump(self._collector.values),
        )
        writer = BagWriter(self._free_path(description.run_id), header)
        self._writer, self._close_at, self._failure = writer, None, ""
        self._incomplete.clear()
        self._record(topics.RUN_DESCRIPTION, serialize_message(description))
        self.get_logger().info(f"recording {writer.path}")

    def on_run_end(self) -> None:
        """Close the bag after the last results, and the readings of the last stop, have come."""
        self._close_at = self.real_time() + LINGER
        self._close_latest = self.real_time() + STORE_LIMIT

    def close(self) -> None:
        """Close the bag that is open."""
        self._close()

    def _record(self, topic: Topic, message: bytes) -> None:
        if topic is topics.READING:
            self._newest_reading = message
        if self._writer is None:
            return
        try:
            name = self.resolve_topic_name(topic.name)
            self._writer.write(name, topic.type_name, message, self.now())
            if topic is topics.RUN_STATE:
                self._writer.flush()
            elif topic is topics.STOP:
                self._incomplete.append(deserialize_message(message, message_class(topic)))
                self._complete_stops(self._writer)
            elif topic is topics.READING and self._incomplete:
                self._complete_stops(self._writer)
        except BagError as error:
            self._writer, self._failure = None, str(error)
            self.unwell(self._failure)
        if self._close_at is not None and topic.derived:
            self._close_at = self.real_time() + LINGER

    def _complete_stops(self, writer: BagWriter) -> None:
        """Put stops on the disk whose readings are all there; only then may the machine go on."""
        stored, until = None, self._heard_until()
        while self._incomplete and to_nanoseconds(self._incomplete[0].window_end) <= until:
            stored = self._incomplete.popleft()
        if stored is not None:
            writer.flush()
            self.facts["stored"] = fact_of_run(stored.run_id, str(stored.command_id))
            self.beat()

    def _heard_until(self) -> int:
        if not self._newest_reading:
            return 0
        reading = deserialize_message(self._newest_reading, message_class(topics.READING))
        return to_nanoseconds(reading.header.stamp)

    def beat(self) -> None:
        """Say with the heartbeat how far the readings have been taken."""
        if self._newest_reading:
            self.facts[HEARD_UNTIL] = str(self._heard_until())
        super().beat()

    def _close_when_over(self) -> None:
        if self._close_at is None:
            return
        awaited = self._incomplete and self.real_time() < self._close_latest
        if awaited or self.watch.working():
            self._close_at = self.real_time() + LINGER
        elif self.real_time() >= self._close_at:
            self._close()

    def _close(self) -> None:
        writer, self._writer, self._close_at = self._writer, None, None
        if writer is None:
            if self._failure:
                self.healthy(f"ready; recorded only in part: {self._failure}")
            return
        try:
            writer.close()
        except BagError as error:
            self.unwell(str(error))
            return
        self.get_logger().info(f"closed {writer.path}: {writer.message_count} messages")
        self.healthy(f"ready; recorded {writer.path}")

    def _free_path(self, run_id: str) -> Path:
        path, part = self._folder / f"{run_id}.mcap", 1
        while path.exists():
            part += 1
            path = self._folder / f"{run_id}_part{part}.mcap"
        return path

    def _ask_parameters(self) -> None:
        for name in (self.get_fully_qualified_name(), *self.watch.peers):
            self._collector.ask(name, self.real_time())
        if self.run_over and self._collector.waiting(self.real_time()):
            self.not_ready("asking the other nodes for their parameters")
        else:
            self.ready()


def main() -> int:
    """Run the node."""
    return spin(RecorderNode)


if __name__ == "__main__":
    sys.exit(main())
