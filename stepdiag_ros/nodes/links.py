"""Publishers and subscriptions on the topics of the suite, with what the topics' meaning asks for.

Quality of service follows from ``topics.py``. Messages that hold until the next one
(descriptions, states, lines, results) are repeated slowly, and repetitions are dropped where they
arrive, so that a node receives each message once however often it arrives. The log and /diagnostics
name every endpoint that does not fit one of these topics.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time

from stepdiag_ros.messages.repetition import REPEAT_PERIOD, Memory, Repeater
from stepdiag_ros.messages.types import message_type
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.link_check import LinkCheck
from stepdiag_ros.nodes.timing import TimedNode
from stepdiag_ros.run.sole_sender import Sender
from stepdiag_ros.text.controls import one_line
from stepdiag_ros.topics import RUN_DESCRIPTION, Qos, Topic

try:
    from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
except ImportError:  # ROS 2 Humble
    from rclpy.qos_event import PublisherEventCallbacks, SubscriptionEventCallbacks

BACKLOG = 20
"""Messages that a subscription keeps at least while its node is busy; a publisher may keep fewer,
so that a late subscriber is shown the present state alone."""
TEND_PERIOD = 0.5
"""Real seconds between two checks for messages to repeat."""
LOOKS_ALONE = 3
"""Looks in a row that find nobody who says a run's description, and nothing taken since."""
STEP_BACK = 1_000_000_000
"""ns of simulated time, more than two clocks that run at once are apart."""
LOOK_PERIOD = 2.0
"""Real seconds between two looks at the other ends of a topic, one topic after another; where the
middleware says that an end does not fit, its topic is looked at at once."""
PATIENCE = 30.0
"""Real seconds for which an outlet that keeps all waits for its slowest subscriber."""
_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN"
"""Name that rmw gives the node of an endpoint without a known node."""
NAP = 0.005
"""Real seconds between two tries to publish."""


def quality(topic: Topic, keep_all: bool = False) -> QoSProfile:
    """Return the quality of service of a topic.

    Args:
        topic: which.
        keep_all: for a reader that must not miss a message however far it falls behind.
    """
    return QoSProfile(
        history=HistoryPolicy.KEEP_ALL if keep_all else HistoryPolicy.KEEP_LAST,
        depth=topic.depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL
            if topic.qos.transient_local
            else DurabilityPolicy.VOLATILE
        ),
    )


def message_class(topic: Topic) -> Any:
    """Return the message class of a topic."""
    return message_type(topic.type_name)


def decoded(data: bytes, kind: Any) -> Any:
    """Return the message of a class that CDR bytes are.

    Raises:
        ValueError: they are none.
    """
    try:
        return deserialize_message(data, kind)
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"{len(data)} bytes are not a {kind.__name__}") from error


