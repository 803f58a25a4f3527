"""Time, durations, clocks, timers and simulated time. Only rclpy's public interface is used."""

from __future__ import annotations

import time
from typing import Any

import pytest
from patience import PATIENCE
from ros_processes import spin_until


def test_time_arithmetic() -> None:
    from builtin_interfaces.msg import Duration as DurationMsg
    from rclpy.clock import ClockType
    from rclpy.duration import Duration
    from rclpy.time import Time

    a, b = Time(seconds=5, nanoseconds=1), Time(seconds=3)
    assert (a - b) == Duration(seconds=2, nanoseconds=1)
    assert b + Duration(seconds=2, nanoseconds=1) == a
    assert a - Duration(seconds=2, nanoseconds=1) == b
    assert b < a and a > b and a >= b and b <= a and a != b
    assert a.seconds_nanoseconds() == (5, 1)
    assert Time.from_msg(a.to_msg()).nanoseconds == a.nanoseconds
    assert Duration(seconds=-1.5).to_msg() == DurationMsg(sec=-2, nanosec=500000000)
    assert Duration.from_msg(DurationMsg(sec=-2, nanosec=500000000)) == Duration(seconds=-1.5)
    assert Duration(seconds=1) < Duration(seconds=2)
    assert Time(seconds=1_700_000_000, nanoseconds=123456789).nanoseconds == 1700000000123456789
    with pytest.raises(TypeError):
        _ = a < Time(seconds=1, clock_type=ClockType.STEADY_TIME)
    with pytest.raises(ValueError):
        Time(seconds=-1)
    with pytest.raises(ValueError):
        _ = b - Duration(seconds=4)
    with pytest.raises(OverflowError):
        Time(nanoseconds=2**63)


def test_clocks_tell_their_time(node: Any) -> None:
    from rclpy.clock import Clock, ClockType

    assert abs(node.get_clock().now().nanoseconds - time.time_ns()) < PATIENCE * 1e9
    assert node.get_clock().now().clock_type.name == ClockType.ROS_TIME.name
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    first = steady.now()
    assert steady.now() >= first
    assert Clock().clock_type == ClockType.SYSTEM_TIME


def test_timer_keeps_its_period(node: Any) -> None:
    calls: list[float] = []
    timer = node.create_timer(0.02, lambda: calls.append(time.monotonic()))
    started = time.monotonic()
    assert spin_until(node, lambda: len(calls) == 25)
    # Never early; what a busy computer misses is skipped, and makes it later.
    assert 0.48 < calls[-1] - started < PATIENCE
    timer.cancel()
    count = len(calls)
    spin_until(node, lambda: False, 0.1)
    assert len(calls) == count and timer.is_canceled()
    timer.reset()
    assert spin_until(node, lambda: len(calls) == count + 1)


def test_missed_calls_are_skipped(ros: Any, node: Any) -> None:
    calls: list[int] = []
    timer = node.create_timer(0.02, lambda: calls.append(1))
    time.sleep(0.21)
    end = time.monotonic() + 0.005
    while time.monotonic() < end:
        ros.spin_once(node, timeout_sec=0.0)
    # Ten were missed; one more may come due if this process had to wait.
    assert 1 <= len(calls) <= 2
    assert timer.time_until_next_call() <= 20_000_000


def test_destroyed_timer_is_quiet(node: Any) -> None:
    calls: list[int] = []
    timer = node.create_timer(0.01, lambda: calls.append(1))
    assert node.destroy_timer(timer)
    spin_until(node, lambda: False, 0.05)
    assert calls == []


def test_simulated_time(ros: Any) -> None:
    from rclpy.parameter import Parameter
    from rosgraph_msgs.msg import Clock as ClockMsg

    sim = Parameter("use_sim_time", value=True)
    node = ros.create_node("tester", parameter_overrides=[sim])
    source = ros.create_node("source")
    publisher = source.create_publisher(ClockMsg, "/clock", 10)
    calls: list[int] = []
    node.create_timer(1.0, lambda: calls.append(node.get_clock().now().nanoseconds))
    clock = node.get_clock()

    def tick(seconds: float, count: int) -> None:
        """Let it be so late, and see how often the timer has called by then."""
        message = ClockMsg()
        message.clock = _time_message(seconds)
        publisher.publish(message)
        wanted = int(seconds * 1e9)
        assert spin_until(node, lambda: clock.now().nanoseconds == wanted and len(calls) >= count)
        spin_until(node, lambda: False, 0.03)
        assert len(calls) == count

    assert clock.now().nanoseconds == 0
    spin_until(node, lambda: False, 1.2)
    assert calls == []
    tick(0.5, 0)
    tick(1.25, 1)
    tick(1.75, 1)
    tick(9.5, 2)
    assert calls == [1_250_000_000, 9_500_000_000]
    tick(9.9, 2)
    # The clock is set back, as when a bag starts again.
    tick(2.0, 2)
    tick(2.9, 2)
    tick(3.1, 3)
    # Back to the system's time.
    result = node.set_parameters([Parameter("use_sim_time", value=False)])[0]
    assert result.successful
    assert abs(clock.now().nanoseconds - time.time_ns()) < PATIENCE * 1e9
    count = len(calls)
    assert spin_until(node, lambda: len(calls) > count)
    source.destroy_node()
    node.destroy_node()


def _time_message(seconds: float) -> Any:
    from rclpy.time import Time

    return Time(nanoseconds=round(seconds * 1e9)).to_msg()


def test_sleeping(node: Any) -> None:
    from rclpy.duration import Duration

    started = time.monotonic()
    assert node.get_clock().sleep_for(Duration(seconds=0.05))
    assert 0.045 < time.monotonic() - started < PATIENCE


def test_rate_in_another_thread(ros: Any, node: Any) -> None:
    import threading

    executor = ros.executors.SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    rate = node.create_rate(50)
    rate.sleep()
    started = time.monotonic()
    for _ in range(10):
        rate.sleep()
    assert 0.15 < time.monotonic() - started < PATIENCE
    executor.shutdown()
    thread.join(PATIENCE)
