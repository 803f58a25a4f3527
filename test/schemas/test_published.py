"""What a generated schema takes and refuses is what the published schema of its version does.

``data/schemas`` holds the rules of schemas as they were published, without words. A declaration may
be written in another way; a document must not fit one and miss the other.
"""

import json
import re
from pathlib import Path

import jsonschema_rs
import pytest

from stepdiag_ros import schemas

PUBLISHED = sorted((Path(__file__).parents[1] / "data" / "schemas").glob("*.json"))
WRONG = ("wrong", -1.5, 7, True, None, {}, [], [None], ["wrong"], {"wrong": None})
EXAMPLES = {"string": "some", "number": 0.5, "integer": 2, "boolean": True, "null": None}


TEXTS = ("some", "E_XX", "XYZ", "0" * 64)
"""One of them fits each pattern."""


def example(node, root):
    """Return a value that fits a schema and leaves out no field."""
    if "$ref" in node:
        document, _, pointer = node["$ref"].partition("#")
        root = schemas.schema(document.split(":")[2]) if document else root
        node = root
        for name in pointer.split("/")[1:]:
            node = node[name]
        return example(node, root)
    for key in ("anyOf", "oneOf"):
        if key in node:
            return example(node[key][0], root)
    if "const" in node or "enum" in node:
        return node.get("const", node.get("enum", [None])[0])
    kind = node["type"] if isinstance(node["type"], str) else node["type"][0]
    if kind == "object":
        further = node.get("additionalProperties")
        made = {name: example(below, root) for name, below in node.get("properties", {}).items()}
        name = example({"type": "string", **node.get("propertyNames", {})}, root)
        for number in range(node.get("minProperties", 1) if further else 0):
            made[f"{name}{number or ''}"] = example(further, root)
        return made
    if kind == "array":
        return [example(node["items"], root) for _ in range(node.get("minItems", 1))]
    if "pattern" in node:
        return next(text for text in TEXTS if re.search(node["pattern"], text))
    made = EXAMPLES[kind]
    return made.ljust(node.get("minLength", 0), "x") if kind == "string" else made


def containers(part):
    """Yield every object and array of a document."""
    yield part
    for below in list(part.values() if isinstance(part, dict) else part):
        if isinstance(below, dict | list):
            yield from containers(below)


def changes(document):
    """Change a document in one place at a time, and yield what is changed while it is so."""
    for part in list(containers(document)):
        if isinstance(part, dict):
            part["extra"] = None
            yield "a field more"
            del part["extra"]
        for key in list(part) if isinstance(part, dict) else range(len(part)):
            kept = part[key]
            for value in WRONG:
                part[key] = value
                yield f"{key}: {value!r}"
            del part[key]
            yield f"no {key}"
            if isinstance(part, dict):
                part[key] = kept
            else:
                part.insert(key, kept)


@pytest.mark.parametrize("path", PUBLISHED, ids=[path.stem for path in PUBLISHED])
def test_a_schema_takes_and_refuses_what_its_published_version_did(path):
    published = json.loads(path.read_text())
    name = published["$id"].split(":")[2]
    assert published["$id"] == schemas.identifier(name), "a new version is published by a new file"
    document = example(published, published)
    registry = jsonschema_rs.Registry(
        [(schemas.identifier(one), schemas.schema(one)) for one in schemas.VERSIONS]
    )
    before = jsonschema_rs.Draft202012Validator(published, registry=registry)
    now = jsonschema_rs.Draft202012Validator(schemas.schema(name))
    before.validate(document)
    now.validate(document)
    verdicts = set()
    for change in changes(document):
        verdict = before.is_valid(document)
        assert now.is_valid(document) == verdict, change
        verdicts.add(verdict)
    assert verdicts == {True, False}