class Outlet:
    """Publishes on a topic, and says again what still holds.

    Args:
        topic: which.
        publisher: on it.
        node: that publishes.
        patience: real seconds for which slow subscribers are waited for; 0 where the oldest
            messages make way instead.
    """

    def __init__(
        self, topic: Topic, publisher: Publisher, node: TimedNode, patience: float = 0.0
    ) -> None:
        self._patience = patience
        self._topic = topic
        self._class = message_class(topic)
        self._publisher = publisher
        self._node = node
        self._repeater = Repeater(topic, REPEAT_PERIOD) if topic.qos.repeated else None

    def publish(self, message: Any) -> None:
        """Publish a message, or the CDR bytes of one.

        Raises:
            ValueError: a subscriber does not take what has been published so far.
        """
        if self._repeater is None:
            self._send(message)
            return
        if isinstance(message, bytes):
            data, message = message, decoded(message, self._class)
        else:
            data = serialize_message(message)
        self._send(data)
        self._repeater.said(message, data, self._node.real_time())

    def publish_all(self, messages: Iterable[Any]) -> None:
        """Publish messages that came at once; the embedded client puts them into few packets."""
        at_once = getattr(self._publisher, "publish_all", None)
        if at_once is None or self._repeater is not None or self._patience:
            for message in messages:
                self.publish(message)
        else:
            at_once(messages)

    def forget_results(self) -> None:
        """Do not say again what follows from the run so far."""
        if self._repeater is not None and self._topic.derived:
            self._repeater.forget()

    def repeat(self) -> None:
        """Publish again the messages that were published a while ago and still hold."""
        if self._repeater is not None:
            for data in self._repeater.due(self._node.real_time()):
                self._send(data)

    def get_subscription_count(self) -> int:
        """Return how many subscriptions receive what is published."""
        count: int = self._publisher.get_subscription_count()
        return count

    def _send(self, message: Any) -> None:
        if not self._patience:
            self._publisher.publish(message)
            return
        deadline = self._node.real_time() + self._patience
        while True:
            # Cyclone DDS waits by itself until there is room; Fast DDS gives up after 0.1 s, and
            # its error has no class of its own.
            try:
                self._publisher.publish(message)
            except RuntimeError as error:
                if not self._node.context.ok():
                    raise
                if self._node.real_time() > deadline:
                    raise Refusal(
                        f"a subscriber of {self._topic.name} has not taken what was published "
                        f"{self._patience:g} s ago: end it, or publish more slowly ({error})",
                        fault="silent",
                    ) from error
                time.sleep(NAP)
            else:
                return


