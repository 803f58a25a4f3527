"""Data classes whose fields a message has under the same names: carried over by their types.

What a message has under another name, or in another form, is listed beside the data class.
"""

from array import array
from collections.abc import Callable, Iterable
from typing import Any, Protocol, get_type_hints

import numpy as np

from stepdiag_ros.messages.types import NewMessage, new_message
from stepdiag_ros.metrology.frames import MACHINE
from stepdiag_ros.metrology.measurement import Nanoseconds
from stepdiag_ros.metrology.units import NANOSECONDS

_STAMPED = 2**31 * NANOSECONDS


def to_nanoseconds(stamp: Any) -> int:
    """Return a ``builtin_interfaces/Time`` as whole nanoseconds."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def set_stamp(stamp: Any, nanoseconds: int) -> None:
    """Write whole nanoseconds into a ``builtin_interfaces/Time``.

    Raises:
        ValueError: it is beyond the times that a stamp can hold (1901 to 2038).
    """
    if not abs(nanoseconds) < _STAMPED:
        raise ValueError(f"a time of {nanoseconds * 1e-9:g} s does not fit into a stamp")
    stamp.sec, stamp.nanosec = divmod(int(nanoseconds), NANOSECONDS)


def set_header(message: Any, time: int, frame: str = MACHINE) -> None:
    """Write time (ns) and frame into a message's header."""
    set_stamp(message.header.stamp, time)
    message.header.frame_id = frame


def triple(values: Iterable[Any]) -> tuple[float, float, float]:
    """Return the three numbers of a field."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def doubles(values: Any) -> "array[float]":
    """Return numbers of any shape as a float64[] field takes them, one after another."""
    # array.array is the one form that rclpy's setters, the embedded client and a bag all accept for
    # float64[]; it also makes sure that whole numbers become doubles.
    return array("d", np.asarray(values, dtype=np.float64).ravel().tolist())


class Part(Protocol):
    """Reads one value from the fields of a message, and writes it into them."""

    def read(self, message: Any) -> Any:
        """Return the value."""

    def write(self, message: Any, value: Any) -> None:
        """Write the value."""


class Header:
    """The time of a message in its header; written with the frame of the machine."""

    def read(self, message: Any) -> int:
        """Return the time, ns."""
        return to_nanoseconds(message.header.stamp)

    def write(self, message: Any, value: int) -> None:
        """Write the time, ns, and the frame."""
        set_header(message, value)


class Stamp:
    """A time in a field of its own; ``name`` is that of the field."""

    def __init__(self, name: str) -> None:
        self._name = name

    def read(self, message: Any) -> int:
        """Return the time, ns."""
        return to_nanoseconds(getattr(message, self._name))

    def write(self, message: Any, value: int) -> None:
        """Write the time, ns."""
        set_stamp(getattr(message, self._name), value)


class Field:
    """A number, a text, a place or several texts in a field of its own.

    Args:
        name: of the field.
        kind: makes the value.
        default: the value where a message lacks the field, if it may.
    """

    def __init__(self, name: str, kind: Callable[[Any], Any], *default: Any) -> None:
        self._name, self._kind, self._default = name, kind, default

    def read(self, message: Any) -> Any:
        """Return the value."""
        return self._kind(getattr(message, self._name, *self._default))

    def write(self, message: Any, value: Any) -> None:
        """Write the value."""
        made = self._kind(value)
        setattr(message, self._name, list(made) if isinstance(made, tuple) else made)


class Doubles:
    """Any number of numbers; ``name`` is that of the field."""

    def __init__(self, name: str) -> None:
        self._name = name

    def read(self, message: Any) -> tuple[float, ...]:
        """Return the numbers."""
        return tuple(float(value) for value in getattr(message, self._name))

    def write(self, message: Any, value: Iterable[float]) -> None:
        """Write the numbers."""
        setattr(message, self._name, doubles(value))


def texts(values: Iterable[Any]) -> tuple[str, ...]:
    """Return the texts of a field."""
    return tuple(str(value) for value in values)


_KINDS: dict[Any, Callable[[Any], Any]] = {
    **{kind: kind for kind in (bool, int, float, str)},
    tuple[float, float, float]: triple,
    tuple[str, ...]: texts,
}


class Carried:
    """All fields of a data class in the fields of a message.

    A field that has a default may be missing in messages of older bags.

    Args:
        kind: the data class or named tuple.
        suffix: of the message's fields behind the names of the data class.
        parts: of its fields those that are not a number, text, place or time of the same name.
    """

    def __init__(self, kind: type, suffix: str = "", **parts: "Part | Messages") -> None:
        self._kind = kind
        exact = get_type_hints(kind, include_extras=True)
        self._parts: dict[str, Part | Messages] = {}
        for name, plain in get_type_hints(kind).items():
            if name in parts:
                self._parts[name] = parts[name]
            elif exact[name] == Nanoseconds:
                self._parts[name] = Stamp(name + suffix)
            elif plain == tuple[float, ...]:
                self._parts[name] = Doubles(name + suffix)
            else:
                self._parts[name] = Field(name + suffix, _KINDS[plain], *_default(kind, name))

    def read(self, message: Any) -> Any:
        """Return the data class of a message."""
        return self._kind(**{name: part.read(message) for name, part in self._parts.items()})

    def write(self, message: Any, value: Any, new: NewMessage = new_message) -> None:
        """Write a data class into a message; ``new`` makes messages that are parts of it."""
        for name, part in self._parts.items():
            if isinstance(part, Messages):
                part.write(message, getattr(value, name), new)
            else:
                part.write(message, getattr(value, name))


class Messages:
    """A field with any number of messages of one type.

    Args:
        name: of the field.
        type_name: of the messages.
        carried: what each of them carries.
        default: the messages where a message lacks the field, if it may.
    """

    def __init__(self, name: str, type_name: str, carried: Carried, *default: Any) -> None:
        self._name, self._type_name, self._carried = name, type_name, carried
        self._default = default

    def read(self, message: Any) -> tuple[Any, ...]:
        """Return the data class of each message."""
        return tuple(
            self._carried.read(one) for one in getattr(message, self._name, *self._default)
        )

    def write(self, message: Any, value: Iterable[Any], new: NewMessage) -> None:
        """Write a message for each data class."""
        made = []
        for one in value:
            part = new(self._type_name)
            self._carried.write(part, one)
            made.append(part)
        setattr(message, self._name, made)


def defaults_of(kind: type) -> dict[str, Any]:
    """Return the fields of a data class or named tuple that have a default, with these."""
    named: dict[str, Any] = getattr(kind, "_field_defaults", {})
    return named or {name: vars(kind)[name] for name in get_type_hints(kind) if name in vars(kind)}


def _default(kind: type, name: str) -> list[Any]:
    found = defaults_of(kind)
    return [found[name]] if name in found else []
