"""Actions between processes, of which one may end at any time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from patience import PATIENCE
from ros_processes import Peer, wait_until

Start = Callable[..., Peer]

SERVER = """
import sys, time
from example_interfaces.action import Fibonacci
from rclpy.action import ActionServer, CancelResponse
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor

def execute(handle):
    print("started", flush=True)
    for number in range(handle.request.order):
        handle.publish_feedback(Fibonacci.Feedback(sequence=[number]))
        time.sleep(0.01)
        if not rclpy.ok():
            # Some rclpys finish their goals before the process ends.
            return Fibonacci.Result()
        if handle.is_cancel_requested:
            handle.canceled()
            print("canceled", flush=True)
            return Fibonacci.Result()
    handle.succeed()
    print("finished", flush=True)
    return Fibonacci.Result(sequence=[handle.request.order])

rclpy.init()
node = rclpy.create_node("counter")
ActionServer(node, Fibonacci, "count", execute,
             cancel_callback=lambda _: CancelResponse.ACCEPT)
executor = MultiThreadedExecutor(4)
executor.add_node(node)
try:
    executor.spin()
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""

CLIENT = """
import sys
from example_interfaces.action import Fibonacci
from rclpy.action import ActionClient
rclpy.init()
node = rclpy.create_node("caller")
client = ActionClient(node, Fibonacci, "count")
assert client.wait_for_server(timeout_sec=300)
goal = client.send_goal_async(
    Fibonacci.Goal(order=int(sys.argv[1])),
    feedback_callback=lambda message: print("feedback", flush=True),
)
rclpy.spin_until_future_complete(node, goal, timeout_sec=300)
result = goal.result().get_result_async()
rclpy.spin_until_future_complete(node, result, timeout_sec=300)
print("status", result.result().status, list(result.result().result.sequence), flush=True)
"""


def client_of(node: Any) -> Any:
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient

    return ActionClient(node, Fibonacci, "count")


def goal(order: int) -> Any:
    from example_interfaces.action import Fibonacci

    return Fibonacci.Goal(order=order)


def test_goals_cross_processes(node: Any, peer: Start, spin: Callable[..., None]) -> None:
    client = client_of(node)
    assert not client.server_is_ready()
    assert not client.wait_for_server(timeout_sec=0.05)
    peer(SERVER)
    assert client.wait_for_server(timeout_sec=PATIENCE)
    spin(node)
    feedback: list[int] = []

    def note(message: Any) -> None:
        feedback.extend(message.feedback.sequence)

    response = client.send_goal(goal(8), feedback_callback=note)
    assert response.status == 4 and list(response.result.sequence) == [8]
    assert feedback == list(range(len(feedback))) and feedback


def test_the_client_goes_and_the_server_goes_on(
    node: Any, peer: Start, spin: Callable[..., None]
) -> None:
    server = peer(SERVER)
    gone = peer(CLIENT, "60")
    gone.wait_for_line("feedback")
    gone.process.kill()
    server.wait_for_line("finished")
    client = client_of(node)
    spin(node)
    assert client.wait_for_server(timeout_sec=PATIENCE)
    assert client.send_goal(goal(2)).status == 4
    assert server.process.poll() is None
    # Before its own end it would wait for the dead client's acknowledgement.
    server.process.kill()


def test_the_server_goes_and_comes_back(node: Any, peer: Start, spin: Callable[..., None]) -> None:
    server = peer(SERVER)
    client = client_of(node)
    spin(node)
    assert client.wait_for_server(timeout_sec=PATIENCE)
    sent = client.send_goal_async(goal(2000))
    assert wait_until(sent.done)
    lost = sent.result().get_result_async()
    server.wait_for_line("started")
    server.process.terminate()
    # Or it is missed when its lease is over.
    assert wait_until(lambda: not client.server_is_ready())
    # Nobody will ever answer; whoever waits must look whether the server is still there.
    time.sleep(0.1)
    assert not lost.done()
    peer(SERVER)
    assert client.wait_for_server(timeout_sec=PATIENCE)
    assert client.send_goal(goal(2)).status == 4
    assert not lost.done()


def test_two_processes_call_one_server(peer: Start) -> None:
    server = peer(SERVER)
    callers = [peer(CLIENT, str(order)) for order in (20, 30)]
    ends = [caller.finish() for caller in callers]
    for (code, out, err), order in zip(ends, (20, 30), strict=True):
        assert code == 0 and f"status 4 [{order}]" in out, err
        assert 1 <= out.count("feedback") <= order
    assert server.process.poll() is None
