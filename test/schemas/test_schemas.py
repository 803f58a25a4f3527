"""The schemas themselves: complete, closed, and the only way in which JSON leaves the package.

That real documents fit is checked wherever a test makes one (``conftest.py``).
"""

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import jsonschema_rs
import numpy as np
import pytest
from msgspec import UNSET, UnsetType
from refused import refused

import stepdiag_ros
from stepdiag_ros import schemas
from stepdiag_ros.cli import main
from stepdiag_ros.schemas.parts import part_of

PACKAGE = Path(stepdiag_ros.__file__).parent
WRITERS_OF_OTHER_JSON = {
    "schemas/__init__.py",
    "embedded/typehash.py",
    "viewers/page/server.py",
    "viewers/page/state.py",
}
"""The second makes what ROS 2 hashes, the last two what the live page is sent. Drivers
speak JSON where their devices do, and print none."""


def _objects(part, path="$"):
    """Yield every schema of an object in a schema, with its place."""
    if isinstance(part, dict):
        if "properties" in part and part.get("type") == "object":
            yield path, part
        for key, value in part.items():
            yield from _objects(value, f"{path}.{key}")
    elif isinstance(part, list):
        for number, value in enumerate(part):
            yield from _objects(value, f"{path}[{number}]")


def test_every_document_is_declared_once_as_a_type_or_in_a_file():
    files = [path.name.split(".")[0] for path in (PACKAGE / "schemas").glob("*.json")]
    types = [
        path.stem
        for path in (PACKAGE / "schemas").glob("*.py")
        if "\nclass Document" in path.read_text()
    ]
    assert sorted(files + types) == sorted(schemas.VERSIONS)
    assert not list((PACKAGE / "report").glob("*.json"))


@pytest.mark.parametrize("name", schemas.VERSIONS)
def test_a_schema_is_valid_and_says_which_it_is(name):
    schema = schemas.schema(name)
    jsonschema_rs.meta.validate(schema)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["$id"] == schemas.identifier(name)
    assert schema["properties"]["schema"]["const"] == schema["$id"]
    assert list(schema["properties"])[:2] == ["schema", "software_version"]
    assert schema["title"]
    assert "SI units" in schema["description"] and "null" in schema["description"]


@pytest.mark.parametrize("name", schemas.VERSIONS)
def test_a_schema_has_room_for_nothing_that_it_does_not_explain(name):
    for place, part in _objects(schemas.schema(name)):
        assert part.get("additionalProperties") is not None, f"{name} {place} is open"
        if "methods" not in place and place != "$.properties.methods":
            known = set(part["properties"])
            assert set(part.get("required", ())) <= known, f"{name} {place}"


@pytest.mark.parametrize("name", schemas.VERSIONS)
def test_a_document_without_identity_or_with_a_further_field_is_refused(name):
    validator = jsonschema_rs.Draft202012Validator(schemas.schema(name))
    assert not validator.is_valid({})
    errors = list(validator.iter_errors({**schemas.document(name, {}), "extra": 1}))
    assert any("extra" in error.message for error in errors)
    other = {**schemas.document(name, {}), "schema": "urn:stepdiag_ros:other:1"}
    assert any(error.instance_path == ["schema"] for error in validator.iter_errors(other))


def test_json_is_written_in_one_place():
    """So that no command prints a document which the fixture of all tests does not see."""
    found = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if PACKAGE / "devices" not in path.parents
        and re.search(r"\bjson\.dumps?\(", path.read_text())
    }
    assert found == WRITERS_OF_OTHER_JSON
    options = {
        path.name for path in (PACKAGE / "commands").glob("*.py") if '"--json"' in path.read_text()
    }
    assert options, "no command prints JSON any more"


def test_what_is_no_number_is_refused_not_written(monkeypatch):
    monkeypatch.undo()  # the check of all tests, which would refuse it first
    with refused(ValueError, None, "nan"):
        schemas.json_text(schemas.document("info", {"duration": float("nan")}))


def test_of_a_typed_document_what_is_not_known_is_null_and_refused_where_it_must_be_known():
    @dataclass(frozen=True, kw_only=True)
    class Size:
        name: str
        sizes: Sequence[float | None]
        factor: float = 2.0

    made = schemas.document("info", Size(name="a", sizes=np.array([1e-6, math.nan, math.inf])))
    assert made["sizes"] == [1e-6, None, None]
    assert list(made) == ["schema", "software_version", "name", "sizes", "factor"]
    with refused(ValueError, None, "factor"):
        schemas.document("info", Size(name="a", sizes=(), factor=math.nan))


def test_the_command_prints_and_lists(capsys):
    assert main(["schema", "diagnosis"]) == 0
    assert json.loads(capsys.readouterr().out) == schemas.schema("diagnosis")
    assert main(["schema"]) == 0
    *documents, messages = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in documents] == list(schemas.VERSIONS)
    assert "RunVerdict" in messages
    with refused(SystemExit, code=2):
        main(["schema", "nonsense"])
    # Fifty names are no answer; the command without a name lists them.
    error = capsys.readouterr().err
    assert "'nonsense'" in error and "stepdiag schema" in error and "RunVerdict" not in error
    with refused(SystemExit, code=2):
        main(["schema", "diagnosi"])
    assert "diagnosis" in capsys.readouterr().err
    with refused(SystemExit, code=2):
        main(["schema", "result/verdict"])
    assert "stepdiag schema RunVerdict" in capsys.readouterr().err


def test_the_readme_names_the_command():
    readme = (PACKAGE.parent / "README.md").read_text(encoding="utf-8")
    assert "stepdiag schema" in readme
    assert "result.schema.json" not in readme


def test_a_part_is_made_of_what_a_result_has_and_what_is_given():
    @dataclass(frozen=True, kw_only=True)
    class Part:
        name: str
        value: float
        note: str | UnsetType = UNSET

    result = SimpleNamespace(name="E_XX", value=1.0, note="of the result", source="a field")
    assert part_of(Part, result) == Part(name="E_XX", value=1.0)
    assert part_of(Part, result, value=2.0, note="n") == Part(name="E_XX", value=2.0, note="n")
    with pytest.raises(AttributeError):
        part_of(Part, SimpleNamespace(name="E_XX"))
    with pytest.raises(TypeError):
        part_of(Part, result, unknown=1.0)
