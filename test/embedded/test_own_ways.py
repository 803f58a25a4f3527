"""What the embedded client does in its own way, better than any rclpy must."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest
from patience import PATIENCE

from .conftest import Peer, spin_until, wait_until

Start = Callable[..., Peer]


def test_incompatible_qos_is_told_on_both_sides(node: Any, peer: Start, capfd: Any) -> None:
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from std_msgs.msg import String

    other = peer(
        """
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from std_msgs.msg import String
        rclpy.init()
        node = rclpy.create_node('listener')
        node.create_subscription(String, 'chat', print, 10)
        for _ in range(10):
            rclpy.spin_once(node, timeout_sec=0.2)
        """
    )
    qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = node.create_publisher(String, "chat", qos)
    spin_until(node, lambda: other.process.poll() is not None)
    code, out, err = other.finish()
    assert code == 0 and out == ""
    assert "New publisher discovered on topic '/chat', offering incompatible QoS" in err
    assert "RELIABILITY" in err
    assert publisher.get_subscription_count() == 0
    own = capfd.readouterr().err
    assert "[WARN]" in own and "[tester]" in own
    assert "New subscription discovered on topic '/chat', requesting incompatible QoS" in own


def test_nothing_of_a_burst_is_lost_or_out_of_order(ros: Any, node: Any, peer: Start) -> None:
    from rclpy.qos import HistoryPolicy, QoSProfile
    from std_msgs.msg import Header

    got: list[str] = []
    qos = QoSProfile(history=HistoryPolicy.KEEP_ALL)
    node.create_subscription(Header, "fast", lambda message: got.append(message.frame_id), qos)
    peer(
        """
        import time
        from rclpy.qos import HistoryPolicy, QoSProfile
        from std_msgs.msg import Header
        rclpy.init()
        node = rclpy.create_node('talker')
        qos = QoSProfile(history=HistoryPolicy.KEEP_ALL)
        publisher = node.create_publisher(Header, 'fast', qos)
        while publisher.get_subscription_count() < 1:
            time.sleep(0.01)
        for number in range(30000):
            publisher.publish(Header(frame_id=str(number)))
        publisher.wait_for_all_acked()
        """
    )
    executor = ros.executors.SingleThreadedExecutor()
    executor.add_node(node)
    end = time.monotonic() + PATIENCE
    while len(got) < 30000 and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.5)
    executor.shutdown()
    # How fast: benchmarks/latency.py.
    assert got == [str(number) for number in range(30000)]


def test_broken_sample_is_said_once_and_survived(node: Any, capfd: Any) -> None:
    from std_msgs.msg import Int32, String

    got: list[str] = []
    node.create_subscription(String, "chat", lambda m: got.append(m.data), 10)
    publisher = node.create_publisher(String, "chat", 10)
    for data in (b"\0\1\0\0" + b"\xff" * 40, b"\0\1\0\0\5\0\0\0good"):
        publisher.publish(data)
    publisher.publish(String(data="good"))
    assert spin_until(node, lambda: bool(got))
    assert got == ["good"]
    assert capfd.readouterr().err.count("is dropped") == 1
    with pytest.raises(TypeError):
        publisher.publish(Int32())


def test_messages_published_at_once_arrive_in_order_and_as_far_as_they_were_made(
    node: Any, peer: Start
) -> None:
    from rclpy.qos import HistoryPolicy, QoSProfile
    from std_msgs.msg import Int32

    got: list[int] = []
    qos = QoSProfile(history=HistoryPolicy.KEEP_ALL)
    node.create_subscription(Int32, "many", lambda message: got.append(message.data), qos)
    other = peer(
        """
        import time
        from rclpy.qos import HistoryPolicy, QoSProfile
        from std_msgs.msg import Int32
        rclpy.init()
        node = rclpy.create_node('talker')
        publisher = node.create_publisher(Int32, 'many', QoSProfile(history=HistoryPolicy.KEEP_ALL))
        while not publisher.get_subscription_count():
            time.sleep(0.01)

        def made(first, last):
            message = Int32()
            for message.data in range(first, last):
                yield message

        def broken():
            yield from made(5000, 5003)
            raise ValueError('no more')

        publisher.publish_all(made(0, 5000))
        publisher.publish_all([])
        try:
            publisher.publish_all(broken())
        except ValueError as error:
            print(error)
        publisher.publish(Int32(data=5003))
        publisher.wait_for_all_acked()
        """
    )
    assert spin_until(node, lambda: len(got) >= 5004)
    assert got == [*range(5004)]
    assert other.finish()[1].strip() == "no more"


def test_a_tilde_needs_its_slash(node: Any) -> None:
    from rclpy.exceptions import InvalidTopicNameException
    from std_msgs.msg import String

    with pytest.raises(InvalidTopicNameException):
        node.create_publisher(String, "~a", 10)


@pytest.mark.usefixtures("ros")
def test_jump_callbacks() -> None:
    from rclpy.clock import ClockChange, JumpThreshold, ROSClock
    from rclpy.duration import Duration
    from rclpy.time import Time

    clock = ROSClock()
    jumps: list[Any] = []
    threshold = JumpThreshold(
        min_forward=Duration(seconds=1), min_backward=Duration(seconds=-1), on_clock_change=True
    )
    handle = clock.create_jump_callback(threshold, post_callback=jumps.append)
    clock._set_ros_time_is_active(True)
    assert jumps[-1].clock_change == ClockChange.ROS_TIME_ACTIVATED
    for seconds, count in ((5.0, 2), (5.5, 2), (5.0, 2), (3.0, 3)):
        clock.set_ros_time_override(Time(seconds=seconds))
        assert len(jumps) == count, seconds
    assert jumps[-1].delta == Duration(seconds=-2)
    handle.unregister()
    clock.set_ros_time_override(Time(seconds=100))
    assert len(jumps) == 3


def test_ctrl_c_waits_until_a_pool_has_taken_up_its_work(peer: Start) -> None:
    # Python's pools fail with other errors, or never end, if Ctrl-C comes inside of them.
    other = peer(
        """
        import os, signal
        from rclpy.executors import MultiThreadedExecutor
        rclpy.init()
        node = rclpy.create_node('spinner')
        node.create_timer(0.01, lambda: None)
        executor = MultiThreadedExecutor()
        executor.add_node(node)
        submit = executor._pool.submit

        def interrupted(*arguments):
            os.kill(os.getpid(), signal.SIGINT)
            for _ in range(1000):
                pass
            submit(*arguments)
            print('taken up', flush=True)

        executor._pool.submit = interrupted
        try:
            executor.spin()
        except KeyboardInterrupt:
            print('interrupted', rclpy.ok())
        executor.shutdown()
        node.destroy_node()
        """
    )
    code, out, err = other.finish()
    assert code == 0, err
    assert out.split("\n") == ["taken up", "interrupted False", ""]


def test_levels_of_the_log_hold_until_the_last_context_ends() -> None:
    import rclpy
    from rclpy.logging import LoggingSeverity, get_logger_effective_level

    first, second = rclpy.Context(), rclpy.Context()
    first.init(["x", "--ros-args", "--log-level", "fatal"])
    second.init(["x"])
    first.shutdown()
    assert get_logger_effective_level("") is LoggingSeverity.FATAL
    second.shutdown()
    assert get_logger_effective_level("") is LoggingSeverity.INFO


def test_simulated_time_that_is_looked_for_when_asked_wakes_nobody(ros: Any) -> None:
    from rclpy.executors import SingleThreadedExecutor, TimeoutException
    from rclpy.parameter import Parameter
    from rosgraph_msgs.msg import Clock

    sim = Parameter("use_sim_time", value=True)
    node = ros.create_node("tester", parameter_overrides=[sim])
    node._time_source.look_when_asked()
    publisher = ros.create_node("source").create_publisher(Clock, "/clock", 10)
    clock = node.get_clock()
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def tick(seconds: int) -> None:
        message = Clock()
        message.clock.sec = seconds
        publisher.publish(message)

    def reached(seconds: int) -> Callable[[], bool]:
        return lambda: clock.now().nanoseconds == seconds * 1_000_000_000

    tick(1)
    with pytest.raises(TimeoutException):
        executor._wait(200_000_000, None)
    # Without any spinning.
    wait_until(reached(1))
    # What goes by the clock is woken by it, and nobody is any more once that has ended.
    calls: list[int] = []
    timer = node.create_timer(1.0, lambda: calls.append(clock.now().nanoseconds))
    tick(3)
    spin_until(node, lambda: bool(calls))
    assert calls == [3_000_000_000]
    assert node.destroy_timer(timer)
    tick(5)
    wait_until(reached(5))
    assert calls == [3_000_000_000]


def test_the_graph_is_read_anew_when_somebody_comes_goes_or_dies(node: Any, peer: Start) -> None:
    from std_msgs.msg import String

    def there() -> int:
        return len(node.get_publishers_info_by_topic("chat"))

    for _ in range(20):
        publisher = node.create_publisher(String, "chat", 1)
        assert there() == 1 and there() == 1
        node.destroy_publisher(publisher)
        assert there() == 0 and there() == 0
    other = peer(
        """
        from std_msgs.msg import String
        rclpy.init()
        node = rclpy.create_node('talker')
        publisher = node.create_publisher(String, 'chat', 1)
        rclpy.spin(node)
        """
    )
    wait_until(lambda: there() == 1)
    other.process.kill()
    wait_until(lambda: there() == 0)
