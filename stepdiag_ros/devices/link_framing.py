"""Messages out of a stream of bytes: lines, records of fixed length, or what lies between marks.

A framing keeps what is not whole yet and gives it with the rest. It never keeps more than the
longest message: whatever goes on longer without an end is not a message of this device, and
refused.
"""

from dataclasses import dataclass
from typing import Protocol

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Refusal

LONGEST = 4096
"""Bytes of a message, unless the settings say otherwise."""


class Framing(Protocol):
    """Finds whole messages."""

    def take(self, data: bytes) -> list[bytes]:
        """Return the messages that are whole with these bytes, without terminators and marks.

        Raises:
            ValueError: the bytes have no message of allowed length.
        """
        ...


class Lines:
    r"""Messages that end with a terminator; empty ones are left out.

    Args:
        terminator: such as ``b"\n"``; a carriage return before or after a line is left out in any
            case.
        longest: bytes that a line may have.
    """

    def __init__(self, terminator: bytes = b"\n", longest: int = LONGEST) -> None:
        self._terminator = terminator
        self._longest = longest
        self._kept = b""

    def take(self, data: bytes) -> list[bytes]:
        """Return whole lines (see ``Framing.take``)."""
        *lines, self._kept = (self._kept + data).split(self._terminator)
        if max(map(len, (*lines, self._kept))) > self._longest:
            self._kept = b""
            raise Refusal(
                f"more than {self._longest} bytes came without the terminator {self._terminator!r}:"
                " check the terminator and the speed of the port",
                fault="too_many",
            )
        return [stripped for line in lines if (stripped := line.strip(b"\r\n"))]


class FixedLength:
    """Messages of one length, recognised by their first bytes.

    Args:
        length: bytes of a message.
        start: bytes that each message begins with; what lies before them is left out. Without
            them the beginning of a message is unknown.
    """

    def __init__(self, length: int, start: bytes = b"") -> None:
        self._length = length
        self._start = start
        self._kept = b""

    def take(self, data: bytes) -> list[bytes]:
        """Return whole messages, with their start (see ``Framing.take``)."""
        kept = self._kept + data
        messages = []
        while True:
            if self._start:
                kept = _from(kept, self._start)
            if len(kept) < self._length:
                break
            messages.append(kept[: self._length])
            kept = kept[self._length :]
        self._kept = kept
        return messages


class Between:
    """Messages between two marks; what lies outside them is left out.

    Args:
        start: mark before a message.
        end: mark after it.
        longest: bytes that a message may have.
    """

    def __init__(self, start: bytes, end: bytes, longest: int = LONGEST) -> None:
        self._start, self._end, self._longest = start, end, longest
        self._kept = b""

    def take(self, data: bytes) -> list[bytes]:
        """Return what lies between marks (see ``Framing.take``)."""
        kept = self._kept + data
        messages = []
        while True:
            kept = _from(kept, self._start)
            end = kept.find(self._end, len(self._start))
            whole = end >= 0
            # A message that was cut off by the loss of its end starts again with the next mark.
            begin = kept.rfind(self._start, 0, end if whole else len(kept))
            begin = begin if whole and self._start != self._end else 0
            if (end if whole else len(kept)) - begin - len(self._start) > self._longest:
                self._kept = b""
                raise Refusal(
                    f"more than {self._longest} bytes came after {self._start!r} without"
                    f" {self._end!r}",
                    fault="too_many",
                )
            if not whole:
                break
            messages.append(kept[begin + len(self._start) : end])
            kept = kept[end + len(self._end) :]
        self._kept = kept
        return messages


def _from(data: bytes, start: bytes) -> bytes:
    """Return the bytes from a mark on, or as many of the last ones as may begin the mark."""
    found = data.find(start)
    if found >= 0:
        return data[found:]
    for length in range(min(len(start) - 1, len(data)), 0, -1):
        if data.endswith(start[:length]):
            return data[-length:]
    return b""


@dataclass(frozen=True)
class FramingSettings:
    """How messages are framed.

    Attributes:
        kind: lines, fixed or between.
        terminator: of a line.
        length: of a message of fixed length, bytes.
        start: mark before a message.
        end: mark after it.
        longest: bytes that a message may have.
    """

    kind: str = "lines"
    terminator: bytes = b"\n"
    length: int = 0
    start: bytes = b""
    end: bytes = b""
    longest: int = LONGEST

    @classmethod
    def from_section(cls, section: Section) -> "FramingSettings":
        """Take the settings from ``kind``, ``terminator``, ``length``, ``start``, ``end``.

        Raises:
            ValueError: a setting is wrong, or missing for this kind.
        """
        kind = section.names("kind", ("lines", "fixed", "between"), default=("lines",))[0]
        longest = section.integer("longest", low=1, high=1 << 20, default=LONGEST)
        if kind == "lines":
            settings = cls(kind, terminator=_mark(section, "terminator", "\n"), longest=longest)
        elif kind == "fixed":
            length = section.integer("length", low=1, high=longest)
            start = section.text("start", default="").encode("latin-1")
            settings = cls(kind, length=length, start=start)
        else:
            start, end = _mark(section, "start"), _mark(section, "end")
            settings = cls(kind, start=start, end=end, longest=longest)
        section.finish()
        return settings

    def make(self) -> Framing:
        """Return the framing, with nothing in it."""
        if self.kind == "fixed":
            return FixedLength(self.length, self.start)
        if self.kind == "between":
            return Between(self.start, self.end, self.longest)
        return Lines(self.terminator, self.longest)


def _mark(section: Section, key: str, default: str | None = None) -> bytes:
    text = section.text(key) if default is None else section.text(key, default=default)
    try:
        mark = text.encode("latin-1")
    except UnicodeEncodeError:
        raise ValueError(f"{section.source}: '{key}' is {text!r}; expected bytes") from None
    if not mark:
        raise Refusal(
            f"{section.source}: '{key}' is empty; expected at least one character",
            fault="malformed",
        )
    return mark
