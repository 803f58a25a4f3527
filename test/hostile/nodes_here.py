"""Nodes of the suite in this process, with nobody on the network, and every callback at hand."""

from collections.abc import Callable, Iterator
from concurrent.futures import wait
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import rclpy
from rclpy.serialization import deserialize_message, serialize_message

from stepdiag_ros.topics import Topic, absolute

NODES = {
    "archive": "ArchiveNode",
    "bridge": "BridgeNode",
    "interferometer": "InterferometerNode",
    "weather": "WeatherNode",
    "assembler": "AssemblerNode",
    "solver": "SolverNode",
    "evaluator": "EvaluatorNode",
    "diagnosis": "DiagnosisNode",
    "recorder": "RecorderNode",
    "sequencer": "SequencerNode",
    "by_hand": "ByHandNode",
    "monitor": "MonitorNode",
    "foxglove_server": "FoxgloveServerNode",
    "scene": "SceneNode",
    "clock": "ClockNode",
    "operator": "OperatorNode",
}
"""Module below ``stepdiag_ros.nodes`` → class: all that subscribe to anything."""
LONGEST_WORK = 20.0


class Here:
    """A node whose callbacks are called by hand.

    Attributes:
        node: the node.
    """

    def __init__(self, node: Any) -> None:
        self.node = node

    @property
    def hears(self) -> list[Any]:
        """Its subscriptions, in a fixed order."""
        return sorted(self.node.subscriptions, key=lambda one: (one.topic, one.raw))

    def give(self, topic: Topic, data: bytes) -> None:
        """Give the bytes of a message to whatever of the node hears a topic."""
        for one in self.hears:
            if one.topic == absolute(topic):
                one.callback(data if one.raw else deserialize_message(data, one.msg_type))

    @staticmethod
    def give_to(subscription: Any, message: Any) -> None:
        """Give a message, or the bytes of one, to a subscription."""
        if subscription.raw and not isinstance(message, bytes):
            message = serialize_message(message)
        subscription.callback(message)

    def work(self) -> None:
        """Let everything happen that is due by the clock, and wait for what it has begun."""
        for timer in list(self.node.timers):
            timer.callback()
        solving = [entry[-1] for entry in getattr(self.node, "_solving", ())]
        task = getattr(self.node, "_task", None)
        wait([*solving, *([task] if task is not None else [])], LONGEST_WORK)
        for timer in list(self.node.timers):
            timer.callback()


@contextmanager
def node_here(name: str, *parameters: str) -> Iterator[Here]:
    """Make a node; a device's is active."""
    given = [word for one in parameters for word in ("-p", one)]
    rclpy.init(args=["x", "--ros-args", "--log-level", "fatal", *given])
    kind: Callable[[], Any] = getattr(import_module(f"stepdiag_ros.nodes.{name}"), NODES[name])
    node = kind()
    try:
        if hasattr(node, "trigger_configure"):
            node._start()
        yield Here(node)
    finally:
        if hasattr(node, "close"):
            node.close()
        node.destroy_node()
        rclpy.try_shutdown()
