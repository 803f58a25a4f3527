"""Nodes that only look on: they fold the messages of a run into the sections of its view."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy

from stepdiag_ros import topics
from stepdiag_ros.nodes.base import StepdiagNode
from stepdiag_ros.nodes.links import Outlet, decoded, message_class
from stepdiag_ros.run.supervision import BYSTANDERS
from stepdiag_ros.topics import Topic
from stepdiag_ros.viewers.page.contact import contact_of
from stepdiag_ros.viewers.page.items import SOURCES, HeardTopic, Said, to_run_begin, to_run_status
from stepdiag_ros.viewers.page.state import PageState


class Onlooker(StepdiagNode):
    """Subscribes to all that a view of a run shows, and folds it into its sections.

    Args:
        name: default name of the node.
        state: sections of the view.
        rate: looks in a real second at what comes too often to be looked at each time.
    """

    def __init__(self, name: str, state: PageState, rate: float) -> None:
        super().__init__(name)
        self.state = state
        self._newest: dict[str, bytes] = {}
        # Topic → when its newest message was taken up.
        self._taken: dict[str, float] = {}
        self.follow_run()
        for source in SOURCES:
            if source.topic not in (topics.RUN_DESCRIPTION, topics.RUN_STATE):
                self._hear(source)
        self.every(1.0 / rate, self.on_look, real=True)

    def on_run(self, description: Any) -> None:
        """Start again with the plan of the run."""
        self.state.take(to_run_begin(description))

    def on_run_state(self, state: Any) -> None:
        """Say where the run is."""
        self._fold(topics.RUN_STATE, lambda: (to_run_status(state),), state)

    def on_peer_lost(self, text: str) -> None:
        """Report nothing: the view itself lists the silent nodes."""

    def on_look(self) -> None:
        """Take up the newest of what comes too often to be looked at each time."""
        for source in SOURCES:
            data = self._newest.pop(source.topic.name, None)
            if data is not None:
                self._taken[source.topic.name] = self.real_time()
                self.try_with(source.topic.name, partial(self._take_bytes, source), data)
        self.state.take(contact_of(self.watch, self._taken, self.real_time()))

    def take(self, source: HeardTopic, message: Any) -> None:
        """Fold in a message.

        Args:
            source: whose it is.
            message: as received.
        """
        self._fold(source.topic, lambda: source.convert(message), message)

    def _take_bytes(self, source: HeardTopic, data: bytes) -> None:
        self.take(source, decoded(data, message_class(source.topic)))

    def _fold(self, topic: Topic, convert: Callable[[], Iterable[Any]], message: Any) -> None:
        """Fold in a message; whatever anybody may publish, the view goes on."""
        try:
            for item in convert():
                if not isinstance(item, Said) or self._is_of_this_cell(item.name):
                    self.state.take(item, str(getattr(message, "run_id", "")))
        except (ValueError, LookupError, ArithmeticError) as error:
            self.unwell(f"a message on {topic.name} cannot be shown: {error}")

    def _hear(self, source: HeardTopic) -> None:
        topic = source.topic
        if source.newest:
            # Whoever only shows must never hold up those who measure.
            newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

            def keep(data: bytes, name: str = topic.name) -> None:
                self._newest[name] = data

            self.create_subscription(message_class(topic), topic.name, keep, newest, raw=True)
        else:
            self.listen(topic, partial(self.take, source), past=True)

    def _is_of_this_cell(self, name: str) -> bool:
        """Say whether a status on /diagnostics is of a node of this measurement."""
        node = "/" + name.partition(": ")[0]
        own = node == self.get_fully_qualified_name()
        return own or (node in self.watch.peers and node not in self.watch.lost)


class ViewerNode(Onlooker):
    """Looks on from a terminal, comes and goes as it likes, and is missed by nobody.

    It has no heartbeat: the nodes of a run would take its end for the loss of a node. What it has
    to say of itself it shows to its own viewer only.

    Args:
        state: sections of the view.
        rate: looks in a real second.
        look: called after each; returns whether the node is to end.
        close: called once when the node ends.
    """

    role = "viewer"

    def __init__(
        self,
        state: PageState,
        rate: float,
        look: Callable[["ViewerNode"], bool],
        close: Callable[[], None] = lambda: None,
    ) -> None:
        self._show, self._end = look, close
        super().__init__("viewer", state, rate)
        self._domain = self.context.get_domain_id()

    def announce(self, topic: Topic, keep_all: bool = False) -> Outlet:
        """Return an outlet to this node's own view."""
        del keep_all
        (source,) = (one for one in SOURCES if one.topic is topic)
        return _Inward(partial(self.take, source))

    def contact(self) -> str:
        """Return how many nodes that a run needs answer, in words."""
        needed = {name for name, peer in self.watch.peers.items() if peer.role not in BYSTANDERS}
        known, silent = len(needed), len(needed & self.watch.lost.keys())
        if not known:
            return f"no node found in {self.get_namespace()} on ROS domain {self._domain}"
        if silent:
            return f"{known - silent} of {known} nodes answer"
        return "1 node" if known == 1 else f"{known} nodes"

    def on_look(self) -> None:
        """Take up the newest, and show it."""
        super().on_look()
        if self._show(self):
            rclpy.try_shutdown()

    def close(self) -> None:
        """Leave the terminal as it was."""
        self._end()


class _Inward(Outlet):
    """Takes what a node says of itself to its own view, and to nobody else."""

    def __init__(self, take: Callable[[Any], None]) -> None:
        self._take = take

    def publish(self, message: Any) -> None:
        self._take(message)
