"""Clocks: the system's, a steady one, and ROS time, which a ``/clock`` topic can take over."""

from __future__ import annotations

import threading
import time as _time
from collections.abc import Callable
from enum import IntEnum
from typing import Any

from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.time import Time

__all__ = [
    "Clock",
    "ClockChange",
    "ClockType",
    "JumpHandle",
    "JumpThreshold",
    "ROSClock",
    "TimeJump",
]


class ClockChange(IntEnum):
    """What happened to ROS time at a jump."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


class JumpThreshold:
    """How far time must jump before a callback is called.

    Args:
        min_forward: Smallest jump forwards, positive, or ``None``.
        min_backward: Smallest jump backwards, negative, or ``None``.
        on_clock_change: Whether the start and end of a taken-over time count.

    Raises:
        ValueError: A threshold has the wrong sign, or nothing at all is watched.
    """

    def __init__(
        self,
        *,
        min_forward: Duration | None,
        min_backward: Duration | None,
        on_clock_change: bool = True,
    ) -> None:
        if min_forward is not None and min_forward.nanoseconds <= 0:
            raise ValueError("min_forward must be a positive non-zero duration")
        if min_backward is not None and min_backward.nanoseconds >= 0:
            raise ValueError("min_backward must be a negative non-zero duration")
        if min_forward is None and min_backward is None and not on_clock_change:
            raise ValueError("At least one jump threshold must be enabled")
        self.min_forward = min_forward
        self.min_backward = min_backward
        self.on_clock_change = on_clock_change


class TimeJump:
    """A jump of time: what changed, and by how much."""

    def __init__(self, clock_change: ClockChange, delta: Duration) -> None:
        self._clock_change = clock_change
        self._delta = delta

    @property
    def clock_change(self) -> ClockChange:
        """What happened to ROS time."""
        return self._clock_change

    @property
    def delta(self) -> Duration:
        """How far time went."""
        return self._delta


class JumpHandle:
    """A registered pair of jump callbacks; :meth:`unregister` ends it."""

    def __init__(
        self,
        clock: Clock,
        threshold: JumpThreshold,
        pre_callback: Callable[[], None] | None,
        post_callback: Callable[[TimeJump], None] | None,
    ) -> None:
        if pre_callback is None and post_callback is None:
            raise ValueError("One of pre_callback or post_callback must be callable")
        self._clock = clock
        self._threshold = threshold
        self._pre, self._post = pre_callback, post_callback
        clock._jump_handles.append(self)
        clock._watchers_changed()

    def unregister(self) -> None:
        """Call the callbacks no more."""
        if self in self._clock._jump_handles:
            self._clock._jump_handles.remove(self)
            self._clock._watchers_changed()

    def _wants(self, change: ClockChange, delta: int) -> bool:
        if change in (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED):
            return self._threshold.on_clock_change
        forward, backward = self._threshold.min_forward, self._threshold.min_backward
        return (forward is not None and delta >= forward.nanoseconds) or (
            backward is not None and delta <= backward.nanoseconds
        )

    def __enter__(self) -> JumpHandle:
        return self

    def __exit__(self, *_: object) -> None:
        self.unregister()


class Clock:
    """Clock of a kind; ``Clock(clock_type=ClockType.ROS_TIME)`` gives a :class:`ROSClock`."""

    _clock_type: ClockType
    _jump_handles: list[JumpHandle]

    def __new__(cls, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> Clock:
        """Return a new clock.

        Raises:
            TypeError: The type is not a clock type.
        """
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        made: Clock
        if clock_type is ClockType.ROS_TIME:
            made = super().__new__(ROSClock)
        else:
            made = super().__new__(cls)
        made._clock_type = clock_type
        made._jump_handles = []
        return made

    @property
    def clock_type(self) -> ClockType:
        """The kind of the clock."""
        return self._clock_type

    def __repr__(self) -> str:
        return f"Clock(clock_type={self._clock_type.name})"

    def now(self) -> Time:
        """Return the time."""
        return Time(nanoseconds=self._now_ns(), clock_type=self._clock_type)

    def _now_ns(self) -> int:
        if self._clock_type is ClockType.STEADY_TIME:
            return _time.monotonic_ns()
        return _time.time_ns()

    def _timer_ns(self) -> int:
        """Return the time timers go by: steady, unless ROS time is taken over.

        In rcl a timer on system time stalls when the wall clock is set back; here it does not.
        """
        return _time.monotonic_ns()

    @property
    def _is_taken_over(self) -> bool:
        return False

    def _watchers_changed(self) -> None:
        """Called when jumps of the clock are watched, or are not any more."""

    def create_jump_callback(
        self,
        threshold: JumpThreshold,
        *,
        pre_callback: Callable[[], None] | None = None,
        post_callback: Callable[[TimeJump], None] | None = None,
    ) -> JumpHandle:
        """Call functions before and after time jumps farther than a threshold."""
        return JumpHandle(self, threshold, pre_callback, post_callback)

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Sleep until a time on this clock; return whether it was reached before shutdown.

        Raises:
            ValueError: The time is one of another kind of clock.
            rclpy.exceptions.NotInitializedException: rclpy is not initialised.
        """
        from rclpy.exceptions import NotInitializedException
        from rclpy.utilities import get_default_context

        context = context or get_default_context()
        if not context.ok():
            raise NotInitializedException
        if until.clock_type is not self._clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        wake = threading.Event()
        context._wakers.add(wake.set)
        handle = self.create_jump_callback(
            JumpThreshold(
                min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1)
            ),
            post_callback=lambda _: wake.set(),
        )
        taken_over = self._is_taken_over
        try:
            while context.ok() and taken_over == self._is_taken_over:
                left = until.nanoseconds - self._now_ns()
                if left <= 0:
                    return True
                wake.wait(None if self._is_taken_over else left / 1e9)
                wake.clear()
            return False
        finally:
            handle.unregister()
            context._wakers.discard(wake.set)

    def sleep_for(self, rel_time: Duration, context: Context | None = None) -> bool:
        """Sleep for a duration on this clock; return whether it passed before shutdown."""
        return self.sleep_until(self.now() + rel_time, context)


