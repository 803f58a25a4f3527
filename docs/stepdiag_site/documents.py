"""The reference of the JSON documents: their schemas as tables of fields."""

from collections.abc import Iterator
from typing import Any

Row = tuple[str, str, str]


def documents_page(_: str) -> str:
    """Return every JSON document with its fields, types and meanings."""
    from stepdiag_ros import schemas

    parts = []
    for name in schemas.VERSIONS:
        schema = schemas.schema(name)
        table = "".join(
            f"| `{path}` | {kind} | {_escaped(text)} |\n"
            for path, kind, text in _fields(schema, schema, "", ())
        )
        about = _escaped(schema.get("description", ""))
        parts.append(
            f"## {name}\n\n{schema['title']}. `stepdiag schema {name}`\n\n{about}\n\n"
            f"| Field | Type | Meaning |\n| --- | --- | --- |\n{table}"
        )
    return "\n".join(parts)


def _fields(
    schema: dict[str, Any], node: dict[str, Any], path: str, above: tuple[str, ...]
) -> Iterator[Row]:
    reference = node.get("$ref", "")
    if reference and not reference.startswith("#"):
        other = reference.split(":")[-2]
        yield path, f"document [{other}](#{other})", node.get("description", "")
        return
    if reference:
        if reference in above:
            return
        above = (*above, reference)
        node = {**_target(schema, reference), **{k: v for k, v in node.items() if k != "$ref"}}
    if path and "description" in node:
        yield path, _kind(node), node["description"]
    for name, below in node.get("properties", {}).items():
        place = f"{path}.{name}" if path else name
        if not {"description", "$ref"} & below.keys():
            yield place, _kind(below), ""
        yield from _fields(schema, below, place, above)
    for key, mark in (("items", "[]"), ("additionalProperties", ".*")):
        if isinstance(node.get(key), dict):
            yield from _fields(schema, node[key], path + mark, above)
    for key in ("anyOf", "oneOf", "allOf"):
        for below in node.get(key, ()):
            yield from _fields(schema, below, path, above)


def _target(schema: dict[str, Any], reference: str) -> dict[str, Any]:
    found: Any = schema
    for part in reference.removeprefix("#/").split("/"):
        found = found[part]
    result: dict[str, Any] = found
    return result


def _kind(node: dict[str, Any]) -> str:
    if "anyOf" in node:
        return " or ".join(filter(None, map(_kind, node["anyOf"])))
    kinds = node.get("type", "")
    if "const" in node:
        return "constant"
    return " or ".join([kinds] if isinstance(kinds, str) else kinds)


def _escaped(text: str) -> str:
    return text.replace("|", r"\|").replace("<", r"\<").replace("*", r"\*")
