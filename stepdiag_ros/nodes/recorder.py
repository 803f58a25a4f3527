#!/usr/bin/env python3
"""Node: records each run into one MCAP file that survives a crash."""

import os
import sys
from collections import deque
from errno import EACCES
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from rclpy.serialization import serialize_message
from rclpy.utilities import get_rmw_implementation_identifier

from stepdiag_ros import topics
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.peek import block_head_of, head_of, stamp_of
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.embedded import client
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.nodes.links import decoded, message_class
from stepdiag_ros.nodes.parameters import ParameterCollector
from stepdiag_ros.run.conclusion import BAG, BAG_CLOSED, BAG_FAILURE
from stepdiag_ros.run.health import Gaps, HealthFinding
from stepdiag_ros.run.identity import file_name_of
from stepdiag_ros.run.sequence import STORE_LIMIT
from stepdiag_ros.run.supervision import BY_HAND_ROLE, HEARD_UNTIL, fact_of_run
from stepdiag_ros.run.work_health import Storage, StreamArrival, judge_recording
from stepdiag_ros.topics import Topic

ASK_PERIOD = 0.2
LINGER = 1.0
"""Real seconds of silence on lines and results after a run, before its bag is closed."""


def made_folder(name: str) -> Path:
    """Return a folder for bags; it is made if it is not there.

    Raises:
        OSError: it cannot be made, or no write permission; names it.
    """
    folder = Path(name).expanduser()
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise PermissionError(EACCES, "no write permission", str(folder))
    return folder