class ROSClock(Clock):
    """ROS time: the system's, or that of ``/clock`` once it is taken over."""

    def __new__(cls, **_: Any) -> ROSClock:
        """Return a new clock."""
        made = super().__new__(cls, clock_type=ClockType.ROS_TIME)
        assert isinstance(made, ROSClock)
        made._active = False
        made._override = 0
        made._look = made._tell_watchers = None
        return made

    _active: bool
    _override: int
    #: Of a time source that is asked for the time: brings it up to date.
    _look: Callable[[], None] | None
    #: Of the same: is told when jumps of this clock are watched, or are not any more.
    _tell_watchers: Callable[[], None] | None

    @property
    def ros_time_is_active(self) -> bool:
        """Whether time comes from ``/clock``."""
        return self._active

    @property
    def _is_taken_over(self) -> bool:
        return self._active

    def _now_ns(self) -> int:
        if not self._active:
            return _time.time_ns()
        if self._look is not None:
            self._look()
        return self._override

    def _timer_ns(self) -> int:
        return self._override if self._active else _time.monotonic_ns()

    def _watchers_changed(self) -> None:
        if self._tell_watchers is not None:
            self._tell_watchers()

    def _set_ros_time_is_active(self, enabled: bool) -> None:
        if enabled == self._active:
            return
        before = self._now_ns()
        change = ClockChange.ROS_TIME_ACTIVATED if enabled else ClockChange.ROS_TIME_DEACTIVATED
        delta = (self._override if enabled else _time.time_ns()) - before
        self._jump(change, delta, lambda: setattr(self, "_active", enabled))

    def set_ros_time_override(self, time: Time) -> None:
        """Set the time which counts while ROS time is taken over.

        Raises:
            TypeError: It is not a ROS time.
        """
        if not isinstance(time, Time):
            raise TypeError("Time must be specified as rclpy.time.Time. Received type: ")
        new = time.nanoseconds
        if not self._active:
            self._override = new
            return
        delta = new - self._override
        self._jump(ClockChange.ROS_TIME_NO_CHANGE, delta, lambda: setattr(self, "_override", new))

    def _jump(self, change: ClockChange, delta: int, apply: Callable[[], None]) -> None:
        told = [handle for handle in list(self._jump_handles) if handle._wants(change, delta)]
        for handle in told:
            if handle._pre is not None:
                handle._pre()
        apply()
        jump = TimeJump(change, Duration(nanoseconds=delta))
        for handle in told:
            if handle._post is not None:
                handle._post(jump)