class LinkedNode(TimedNode):
    """A node that speaks and listens on topics of the suite; takes the arguments of ``Node``."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._repeating: list[Outlet] = []
        self._memories: defaultdict[str, list[Memory]] = defaultdict(list)
        self._newest_time = 0
        self._heard_lately: set[str] = set()
        self._looks_alone = 0
        self._link_check = LinkCheck(self)
        self.every(TEND_PERIOD, self._tend_links, real=True)
        self.every(LOOK_PERIOD, self._look_at_links, real=True)

    def on_unusable(self, topic: str, error: ValueError) -> None:
        """Called with why a message on a topic was refused; the node goes on with the next."""

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[[Any], Any], *args: Any, **kwargs: Any
    ) -> Any:
        """Subscribe as every node does; whatever anybody publishes ends no node.

        A message that the callback refuses by a ValueError goes to ``on_unusable``.
        """

        def take(message: Any) -> None:
            self.try_with(topic, callback, message)

        return super().create_subscription(msg_type, topic, take, *args, **kwargs)

    def try_with(self, topic: str, callback: Callable[[Any], Any], message: Any) -> None:
        """Call back with a message of a topic, which may be of any content."""
        try:
            callback(message)
        except ValueError as error:
            self.on_unusable(topic, error)

    def announce(self, topic: Topic, keep_all: bool = False) -> Outlet:
        """Return an outlet on a topic of the suite.

        Args:
            topic: which.
            keep_all: wait for slow subscribers instead of dropping what they have not taken.
        """
        name = self.resolve_topic_name(topic.name)
        events = PublisherEventCallbacks(
            incompatible_qos=lambda _event: self._link_check.look_soon(name)
        )
        publisher = self.create_publisher(
            message_class(topic), topic.name, quality(topic, keep_all), event_callbacks=events
        )
        outlet = Outlet(topic, publisher, self, PATIENCE if keep_all else 0.0)
        if topic.qos.repeated:
            self._repeating.append(outlet)
        self._link_check.speaks(name, topic)
        return outlet

    def listen(
        self,
        topic: Topic,
        callback: Callable[[Any], None],
        keep_all: bool = False,
        raw: bool = False,
        past: bool = False,
    ) -> None:
        """Call back with each message of a topic of the suite.

        A repeated message is delivered once.

        Args:
            topic: which.
            callback: takes the message.
            keep_all: miss none, however far this node falls behind.
            raw: call back with the CDR bytes.
            past: events (``Qos.EVENTS``) from before this node came, too: for viewers.
        """
        name = self.resolve_topic_name(topic.name)
        events = SubscriptionEventCallbacks(
            incompatible_qos=lambda _event: self._link_check.look_soon(name)
        )
        if topic.qos.repeated:
            hear, heard_raw = self._once(name, topic, callback, raw), True
        else:
            hear, heard_raw = callback, raw
        qos = quality(topic, keep_all)
        qos.depth = max(qos.depth, BACKLOG)
        if topic.qos is Qos.EVENTS and not past:
            qos.durability = DurabilityPolicy.VOLATILE
        self.create_subscription(
            message_class(topic),
            topic.name,
            hear,
            qos,
            event_callbacks=events,
            raw=heard_raw,
        )
        self._link_check.hears(name, topic)

    def senders(self, *wanted: Topic) -> list[Sender]:
        """Return all publishers on some topics that the graph shows, in this process and others."""
        found = []
        for topic in wanted:
            for end in self.get_publishers_info_by_topic(self.resolve_topic_name(topic.name)):
                name = f"{end.node_namespace.rstrip('/')}/{end.node_name}"
                known = not end.node_name.startswith(_UNKNOWN_NODE)
                gid = bytes(end.endpoint_gid).hex()
                found.append(Sender(topic.name, one_line(name) if known else "", gid))
        return found

    def forget_results(self) -> None:
        """Repeat nothing any more of what follows from a run: a new one begins."""
        for outlet in self._repeating:
            outlet.forget_results()

    @property
    def link_troubles(self) -> list[str]:
        """Return sentences about nodes that cannot be understood on these topics, and why."""
        return self._link_check.troubles

    def _once(
        self, name: str, topic: Topic, callback: Callable[[Any], None], raw: bool
    ) -> Callable[[bytes], None]:
        """Return what takes the bytes of a topic that is repeated, and passes on what is new."""
        kind = message_class(topic)
        # Each subscription has a memory of its own: a node may listen twice on a topic.
        memory = Memory()
        self._memories[name].append(memory)

        def hear(data: bytes) -> None:
            self._heard_lately.add(name)
            self._follow_time()
            if memory.is_news(data, lambda: self._has_happened(decoded(data, kind))):
                callback(data if raw else decoded(data, kind))

        return hear

    def _has_happened(self, message: Any) -> bool:
        header = getattr(message, "header", None)
        if header is None:
            return True
        stamp: int = Time.from_msg(header.stamp).nanoseconds
        return stamp <= self.now() + STEP_BACK

    def _follow_time(self) -> None:
        """Take everything for news again when a recorded run starts again: the time goes back.

        Where time is that of the computer, nothing is replayed, and a clock that is set back shall
        not make a run of what is long over.
        """
        time = self.now()
        if time < self._newest_time - STEP_BACK and self._is_simulated():
            for memories in self._memories.values():
                for memory in memories:
                    memory.begin_anew()
            self._newest_time = time
        self._newest_time = max(self._newest_time, time)

    def _is_simulated(self) -> bool:
        return self.get_parameter("use_sim_time").value is True

    def _tend_links(self) -> None:
        if not self.context.ok():
            return
        for outlet in self._repeating:
            outlet.repeat()
        self._await_another_replay()
        self._link_check.look_at_suspect()

    def _await_another_replay(self) -> None:
        """Take a run's description for news again once who replayed it has ended.

        The next replay may be of the same run, and its description may come before the time is seen
        to go back. The last message may still be on its way when its publisher has gone; and on a
        busy computer one look may follow the other before anything is taken.
        """
        name = self.resolve_topic_name(RUN_DESCRIPTION.name)
        if name not in self._memories or not self._is_simulated():
            return
        alone = not self.count_publishers(name) and name not in self._heard_lately
        self._looks_alone = self._looks_alone + 1 if alone else 0
        if self._looks_alone == LOOKS_ALONE:
            for memory in self._memories[name]:
                memory.begin_anew()
        self._heard_lately.clear()

    def _look_at_links(self) -> None:
        if self.context.ok():
            self._link_check.look()
