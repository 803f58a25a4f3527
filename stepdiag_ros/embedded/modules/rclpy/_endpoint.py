"""What publishers, subscriptions, services and clients share: names, types and their errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy._source import Source
from rclpy.qos import _DDS_POLICIES
from stepdiag_ros.embedded import dds, registry

if TYPE_CHECKING:
    from rclpy.node import Node


def type_user_data(cls: type) -> str:
    """Return the user data that tells peers the type hash of a message class."""
    return f"typehash={registry.hash_of(cls)};"


class QosWatch(Source):
    """Logs a warning when a peer does not match because of its quality of service."""

    def __init__(self, node: Node, endpoint: dds.Writer | dds.Reader, topic: str) -> None:
        super().__init__(None)
        self._endpoint = endpoint
        self._topic = topic
        self._logger = node.get_logger()

    def _conditions(self) -> list[int]:
        return [self._endpoint.handle]

    def _fetch(self) -> None:
        if not self._endpoint.handle:
            return
        count, policy = self._endpoint.incompatible()
        if count <= 0:
            return
        kind = _DDS_POLICIES.get(policy)
        name = kind.name if kind is not None else "INVALID"
        if isinstance(self._endpoint, dds.Writer):
            self._logger.warning(
                f"New subscription discovered on topic '{self._topic}', requesting incompatible"
                f" QoS. No messages will be sent to it. Last incompatible policy: {name}"
            )
        else:
            self._logger.warning(
                f"New publisher discovered on topic '{self._topic}', offering incompatible QoS."
                f" No messages will be received from it. Last incompatible policy: {name}"
            )

    def _run(self, item: Any) -> Any:  # noqa: ARG002 - there is no callback
        return None


class Decoder:
    """Turns samples into messages; one that cannot be decoded is dropped, and said once."""

    def __init__(self, node: Node, cls: type, what: str) -> None:
        self._decode = registry.deserializer(cls)
        self._logger = node.get_logger()
        self._what = what
        self._told = False

    def __call__(self, data: bytes) -> Any:
        """Return the message, ``None`` if the bytes are none."""
        try:
            return self._decode(data)
        except ValueError as error:
            if not self._told:
                self._told = True
                self._logger.error(
                    f"A sample on {self._what} is dropped, further ones silently: {error}"
                )
            return None
