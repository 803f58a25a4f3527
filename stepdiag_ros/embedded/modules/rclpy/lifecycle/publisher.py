"""Publishers that publish only while their node is active."""

from __future__ import annotations

from typing import Any

from rclpy.lifecycle.managed_entity import SimpleManagedEntity
from rclpy.publisher import Publisher


class LifecyclePublisher(SimpleManagedEntity, Publisher):
    """Publisher of a managed node; made by ``LifecycleNode.create_lifecycle_publisher``."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        SimpleManagedEntity.__init__(self)
        Publisher.__init__(self, *args, **kwargs)

    def publish(self, msg: Any) -> None:
        """Publish a message; while the node is not active nothing happens.

        Raises:
            TypeError: It is another message than the topic's.
            rclpy.exceptions.RCLError: The context is shut down.
            rclpy.exceptions.InvalidHandle: The publisher is destroyed.
        """
        if self._enabled:
            Publisher.publish(self, msg)
