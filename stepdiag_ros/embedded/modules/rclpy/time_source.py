"""Where ROS time comes from: the parameter ``use_sim_time`` and the topic ``/clock``."""

from __future__ import annotations

import threading
import time
import weakref
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import SetParametersResult

from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.subscription import Subscription

CLOCK_TOPIC = "/clock"
USE_SIM_TIME_NAME = "use_sim_time"
#: Whoever asks for the time more often than this, in ns, is told the same.
_LOOK_NS = 100_000


class TimeSource:
    """Keeps a node's ROS clocks on ``/clock`` while ``use_sim_time`` is set."""

    def __init__(self, *, node: Node) -> None:
        self._node = weakref.ref(node)
        self._subscription: Subscription | None = None
        self._clocks: list[ROSClock] = []
        self._last = Time(clock_type=ClockType.ROS_TIME)
        self._active = False
        self._when_asked = False
        self._next_look = 0
        self._looking = threading.Lock()
        if not node.has_parameter(USE_SIM_TIME_NAME):
            node.declare_parameter(USE_SIM_TIME_NAME, False)
        self.ros_time_is_active = bool(node.get_parameter(USE_SIM_TIME_NAME).value)
        node.add_on_set_parameters_callback(self._check_parameters)
        node.add_post_set_parameters_callback(self._apply_parameters)

    @property
    def ros_time_is_active(self) -> bool:
        """Whether time comes from ``/clock``."""
        return self._active

    @ros_time_is_active.setter
    def ros_time_is_active(self, enabled: bool) -> None:
        node = self._node()
        if enabled == self._active or node is None:
            return
        self._active = enabled
        for clock in self._clocks:
            clock._set_ros_time_is_active(enabled)
        if enabled:
            from rosgraph_msgs.msg import Clock as ClockMsg

            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._subscription = node.create_subscription(
                ClockMsg, CLOCK_TOPIC, self.clock_callback, qos, callback_group=node._clock_group
            )
            self._choose_wakes()
        elif self._subscription is not None:
            node.destroy_subscription(self._subscription)
            self._subscription = None

    def attach_clock(self, clock: ROSClock) -> None:
        """Keep a clock on this source too."""
        clock.set_ros_time_override(self._last)
        clock._set_ros_time_is_active(self._active)
        self._clocks.append(clock)
        if self._when_asked:
            self._follow_when_asked(clock)

    def look_when_asked(self) -> None:
        """Take the time from ``/clock`` when somebody asks for it, not at each message.

        rclpy has nothing like it. Messages wake the executor only while a timer goes by ROS time or
        jumps of it are watched.
        """
        self._when_asked = True
        for clock in self._clocks:
            self._follow_when_asked(clock)

    def _follow_when_asked(self, clock: ROSClock) -> None:
        clock._look, clock._tell_watchers = self._look, self._choose_wakes
        self._choose_wakes()

    def _choose_wakes(self) -> None:
        if self._subscription is not None and self._when_asked:
            self._subscription._set_wakes(any(clock._jump_handles for clock in self._clocks))

    def _look(self) -> None:
        """Set the clocks to the newest message, unless its arrival wakes the executor anyway."""
        subscription, now = self._subscription, time.monotonic_ns()
        if subscription is None or subscription._wakes or now < self._next_look:
            return
        if not self._looking.acquire(blocking=False):
            return
        try:
            self._next_look = now + _LOOK_NS
            subscription._fetch()
            while (item := subscription._take()) is not None:
                subscription._run(item)
        finally:
            self._looking.release()

    def clock_callback(self, msg: Any) -> None:
        """Set the clocks to the time of a ``/clock`` message."""
        self._last = Time.from_msg(msg.clock)
        for clock in self._clocks:
            clock.set_ros_time_override(self._last)

    def _check_parameters(self, parameters: list[Parameter]) -> Any:
        for parameter in parameters:
            if parameter.name == USE_SIM_TIME_NAME and not isinstance(parameter.value, bool):
                return SetParametersResult(
                    successful=False, reason=f"{USE_SIM_TIME_NAME} must be a bool"
                )
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: list[Parameter]) -> None:
        for parameter in parameters:
            if parameter.name == USE_SIM_TIME_NAME:
                self.ros_time_is_active = parameter.value
