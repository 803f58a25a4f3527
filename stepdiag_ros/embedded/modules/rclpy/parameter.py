"""Parameters: names with values of one of ten types."""

from __future__ import annotations

from array import array
from enum import Enum
from typing import Any

from rcl_interfaces.msg import Parameter as _ParameterMsg
from rcl_interfaces.msg import ParameterType, ParameterValue

PARAMETER_SEPARATOR_STRING = "."

_FIELDS = {
    ParameterType.PARAMETER_BOOL: "bool_value",
    ParameterType.PARAMETER_INTEGER: "integer_value",
    ParameterType.PARAMETER_DOUBLE: "double_value",
    ParameterType.PARAMETER_STRING: "string_value",
    ParameterType.PARAMETER_BYTE_ARRAY: "byte_array_value",
    ParameterType.PARAMETER_BOOL_ARRAY: "bool_array_value",
    ParameterType.PARAMETER_INTEGER_ARRAY: "integer_array_value",
    ParameterType.PARAMETER_DOUBLE_ARRAY: "double_array_value",
    ParameterType.PARAMETER_STRING_ARRAY: "string_array_value",
}


class ParameterKind(Enum):
    """Type of a parameter; the numbers are those of ``ParameterType``."""

    NOT_SET = ParameterType.PARAMETER_NOT_SET
    BOOL = ParameterType.PARAMETER_BOOL
    INTEGER = ParameterType.PARAMETER_INTEGER
    DOUBLE = ParameterType.PARAMETER_DOUBLE
    STRING = ParameterType.PARAMETER_STRING
    BYTE_ARRAY = ParameterType.PARAMETER_BYTE_ARRAY
    BOOL_ARRAY = ParameterType.PARAMETER_BOOL_ARRAY
    INTEGER_ARRAY = ParameterType.PARAMETER_INTEGER_ARRAY
    DOUBLE_ARRAY = ParameterType.PARAMETER_DOUBLE_ARRAY
    STRING_ARRAY = ParameterType.PARAMETER_STRING_ARRAY

    @classmethod
    def from_parameter_value(cls, parameter_value: Any) -> ParameterKind:
        """Return the type of a Python value; an empty list counts as BYTE_ARRAY, as in rclpy.

        Raises:
            TypeError: No parameter can have this value.
        """
        if parameter_value is None:
            return cls.NOT_SET
        for kind, name in _SINGLES:
            if isinstance(parameter_value, kind):
                return cls[name]
        if isinstance(parameter_value, (list, tuple, array)):
            for kind, name in _LISTS:
                if all(isinstance(item, kind) for item in parameter_value):
                    return cls[name]
            raise TypeError(
                f"The given value is not a list of one of the allowed types '{parameter_value}'."
            )
        raise TypeError(f"The given value is not one of the allowed types '{parameter_value}'.")

    def check(self, parameter_value: Any) -> bool:
        """Return whether a value fits the type."""
        if self is ParameterKind.NOT_SET:
            return parameter_value is None
        for kind, name in _SINGLES:
            if self.name == name:
                return isinstance(parameter_value, kind)
        kind = next(kind for kind, name in _LISTS if name == self.name)
        return isinstance(parameter_value, (list, tuple, array)) and all(
            isinstance(item, kind) for item in parameter_value
        )


#: Python type of each single value, in the order in which they are tried (a bool is an int too).
_SINGLES: list[tuple[type, str]] = [
    (bool, "BOOL"),
    (int, "INTEGER"),
    (float, "DOUBLE"),
    (str, "STRING"),
]
_LISTS: list[tuple[type, str]] = [
    (bytes, "BYTE_ARRAY"),
    (bool, "BOOL_ARRAY"),
    (int, "INTEGER_ARRAY"),
    (float, "DOUBLE_ARRAY"),
    (str, "STRING_ARRAY"),
]


class Parameter:
    """A parameter: name, type and value.

    Args:
        name: The name.
        type_: The type; that of the value if ``None``.
        value: The value.

    Raises:
        TypeError: No type fits the value.
        ValueError: The value does not fit the type.
    """

    Type = ParameterKind

    def __init__(self, name: str, type_: ParameterKind | None = None, value: Any = None) -> None:
        if type_ is None:
            type_ = ParameterKind.from_parameter_value(value)
        if not isinstance(type_, ParameterKind):
            raise TypeError(f"type must be an instance of '{ParameterKind!r}'")
        if not type_.check(value):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self._type = type_
        self._name = name
        self._value = value

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> Parameter:
        """Return the parameter of a message."""
        value = parameter_value_to_python(param_msg.value)
        return cls(param_msg.name, ParameterKind(param_msg.value.type), value)

    @property
    def name(self) -> str:
        """The name."""
        return self._name

    @property
    def type_(self) -> ParameterKind:
        """The type."""
        return self._type

    @property
    def value(self) -> Any:
        """The value."""
        return self._value

    def get_parameter_value(self) -> Any:
        """Return the value as a message."""
        message = ParameterValue(type=self._type.value)
        if self._type is not ParameterKind.NOT_SET:
            value = list(self._value) if isinstance(self._value, tuple) else self._value
            setattr(message, _FIELDS[self._type.value], value)
        return message

    def to_parameter_msg(self) -> Any:
        """Return the parameter as a message."""
        return _ParameterMsg(name=self._name, value=self.get_parameter_value())

    def __repr__(self) -> str:
        return f"Parameter(name={self._name!r}, type_={self._type}, value={self._value!r})"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Parameter):
            return NotImplemented
        return (self._name, self._type, self._value) == (other._name, other._type, other._value)

    __hash__ = None  # type: ignore[assignment]


def get_parameter_value(string_value: str) -> Any:
    """Return a parameter value as a message, its type guessed from YAML text."""
    import yaml

    try:
        value = yaml.safe_load(string_value)
        kind = ParameterKind.from_parameter_value(value)
    except (yaml.YAMLError, TypeError):
        value, kind = string_value, ParameterKind.STRING
    if value is None:
        value, kind = string_value, ParameterKind.STRING
    return Parameter("", kind, value).get_parameter_value()


def parameter_value_to_python(parameter_value: Any) -> Any:
    """Return the Python value of a message; sequences become lists.

    Raises:
        RuntimeError: Its type is unknown.
    """
    kind = parameter_value.type
    if kind == ParameterType.PARAMETER_NOT_SET:
        return None
    if kind not in _FIELDS:
        raise RuntimeError(f"unexpected parameter type {kind}")
    value = getattr(parameter_value, _FIELDS[kind])
    return list(value) if isinstance(value, (list, array)) else value
