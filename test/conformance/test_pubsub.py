"""Topics between nodes and between processes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest
from patience import PATIENCE
from ros_processes import Peer, spin_until, wait_until

Start = Callable[..., Peer]

PUBLISH = """
import time
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node('talker')
qos = QoSProfile(depth=3, durability=DurabilityPolicy.TRANSIENT_LOCAL)
publisher = node.create_publisher(String, 'chat', qos)
for number in range(5):
    publisher.publish(String(data=str(number)))
print('ready', flush=True)
while rclpy.ok():
    time.sleep(0.02)
node.destroy_node()
rclpy.try_shutdown()
"""


def test_node_to_node_in_one_process(node: Any) -> None:
    from std_msgs.msg import Header

    got: list[Any] = []
    node.create_subscription(Header, "chat", got.append, 10)
    publisher = node.create_publisher(Header, "/chat", 10)
    assert publisher.get_subscription_count() == 1
    message = Header(frame_id="laser")
    message.stamp.sec = 7
    publisher.publish(message)
    assert spin_until(node, lambda: bool(got))
    assert got == [message] and got[0] is not message
    assert publisher.topic_name == "/chat"


def test_late_joiner_gets_the_last_three(node: Any, peer: Start) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import String

    other = peer(PUBLISH)
    other.wait_for_line("ready")
    got: list[str] = []
    qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(String, "chat", lambda m: got.append(m.data), qos)
    assert spin_until(node, lambda: len(got) >= 3)
    assert got == ["2", "3", "4"]


def test_volatile_late_joiner_gets_nothing(node: Any, peer: Start) -> None:
    from std_msgs.msg import String

    other = peer(PUBLISH)
    other.wait_for_line("ready")
    got: list[Any] = []
    node.create_subscription(String, "chat", got.append, 10)
    assert spin_until(node, lambda: node.count_publishers("chat") == 1)
    assert not spin_until(node, lambda: bool(got), 0.5)


def test_keep_all_loses_nothing(ros: Any, node: Any, peer: Start) -> None:
    from rclpy.qos import HistoryPolicy, QoSProfile
    from std_msgs.msg import UInt64

    numbers: list[int] = []
    qos = QoSProfile(history=HistoryPolicy.KEEP_ALL)
    node.create_subscription(UInt64, "numbers", lambda m: numbers.append(m.data), qos)
    peer(
        """
        import time
        from rclpy.duration import Duration
        from rclpy.qos import HistoryPolicy, QoSProfile
        from std_msgs.msg import UInt64
        rclpy.init()
        node = rclpy.create_node('talker')
        qos = QoSProfile(history=HistoryPolicy.KEEP_ALL)
        publisher = node.create_publisher(UInt64, 'numbers', qos)
        while publisher.get_subscription_count() < 1:
            time.sleep(0.01)
        for number in range(20000):
            publisher.publish(UInt64(data=number))
        assert publisher.wait_for_all_acked(Duration(seconds=20))
        """
    )
    # A subscriber that sleeps first, so that much piles up.
    assert wait_until(lambda: node.count_publishers("numbers") == 1)
    time.sleep(0.5)
    executor = ros.executors.SingleThreadedExecutor()
    executor.add_node(node)
    end = time.monotonic() + PATIENCE
    while len(numbers) < 20000 and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.5)
    executor.shutdown()
    assert numbers == list(range(20000))


def test_raw_bytes_in_and_out(node: Any) -> None:
    from rclpy.serialization import deserialize_message, serialize_message
    from std_msgs.msg import String

    got: list[bytes] = []
    node.create_subscription(String, "chat", got.append, 10, raw=True)
    publisher = node.create_publisher(String, "chat", 10)
    data = serialize_message(String(data="hello"))
    publisher.publish(data)
    assert spin_until(node, lambda: bool(got))
    assert isinstance(got[0], bytes) and got[0][: len(data)] == data
    assert deserialize_message(got[0], String) == String(data="hello")


def test_callback_may_take_the_message_info(node: Any) -> None:
    from std_msgs.msg import String

    got: list[Any] = []
    node.create_subscription(String, "chat", lambda m, info: got.append((m, info)), 10)
    before = time.time_ns()
    node.create_publisher(String, "chat", 10).publish(String(data="a"))
    assert spin_until(node, lambda: bool(got))
    info = got[0][1]
    assert before <= info["source_timestamp"] <= info["received_timestamp"] <= time.time_ns()


def test_depth_one_keeps_the_newest(node: Any) -> None:
    from std_msgs.msg import Int32

    got: list[int] = []
    node.create_subscription(Int32, "chat", lambda m: got.append(m.data), 1)
    publisher = node.create_publisher(Int32, "chat", 100)
    for number in range(50):
        publisher.publish(Int32(data=number))
    assert spin_until(node, lambda: bool(got))
    spin_until(node, lambda: False, 0.2)
    assert got == [49]


def test_destroyed_ends_are_quiet(ros: Any, node: Any) -> None:
    from rclpy.exceptions import InvalidHandle
    from std_msgs.msg import Int32

    got: list[Any] = []
    subscription = node.create_subscription(Int32, "chat", got.append, 10)
    publisher = node.create_publisher(Int32, "chat", 10)
    assert node.destroy_subscription(subscription)
    assert wait_until(lambda: publisher.get_subscription_count() == 0)
    publisher.publish(Int32())
    assert node.destroy_publisher(publisher)
    with pytest.raises(InvalidHandle):
        publisher.publish(Int32())
    ros.spin_once(node, timeout_sec=0.05)
    assert got == []


def test_large_message_crosses_processes(node: Any, peer: Start) -> None:
    from std_msgs.msg import Float64MultiArray

    got: list[Any] = []
    node.create_subscription(Float64MultiArray, "big", got.append, 10)
    peer(
        """
        import time
        from std_msgs.msg import Float64MultiArray
        rclpy.init()
        node = rclpy.create_node('talker')
        publisher = node.create_publisher(Float64MultiArray, 'big', 10)
        while publisher.get_subscription_count() < 1:
            time.sleep(0.01)
        publisher.publish(Float64MultiArray(data=[float(i) for i in range(200000)]))
        publisher.wait_for_all_acked()
        """
    )
    assert spin_until(node, lambda: bool(got))
    assert got[0].data.tolist() == list(range(200000))


@pytest.mark.parametrize("name", ["", "a b", "1a", "a//b", "a/", "{nope}/a", "/ä"])
def test_wrong_topic_names_are_refused(node: Any, name: str) -> None:
    from rclpy.exceptions import InvalidTopicNameException
    from std_msgs.msg import String

    with pytest.raises((InvalidTopicNameException, ValueError)):
        node.create_publisher(String, name, 10)


def test_wrong_arguments_are_refused(node: Any) -> None:
    from rclpy.qos import InvalidQoSProfileException, QoSProfile
    from std_msgs.msg import String

    with pytest.raises(TypeError):
        node.create_publisher(String, "a", "10")
    with pytest.raises(ValueError):
        node.create_publisher(String, "a", -1)
    with pytest.raises(InvalidQoSProfileException):
        QoSProfile()
    with pytest.raises(Exception) as caught:
        node.create_subscription(String, "a", lambda: None, 10)
    said = str(caught.value).lower()
    assert "callback" in said or "argument" in said, "each client has words of its own"
