"""Data classes whose fields a message has under the same names: carried over by their types.

What a message has under another name, or in another form, is listed beside the data class.
"""

from collections.abc import Callable, Iterable
from typing import Any, Protocol, get_type_hints

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


class _Field:
    """A number, a text or a place; ``default`` holds the value where a message lacks the field."""

    def __init__(self, name: str, kind: Callable[[Any], Any], default: tuple[Any, ...]) -> None:
        self._name, self._kind, self._default = name, kind, default

    def read(self, message: Any) -> Any:
        return self._kind(getattr(message, self._name, *self._default))

    def write(self, message: Any, value: Any) -> None:
        made = self._kind(value)
        setattr(message, self._name, list(made) if isinstance(made, tuple) else made)


_KINDS: dict[Any, Callable[[Any], Any]] = {
    **{kind: kind for kind in (bool, int, float, str)},
    tuple[float, float, float]: triple,
}


class Carried:
    """All fields of a data class in the fields of a message.

    A field that has a default may be missing in messages of older bags.

    Args:
        kind: the data class or named tuple.
        parts: of its fields those that are not a number, text, place or time of the same name.
    """

    def __init__(self, kind: type, **parts: Part) -> None:
        self._kind = kind
        exact = get_type_hints(kind, include_extras=True)
        self._parts: dict[str, Part] = {}
        for name, plain in get_type_hints(kind).items():
            if name in parts:
                self._parts[name] = parts[name]
            elif exact[name] == Nanoseconds:
                self._parts[name] = Stamp(name)
            else:
                self._parts[name] = _Field(name, _KINDS[plain], tuple(_default(kind, name)))

    def read(self, message: Any) -> Any:
        """Return the data class of a message."""
        return self._kind(**{name: part.read(message) for name, part in self._parts.items()})

    def write(self, message: Any, value: Any) -> None:
        """Write a data class into a message."""
        for name, part in self._parts.items():
            part.write(message, getattr(value, name))


def defaults_of(kind: type) -> dict[str, Any]:
    """Return the fields of a data class or named tuple that have a default, with these."""
    named: dict[str, Any] = getattr(kind, "_field_defaults", {})
    return named or {name: vars(kind)[name] for name in get_type_hints(kind) if name in vars(kind)}


def _default(kind: type, name: str) -> list[Any]:
    found = defaults_of(kind)
    return [found[name]] if name in found else []
