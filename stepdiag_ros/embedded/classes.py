"""Message classes: made from definitions, with the behaviour of the classes ROS 2 generates.

Constructors take keywords only and give every field its default; a value of the wrong type or out
of range raises ``AssertionError`` with a sentence that names the field, as rclpy's classes do when
their checks are on. Primitive sequences are ``array.array``, fixed numeric arrays are
``numpy.ndarray``, and a ``byte`` is ``bytes`` of length one.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Sequence, Set
from operator import attrgetter
from typing import Any

from .definitions import PRIMITIVES, Definition, Field, FieldType

_FLOAT32_MAX = 3.402823466e38
_INTEGERS = {
    name: (-(2 ** (8 * size - 1)), 2 ** (8 * size - 1) - 1)
    if name.startswith("int")
    else (0, 2 ** (8 * size) - 1)
    for name, (_, size) in PRIMITIVES.items()
    if "int" in name or name == "char"
}

Check = Callable[[Any], Any]


def make_class(
    definition: Definition, message_class: Callable[[str], type], module: str, name: str
) -> type:
    """Return the Python class of a message.

    Args:
        definition: The message.
        message_class: Gives the class of a nested message by its full name.
        module: Value of the class's ``__module__``.
        name: Name of the class.
    """
    fields = definition.fields
    namespace: dict[str, Any] = {
        "__slots__": tuple(f"_{field.name}" for field in fields),
        "__module__": module,
        "__doc__": f"Message class '{name}' ({definition.name}).",
        "_DEFINITION": definition,
        "__hash__": None,
        **definition.constants,
    }
    cls = type(name, (_Message,), namespace)
    plan: list[tuple[str, Callable[[Any, Any], None], Callable[[], Any]]] = []
    for field in fields:
        store = cls.__dict__[f"_{field.name}"].__set__
        check = _make_check(field, message_class)
        setattr(cls, field.name, property(attrgetter(f"_{field.name}"), _setter(store, check)))
        plan.append((field.name, store, _make_default(field, message_class)))
    cls._PLAN = tuple(plan)  # type: ignore[attr-defined]
    cls._NAMES = frozenset(field.name for field in fields)  # type: ignore[attr-defined]
    return cls


class _Message:
    """What all message classes share."""

    __slots__ = ()
    _DEFINITION: Definition
    _PLAN: tuple[tuple[str, Callable[[Any, Any], None], Callable[[], Any]], ...]
    _NAMES: frozenset[str]

    def __init__(self, **kwargs: Any) -> None:
        # rclpy (Jazzy) lets callers choose whether to check; here checks are always on.
        kwargs.pop("check_fields", None)
        for name, store, default in self._PLAN:
            if name in kwargs:
                setattr(self, name, kwargs[name])
            else:
                store(self, default())
        if not kwargs.keys() <= self._NAMES:
            wrong = ", ".join(sorted(kwargs.keys() - self._NAMES))
            raise AssertionError(
                "Invalid arguments passed to constructor:"
                f" {type(self).__name__} has no field {wrong}"
            )

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Return the type of each field, by name, as text."""
        return {field.name: field.type.describe() for field in cls._DEFINITION.fields}

    def __repr__(self) -> str:
        module = type(self).__module__
        values = ", ".join(f"{name}={_show(getattr(self, name))}" for name, _, _ in self._PLAN)
        return f"{module}.{type(self).__qualname__}({values})"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return False
        return all(_equal(getattr(self, name), getattr(other, name)) for name, _, _ in self._PLAN)

    __hash__ = None  # type: ignore[assignment]

    def __copy__(self) -> _Message:
        copied = type(self).__new__(type(self))
        for name, store, _ in self._PLAN:
            store(copied, getattr(self, name))
        return copied

    def __reduce__(self) -> Any:
        return _rebuild, (type(self), {name: getattr(self, name) for name, _, _ in self._PLAN})


def _rebuild(cls: type, values: dict[str, Any]) -> Any:
    return cls(**values)


def _show(value: Any) -> str:
    if isinstance(value, array):
        return repr(value.tolist())
    return repr(value)


def _equal(one: Any, two: Any) -> bool:
    result = one == two
    return bool(result.all()) if hasattr(result, "all") else bool(result)


def _setter(store: Callable[[Any, Any], None], check: Check) -> Callable[[Any, Any], None]:
    def set_value(self: Any, value: Any) -> None:
        store(self, check(value))

    return set_value


def _make_default(field: Field, message_class: Callable[[str], type]) -> Callable[[], Any]:
    kind, default = field.type, field.default
    code = PRIMITIVES[kind.name][0] if kind.is_primitive else ""
    listed = kind.name in ("bool", "byte") or not kind.is_primitive
    if not kind.array:
        if kind.is_message:
            return message_class(kind.name)
        value = _zero(kind) if default is None else default
        return lambda: value
    if kind.array == "fixed" and not listed:
        import numpy

        values = numpy.array(default or [0] * kind.size, dtype=code)
        return values.copy
    if listed:
        if kind.is_message and kind.array == "fixed":
            nested = message_class(kind.name)
            return lambda: [nested() for _ in range(kind.size)]
        items = default or ([_zero(kind)] * kind.size if kind.array == "fixed" else [])
        return lambda: list(items)
    numbers = array(code, default or [])
    return lambda: array(code, numbers)


