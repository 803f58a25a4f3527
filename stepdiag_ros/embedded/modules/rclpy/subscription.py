"""Subscriptions."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy._endpoint import Decoder, QosWatch, type_user_data
from rclpy._source import Source
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSProfile
from stepdiag_ros.embedded import naming, registry

if TYPE_CHECKING:
    from rclpy.node import Node

#: Samples taken from DDS at once.
_BATCH = 64


class Subscription(Source):
    """Calls a function with each message of a topic; made by ``Node.create_subscription``.

    The function gets the message and, if it takes a second argument, a dictionary with
    ``source_timestamp`` and ``received_timestamp`` in nanoseconds.
    """

    def __init__(
        self,
        node: Node,
        msg_type: type,
        topic: str,
        callback: Callable[..., Any],
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
        raw: bool = False,
        event_callbacks: SubscriptionEventCallbacks | None = None,
    ) -> None:
        super().__init__(callback_group)
        self._node = node
        self.msg_type = msg_type
        self.topic = topic
        self.qos_profile = qos_profile
        self.raw = raw
        self.callback = callback
        self._wakes = True
        self._decode = Decoder(node, msg_type, f"topic {topic}")
        participant, _ = node.context._require()
        self._reader = participant.create_reader(
            naming.dds_topic(topic),
            naming.dds_type(registry.type_name(msg_type)),
            qos_profile._to_dds(),
            type_user_data(msg_type),
        )
        self._guid = self._reader.guid
        self._watch = QosWatch(node, self._reader, topic, event_callbacks, callback_group)

    @property
    def callback(self) -> Callable[..., Any]:
        """The function that is called."""
        return self._callback

    @callback.setter
    def callback(self, value: Callable[..., Any]) -> None:
        self._callback = value
        self._wants_info = _takes_info(value)

    @property
    def topic_name(self) -> str:
        """The topic's full name."""
        return self.topic

    def get_publisher_count(self) -> int:
        """Return how many publishers are received."""
        return self._reader.matched()

    def destroy(self) -> None:
        """End the subscription."""
        self._watch.destroy()
        super().destroy()
        self._reader.close()

    def __enter__(self) -> Subscription:
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_subscription(self)

    def _conditions(self) -> list[int]:
        return [self._reader.condition] if self._wakes else []

    def _set_wakes(self, wakes: bool) -> None:
        """Choose whether messages wake the executor; those that do not wait to be taken."""
        if wakes == self._wakes:
            return
        self._wakes = wakes
        executor = self._executor()
        if executor is not None:
            executor._remove_source(self)
            executor._add_source(self)
            executor.wake()

    def _fetch(self) -> None:
        self._pending.extend(self._reader.take(_BATCH))

    def _run(self, item: Any) -> Any:
        message = item.data if self.raw else self._decode(item.data)
        if message is None:
            return None
        if self._wants_info:
            info = {
                "source_timestamp": item.source_timestamp,
                "received_timestamp": time.time_ns(),
            }
            return self._callback(message, info)
        return self._callback(message)


def _takes_info(callback: Callable[..., Any]) -> bool:
    """Return whether a callback takes the message's info as a second argument, as in rclpy."""
    try:
        inspect.signature(callback).bind(object())
        return False
    except TypeError:
        pass
    except ValueError:
        return False
    try:
        inspect.signature(callback).bind(object(), object())
    except TypeError:
        raise RuntimeError(
            "Subscription.__init__(): callback should be either be callable with one argument "
            "(to get only the message) or two (to get message and message info)"
        ) from None
    return True
