"""The JSON documents that commands print and write, each with its schema.

Every document begins with ``schema``, the name and version of its schema, and ``software_version``.
Numbers are in SI units; what is not known is ``null``, never 0. A schema (JSON Schema 2020-12) has
an entry, with meaning and unit, for every field that a document may have. The names of methods in
it are those of the methods that are installed. A version grows when a
field changes its meaning or goes; new fields do not change it.

A document is declared in the module of its name in this package: its class ``Document`` is what
makes the document and what its schema is generated from. Some are not yet declared so. They are
mappings, and their schemas are files.
"""

import inspect
import json
import math
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib import resources as package_files
from typing import Any

from stepdiag_ros import __version__
from stepdiag_ros.metrology.spelling import nearest, suggestion

VERSIONS = {
    "result": 1,
    "diagnosis": 1,
    "history": 1,
    "trends": 1,
    "fleet": 1,
    "budget": 1,
    "comparison": 1,
    "iso230": 1,
    "squareness": 1,
    "volumetric": 1,
    "volumetric_map": 1,
    "compensation": 1,
    "report": 1,
    "changes": 1,
    "nc_correction": 1,
    "plan": 1,
    "measurement": 1,
    "tracker_plan": 1,
    "tracker_readings": 1,
    "tracker_result": 2,
    "tracker_figures": 1,
    "tracker_report": 1,
    "info": 1,
    "recovery": 1,
    "replay": 1,
    "import": 1,
    "by_hand": 1,
    "export": 1,
    "selftest": 1,
    "lead": 1,
    "seal": 1,
    "seal_check": 1,
}
"""Name of every document → version of its schema."""

_METHODS = "methods"
"""Part of a schema that is not in a file, but made from the methods that are installed."""
_OF_ALL = (
    "Numbers are in SI units (m, rad, s, degC, Pa) unless the key or the field `unit` says"
    " otherwise. null means unknown or not determined; it never stands for zero."
)


def identifier(name: str) -> str:
    """Return what a document names its schema by, which is the schema's ``$id``."""
    return f"urn:stepdiag_ros:{name}:{VERSIONS[name]}"


def schema_text(name: str) -> str:
    """Return a schema as JSON text; see ``schema``.

    Raises:
        ValueError: the name is unknown.
    """
    return json.dumps(schema(name), indent=2, ensure_ascii=False) + "\n"


def schema(name: str) -> dict[str, Any]:
    """Return a schema, with those of the documents that are parts of it among its ``$defs``.

    Raises:
        ValueError: the name is unknown.
    """
    if name not in VERSIONS:
        near = nearest(name, VERSIONS)
        hint = suggestion(near, f"there are {', '.join(VERSIONS)}")
        raise ValueError(f"there is no schema '{name}'; {hint}")
    file = package_files.files(__name__).joinpath(f"{name}.schema.json")
    loaded = json.loads(file.read_text("utf-8")) if file.is_file() else _generated(name)
    if parts := sorted(set(_parts(loaded))):
        found = {part: _methods() if part == _METHODS else schema(part) for part in parts}
        loaded["$defs"] = {**loaded.get("$defs", {}), **found}
    return loaded


def _methods() -> dict[str, Any]:
    """Return what is asked of an object with an entry for each method, from the methods there are.

    Its ``solver`` is the name of a method that solves measured lines.
    """
    # With the methods come the numerical libraries, which nothing else here needs.
    from stepdiag_ros.metrology.solvers import methods, solvers

    return {
        "$id": f"urn:stepdiag_ros:{_METHODS}:1",
        "propertyNames": {"enum": list(methods())},
        "properties": {
            name: {
                "properties": {
                    "curves": {"required": list(method.curves)},
                    "standard_uncertainty": {"required": list(method.curves)},
                }
            }
            for name, method in methods().items()
        },
        "$defs": {"solver": {"enum": list(solvers())}},
    }


def _generated(name: str) -> dict[str, Any]:
    """Return the schema of a document that is declared as a type."""
    import msgspec

    kind = import_module(f"{__name__}.{name}").Document
    title, _, about = (inspect.getdoc(kind) or "").partition("\n\n")
    parts = msgspec.json.schema(kind)["$defs"]
    for part in parts.values():
        part["additionalProperties"] = False
    content = parts.pop("Document")
    head = {
        "schema": {
            "description": "Name and version of the schema of this document.",
            "const": identifier(name),
        },
        "software_version": {
            "description": "Version of stepdiag_ros that made this document.",
            "type": "string",
        },
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": identifier(name),
        **content,
        "title": title.rstrip("."),
        "description": f"{_OF_ALL} {' '.join(about.split())}",
        "properties": head | content["properties"],
        "required": [*head, *content["required"]],
        "$defs": parts,
    }


def _parts(of: Any) -> Iterator[str]:
    """Yield the names of the other schemas that a schema refers to."""
    if isinstance(of, dict):
        for key, value in of.items():
            if key == "$ref" and value.startswith("urn:"):
                yield value.split(":")[2]
            else:
                yield from _parts(value)
    elif isinstance(of, list):
        for value in of:
            yield from _parts(value)


def document(name: str, content: Any) -> dict[str, Any]:
    """Return a document: its content, and before it what it is and which software made it.

    Args:
        name: of its schema.
        content: the declared ``Document``, or of what is not declared yet a mapping.

    Raises:
        ValueError: a number is not known where its type has no ``null``.
    """
    fields = content if isinstance(content, Mapping) else plain(content)
    return {"schema": identifier(name), "software_version": __version__, **fields}


def plain(content: Any) -> dict[str, Any]:
    """Return content as JSON knows it: ``null`` for a number that is NaN or infinite.

    Raises:
        ValueError: such a number stands where its type has no ``null``.
    """
    import msgspec

    encoded = msgspec.json.encode(content, enc_hook=lambda array: array.tolist())
    msgspec.json.decode(encoded, type=type(content))
    made: dict[str, Any] = msgspec.json.decode(encoded)
    return made


def number(value: float) -> float | None:
    """Return a number as JSON knows it: ``null`` where it is not known (NaN or infinite)."""
    return float(value) if math.isfinite(value) else None


def json_text(made: Mapping[str, Any]) -> str:
    """Return a document as JSON text.

    Args:
        made: of ``document``.

    Raises:
        ValueError: a number is NaN or infinite.
    """
    return json.dumps(made, indent=2, ensure_ascii=False, allow_nan=False)
