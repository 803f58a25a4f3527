"""Many messages of one type at once: their numbers as columns.

Decoding each message alone takes most of the time of reading a bag. Messages that hold
nothing but numbers and the same texts have their numbers at the same places, so that an array over
their bytes is all the decoding that they need.
"""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Nodetype

from stepdiag_ros.bags.types import CDR_HEADER, DTYPES, MessageTypes

Column = npt.NDArray[Any]
"""Values of one field, one for each message, shape (n,)."""


def columns_of(
    types: MessageTypes, type_name: str, messages: Sequence[bytes]
) -> dict[str, Column] | None:
    """Return the numbers of messages as ``MessageTypes.decode`` would have them.

    Args:
        types: that the messages are written in.
        type_name: full type name.
        messages: serialised (CDR with its encapsulation), at least one, of which the first can be
            decoded.

    Returns:
        Name of each number (``header.stamp.sec``) → its values; None unless the messages hold only
        numbers and texts, and all of them the same texts in the same byte order.
    """
    form = _Form(types, messages[0])
    if not form.take(type_name) or any(len(one) != len(messages[0]) for one in messages):
        return None
    table = np.frombuffer(b"".join(messages), form.dtype())
    if any((table[text] != table[text][0]).any() for text in form.texts):
        return None
    return {name: table[name] for name in form.numbers}


class _Form:
    """Where numbers and texts stand in the bytes of messages that are like one of them.

    Args:
        types: that it is written in.
        example: the message.

    Attributes:
        numbers: names of the numbers.
        texts: names of what must be the same in all messages: texts and their lengths, and the
            encapsulation, which states the byte order.
    """

    def __init__(self, types: MessageTypes, example: bytes) -> None:
        self._types, self._example = types, example
        self._order = "<" if example[1] else ">"
        self._end = CDR_HEADER
        self._places: dict[str, tuple[Any, int]] = {"encapsulation": (("u1", 2), 0)}
        self.numbers: list[str] = []
        self.texts = ["encapsulation"]

    def take(self, type_name: str, prefix: str = "") -> bool:
        """Find the fields of a type; say whether they are only numbers and texts."""
        for field, (node, content) in self._types.fields(type_name):
            name = f"{prefix}{field}"
            if node == Nodetype.NAME:
                if not self.take(content, f"{name}."):
                    return False
            elif node != Nodetype.BASE:
                return False
            elif content[0] == "string":
                begin = self._put(f"{name}, length", ("u1", 4), 4, 4)
                (length,) = struct.unpack_from(f"{self._order}I", self._example, begin)
                self._put(name, ("u1", length), length, 1)
                self.texts += [f"{name}, length", name]
            else:
                kind = np.dtype(DTYPES.get(content[0], content[0])).newbyteorder(self._order)
                self._put(name, kind, kind.itemsize, kind.itemsize)
                self.numbers.append(name)
        return True

    def _put(self, name: str, kind: Any, size: int, alignment: int) -> int:
        # CDR counts alignment from behind the encapsulation.
        begin = self._end + (CDR_HEADER - self._end) % alignment
        self._places[name] = kind, begin
        self._end = begin + size
        return begin

    def dtype(self) -> "np.dtype[np.void]":
        """Return the form of a message as a type of array elements."""
        kinds, begins = zip(*self._places.values(), strict=True)
        form: Any = {"names": list(self._places), "formats": kinds, "offsets": begins}
        found: np.dtype[np.void] = np.dtype(form | {"itemsize": len(self._example)})
        return found
