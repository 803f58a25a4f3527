"""Links of nodes: what holds is said again, heard once, and who cannot be understood is named."""

from __future__ import annotations

import itertools
import time
from typing import Any

import pytest
import rclpy
from patience import PATIENCE
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from refused import refused
from std_msgs.msg import String

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.messages.conversion import new_message
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes import links
from stepdiag_ros.nodes.links import LOOKS_ALONE, LinkedNode, Outlet, message_class, quality

VOLATILE = QoSProfile(depth=100)


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return two linked nodes, which say again after 0.2 s, and an executor of both."""
    from rclpy.executors import SingleThreadedExecutor

    rclpy.init(args=[])
    monkeypatch.setattr(links, "REPEAT_PERIOD", 0.2)
    monkeypatch.setattr(links, "TEND_PERIOD", 0.05)
    monkeypatch.setattr(links, "LOOK_PERIOD", 0.1)
    speaker, hearer = LinkedNode("speaker"), LinkedNode("hearer")
    executor = SingleThreadedExecutor()
    for node in (speaker, hearer):
        executor.add_node(node)

    def until(done: Any, limit: float = PATIENCE) -> bool:
        deadline = time.monotonic() + limit
        while not done() and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.02)
        return bool(done())

    yield speaker, hearer, until
    for node in (speaker, hearer):
        executor.remove_node(node)
        node.destroy_node()
    rclpy.try_shutdown()


def line(index: int, run_id: str = "a") -> Any:
    message = new_message(topics.LINE.type_name)
    set_header(message, 1_000_000_000 * index)
    message.run_id, message.line_index, message.attempt = run_id, index, 1
    message.displacement = [0.1 * index, float("nan")]
    return message


def test_a_volatile_late_listener_hears_all_that_holds_and_a_node_hears_it_once(pair: Any) -> None:
    speaker, hearer, until = pair
    outlet = speaker.announce(topics.LINE)
    heard: list[Any] = []
    raw: list[bytes] = []
    hearer.listen(topics.LINE, heard.append)
    hearer.listen(topics.LINE, raw.append, raw=True)
    sent = [serialize_message(line(index)) for index in range(3)]
    outlet.publish(line(0))
    outlet.publish(sent[1])
    outlet.publish(line(2))
    assert until(lambda: len(heard) == len(raw) == 3)

    # As a bridge does it: volatile, and long after all was said.
    late: list[bytes] = []
    hearer.create_subscription(
        message_class(topics.LINE), topics.LINE.name, late.append, VOLATILE, raw=True
    )
    assert until(lambda: len(late) >= 6)
    assert sorted(late[:3]) == sorted(sent)
    assert set(late) == set(sent)
    # All of this was no news to the node.
    assert raw == sent
    assert [message.line_index for message in heard] == [0, 1, 2]

    # With a new run the old lines are said no more.
    outlet.publish(line(0, "b"))
    assert until(lambda: len(raw) == 4)
    late.clear()
    assert until(lambda: len(late) >= 3)
    assert set(late) == {serialize_message(line(0, "b"))}


def test_a_recorded_run_that_begins_anew_is_news_but_a_computers_clock_set_back_is_not(
    pair: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    speaker, hearer, until = pair
    outlet, heard = speaker.announce(topics.RUN_DESCRIPTION), []
    hearer.listen(topics.RUN_DESCRIPTION, heard.append)
    description = new_message(topics.RUN_DESCRIPTION.type_name)
    set_header(description, 7)
    now = 20_000_000_000
    monkeypatch.setattr(hearer, "now", lambda: now)
    outlet.publish(description)
    measured: list[Any] = []
    hearer.listen(topics.LINE, measured.append)
    lines = speaker.announce(topics.LINE)
    lines.publish(line(12))
    assert until(lambda: len(heard) == len(measured) == 1)
    now = 10_000_000_000
    assert not until(lambda: len(heard) > 1, 0.4)
    monkeypatch.setattr(hearer, "_is_simulated", lambda: True)
    now = 19_500_000_000
    assert not until(lambda: len(heard) > 1, 0.4)
    now = 5_000_000_000
    assert until(lambda: len(heard) == 2)
    # A line that will be measured in seven seconds is still said of the time before.
    assert not until(lambda: len(heard) > 2 or len(measured) > 1, 0.6)
    now = 12_000_000_000
    assert until(lambda: len(measured) == 2)
    speaker.forget_results()
    assert not until(lambda: len(measured) > 2, 0.4)

    # Nor does it need the time to go back: the next replay of the same run is another publisher.
    speaker.destroy_node()
    assert until(lambda: hearer.count_publishers(topics.RUN_DESCRIPTION.name) == 0)
    assert until(lambda: hearer._looks_alone >= LOOKS_ALONE) and len(heard) == 2
    player = rclpy.create_node("player")
    latched = quality(topics.RUN_DESCRIPTION)
    outlet = player.create_publisher(type(description), topics.RUN_DESCRIPTION.name, latched)

    def is_heard_again() -> bool:
        outlet.publish(description)
        return len(heard) == 3

    assert until(is_heard_again)
    player.destroy_node()


def test_what_was_on_its_way_when_its_publisher_went_is_no_news(
    pair: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    speaker, hearer, until = pair
    monkeypatch.setattr(hearer, "_is_simulated", lambda: True)
    heard: list[Any] = []
    hearer.listen(topics.RUN_DESCRIPTION, heard.append)
    outlet = speaker.announce(topics.RUN_DESCRIPTION)
    description = new_message(topics.RUN_DESCRIPTION.type_name)
    outlet.publish(description)
    assert until(lambda: len(heard) == 1)
    # Nobody takes what comes, as in a node that has much to do.
    for _ in range(3):
        outlet._send(serialize_message(description))
    speaker.destroy_node()
    deadline = time.monotonic() + PATIENCE
    while hearer.count_publishers(topics.RUN_DESCRIPTION.name) and time.monotonic() < deadline:
        time.sleep(0.01)
    hearer._tend_links()
    looks = itertools.count()
    until(lambda: next(looks) > 9)
    assert len(heard) == 1


def test_who_cannot_be_understood_is_named_with_what_to_do_until_it_is_gone(pair: Any) -> None:
    speaker, hearer, until = pair
    speaker.announce(topics.READING)
    speaker.announce(topics.RUN_STATE)
    hearer.listen(topics.RUN_STATE, print)
    hearer.listen(topics.READING, print)
    other = rclpy.create_node("other", namespace="/cell")
    kind = message_class(topics.READING)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    other.create_subscription(kind, "/interferometer/reading", print, latched)
    hurried = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    other.create_publisher(kind, "/interferometer/reading", hurried)
    other.create_publisher(message_class(topics.RUN_STATE), "/run/state", VOLATILE)
    other.create_publisher(String, "/machine/state", 10)
    speaker.announce(topics.MACHINE_STATE)

    assert until(lambda: len(speaker.link_troubles) == 2 and len(hearer.link_troubles) == 2)
    assert set(speaker.link_troubles) == {
        "node /cell/other subscribes to /interferometer/reading and asks for durability"
        " TRANSIENT_LOCAL, but VOLATILE is offered: it receives nothing; subscribe with durability"
        " VOLATILE",
        "node /cell/other publishes /machine/state as std_msgs/msg/String, not as"
        " stepdiag_ros/msg/MachineState: its messages do not arrive; give its topic another"
        " name",
    }
    assert set(hearer.link_troubles) == {
        "node /cell/other publishes on /interferometer/reading with reliability BEST_EFFORT, but"
        " RELIABLE is requested: its messages do not arrive. Publish with reliability RELIABLE",
        "node /cell/other publishes on /run/state with durability VOLATILE, but TRANSIENT_LOCAL is"
        " requested: its messages do not arrive. Publish with durability TRANSIENT_LOCAL",
    }
    other.destroy_node()
    assert until(lambda: not speaker.link_troubles and not hearer.link_troubles)


class FullPublisher:
    """What Fast DDS does where Cyclone DDS waits: it refuses while a subscriber is behind."""

    def __init__(self, refusals: int) -> None:
        self.left = refusals
        self.sent: list[Any] = []

    def publish(self, message: Any) -> None:
        if self.left:
            self.left -= 1
            raise RuntimeError("Failed to publish: cannot publish data")
        self.sent.append(message)


def test_an_outlet_that_keeps_all_waits_for_a_slow_subscriber(pair: Any) -> None:
    speaker, _, _ = pair
    full = FullPublisher(refusals=3)
    Outlet(topics.READING, full, speaker, patience=PATIENCE).publish(b"a")  # type: ignore[arg-type]
    assert full.sent == [b"a"]


def test_a_subscriber_that_takes_nothing_any_more_is_said_once_patience_has_ended(
    pair: Any,
) -> None:
    speaker, _, _ = pair
    stuck = FullPublisher(refusals=1_000_000)
    outlet = Outlet(topics.READING, stuck, speaker, patience=0.05)  # type: ignore[arg-type]
    with refused(Refusal, "silent", topics.READING.name, "0.05"):
        outlet.publish(b"a")
    assert not stuck.sent
    # Where the oldest messages make way, a refusal is something else, and no waiting mends it.
    with refused(RuntimeError):
        Outlet(topics.READING, stuck, speaker).publish(b"a")  # type: ignore[arg-type]


def test_every_node_says_so_on_diagnostics() -> None:
    from diagnostic_msgs.msg import DiagnosticStatus

    from stepdiag_ros.nodes.operator import OperatorNode

    rclpy.init(args=[])
    operator, other = OperatorNode(), rclpy.create_node("other")
    said: dict[str, Any] = {}

    def hear(array: Any) -> None:
        said.update({status.name: status for status in array.status})

    other.create_subscription(message_class(topics.DIAGNOSTICS), "/diagnostics", hear, 10)
    stranger = other.create_publisher(String, "/run/state", 10)

    def until(level: bytes) -> bool:
        def found() -> bool:
            links_said = said.get(f"{operator.get_name()}: links")
            rclpy.spin_once(other, timeout_sec=0.05)
            return links_said is not None and links_said.level == level

        return operator.spin_until(found, PATIENCE)

    try:
        assert until(DiagnosticStatus.WARN)
        text = said[f"{operator.get_name()}: links"].message
        assert "node /other publishes /run/state as std_msgs/msg/String, not as" in text
        other.destroy_publisher(stranger)
        assert until(DiagnosticStatus.OK)
    finally:
        rclpy.try_shutdown()
