"""A node's logs on ``/rosout``."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from rcl_interfaces.msg import Log

from rclpy import logging
from rclpy.exceptions import InvalidHandle, RCLError
from rclpy.qos import qos_profile_rosout_default

if TYPE_CHECKING:
    from rclpy.node import Node

_NS_PER_S = 1_000_000_000


class Rosout:
    """Publishes what a node and the children of its logger log."""

    def __init__(self, node: Node) -> None:
        self._name = node.get_logger().name
        self._publisher = node.create_publisher(Log, "/rosout", qos_profile_rosout_default)
        self._publish = self.publish
        logging._rosout[self._name] = self._publish

    def publish(
        self, now: int, level: int, name: str, message: str, file: str, function: str, line: int
    ) -> None:
        """Publish one entry; after shutdown nothing happens."""
        entry = Log(level=level, name=name, msg=message, file=file, function=function, line=line)
        entry.stamp.sec, entry.stamp.nanosec = divmod(now, _NS_PER_S)
        # The console has it; logging must work until the very end.
        with suppress(RCLError, InvalidHandle):
            self._publisher.publish(entry)

    def close(self) -> None:
        """Publish no more."""
        if logging._rosout.get(self._name) is self._publish:
            del logging._rosout[self._name]
