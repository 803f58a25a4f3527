"""YAML as ROS reads it, in parameter files and on command lines.

ROS has rules of its own for what an unquoted scalar is: ``1e3`` is a number, ``2026-01-02`` and
``1:30`` are texts, ``y`` is true, ``~`` is a text. See ``get_value`` in rcl_yaml_param_parser.
"""

from __future__ import annotations

import math
import re
from typing import Any

import yaml

_TRUE = frozenset(("Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"))
_FALSE = frozenset(("N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"))
_INTEGER = re.compile(r"[+-]?(?:0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)")
_LARGEST_INTEGER = 2**63 - 1
_DOUBLE = re.compile(
    r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|inf|infinity|nan)", re.IGNORECASE
)
_HEXADECIMAL = re.compile(
    r"[+-]?0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][+-]?[0-9]+)?"
)
_DOTTED = re.compile(r"([+-]?)\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_SMALLEST_NORMAL = 2.2250738585072014e-308
_PLAIN = "plain"
"""Tag of a scalar without quotes and without a tag of its own."""


class _Loader(yaml.BaseLoader):
    """Leaves it open what a plain scalar is."""

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        if kind is yaml.ScalarNode and implicit[0]:
            return _PLAIN
        return super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]


def read(text: str) -> Any:
    """Return what a YAML text holds: single values, lists of them, dicts with names as keys.

    Returns:
        None for an empty text.

    Raises:
        ValueError: not YAML, or a value is missing; says in which line.
    """
    try:
        node = yaml.compose(text, Loader=_Loader)
        return None if node is None or _is_empty(node) else _value(node)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f"line {mark.line + 1}: " if mark is not None else ""
        raise ValueError(f"{line}{error.problem or error.context}") from None
    except yaml.YAMLError as error:
        raise ValueError(str(getattr(error, "reason", error))) from None


def plain_scalar(text: str) -> bool | int | float | str:
    """Return what an unquoted scalar is: a truth value, an integer, a double, or else a text."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if _INTEGER.fullmatch(text):
        digits = text.lstrip("+-")
        octal = digits.startswith("0") and digits.isdigit() and digits != "0"
        integer = int(text, 8) if octal else int(text, 0)
        if -_LARGEST_INTEGER - 1 <= integer <= _LARGEST_INTEGER:
            return integer
    if dotted := _DOTTED.fullmatch(text):
        sign, infinite, _ = dotted.groups()
        return float(f"{sign}inf") if infinite else math.nan
    if _DOUBLE.fullmatch(text):
        return _unless_beyond(text, float(text))
    if _HEXADECIMAL.fullmatch(text):
        try:
            return _unless_beyond(text, float.fromhex(text))
        except OverflowError:
            return text
    return text


def _unless_beyond(text: str, value: float) -> float | str:
    """Return the text where the number is too large or too small for a double, as ROS does."""
    if math.isinf(value) and "inf" not in text.lower():
        return text
    nothing = not re.search("[1-9]", text.lower().partition("e")[0])
    if abs(value) < _SMALLEST_NORMAL and not (value == 0.0 and nothing):
        return text
    return value


def _is_empty(node: yaml.Node) -> bool:
    return isinstance(node, yaml.ScalarNode) and node.tag == _PLAIN and node.value == ""


def _value(node: yaml.Node) -> Any:
    if _is_empty(node):
        raise yaml.MarkedYAMLError(problem="there is no value", problem_mark=node.start_mark)
    if isinstance(node, yaml.MappingNode):
        return {str(key.value): _value(value) for key, value in node.value}
    if isinstance(node, yaml.SequenceNode):
        return [_value(item) for item in node.value]
    assert isinstance(node, yaml.ScalarNode)
    quoted = node.style in ("'", '"') or node.tag == "tag:yaml.org,2002:str"
    return str(node.value) if quoted else plain_scalar(node.value)
