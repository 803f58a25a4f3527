"""Type hashes: the RIHS01 value by which ROS 2 peers check whether two definitions are the same."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from typing import Any

from .definitions import Definition, Field

#: Type numbers of ``type_description_interfaces/msg/FieldType``. A ``char`` counts as ``uint8``.
_TYPE_IDS = {
    "int8": 2,
    "uint8": 3,
    "char": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
}
_BOUNDED_STRING = 21
_NESTED = 1
_ARRAY_OFFSETS = {"": 0, "fixed": 48, "bounded": 96, "unbounded": 144}


def type_hash(definition: Definition, find: Callable[[str], Definition]) -> str:
    """Return the RIHS01 hash of a message.

    Args:
        definition: The message.
        find: Gives the definition of a nested message by its full name.
    """
    structures: dict[str, dict[str, Any]] = {}

    def add(item: Definition) -> None:
        if item.name in structures:
            return
        structures[item.name] = {}
        structures[item.name] = {
            "type_name": item.name,
            "fields": [_describe(field) for field in item.wire_fields],
        }
        for field in item.fields:
            if field.type.is_message:
                add(find(field.type.name))

    add(definition)
    document = {
        "type_description": structures.pop(definition.name),
        "referenced_type_descriptions": [structures[name] for name in sorted(structures)],
    }
    return "RIHS01_" + hashlib.sha256(json.dumps(document).encode()).hexdigest()


def _describe(field: Field) -> dict[str, Any]:
    kind = field.type
    number = _NESTED if kind.is_message else _TYPE_IDS[kind.name]
    if kind.text_bound:
        number = _BOUNDED_STRING
    return {
        "name": field.name,
        "type": {
            "type_id": number + _ARRAY_OFFSETS[kind.array],
            "capacity": kind.size,
            "string_capacity": kind.text_bound,
            "nested_type_name": kind.name if kind.is_message else "",
        },
    }
