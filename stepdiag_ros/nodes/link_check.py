"""Endpoints that do not fit a node's topics, and why, by the ROS graph.

A middleware says nothing to a publisher or subscription whose quality of service or type does not
fit; the two never meet. So the other ends of each topic are looked at, one topic after another.
"""

from collections import deque
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from stepdiag_ros.topics import Topic

_FOREVER = 2**62
"""ns: a time that is longer, or zero, is not a limit."""
_LOOKS_AFTER_EVENT = 4
"""The graph may list an endpoint later than the middleware reports that it does not fit."""


def mismatches(offered: QoSProfile, asked: QoSProfile) -> list[str]:
    """Return the names of the policies because of which publisher and subscription never meet.

    Args:
        offered: by the publisher.
        asked: by the subscription.
    """
    found = []
    if (asked.durability, offered.durability) == (
        DurabilityPolicy.TRANSIENT_LOCAL,
        DurabilityPolicy.VOLATILE,
    ):
        found.append("durability")
    if (asked.reliability, offered.reliability) == (
        ReliabilityPolicy.RELIABLE,
        ReliabilityPolicy.BEST_EFFORT,
    ):
        found.append("reliability")
    if _limit(asked.deadline) < _limit(offered.deadline):
        found.append("deadline")
    manual = LivelinessPolicy.MANUAL_BY_TOPIC
    if (asked.liveliness == manual and offered.liveliness != manual) or (
        _limit(asked.liveliness_lease_duration) < _limit(offered.liveliness_lease_duration)
    ):
        found.append("liveliness")
    return found


def _limit(duration: Any) -> int:
    nanoseconds: int = duration.nanoseconds
    return _FOREVER if nanoseconds == 0 else min(nanoseconds, _FOREVER)


_WORDS: dict[str, tuple[str, str]] = {
    "durability": ("TRANSIENT_LOCAL", "VOLATILE"),
    "reliability": ("RELIABLE", "BEST_EFFORT"),
    "deadline": ("a deadline", "none as short"),
    "liveliness": ("another kind of liveliness", "AUTOMATIC, without a limit"),
}
"""Policy → what a subscription asks for that does not fit, and what the publisher offers."""


class LinkCheck:
    """Looks at the other ends of a node's topics.

    Args:
        node: whose topics.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._topics: dict[str, Topic] = {}
        self._speaks: set[str] = set()
        self._hears: set[str] = set()
        self._turn: deque[str] = deque()
        self._soon: deque[str] = deque()
        self._found: dict[str, list[str]] = {}

    @property
    def troubles(self) -> list[str]:
        """Return sentences about the ends that cannot be understood, each with what to do."""
        return [text for texts in self._found.values() for text in texts]

    def speaks(self, name: str, topic: Topic) -> None:
        """Take up a topic (full name) that the node publishes on."""
        self._speaks.add(name)
        self._take_up(name, topic)

    def hears(self, name: str, topic: Topic) -> None:
        """Take up a topic (full name) that the node listens to."""
        self._hears.add(name)
        self._take_up(name, topic)

    def _take_up(self, name: str, topic: Topic) -> None:
        if name not in self._topics:
            self._topics[name] = topic
            self._turn.append(name)

    def look_soon(self, name: str) -> None:
        """Look at this topic soon: the middleware says that another end does not fit."""
        self._soon.extend([name] * _LOOKS_AFTER_EVENT)

    def look_at_suspect(self) -> None:
        """Check the topic that the middleware has reported, if any."""
        if self._soon:
            name = self._soon.popleft()
            self._found[name] = self._look_at(name)

    def look(self) -> None:
        """Look at the other ends of the next topic, and of those where something was wrong."""
        due = {name for name, found in self._found.items() if found}
        if self._turn:
            due.add(self._turn[0])
            self._turn.rotate(-1)
        for name in due:
            self._found[name] = self._look_at(name)

    def _look_at(self, name: str) -> list[str]:
        publishers = self._node.get_publishers_info_by_topic(name)
        subscribers = self._node.get_subscriptions_info_by_topic(name)
        own = [end for end in (*publishers, *subscribers) if self._is_own(end)]
        found = []
        for end in (*publishers, *subscribers):
            if end.topic_type != self._topics[name].type_name:
                found.append(self._of_another_type(name, end, end in publishers))
            elif any(_hash(end) and _hash(mine) not in ("", _hash(end)) for mine in own):
                found.append(
                    f"{_who(end)} has another definition of {end.topic_type} (topic {name}):"
                    " let both run the same version of stepdiag_ros"
                )
        if name in self._speaks:
            offers = [end.qos_profile for end in publishers if self._is_own(end)]
            found += [
                f"{_who(end)} subscribes to {name} and asks for {policy} {_WORDS[policy][0]}, but"
                f" {_WORDS[policy][1]} is offered: it receives nothing; subscribe with {policy}"
                f" {_WORDS[policy][1]}"
                for end in subscribers
                for policy in (mismatches(offers[0], end.qos_profile) if offers else ())
            ]
        if name in self._hears:
            asks = [end.qos_profile for end in subscribers if self._is_own(end)]
            found += [
                f"{_who(end)} publishes on {name} with {policy} {_WORDS[policy][1]}, but"
                f" {_WORDS[policy][0]} is requested: its messages do not arrive. Publish with"
                f" {policy} {_WORDS[policy][0]}"
                for end in publishers
                for policy in (mismatches(end.qos_profile, asks[0]) if asks else ())
            ]
        return list(dict.fromkeys(found))

    def _is_own(self, end: Any) -> bool:
        own = (self._node.get_name(), self._node.get_namespace())
        return (end.node_name, end.node_namespace) == own

    def _of_another_type(self, name: str, end: Any, publishes: bool) -> str:
        does, lost = (
            ("publishes", "its messages do not arrive")
            if publishes
            else ("subscribes to", "it receives nothing")
        )
        return (
            f"{_who(end)} {does} {name} as {end.topic_type}, not as"
            f" {self._topics[name].type_name}: {lost}; give its topic another name"
        )


def _who(end: Any) -> str:
    return f"node {end.node_namespace.rstrip('/')}/{end.node_name}"


def _hash(end: Any) -> str:
    """Return the hash of an endpoint's type as a text; empty where it is not available (Humble)."""
    told = getattr(end, "topic_type_hash", None)
    if told is None or getattr(told, "version", 1) < 1:
        return ""
    return str(told)