class RecorderNode(StepdiagNode):
    """Opens a bag when a run begins, flushes it at every stop, closes it when the run has ended."""

    role = "recorder"
    _newest_reading = b""

    def __init__(self) -> None:
        super().__init__("recorder")
        made_folder(self.parameter("folder"))
        self.on_change("folder", prepare=made_folder)
        self._writer: BagWriter | None = None
        self._close_at: float | None = None
        self._close_latest = 0.0
        # Stops whose readings are still on their way: on a busy computer the many readings come
        # seconds after the few stops that were made from them.
        self._incomplete: deque[Any] = deque()
        # States, lines and results of a run that is not described yet: a recorder that comes late
        # is sent them in any order.
        self._early = {
            topic: deque[bytes](maxlen=topic.depth)
            for topic in topics.RECORDED
            if topic.qos.repeated
        }
        self._failure = ""
        self._bag_run = ""
        self.health.live_facts[HEARD_UNTIL] = lambda: str(self._heard_until() or "")
        self._collector = ParameterCollector(self)
        self._gaps, self._sample_gaps = Gaps(), Gaps(what="sample")
        self._readings = StreamArrival("reading", self.parameter("reading_timeout"))
        self._positions = StreamArrival("actual position", self.parameter("position_timeout"))
        self._storage = Storage(self.parameter("space_wanted"), self.parameter("space_needed"))
        self.on_change("reading_timeout", partial(setattr, self._readings, "stale_after"))
        self.on_change("position_timeout", partial(setattr, self._positions, "stale_after"))
        self.on_change("space_wanted", partial(setattr, self._storage, "warn_below"))
        self.on_change("space_needed", partial(setattr, self._storage, "stop_below"))
        self.health.add_task("recording", self._judge_recording, log=False)
        self.health.add_task("disk", self._judge_disk)
        self.health.add_task("readings", partial(self._judge_arrival, self._readings))
        self.health.add_task("positions", self._judge_positions)
        self.health.add_task("sequence", partial(self._judge_gaps, self._gaps))
        self.health.add_task("samples", partial(self._judge_gaps, self._sample_gaps))
        self._names = {topic: self.resolve_topic_name(topic.name) for topic in topics.RECORDED}
        self.follow_run()
        for topic in topics.RECORDED:
            if topic is not topics.RUN_DESCRIPTION:
                self.listen(topic, partial(self._record, topic), keep_all=True, raw=True)
        self.every(0.2, self._close_when_over, real=True)
        self.every(ASK_PERIOD, self._ask_parameters, real=True)
        # Not only at the first tick: a run that begins before it would have no parameters.
        self._ask_parameters()

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
        # Whoever joins just now, such as the operator who has started the run, is not waited for.
        self.ready()
        self._bag_run = description.run_id
        for fact in (BAG_CLOSED, BAG_FAILURE):
            self.facts.pop(fact, None)
        self._say_of_bag(BAG, str(writer.path.resolve()))
        self._incomplete.clear()
        self._gaps.begin()
        self._sample_gaps.begin()
        for arrival in (self._readings, self._positions):
            arrival.begin(self.now(), self.real_time())
        self._record(topics.RUN_DESCRIPTION, serialize_message(description))
        self._record_early(description.run_id)
        self.get_logger().info(f"recording {writer.path}")

    def _record_early(self, run_id: str) -> None:
        """Record what came before the description of its run."""
        for topic, messages in self._early.items():
            kind = message_class(topic)
            for message in messages:
                if getattr(decoded(message, kind), "run_id", "") == run_id:
                    self._record(topic, message)
            messages.clear()

    def on_run_end(self) -> None:
        """Close the bag after the last results, and the readings of the last stop, have come."""
        self._close_at = self.real_time() + LINGER
        self._close_latest = self.real_time() + STORE_LIMIT

    def close(self) -> None:
        """Close the bag that is open."""
        self._close()

    def _record(self, topic: Topic, message: bytes) -> None:
        self._take_note(topic, message)
        if self._writer is None:
            if topic in self._early:
                self._early[topic].append(message)
            return
        try:
            self._writer.write(self._names[topic], topic.type_name, message, self.now())
            if topic is topics.RUN_STATE:
                self._writer.flush()
            elif topic is topics.STOP:
                self._incomplete.append(decoded(message, message_class(topic)))
                self._complete_stops(self._writer)
            elif topic is topics.READING and self._incomplete:
                self._complete_stops(self._writer)
        except BagError as error:
            self._writer, self._failure = None, str(error)
            self._say_of_bag(BAG_FAILURE, self._failure)
            self.unwell(self._failure)
        if self._close_at is not None and topic.derived:
            self._close_at = self.real_time() + LINGER

    def _take_note(self, topic: Topic, message: bytes) -> None:
        if topic is topics.READING:
            head, real = head_of(message), self.real_time()
            self._newest_reading = message
            self._gaps.take(head.sequence, head.time, real)
            self._readings.take(head.time, real)
        elif topic is topics.SAMPLES:
            block = block_head_of(message)
            self._sample_gaps.take(block.sequence, block.time, self.real_time(), block.samples)
        elif topic is topics.JOINT_STATES:
            self._positions.take(stamp_of(message), self.real_time())

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
        return stamp_of(self._newest_reading) if self._newest_reading else 0

    def _judge_recording(self) -> HealthFinding:
        writer, stored = self._writer, self.facts.get("stored", "")
        path, messages = (str(writer.path), writer.message_count) if writer else ("", 0)
        return judge_recording(path, messages, stored, len(self._incomplete), self._failure)

    def _judge_disk(self) -> HealthFinding:
        folder = Path(self.parameter("folder")).expanduser()
        bag = self._writer.path if self._writer else None
        return self._storage.look(folder, bag, self.real_time())

    def _judge_positions(self) -> HealthFinding:
        # Of a machine that is not connected nobody tells where it is.
        if self.watch.present(BY_HAND_ROLE, self.run_id):
            self._positions.begin(self.now(), self.real_time())
        return self._judge_arrival(self._positions)

    def _judge_arrival(self, arrival: StreamArrival) -> HealthFinding:
        return arrival.judge(not self.run_over, self.now(), self.real_time())

    def _judge_gaps(self, gaps: Gaps) -> HealthFinding:
        return gaps.judge(not self.run_over, self.real_time())

    def _close_when_over(self) -> None:
        if self._close_at is None:
            return
        awaited = self._incomplete and self.real_time() < self._close_latest
        if awaited or self.watch.workers(self.real_time()):
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
            self._say_of_bag(BAG_FAILURE, str(error))
            self.unwell(str(error))
            return
        self._say_of_bag(BAG_CLOSED, str(writer.message_count))
        self.get_logger().info(f"closed {writer.path}: {writer.message_count} messages")
        self.healthy(f"ready; recorded {writer.path}")

    def _say_of_bag(self, fact: str, value: str) -> None:
        self.facts[fact] = fact_of_run(self._bag_run, value)

    def _free_path(self, run_id: str) -> Path:
        folder = Path(self.parameter("folder")).expanduser()
        name = file_name_of(run_id)
        path, part = folder / f"{name}.mcap", 1
        while path.exists():
            part += 1
            path = folder / f"{name}_part{part}.mcap"
        return path

    def _ask_parameters(self) -> None:
        own = self.get_fully_qualified_name()
        self._collector.forget_all_but({own, *self.watch.peers})
        self._collector.ask(own, "", self.real_time())
        for name, peer in self.watch.peers.items():
            self._collector.ask(name, peer.session, self.real_time())
        if self.run_over and self._collector.waiting(self.real_time()):
            self.not_ready("asking the other nodes for their parameters", by_itself=True)
        else:
            self.ready()


def main() -> int:
    """Run the node."""
    return spin(RecorderNode)


if __name__ == "__main__":
    sys.exit(main())
