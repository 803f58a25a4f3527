"""Executors, callback groups, futures and the end of a process."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest
from patience import PATIENCE
from ros_processes import Peer, spin_until

Start = Callable[..., Peer]

SPIN = """
import os, sys, time
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
rclpy.init()
node = rclpy.create_node('spinner')
# Some rclpys see a signal only when something else wakes them.
node.create_timer(0.1, lambda: None)
print('ready', flush=True)
try:
    if sys.argv[1] == 'one':
        rclpy.spin(node)
    elif sys.argv[1] == 'many':
        executor = MultiThreadedExecutor()
        executor.add_node(node)
        executor.spin()
    else:
        rclpy.spin_until_future_complete(node, rclpy.task.Future())
except BaseException as error:
    print(type(error).__name__)
else:
    print('returned')
# The end of the context may come a moment after the signal.
end = time.monotonic() + 2
while rclpy.ok() and time.monotonic() < end:
    time.sleep(0.01)
print(rclpy.ok(), flush=True)
node.destroy_node()
rclpy.try_shutdown()
# Python's thread pools wait for ever at the exit if Ctrl-C comes while they start a thread.
os._exit(0)
"""


@pytest.mark.parametrize(
    ("number", "how", "ends"),
    [
        (signal.SIGINT, "one", ["KeyboardInterrupt"]),
        (signal.SIGINT, "many", ["KeyboardInterrupt"]),
        # Depends on what it does when the signal comes; some rclpys also look at their timers then.
        (signal.SIGTERM, "one", ["ExternalShutdownException", "returned", "RCLError"]),
        (signal.SIGTERM, "many", ["returned", "RCLError"]),
    ],
)
def test_signal_ends_spinning_at_once(
    node: Any, peer: Start, number: int, how: str, ends: list[str]
) -> None:
    other = peer(SPIN, how)
    other.wait_for_line("ready")
    assert spin_until(node, lambda: "spinner" in node.get_node_names())
    time.sleep(0.1)
    other.process.send_signal(number)
    code, out, err = other.finish()
    assert code == 0, err
    assert out.split() in [[end, "False"] for end in ends]
    # The domain was left properly: no ghost stays behind.
    assert spin_until(node, lambda: "spinner" not in node.get_node_names())


def test_several_nodes_and_executors(ros: Any) -> None:
    from rclpy.executors import SingleThreadedExecutor
    from std_msgs.msg import Int32

    nodes = [ros.create_node(f"node{index}") for index in range(3)]
    got: list[list[int]] = [[], [], []]
    executors = [SingleThreadedExecutor(), SingleThreadedExecutor()]
    for node, numbers in zip(nodes, got, strict=True):
        node.create_subscription(Int32, "chat", lambda m, n=numbers: n.append(m.data), 10)
    assert executors[0].add_node(nodes[0]) and executors[1].add_node(nodes[1])
    assert executors[0].add_node(nodes[2]) and not executors[0].add_node(nodes[2])
    threads = [threading.Thread(target=executor.spin, daemon=True) for executor in executors]
    for thread in threads:
        thread.start()
    publisher = nodes[0].create_publisher(Int32, "chat", 10)
    for number in range(5):
        publisher.publish(Int32(data=number))
    end = time.monotonic() + PATIENCE
    while any(len(numbers) < 5 for numbers in got) and time.monotonic() < end:
        time.sleep(0.01)
    assert got == [[0, 1, 2, 3, 4]] * 3
    for executor in executors:
        executor.shutdown()
    for thread in threads:
        thread.join(PATIENCE)
        assert not thread.is_alive()
    for node in nodes:
        node.destroy_node()


def test_entities_made_while_spinning_are_served(ros: Any, node: Any) -> None:
    from std_msgs.msg import Int32

    executor = ros.executors.SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    time.sleep(0.05)
    got = threading.Event()
    node.create_subscription(Int32, "chat", lambda _: got.set(), 10)
    node.create_publisher(Int32, "chat", 10).publish(Int32())
    assert got.wait(PATIENCE)
    ticked = threading.Event()
    node.create_timer(0.01, ticked.set)
    assert ticked.wait(PATIENCE)
    executor.shutdown()
    thread.join(PATIENCE)


def _overlap(ros: Any, node: Any, groups: list[Any], wanted: int) -> int:
    """Return how many of two timers' callbacks ran at the same time, at most.

    Looks for 0.4 s, and on a busy computer longer where more are wanted.
    """
    lock, running, most = threading.Lock(), 0, 0

    def work() -> None:
        nonlocal running, most
        with lock:
            running += 1
            most = max(most, running)
        time.sleep(0.05)
        with lock:
            running -= 1

    for group in groups:
        node.create_timer(0.01, work, callback_group=group)
    executor = ros.executors.MultiThreadedExecutor(num_threads=4)
    executor.add_node(node)
    begun = time.monotonic()
    while (passed := time.monotonic() - begun) < 0.4 or (most < wanted and passed < PATIENCE):
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    return most


def test_callback_groups(ros: Any, node: Any) -> None:
    from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup

    shared = MutuallyExclusiveCallbackGroup()
    assert _overlap(ros, node, [shared, shared], 1) == 1
    other = ros.create_node("other")
    two = [MutuallyExclusiveCallbackGroup(), MutuallyExclusiveCallbackGroup()]
    assert _overlap(ros, other, two, 2) == 2
    third = ros.create_node("third")
    reentrant = ReentrantCallbackGroup()
    assert _overlap(ros, third, [reentrant, reentrant], 2) >= 2


def test_blocked_group_does_not_burn_the_processor(ros: Any, node: Any) -> None:
    from std_msgs.msg import Int32

    done: list[int] = []

    def slow(message: Any) -> None:
        time.sleep(0.4)
        done.append(message.data)

    node.create_subscription(Int32, "chat", slow, 10)
    publisher = node.create_publisher(Int32, "chat", 10)
    for number in range(3):
        publisher.publish(Int32(data=number))
    executor = ros.executors.MultiThreadedExecutor(num_threads=2)
    executor.add_node(node)
    used = time.process_time()
    end = time.monotonic() + PATIENCE
    while len(done) < 3 and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.3)
    assert done == [0, 1, 2]
    assert time.process_time() - used < 0.3
    executor.shutdown()


def test_sources_take_turns(node: Any) -> None:
    from std_msgs.msg import Int32

    order: list[str] = []
    for topic in ("one", "two"):
        node.create_subscription(Int32, topic, lambda _, t=topic: order.append(t), 100)
    publishers = [node.create_publisher(Int32, topic, 100) for topic in ("one", "two")]
    for publisher in publishers:
        for _ in range(20):
            publisher.publish(Int32())
    assert spin_until(node, lambda: len(order) == 40)
    assert abs(order[:20].count("one") - 10) <= 2


def test_timer_runs_while_messages_pour_in(ros: Any, node: Any, peer: Start) -> None:
    from std_msgs.msg import Header

    peer(
        """
        import time
        from std_msgs.msg import Header
        rclpy.init()
        node = rclpy.create_node('talker')
        publisher = node.create_publisher(Header, 'chat', 10)
        while publisher.get_subscription_count() < 1:
            time.sleep(0.01)
        while rclpy.ok():
            publisher.publish(Header())
        """
    )
    messages: list[int] = []
    ticks: list[float] = []
    node.create_subscription(Header, "chat", lambda _: messages.append(1), 10)
    assert spin_until(node, lambda: bool(messages))
    node.create_timer(0.02, lambda: ticks.append(time.monotonic()))
    executor = ros.executors.SingleThreadedExecutor()
    executor.add_node(node)
    # Neither waits until nothing is left to do for the other.
    end = time.monotonic() + PATIENCE
    while not (len(ticks) >= 25 and len(messages) > 500) and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    assert len(ticks) >= 25 and len(messages) > 500


def test_futures_and_tasks(ros: Any, node: Any) -> None:
    from rclpy.task import Future

    executor = ros.executors.SingleThreadedExecutor()
    # A future set by another thread need not wake the executor of who awaits it.
    node.create_timer(0.05, lambda: None)
    executor.add_node(node)
    gate = Future(executor=executor)
    seen: list[Any] = []

    async def work(start: int) -> int:
        return start + await gate

    task = executor.create_task(work, 1)
    task.add_done_callback(lambda t: seen.append(t.result()))
    executor.spin_once(timeout_sec=0.05)
    assert not task.done()
    threading.Timer(0.1, gate.set_result, (41,)).start()
    executor.spin_until_future_complete(task, timeout_sec=PATIENCE)
    assert task.result() == 42
    end = time.monotonic() + PATIENCE
    while not seen and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    assert seen == [42]
    cancelled = Future()
    cancelled.cancel()
    assert cancelled.cancelled() and not cancelled.done() and cancelled.result() is None
    failed = Future()
    failed.set_exception(ValueError("no"))
    with pytest.raises(ValueError):
        failed.result()
    executor.shutdown()


def test_spin_until_future_times_out(ros: Any, node: Any) -> None:
    from rclpy.task import Future

    started = time.monotonic()
    ros.spin_until_future_complete(node, Future(), timeout_sec=0.1)
    assert 0.09 < time.monotonic() - started < PATIENCE


def test_guard_condition(ros: Any, node: Any) -> None:
    calls: list[int] = []
    guard = node.create_guard_condition(lambda: calls.append(1))
    executor = ros.executors.SingleThreadedExecutor()
    executor.add_node(node)
    threading.Timer(0.05, guard.trigger).start()
    end = time.monotonic() + 2
    while not calls and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.5)
    assert calls == [1]
    executor.shutdown()


def test_shutdown_from_another_thread(ros: Any, node: Any) -> None:
    from rclpy.executors import ExternalShutdownException

    threading.Timer(0.1, ros.shutdown).start()
    # Whether it returns or raises depends on which of the two threads comes first.
    with suppress(ExternalShutdownException):
        ros.spin(node)
    assert not ros.ok()


def test_init_and_shutdown_again() -> None:
    import rclpy
    from rclpy.exceptions import NotInitializedException
    from std_msgs.msg import Int32

    assert not rclpy.ok()
    with pytest.raises(NotInitializedException):
        rclpy.create_node("early")
    for _ in range(3):
        rclpy.init(args=[])
        with pytest.raises(RuntimeError):
            rclpy.init(args=[])
        node = rclpy.create_node("again")
        got: list[Any] = []
        node.create_subscription(Int32, "chat", got.append, 10)
        node.create_publisher(Int32, "chat", 10).publish(Int32(data=1))
        assert spin_until(node, lambda got=got: bool(got))
        node.destroy_node()
        rclpy.shutdown()
        assert not rclpy.ok()
    with pytest.raises(RuntimeError):
        rclpy.shutdown()
    rclpy.try_shutdown()


def test_publishing_after_shutdown_is_an_error() -> None:
    import rclpy
    from std_msgs.msg import Int32

    rclpy.init(args=[])
    node = rclpy.create_node("tester")
    publisher = node.create_publisher(Int32, "chat", 10)
    rclpy.shutdown()
    with pytest.raises(RuntimeError):
        publisher.publish(Int32())
    node.get_logger().info("logging still works")
    node.destroy_node()
    node.destroy_node()


def test_two_contexts() -> None:
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from std_msgs.msg import Int32

    contexts = [rclpy.Context(), rclpy.Context()]
    for context in contexts:
        rclpy.init(args=[], context=context)
    nodes = [rclpy.create_node(f"n{i}", context=c) for i, c in enumerate(contexts)]
    got: list[Any] = []
    nodes[0].create_subscription(Int32, "chat", got.append, 10)
    publisher = nodes[1].create_publisher(Int32, "chat", 10)
    end = time.monotonic() + PATIENCE
    while not publisher.get_subscription_count() and time.monotonic() < end:
        time.sleep(0.01)
    publisher.publish(Int32(data=3))
    executor = SingleThreadedExecutor(context=contexts[0])
    executor.add_node(nodes[0])
    while not got and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    assert got == [Int32(data=3)]
    for node, context in zip(nodes, contexts, strict=True):
        node.destroy_node()
        rclpy.shutdown(context=context)
