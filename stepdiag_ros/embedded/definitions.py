"""Interface definitions: parse ``.msg``, ``.srv`` and ``.action`` text into plain data.

The grammar is the one of the ROS 2 interface definition documents; ``wstring`` is refused because
no message of this package's world uses it.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from typing import Any

#: Struct code and size in bytes of every primitive of fixed size.
PRIMITIVES: dict[str, tuple[str, int]] = {
    "bool": ("?", 1),
    "byte": ("B", 1),
    "char": ("B", 1),
    "int8": ("b", 1),
    "uint8": ("B", 1),
    "int16": ("h", 2),
    "uint16": ("H", 2),
    "int32": ("i", 4),
    "uint32": ("I", 4),
    "int64": ("q", 8),
    "uint64": ("Q", 8),
    "float32": ("f", 4),
    "float64": ("d", 8),
}

#: Member that an empty message gets, because a DDS structure cannot be empty.
DUMMY_MEMBER = "structure_needs_at_least_one_member"

_TYPE = re.compile(
    r"^(?P<base>[A-Za-z][A-Za-z0-9_/]*)(<=(?P<text>\d+))?(?P<array>\[(?P<most><=)?(?P<size>\d*)\])?$"
)
_CONSTANT = re.compile(r"^(?P<type>\S+)\s+(?P<name>[A-Z][A-Z0-9_]*)\s*=\s*(?P<value>.*)$")
_FIELD = re.compile(r"^(?P<type>\S+)\s+(?P<name>[a-z][a-z0-9_]*)(\s+(?P<default>\S.*))?$")


class DefinitionError(ValueError):
    """An interface text cannot be understood; the message says which line and why."""


@dataclass(frozen=True)
class FieldType:
    """Type of one field.

    ``name`` is a primitive, ``string``, or a full message name (``std_msgs/msg/Header``).
    ``array`` is ``""`` (a single value), ``"fixed"``, ``"bounded"`` or ``"unbounded"``; ``size`` is
    the number of elements (or the largest one), ``text_bound`` the longest string in bytes (0: no
    limit).
    """

    name: str
    array: str = ""
    size: int = 0
    text_bound: int = 0

    @property
    def is_primitive(self) -> bool:
        """Whether one element has a fixed size and no structure."""
        return self.name in PRIMITIVES

    @property
    def is_message(self) -> bool:
        """Whether one element is itself a message."""
        return "/" in self.name

    def describe(self) -> str:
        """Return the type as rclpy writes it in ``get_fields_and_field_types``."""
        base = {"float64": "double", "float32": "float", "bool": "boolean", "byte": "octet"}.get(
            self.name, re.sub("/(msg|srv|action)/", "/", self.name)
        )
        if self.name == "char":
            base = "uint8"
        if self.text_bound:
            base = f"string<{self.text_bound}>"
        if self.array == "fixed":
            return f"{base}[{self.size}]"
        if self.array == "bounded":
            return f"sequence<{base}, {self.size}>"
        return f"sequence<{base}>" if self.array else base


@dataclass(frozen=True)
class Field:
    """One field: its name, type and default value (``None``: the type's own zero)."""

    name: str
    type: FieldType
    default: Any = None


@dataclass(frozen=True)
class Definition:
    """One message: its full name, fields in order, and constants by name."""

    name: str
    fields: tuple[Field, ...]
    constants: dict[str, Any]

    @property
    def wire_fields(self) -> tuple[Field, ...]:
        """Return the fields on the wire, with the dummy member of an empty message."""
        return self.fields or (Field(DUMMY_MEMBER, FieldType("uint8")),)


def parse_message(name: str, text: str) -> Definition:
    """Parse the text of a message.

    Args:
        name: Full name, ``package/msg/Name`` (or ``package/srv/Name_Request``).
        text: The content of the ``.msg`` file.

    Raises:
        DefinitionError: A line is not a field, a constant or a comment.
    """
    package = name.split("/", 1)[0]
    fields: list[Field] = []
    constants: dict[str, Any] = {}
    for number, raw in enumerate(text.splitlines(), start=1):
        line = _strip_comment(raw).strip()
        if not line or line.startswith("@"):
            continue
        where = f"{name}, line {number}: '{line}'"
        if match := _CONSTANT.match(line):
            constant = parse_type(match["type"], package, where)
            constants[match["name"]] = _value(constant, match["value"], where)
        elif match := _FIELD.match(line):
            kind = parse_type(match["type"], package, where)
            default = match["default"]
            fields.append(
                Field(
                    match["name"], kind, None if default is None else _value(kind, default, where)
                )
            )
        else:
            raise DefinitionError(f"{where} is neither a field, a constant nor a comment.")
    names = [field.name for field in fields]
    if len(set(names)) != len(names):
        raise DefinitionError(f"{name} has two fields of the same name; rename one of them.")
    return Definition(name, tuple(fields), constants)


def parse_service(name: str, text: str) -> tuple[Definition, Definition]:
    """Parse the text of a service into its request and its response.

    Raises:
        DefinitionError: The separating line ``---`` is missing, or a line cannot be understood.
    """
    request, response = _split(name, text, ("request", "response"))
    return parse_message(f"{name}_Request", request), parse_message(f"{name}_Response", response)


def parse_action(name: str, text: str) -> tuple[Definition, Definition, Definition]:
    """Parse the text of an action into its goal, its result and its feedback.

    Raises:
        DefinitionError: A separating line ``---`` is missing, or a line cannot be understood.
    """
    goal, result, feedback = _split(name, text, ("goal", "result", "feedback"))
    return (
        parse_message(f"{name}_Goal", goal),
        parse_message(f"{name}_Result", result),
        parse_message(f"{name}_Feedback", feedback),
    )


def _split(name: str, text: str, parts: tuple[str, ...]) -> list[str]:
    """Return the text of each part, which lines ``---`` separate."""
    pieces: list[list[str]] = [[]]
    for line in text.splitlines():
        if line.strip() == "---":
            pieces.append([])
        else:
            pieces[-1].append(line)
    if len(pieces) != len(parts):
        count = "one line" if len(parts) == 2 else "two lines"
        between = f"{', '.join(parts[:-1])} and {parts[-1]}"
        raise DefinitionError(
            f"{name} needs exactly {count} '---' between {between}; it has {len(pieces) - 1}."
        )
    return ["\n".join(lines) for lines in pieces]


def parse_type(text: str, package: str, where: str) -> FieldType:
    """Parse a type as it stands in a definition; ``package`` completes names without one.

    Raises:
        DefinitionError: The type is not one of ROS 2, or is ``wstring``.
    """
    match = _TYPE.match(text)
    if match is None:
        raise DefinitionError(f"{where} does not start with a ROS 2 type.")
    base, array, size = match["base"], "", 0
    if base == "wstring":
        raise DefinitionError(f"{where} uses wstring, which is not supported; use string.")
    if match["array"]:
        array = "bounded" if match["most"] else "fixed" if match["size"] else "unbounded"
        size = int(match["size"] or 0)
    if base not in PRIMITIVES and base != "string":
        parts = base.split("/")
        if base == "Header":
            parts = ["std_msgs", "msg", "Header"]
        elif len(parts) == 1:
            parts = [package, "msg", base]
        elif len(parts) == 2:
            parts = [parts[0], "msg", parts[1]]
        base = "/".join(parts)
    return FieldType(base, array, size, int(match["text"] or 0))


def _strip_comment(line: str) -> str:
    """Cut a comment off, but not a ``#`` inside a quoted string."""
    quote = ""
    for index, char in enumerate(line):
        if quote:
            if char == quote and line[index - 1] != "\\":
                quote = ""
        elif char in "'\"":
            quote = char
        elif char == "#":
            return line[:index]
    return line


def _value(kind: FieldType, text: str, where: str) -> Any:
    text = text.strip()
    if kind.array:
        if not (text.startswith("[") and text.endswith("]")):
            raise DefinitionError(f"{where} gives an array a default that is not in brackets.")
        single = FieldType(kind.name, text_bound=kind.text_bound)
        if kind.name == "string":
            return list(ast.literal_eval(text))
        return [_value(single, part, where) for part in text[1:-1].split(",") if part.strip()]
    try:
        if kind.name == "string":
            return ast.literal_eval(text) if text[:1] in "'\"" and len(text) > 1 else text
        if kind.name == "bool":
            return {"true": True, "1": True, "false": False, "0": False}[text.lower()]
        if kind.name in ("float32", "float64"):
            return float(text)
        if kind.name == "byte":
            return bytes([int(text, 0)])
        return int(text, 0)
    except (ValueError, KeyError, SyntaxError) as error:
        raise DefinitionError(f"{where} has a value that is not a {kind.name}.") from error
