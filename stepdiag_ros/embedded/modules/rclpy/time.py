"""Points in time, exact to the nanosecond."""

from __future__ import annotations

from typing import Any, overload

from builtin_interfaces.msg import Time as _TimeMsg

from rclpy.clock_type import ClockType
from rclpy.duration import NS_PER_S, Duration

_LIMIT = 2**63


class Time:
    """Point in time on a clock.

    Args:
        seconds: Seconds since the clock's epoch, added to the nanoseconds.
        nanoseconds: Nanoseconds since the clock's epoch.
        clock_type: The kind of clock; times of different kinds cannot be compared.

    Raises:
        ValueError: A part is negative.
        OverflowError: It does not fit in 64 bits of nanoseconds.
    """

    __slots__ = ("_clock_type", "_nanoseconds")

    def __init__(
        self,
        *,
        seconds: float = 0,
        nanoseconds: float = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ) -> None:
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        if seconds < 0:
            raise ValueError("Seconds value must not be negative")
        if nanoseconds < 0:
            raise ValueError("Nanoseconds value must not be negative")
        total = int(seconds * NS_PER_S) + int(nanoseconds)
        if total >= _LIMIT:
            raise OverflowError("Total nanoseconds value is too large to store in C time point.")
        self._nanoseconds = total
        self._clock_type = clock_type

    @property
    def nanoseconds(self) -> int:
        """Nanoseconds since the clock's epoch."""
        return self._nanoseconds

    @property
    def clock_type(self) -> ClockType:
        """The kind of clock."""
        return self._clock_type

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Return whole seconds and the nanoseconds beyond them."""
        return self._nanoseconds // NS_PER_S, self._nanoseconds % NS_PER_S

    def __repr__(self) -> str:
        return f"Time(nanoseconds={self._nanoseconds}, clock_type={self._clock_type.name})"

    def __hash__(self) -> int:
        return hash((self._nanoseconds, self._clock_type))

    def __add__(self, other: Duration) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        return Time(nanoseconds=self._nanoseconds + other.nanoseconds, clock_type=self._clock_type)

    __radd__ = __add__

    @overload
    def __sub__(self, other: Time) -> Duration: ...

    @overload
    def __sub__(self, other: Duration) -> Time: ...

    def __sub__(self, other: Time | Duration) -> Time | Duration:
        if isinstance(other, Time):
            return Duration(nanoseconds=self._nanoseconds - self._same_clock(other, "subtract"))
        if isinstance(other, Duration):
            return Time(
                nanoseconds=self._nanoseconds - other.nanoseconds, clock_type=self._clock_type
            )
        return NotImplemented

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Time):
            return self._nanoseconds == self._same_clock(other, "compare")
        return NotImplemented

    def __lt__(self, other: Time) -> bool:
        return self._nanoseconds < self._same_clock(other, "compare")

    def __le__(self, other: Time) -> bool:
        return self._nanoseconds <= self._same_clock(other, "compare")

    def __gt__(self, other: Time) -> bool:
        return self._nanoseconds > self._same_clock(other, "compare")

    def __ge__(self, other: Time) -> bool:
        return self._nanoseconds >= self._same_clock(other, "compare")

    def _same_clock(self, other: Any, action: str) -> int:
        if not isinstance(other, Time):
            raise TypeError(f"Can't {action} times with a {type(other).__name__}")
        if self._clock_type != other._clock_type:
            raise TypeError(f"Can't {action} times with different clock types")
        return other._nanoseconds

    def to_msg(self) -> Any:
        """Return it as a ``builtin_interfaces`` message."""
        seconds, nanoseconds = self.seconds_nanoseconds()
        return _TimeMsg(sec=seconds, nanosec=nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any, clock_type: ClockType = ClockType.ROS_TIME) -> Time:
        """Return the time of a ``builtin_interfaces`` message.

        Raises:
            TypeError: It is another message.
        """
        if not isinstance(msg, _TimeMsg):
            raise TypeError("Must pass a builtin_interfaces.msg.Time object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)
