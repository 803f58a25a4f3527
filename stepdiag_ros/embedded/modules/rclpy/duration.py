"""Durations, exact to the nanosecond."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Duration as _DurationMsg

NS_PER_S = 1_000_000_000
_LIMIT = 2**63


class Duration:
    """Length of time.

    Args:
        seconds: Seconds, added to the nanoseconds.
        nanoseconds: Nanoseconds.

    Raises:
        OverflowError: It does not fit in 64 bits of nanoseconds.
    """

    __slots__ = ("_nanoseconds",)

    def __init__(self, *, seconds: float = 0, nanoseconds: float = 0) -> None:
        total = int(seconds * NS_PER_S) + int(nanoseconds)
        if not -_LIMIT <= total < _LIMIT:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._nanoseconds = total

    @property
    def nanoseconds(self) -> int:
        """The length in nanoseconds."""
        return self._nanoseconds

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self._nanoseconds})"

    def __str__(self) -> str:
        if self._nanoseconds == _LIMIT - 1:
            return "Infinite"
        return f"{self._nanoseconds} nanoseconds"

    def __hash__(self) -> int:
        return hash(("Duration", self._nanoseconds))

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Duration):
            return self._nanoseconds == other._nanoseconds
        return NotImplemented

    def __lt__(self, other: Duration) -> bool:
        return self._nanoseconds < _nanoseconds(other)

    def __le__(self, other: Duration) -> bool:
        return self._nanoseconds <= _nanoseconds(other)

    def __gt__(self, other: Duration) -> bool:
        return self._nanoseconds > _nanoseconds(other)

    def __ge__(self, other: Duration) -> bool:
        return self._nanoseconds >= _nanoseconds(other)

    def to_msg(self) -> Any:
        """Return it as a ``builtin_interfaces`` message."""
        seconds, nanoseconds = divmod(self._nanoseconds, NS_PER_S)
        return _DurationMsg(sec=seconds, nanosec=nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any) -> Duration:
        """Return the duration of a ``builtin_interfaces`` message.

        Raises:
            TypeError: It is another message.
        """
        if not isinstance(msg, _DurationMsg):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)


def _nanoseconds(other: Any) -> int:
    if isinstance(other, Duration):
        return other.nanoseconds
    raise TypeError(f"Can't compare a duration with a {type(other).__name__}")


#: The longest duration, which means "no limit".
Infinite = Duration(nanoseconds=_LIMIT - 1)
