"""What can be read at the head of a message's CDR bytes without decoding all of it.

A recorder takes many thousand readings a second as bytes; decoding each would keep it from it.
"""

import struct
from typing import NamedTuple

_ENCAPSULATION = 4
"""Bytes in front of the body; the second says which byte order it is in."""
_STAMP = {"<": struct.Struct("<iII"), ">": struct.Struct(">iII")}
_LENGTH = {"<": struct.Struct("<I"), ">": struct.Struct(">I")}
_IN_FRONT_OF_SAMPLES = 72
"""Bytes of an InterferometerSamples from its sequence number to its samples."""
_NUMBER = {"<": struct.Struct("<Q"), ">": struct.Struct(">Q")}


class Head(NamedTuple):
    """What stands first in a message that begins with a header and a sequence number.

    Attributes:
        time: of measurement, ns.
        sequence: its number.
    """

    time: int
    sequence: int


class BlockHead(NamedTuple):
    """What stands first in an InterferometerSamples.

    Attributes:
        time: of measurement of the first sample, ns.
        sequence: its number.
        samples: how many there are.
    """

    time: int
    sequence: int
    samples: int


def stamp_of(cdr: bytes) -> int:
    """Return the time in ns of the std_msgs/Header that a message begins with.

    Raises:
        ValueError: the bytes are not a message of this type.
    """
    seconds, nanoseconds, _ = _read(_STAMP[_order(cdr)], cdr, _ENCAPSULATION)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def head_of(cdr: bytes) -> Head:
    """Return header time and sequence number of an InterferometerReading.

    Raises:
        ValueError: the bytes are not a message of this type.
    """
    order = _order(cdr)
    (sequence,) = _read(_NUMBER[order], cdr, _behind_header(cdr, order))
    return Head(stamp_of(cdr), int(sequence))


def block_head_of(cdr: bytes) -> BlockHead:
    """Return header time, first sequence number and number of an InterferometerSamples.

    Raises:
        ValueError: the bytes are not a message of this type.
    """
    order = _order(cdr)
    begin = _behind_header(cdr, order)
    (sequence,) = _read(_NUMBER[order], cdr, begin)
    (samples,) = _read(_LENGTH[order], cdr, begin + _IN_FRONT_OF_SAMPLES)
    return BlockHead(stamp_of(cdr), int(sequence), int(samples))


def _behind_header(cdr: bytes, order: str) -> int:
    """Return where a number of eight bytes stands that follows the header."""
    stamp = _STAMP[order]
    _, _, length = _read(stamp, cdr, _ENCAPSULATION)
    # The frame's name ends anywhere; a number of eight bytes begins at a multiple of eight.
    return _ENCAPSULATION + int(stamp.size + length + 7) // 8 * 8


def _read(layout: struct.Struct, cdr: bytes, place: int) -> tuple[int, ...]:
    try:
        return layout.unpack_from(cdr, place)
    except struct.error as error:
        raise ValueError(f"{len(cdr)} bytes are not a message of this type: {error}") from None


def _order(cdr: bytes) -> str:
    if len(cdr) < _ENCAPSULATION:
        raise ValueError("no CDR encapsulation")
    return "<" if cdr[1] & 1 else ">"
