#!/usr/bin/env python3
"""Node: serves one live page about the run to browsers."""

import sys
from functools import partial
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from stepdiag_ros import topics
from stepdiag_ros.monitor.access import make_access
from stepdiag_ros.monitor.items import SOURCES, Said, Silent, Source, to_run_begin, to_run_status
from stepdiag_ros.monitor.server import RATE, MonitorServer, Offer
from stepdiag_ros.monitor.state import State
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.nodes.links import message_class
from stepdiag_ros.nodes.run_control import RunControl


class MonitorNode(StepdiagNode):
    """Folds what the nodes publish into the page, and passes on what an operator asks for."""

    role = "monitor"

    def __init__(self) -> None:
        super().__init__("monitor")
        self._state = State()
        self._control = RunControl(self)
        self._newest: dict[str, bytes] = {}
        self.follow_run()
        for source in SOURCES:
            if source.topic not in (topics.RUN_DESCRIPTION, topics.RUN_STATE):
                self._hear(source)
        access = make_access(self.parameter("address"), self.parameter("token_file"))
        offer = Offer(
            state=self._state,
            access=access,
            source="run",
            title=self.get_namespace().strip("/"),
            ask=self._control.ask,
            log=self._log,
        )
        self._server = MonitorServer(offer, self.parameter("port"))
        self._server.start()
        self.get_logger().info(f"the page is at {self._server.url}")
        if access.made:
            # Not to the log, which goes to /rosout and so to everybody on the network.
            print(f"to control the run, open {self._server.url_with_token}", flush=True)
        self.every(1.0 / RATE, self._look, real=True)

    def on_run(self, description: Any) -> None:
        """Begin anew with the plan of the run."""
        self._state.take(to_run_begin(description))

    def on_run_state(self, state: Any) -> None:
        """Say where the run is."""
        self._state.take(to_run_status(state), str(state.run_id))

    def close(self) -> None:
        """Let the viewers go."""
        self._server.close()

    def _log(self, text: str) -> None:
        self.get_logger().info(text)

    def _hear(self, source: Source) -> None:
        topic = source.topic
        if source.newest:
            # Whoever only shows must never hold up those who measure.
            newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

            def keep(data: bytes, name: str = topic.name) -> None:
                self._newest[name] = data

            self.create_subscription(message_class(topic), topic.name, keep, newest, raw=True)
        else:
            self.listen(topic, partial(self._take, source))

    def _take(self, source: Source, message: Any) -> None:
        try:
            items = tuple(source.convert(message))
        except ValueError as error:
            self.unwell(f"a message on {source.topic.name} cannot be shown: {error}")
            return
        for item in items:
            if not isinstance(item, Said) or self._is_of_this_cell(item.name):
                self._state.take(item, str(getattr(message, "run_id", "")))

    def _look(self) -> None:
        """Take up the newest of what comes too often to be looked at each time."""
        for source in SOURCES:
            data = self._newest.pop(source.topic.name, None)
            if data is not None:
                self._take(source, deserialize_message(data, message_class(source.topic)))
        self._state.take(Silent(tuple(sorted(self.watch.lost.items()))))
        self._control.work()

    def _is_of_this_cell(self, name: str) -> bool:
        """Say whether a status on /diagnostics is of a node of this measurement."""
        node = "/" + name.partition(": ")[0]
        own = node == self.get_fully_qualified_name()
        return own or (node in self.watch.peers and node not in self.watch.lost)


def main() -> int:
    """Run the node."""
    return spin(MonitorNode)


if __name__ == "__main__":
    sys.exit(main())
