"""What the tests of actions share: a server and a client that spin, and what they do."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from patience import PATIENCE
from ros_processes import wait_until

#: Function that spins nodes in the background.
Spin = Callable[..., None]

UNKNOWN, ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(7)


class Cell:
    """A node with an action server, another one with a client, and both spinning."""

    def __init__(self, ros: Any, spin: Spin) -> None:
        from example_interfaces.action import Fibonacci

        self.action = Fibonacci
        self.server_node, self.client_node = ros.create_node("server"), ros.create_node("client")
        self.release = threading.Event()
        self.handles: list[Any] = []
        spin(self.server_node, self.client_node)

    def serve(self, execute: Any = None, **kwargs: Any) -> Any:
        from rclpy.action import ActionServer

        return ActionServer(self.server_node, self.action, "count", execute or self.count, **kwargs)

    def call(self, **kwargs: Any) -> Any:
        from rclpy.action import ActionClient

        client = ActionClient(self.client_node, self.action, "count", **kwargs)
        assert client.wait_for_server(timeout_sec=PATIENCE)
        return client

    def goal(self, order: int = 3) -> Any:
        return self.action.Goal(order=order)

    def count(self, handle: Any) -> Any:
        """Count up with feedback, and say yes to whoever wants it cancelled."""
        self.handles.append(handle)
        done: list[int] = []
        for number in range(handle.request.order):
            if handle.is_cancel_requested:
                handle.canceled()
                return self.action.Result(sequence=done)
            done.append(number)
            handle.publish_feedback(self.action.Feedback(sequence=done))
            time.sleep(0.005)
        handle.succeed()
        return self.action.Result(sequence=done)

    def wait(self, handle: Any) -> Any:
        """Execute until :attr:`release` is set or the goal is to be cancelled."""
        self.handles.append(handle)
        while not self.release.wait(0.005):
            if handle.is_cancel_requested:
                handle.canceled()
                return self.action.Result(sequence=[7])
        handle.succeed()
        return self.action.Result(sequence=[8])

    def close(self) -> None:
        self.release.set()
        self.client_node.destroy_node()
        self.server_node.destroy_node()


def identity(handle: Any) -> bytes:
    """Return the identity of a goal, or of what tells of one, as bytes.

    Which must be compared in place of messages: in Jazzy, generated messages with a fixed array are
    equal as soon as one element is.
    """
    return bytes(handle.goal_id.uuid)


def get(future: Any, timeout: float = PATIENCE) -> Any:
    """Return the result of a future that other threads bring about."""
    assert wait_until(future.done, timeout)
    return future.result()


def accept_cancel(_handle: Any) -> Any:
    from rclpy.action import CancelResponse

    return CancelResponse.ACCEPT
