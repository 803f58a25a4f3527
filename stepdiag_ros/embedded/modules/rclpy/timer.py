"""Timers and rates."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy._source import Source
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockChange, JumpThreshold, TimeJump
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import ROSInterruptException
from rclpy.time import Time


@dataclass(frozen=True)
class TimerInfo:
    """When a timer's callback was due and when it was called."""

    expected_call_time: Time
    actual_call_time: Time


class Timer(Source):
    """Calls a function again and again; calls that were missed are skipped, not made up for."""

    def __init__(
        self,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None,
        timer_period_ns: int,
        clock: Clock,
        *,
        context: Context | None = None,  # noqa: ARG002 - rclpy's signature
        autostart: bool = True,
    ) -> None:
        super().__init__(callback_group)
        self.callback = callback
        self._clock = clock
        self._period = int(timer_period_ns)
        if self._period < 0:
            raise ValueError(f"The timer period is {timer_period_ns} ns; it must not be negative.")
        self._canceled = not autostart
        self._last_call = clock._timer_ns()
        self._next_call = self._last_call + self._period
        self._jumps = clock.create_jump_callback(
            JumpThreshold(
                min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1)
            ),
            pre_callback=self._before_jump,
            post_callback=self._after_jump,
        )
        self._credit = 0
        self._wants_info = callback is not None and _takes_argument(callback)

    @property
    def clock(self) -> Clock:
        """The clock the timer goes by."""
        return self._clock

    @property
    def timer_period_ns(self) -> int:
        """The period in nanoseconds; a new one counts from the last call on."""
        return self._period

    @timer_period_ns.setter
    def timer_period_ns(self, value: int) -> None:
        self._period = int(value)
        self._next_call = self._last_call + self._period
        self._reschedule()

    def is_ready(self) -> bool:
        """Return whether the callback is due."""
        return not self._canceled and self._clock._timer_ns() >= self._next_call

    def is_canceled(self) -> bool:
        """Return whether the timer was cancelled."""
        return self._canceled

    def cancel(self) -> None:
        """Stop calling until :meth:`reset`."""
        self._canceled = True

    def reset(self) -> None:
        """Start again: the next call comes in one period."""
        self._canceled = False
        self._last_call = self._clock._timer_ns()
        self._next_call = self._last_call + self._period
        self._reschedule()

    def time_since_last_call(self) -> int:
        """Return the nanoseconds since the last call."""
        return self._clock._timer_ns() - self._last_call

    def time_until_next_call(self) -> int | None:
        """Return the nanoseconds until the next call, ``None`` if cancelled."""
        return None if self._canceled else self._next_call - self._clock._timer_ns()

    def destroy(self) -> None:
        """Stop for good."""
        self._canceled = True
        self._jumps.unregister()
        super().destroy()

    def __enter__(self) -> Timer:
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy()

    def _take(self) -> Any:
        """Note a call and return its data, or ``None`` if it is not due any more."""
        now = self._clock._timer_ns()
        if self._canceled or now < self._next_call:
            return None
        expected, self._last_call = self._next_call, now
        self._next_call += self._period
        if self._next_call < now:
            if self._period:
                missed = (now - self._next_call) // self._period + 1
                self._next_call += missed * self._period
            else:
                self._next_call = now
        return expected, now

    def _run(self, item: Any) -> Any:
        if self.callback is None:
            return None
        if not self._wants_info:
            return self.callback()
        kind = self._clock.clock_type
        expected, actual = (Time(nanoseconds=max(t, 0), clock_type=kind) for t in item)
        return self.callback(TimerInfo(expected, actual))

    def _before_jump(self) -> None:
        self._credit = self._clock._timer_ns() - self._last_call

    def _after_jump(self, jump: TimeJump) -> None:
        now = self._clock._timer_ns()
        if jump.clock_change in (
            ClockChange.ROS_TIME_ACTIVATED,
            ClockChange.ROS_TIME_DEACTIVATED,
        ):
            # What has passed of the period counts on the new clock too.
            self._last_call = now - self._credit
            self._next_call = self._last_call + self._period
        elif now < self._last_call:
            self._last_call = now
            self._next_call = now + self._period
        self._reschedule()

    def _reschedule(self) -> None:
        executor = self._executor()
        if executor is not None:
            executor._timers_changed()


class Rate:
    """Sleeps so that a loop runs at a fixed rate; another thread must spin the node."""

    def __init__(self, timer: Timer, *, context: Context) -> None:
        self._timer = timer
        self._context = context
        self._event = threading.Event()
        self._destroyed = False
        timer.callback = self._event.set
        context._wakers.add(self._event.set)

    def sleep(self) -> None:
        """Sleep until the timer's next call.

        Raises:
            rclpy.exceptions.ROSInterruptException: rclpy was shut down meanwhile.
        """
        self._check()
        self._event.wait()
        self._event.clear()
        self._check()

    def destroy(self) -> None:
        """Wake the sleeper for good."""
        self._destroyed = True
        self._context._wakers.discard(self._event.set)
        self._event.set()
        self._timer.destroy()

    def _check(self) -> None:
        if self._destroyed:
            raise RuntimeError("rate cannot sleep because it has been destroyed")
        if not self._context.ok():
            self.destroy()
            raise ROSInterruptException


def _takes_argument(callback: Callable[..., Any]) -> bool:
    try:
        parameters = inspect.signature(callback).parameters.values()
    except (TypeError, ValueError):
        return False
    return any(
        p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)
        for p in parameters
    )
