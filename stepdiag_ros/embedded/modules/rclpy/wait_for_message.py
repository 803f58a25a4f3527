"""Wait for one message of a topic."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.task import Future

if TYPE_CHECKING:
    from rclpy.node import Node


def wait_for_message(
    msg_type: Any,
    node: Node,
    topic: str,
    *,
    qos_profile: QoSProfile | int = 1,
    time_to_wait: float = -1,
) -> tuple[bool, Any]:
    """Return whether a message came within ``time_to_wait`` seconds (no limit if negative), and it.

    The node must not be spun by anybody else meanwhile.
    """
    future = Future()

    def keep(message: Any) -> None:
        if not future.done():
            future.set_result(message)

    subscription = node.create_subscription(msg_type, topic, keep, qos_profile)
    before = node.executor
    executor = SingleThreadedExecutor(context=node.context)
    try:
        executor.add_node(node)
        executor.spin_until_future_complete(future, time_to_wait if time_to_wait >= 0 else None)
        return future.done(), future.result()
    finally:
        executor.shutdown()
        node.destroy_subscription(subscription)
        node.executor = before
