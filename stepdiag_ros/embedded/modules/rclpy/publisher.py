"""Publishers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from rclpy._endpoint import QosWatch, type_user_data
from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.exceptions import InvalidHandle, RCLError
from rclpy.logging import RcutilsLogger
from rclpy.qos import QoSProfile
from stepdiag_ros.embedded import dds, naming, registry

if TYPE_CHECKING:
    from rclpy.node import Node


_NO_LIMIT = Duration(seconds=-1)


class Publisher:
    """Publishes messages on a topic; made by ``Node.create_publisher``."""

    def __init__(
        self,
        node: Node,
        msg_type: type,
        topic: str,
        qos_profile: QoSProfile,
        callback_group: CallbackGroup | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> None:
        self._node = node
        self.msg_type = msg_type
        self.topic = topic
        self.qos_profile = qos_profile
        self._serialize = registry.serializer(msg_type)
        participant, _ = node.context._require()
        self._writer = participant.create_writer(
            naming.dds_topic(topic),
            naming.dds_type(registry.type_name(msg_type)),
            qos_profile._to_dds(),
            type_user_data(msg_type),
        )
        self._guid = self._writer.guid
        self._watch = QosWatch(node, self._writer, topic, event_callbacks, callback_group)

    @property
    def topic_name(self) -> str:
        """The topic's full name."""
        return self.topic

    @property
    def logger_name(self) -> str:
        """The name of the node's logger."""
        return self._node.get_logger().name

    def publish(self, msg: Any) -> None:
        """Publish a message, or CDR bytes.

        Waits while a reliable KEEP_ALL subscriber is behind.

        Raises:
            TypeError: It is another message than the topic's.
            rclpy.exceptions.RCLError: The context is shut down.
            rclpy.exceptions.InvalidHandle: The publisher is destroyed.
        """
        self._send(msg)

    def publish_all(self, messages: Iterable[Any]) -> None:
        """Publish messages in as few packets as they fit into; not in rclpy.

        Each is serialized before the next one is asked for; errors are those of :meth:`publish`.
        """
        waiting = False
        try:
            for message in messages:
                self._send(message, more=True)
                waiting = True
        finally:
            if waiting and self._writer.handle:
                self._writer.flush()

    def _send(self, msg: Any, more: bool = False) -> None:
        if type(msg) is self.msg_type:
            data = self._serialize(msg)
        elif isinstance(msg, (bytes, bytearray, memoryview)):
            data = bytes(msg)
        elif isinstance(msg, self.msg_type):
            data = self._serialize(msg)
        else:
            raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
        self._check()
        try:
            self._writer.write(data, more)
        except dds.DdsError as error:
            self._check()
            raise RCLError(f"Failed to publish on {self.topic}: {error}") from error

    def get_subscription_count(self) -> int:
        """Return how many subscriptions receive what is published."""
        self._check()
        return self._writer.matched()

    def assert_liveliness(self) -> None:
        """Say that the publisher is alive.

        Raises:
            NotImplementedError: Always; publishing a message says it too.
        """
        raise NotImplementedError(
            "The embedded ROS 2 client has no assert_liveliness; publish a message instead."
        )

    def wait_for_all_acked(self, timeout: Duration = _NO_LIMIT) -> bool:
        """Wait until all reliable subscriptions have everything; return whether they do in time."""
        self._check()
        limit = timeout.nanoseconds
        return self._writer.wait_for_acks(dds.UNLIMITED if limit < 0 else limit)

    def destroy(self) -> None:
        """End the publisher."""
        self._watch.destroy()
        self._writer.close()

    def get_logger(self) -> RcutilsLogger:
        """Return the node's logger."""
        return self._node.get_logger()

    def __enter__(self) -> Publisher:
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_publisher(self)

    def _check(self) -> None:
        if not self._writer.handle:
            raise InvalidHandle("Cannot use Destroyable because destruction was requested")
        if not self._node.context.ok():
            raise RCLError(f"Failed to publish on {self.topic}: publisher's context is invalid")
