"""Callbacks for what happens to a publisher or subscription besides messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.exceptions import RCLError
from rclpy.qos import QoSPolicyKind


class UnsupportedEventTypeError(RCLError):
    """The middleware does not report such events."""


@dataclass(frozen=True)
class QoSRequestedIncompatibleQoSInfo:
    """Peers were found whose quality of service does not fit.

    Attributes:
        total_count: How many there were so far.
        total_count_change: How many there were since the callback was last called.
        last_policy_kind: The policy that did not fit, of the last of them.
    """

    total_count: int
    total_count_change: int
    last_policy_kind: QoSPolicyKind


QoSOfferedIncompatibleQoSInfo = QoSRequestedIncompatibleQoSInfo

OnIncompatibleQos = Callable[[QoSRequestedIncompatibleQoSInfo], Any]


class _EventCallbacks:
    """What both kinds share; only ``incompatible_qos`` is there."""

    def __init__(
        self,
        *,
        incompatible_qos: OnIncompatibleQos | None = None,
        use_default_callbacks: bool = True,
        **others: Any,
    ) -> None:
        for name, callback in others.items():
            if name not in self._NAMES:
                raise TypeError(
                    f"{type(self).__name__}.__init__() got an unexpected keyword argument '{name}'"
                )
            if callback is not None:
                raise NotImplementedError(
                    f"The embedded ROS 2 client has no {name} events; leave them out."
                )
        self.incompatible_qos = incompatible_qos
        self.use_default_callbacks = use_default_callbacks

    _NAMES: tuple[str, ...] = ("deadline", "liveliness", "incompatible_type", "matched")


class PublisherEventCallbacks(_EventCallbacks):
    """Callbacks of a publisher.

    Args:
        incompatible_qos: Called when a subscription asks for what the publisher does not offer.
        use_default_callbacks: Whether that is logged if no callback is given.

    Raises:
        NotImplementedError: A callback for another event is given.
    """


class SubscriptionEventCallbacks(_EventCallbacks):
    """Callbacks of a subscription.

    Args:
        incompatible_qos: Called when a publisher does not offer what the subscription asks for.
        use_default_callbacks: Whether that is logged if no callback is given.

    Raises:
        NotImplementedError: A callback for another event is given.
    """

    _NAMES = (*_EventCallbacks._NAMES, "message_lost")
