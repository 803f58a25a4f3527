"""What publishers, subscriptions, services and clients share: names, types and their errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy._source import Source
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import (
    OnIncompatibleQos,
    PublisherEventCallbacks,
    QoSRequestedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.qos import _DDS_POLICIES, QoSPolicyKind
from stepdiag_ros.embedded import dds, registry

if TYPE_CHECKING:
    from rclpy.node import Node


def type_user_data(cls: type) -> str:
    """Return the user data that announces the type hash of a message class to peers."""
    return f"typehash={registry.hash_of(cls)};"


class QosWatch(Source):
    """Reports a peer that does not match because of its quality of service.

    Args:
        node: Whose publisher or subscription.
        endpoint: Its end in DDS.
        topic: Full name of the topic.
        callbacks: What is called; it is logged if there are none.
        callback_group: Of the callback.
    """

    def __init__(
        self,
        node: Node,
        endpoint: dds.Writer | dds.Reader,
        topic: str,
        callbacks: PublisherEventCallbacks | SubscriptionEventCallbacks | None = None,
        callback_group: CallbackGroup | None = None,
    ) -> None:
        super().__init__(callback_group)
        self._endpoint = endpoint
        self._topic = topic
        self._logger = node.get_logger()
        self._callback: OnIncompatibleQos | None = self._log
        if callbacks is not None and callbacks.incompatible_qos is not None:
            self._callback = callbacks.incompatible_qos
        elif callbacks is not None and not callbacks.use_default_callbacks:
            self._callback = None

    def _conditions(self) -> list[int]:
        return [self._endpoint.handle]

    def _fetch(self) -> None:
        if not self._endpoint.handle:
            return
        total, change, policy = self._endpoint.incompatible()
        if change > 0 and self._callback is not None:
            kind = _DDS_POLICIES.get(policy, QoSPolicyKind.INVALID)
            self._pending.append(QoSRequestedIncompatibleQoSInfo(total, change, kind))

    def _run(self, item: Any) -> Any:
        return self._callback(item) if self._callback is not None else None

    def _log(self, info: QoSRequestedIncompatibleQoSInfo) -> None:
        name = info.last_policy_kind.name
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
