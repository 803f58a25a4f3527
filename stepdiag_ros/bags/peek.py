"""What can be read at the head of a message's CDR bytes without decoding all of it.

A recorder takes many thousand readings a second as bytes; decoding each would keep it from it.
"""

import struct
from typing import NamedTuple

_ENCAPSULATION = 4
"""Bytes in front of the body; the second says which byte order it is in."""
_STAMP = {"<": struct.Struct("<iII"), ">": struct.Struct(">iII")}
_NUMBER = {"<": struct.Struct("<Q"), ">": struct.Struct(">Q")}


class Head(NamedTuple):
    """What stands first in a message that begins with a header and a sequence number.

    Attributes:
        time: of measurement, ns.
        sequence: its number.
    """

    time: int
    sequence: int


def stamp_of(cdr: bytes) -> int:
    """Return the time in ns of the std_msgs/Header that a message begins with.

    Raises:
        struct.error: the bytes are no such message.
    """
    seconds, nanoseconds, _ = _STAMP[_order(cdr)].unpack_from(cdr, _ENCAPSULATION)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def head_of(cdr: bytes) -> Head:
    """Return header time and sequence number of an InterferometerReading.

    Raises:
        struct.error: the bytes are no such message.
    """
    order = _order(cdr)
    stamp = _STAMP[order]
    seconds, nanoseconds, length = stamp.unpack_from(cdr, _ENCAPSULATION)
    # The frame's name ends anywhere; a number of eight bytes begins at a multiple of eight.
    begin = (stamp.size + length + 7) // 8 * 8
    (sequence,) = _NUMBER[order].unpack_from(cdr, _ENCAPSULATION + begin)
    return Head(int(seconds) * 1_000_000_000 + int(nanoseconds), int(sequence))


def _order(cdr: bytes) -> str:
    if len(cdr) < _ENCAPSULATION:
        raise struct.error("no CDR encapsulation")
    return "<" if cdr[1] & 1 else ">"
