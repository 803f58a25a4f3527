"""What the two sides send each other: every message type of the suite, filled at random.

Both sides make the same content from the same seed, so that each can tell what the other must have
sent. Only the public interface of generated messages is used.
"""

from __future__ import annotations

import random
import re
import struct
from importlib import import_module
from numbers import Integral
from pathlib import Path
from typing import Any

from stepdiag_ros.topics import TOPICS

_ROOT = Path(__file__).parents[2]
_OTHERS = (
    "action_msgs/msg/GoalStatusArray",
    "lifecycle_msgs/msg/TransitionEvent",
    "rcl_interfaces/msg/Log",
    "rcl_interfaces/msg/ParameterEvent",
    "std_msgs/msg/String",
)
COUNT = 20
"""Messages of each type; the first one is as its constructor leaves it."""
_WHOLE_NUMBERS = {
    f"{sign}int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if not sign else (0, 2**bits - 1)
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
_TEXTS = ("", "a", "ppp XYZ forward", "E↑ µm °C Ω — ü", "x" * 40)


def message_types() -> list[str]:
    """Return every message type of this package, of its topics, and some that ROS itself sends."""
    own = (f"stepdiag_ros/msg/{path.stem}" for path in (_ROOT / "msg").glob("*.msg"))
    return sorted({*own, *(topic.type_name for topic in TOPICS), *_OTHERS})


def load(type_name: str) -> Any:
    """Return the class of a type such as ``std_msgs/msg/String``.

    Raises:
        ImportError: there is none here; names the type.
    """
    package, kind, name = type_name.split("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError) as error:
        raise ImportError(f"{type_name} was not built here: {error}") from error


def samples(cls: Any, seed: int, count: int = COUNT) -> list[Any]:
    """Return messages of a class: an untouched one, and random ones."""
    source = random.Random(seed)
    return [cls(), *(filled(cls, source) for _ in range(count - 1))]


def three_different(cls: Any, seed: int) -> tuple[Any, Any, Any]:
    """Return three messages of a class with different content, the first one untouched."""
    source = random.Random(seed)
    first = second = third = cls()
    while content(second) == content(first):
        second = filled(cls, source)
    while content(third) in (content(first), content(second)):
        third = filled(cls, source)
    return first, second, third


def content(message: Any) -> Any:
    """Return all of a message, numbers to the last bit, so that it can be compared.

    Messages themselves compare loosely, and of one message Fast DDS makes different bytes each
    time: what it aligns numbers with is whatever was in memory.
    """
    if hasattr(message, "get_fields_and_field_types"):
        return [content(getattr(message, name)) for name in message.get_fields_and_field_types()]
    if isinstance(message, (str, bytes)):
        return message
    if hasattr(message, "__len__"):
        return [content(item) for item in message]
    return int(message) if isinstance(message, Integral) else struct.pack("<d", message)


def filled(cls: Any, source: random.Random) -> Any:
    """Return a message of a class with random content in every field."""
    message = cls()
    for name, kind in cls.get_fields_and_field_types().items():
        setattr(message, name, _value(kind, source))
    return message


def _value(kind: str, source: random.Random) -> Any:
    sequence = re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>", kind)
    if sequence:
        length = source.randrange(min(int(sequence[2] or 9), 9) + 1)
        return [_value(sequence[1], source) for _ in range(length)]
    array = re.fullmatch(r"(.+)\[(\d+)\]", kind)
    if array:
        return [_value(array[1], source) for _ in range(int(array[2]))]
    if "/" in kind:
        package, name = kind.split("/")
        return filled(load(f"{package}/msg/{name}"), source)
    if kind.startswith("string"):
        return source.choice(_TEXTS)
    if kind == "boolean":
        return source.random() < 0.5
    if kind == "octet":
        return bytes([source.randrange(256)])
    if kind in ("double", "float"):
        number = source.choice([0.0, -0.0, 1.5, float("inf"), source.gauss(0, 1), 1e-9])
        single: float = struct.unpack("f", struct.pack("f", number))[0]
        return number if kind == "double" else single
    low, high = _WHOLE_NUMBERS[kind]
    return source.choice([low, high, source.randint(low, high)])