def _zero(kind: FieldType) -> Any:
    if kind.name == "string":
        return ""
    if kind.name == "byte":
        return b"\0"
    if kind.name == "bool":
        return False
    return 0.0 if kind.name.startswith("float") else 0


def _make_check(field: Field, message_class: Callable[[str], type]) -> Check:
    if not field.type.array:
        return _single_check(field.name, field.type, message_class)
    return _array_check(field.name, field.type, message_class)


def _single_check(name: str, kind: FieldType, message_class: Callable[[str], type]) -> Check:
    if kind.is_message:
        return _message_check(name, message_class(kind.name))
    if kind.name == "string":
        return _text_check(name, kind.text_bound)
    if kind.name == "byte":
        return _byte_check(name)
    if kind.name == "bool":
        return _bool_check(name)
    if kind.name.startswith("float"):
        return _float_check(name, kind.name == "float32")
    return _integer_check(name, *_INTEGERS[kind.name])


def _message_check(name: str, nested: type) -> Check:
    def check(value: Any) -> Any:
        if not isinstance(value, nested):
            raise _wrong(name, f"a sub message of type '{nested.__name__}'", value)
        return value

    return check


def _text_check(name: str, bound: int) -> Check:
    def check(value: Any) -> Any:
        if not isinstance(value, str):
            raise _wrong(name, "of type 'str'", value)
        if bound and len(value.encode()) > bound:
            raise AssertionError(f"The '{name}' field must be a string of at most {bound} bytes")
        return value

    return check


def _byte_check(name: str) -> Check:
    def check(value: Any) -> Any:
        if not isinstance(value, (bytes, bytearray)) or len(value) != 1:
            raise _wrong(name, "of type 'bytes' with length 1", value)
        return bytes(value)

    return check


def _bool_check(name: str) -> Check:
    def check(value: Any) -> Any:
        if not isinstance(value, bool):
            raise _wrong(name, "of type 'bool'", value)
        return value

    return check


def _float_check(name: str, narrow: bool) -> Check:
    def check(value: Any) -> Any:
        if not isinstance(value, float):
            raise _wrong(name, "of type 'float'", value)
        if narrow and math.isfinite(value) and abs(value) > _FLOAT32_MAX:
            raise AssertionError(f"The '{name}' field must be within the range of a float32")
        return value

    return check


def _integer_check(name: str, low: int, high: int) -> Check:
    def check(value: Any) -> Any:
        if not isinstance(value, int):
            raise _wrong(name, "of type 'int'", value)
        if not low <= value <= high:
            raise AssertionError(
                f"The '{name}' field must be an integer in [{low}, {high}], but it is {value}"
            )
        return value

    return check


def _array_check(name: str, kind: FieldType, message_class: Callable[[str], type]) -> Check:
    single = _single_check(name, FieldType(kind.name, text_bound=kind.text_bound), message_class)
    code = PRIMITIVES[kind.name][0] if kind.is_primitive else ""
    listed = kind.name in ("bool", "byte") or not kind.is_primitive
    fixed = kind.array == "fixed"

    def check_size(size: int) -> None:
        if fixed and size != kind.size:
            raise AssertionError(f"The '{name}' field must have {kind.size} elements, not {size}")
        if kind.array == "bounded" and size > kind.size:
            raise AssertionError(f"The '{name}' field must have at most {kind.size} elements")

    def check(value: Any) -> Any:
        if isinstance(value, array) and not listed and not fixed:
            if value.typecode != code:
                raise AssertionError(
                    f"The '{name}' field must be an array.array with the type code '{code}',"
                    f" not '{value.typecode}'"
                )
            check_size(len(value))
            return value
        dtype = getattr(value, "dtype", None)
        if dtype is not None:
            value = _from_numpy(name, value, dtype, code if not listed else "", fixed)
            check_size(len(value))
            if not isinstance(value, list):
                return value
        if isinstance(value, (str, bytes, bytearray)) and kind.name != "uint8":
            raise _wrong(name, f"a sequence of '{kind.name}'", value)
        if not isinstance(value, (Sequence, Set, array)):
            raise _wrong(name, f"a sequence of '{kind.name}'", value)
        values = [single(item) for item in value]
        check_size(len(values))
        if listed:
            return values
        if not fixed:
            return array(code, values)
        import numpy

        return numpy.array(values, dtype=code)

    return check


def _from_numpy(name: str, value: Any, dtype: Any, code: str, fixed: bool) -> Any:
    """Take a numpy array: refuse what would change the numbers, convert what cannot."""
    if value.ndim != 1:
        raise AssertionError(f"The '{name}' field must be a flat sequence; use reshape(-1) first")
    if not code:
        return value.tolist()
    import numpy

    wanted = numpy.dtype(code)
    if wanted.kind != dtype.kind and not (wanted.kind in "iu" and dtype.kind in "iu"):
        raise AssertionError(
            f"The '{name}' field must hold numbers of type {wanted}, not {dtype};"
            f" use .astype(numpy.{wanted}) to convert them"
        )
    if dtype != wanted:
        if not numpy.can_cast(dtype, wanted, "same_kind") or dtype.kind in "iu":
            return value.tolist()
        value = value.astype(wanted)
    if fixed:
        return value
    numbers = array(code)
    numbers.frombytes(value.tobytes())
    return numbers


def _wrong(name: str, wanted: str, value: Any) -> AssertionError:
    return AssertionError(
        f"The '{name}' field must be {wanted}, but it is a {type(value).__name__}: {value!r:.60}"
    )
