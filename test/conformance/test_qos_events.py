"""Whoever asks for what is not offered is told of: events of publishers and subscriptions."""

from __future__ import annotations

import time
from typing import Any

from patience import PATIENCE
from rclpy.qos import (
    DurabilityPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from std_msgs.msg import String

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
HURRIED = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def _spin_until(ros: Any, node: Any, done: Any) -> bool:
    deadline = time.monotonic() + PATIENCE
    while not done() and time.monotonic() < deadline:
        ros.spin_once(node, timeout_sec=0.05)
    return bool(done())


def test_both_sides_are_told_of_each_policy_that_does_not_fit(ros: Any, node: Any) -> None:
    from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks

    other = ros.create_node("other")
    told: dict[str, list[Any]] = {"publisher": [], "subscription": []}
    heard: list[Any] = []
    publisher = node.create_publisher(
        String,
        "chat",
        HURRIED,
        event_callbacks=PublisherEventCallbacks(incompatible_qos=told["publisher"].append),
    )
    node.create_subscription(
        String,
        "talk",
        heard.append,
        LATCHED,
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=told["subscription"].append),
    )
    other.create_subscription(String, "chat", heard.append, 10)
    talker = other.create_publisher(String, "talk", 10)
    assert _spin_until(ros, node, lambda: all(told.values()))
    for side, policy in (("publisher", "RELIABILITY"), ("subscription", "DURABILITY")):
        (info,) = told[side]
        assert qos_policy_name_from_kind(info.last_policy_kind) == policy
        assert info.last_policy_kind == QoSPolicyKind[policy]
        assert (info.total_count, info.total_count_change) == (1, 1), side

    # Nothing comes through, and one that fits is no event.
    publisher.publish(String(data="one"))
    talker.publish(String(data="two"))
    other.create_subscription(String, "chat", heard.append, HURRIED)
    second = ros.create_node("second")
    second.create_subscription(String, "chat", heard.append, 10)
    assert _spin_until(ros, node, lambda: len(told["publisher"]) == 2)
    assert (told["publisher"][1].total_count, told["publisher"][1].total_count_change) == (2, 1)
    assert heard == []
    second.destroy_node()
    other.destroy_node()


def test_the_graph_tells_what_each_end_offers_and_asks_for(ros: Any, node: Any) -> None:
    other = ros.create_node("other")
    node.create_publisher(String, "chat", HURRIED)
    other.create_subscription(String, "chat", print, LATCHED)
    assert _spin_until(ros, node, lambda: len(node.get_subscriptions_info_by_topic("/chat")) == 1)
    (asks,) = node.get_subscriptions_info_by_topic("/chat")
    (offers,) = node.get_publishers_info_by_topic("/chat")
    assert (asks.node_name, asks.node_namespace, asks.topic_type) == (
        "other",
        "/",
        "std_msgs/msg/String",
    )
    assert asks.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert asks.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert offers.qos_profile.durability == DurabilityPolicy.VOLATILE
    assert offers.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert str(offers.topic_type_hash) == str(asks.topic_type_hash)
    assert str(offers.topic_type_hash).startswith("RIHS01_")
    other.destroy_node()
