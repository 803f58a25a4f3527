#!/usr/bin/env python3
"""Node: serves what all other nodes publish to Foxglove viewers, over a WebSocket."""

import sys
from functools import partial
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.nodes.links import message_class
from stepdiag_ros.topics import Qos, Topic
from stepdiag_ros.viewers.foxglove.server import FoxgloveServer, ServedPlace

SHOWN = tuple(one for one in topics.TOPICS if one not in (topics.CLOCK, topics.MOTION_PERMIT))
"""Topics offered to viewers. Viewers receive the time in another way, and a permit to
move is for the bridge alone."""
STREAMS = tuple(one for one in SHOWN if one.qos is Qos.STREAM)
"""What comes often."""
LOOK_PERIOD = 0.1
"""Real seconds between two looks at who has come and gone."""


class FoxgloveServerNode(StepdiagNode):
    """Passes on messages as they are; it looks on, and nobody can ask it for anything else.

    Frequent topics are subscribed to only while a viewer wants them, and as best effort,
    so that they delay nobody.
    """

    role = "foxglove_server"

    def __init__(self) -> None:
        super().__init__("foxglove_server")
        place = ServedPlace(
            self.parameter("address"), self.parameter("port"), self.parameter("open_to_network")
        )
        self._names = {topic: str(self.resolve_topic_name(topic.name)) for topic in SHOWN}
        self._streams: dict[Topic, Any] = {}
        title = " ".join(("stepdiag", self.get_namespace().strip("/"))).strip()
        self._server = FoxgloveServer(title, place, self._log)
        types = own_types()
        for topic in SHOWN:
            kind = topic.type_name
            decode = partial(types.decode, kind)
            self._server.offer(self._names[topic], kind, types.schema(kind), decode, topic)
        self.follow_run()
        self._server.start()
        for topic in SHOWN:
            if topic not in STREAMS:
                self.listen(topic, partial(self._pass_on, topic), raw=True)
        self._log(f"viewers connect to {self._server.url}")
        if not place.is_local:
            self.get_logger().warning(
                f"everybody who can reach {place.address} may look on: viewers do not log in"
            )
        self.every(LOOK_PERIOD, self._look, real=True)

    def close(self) -> None:
        """Let the viewers go."""
        self._server.close()

    def hear(self, topic: Topic, wanted: bool) -> None:
        """Begin or end to listen to what comes often."""
        if wanted and topic not in self._streams:
            # Whoever only shows must never hold up those who measure.
            qos = QoSProfile(depth=topic.depth, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._streams[topic] = self.create_subscription(
                message_class(topic), topic.name, partial(self._pass_on, topic), qos, raw=True
            )
        elif not wanted and topic in self._streams:
            self.destroy_subscription(self._streams.pop(topic))

    def _look(self) -> None:
        self._server.work()
        for topic in STREAMS:
            self.hear(topic, self._server.viewers(self._names[topic]) > 0)
        self._server.tell_time(self.now())

    def _pass_on(self, topic: Topic, data: bytes) -> None:
        self._server.send(self._names[topic], data, self.now())

    def _log(self, text: str) -> None:
        self.get_logger().info(text)


def main() -> int:
    """Run the node."""
    return spin(FoxgloveServerNode)


if __name__ == "__main__":
    sys.exit(main())
