"""`ros2 interface show` reads like documentation: fields with their meaning, numbers in units."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
INTERFACES = sorted(
    path for folder in ("msg", "srv", "action") for path in ROOT.glob(f"{folder}/*.{folder}")
)
FIELD = re.compile(r"(?P<type>\S+)\s+(?P<name>\w+)(?P<value>=\S+)?\s*(?P<comment>#\s*\S.*)?$")
UNIT = re.compile(
    r"(m|m/s|rad|s|Hz|Pa|degC|1|0\.\.1)(?=[ ,;]|$)"
    r"|.*\bin (its|that|their|the products of their) unit"
)
"""How a comment begins that says in what a number is given, or where that stands."""


def fields(path):
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if line and not line.startswith("#") and line != "---":
            found = FIELD.match(line)
            assert found, f"{path.name}, line {number}: not a field: {line}"
            yield f"{path.name}, line {number}", found


@pytest.mark.parametrize("path", INTERFACES, ids=lambda path: path.name)
def test_an_interface_says_what_it_is_and_what_each_field_means(path):
    first = path.read_text(encoding="utf-8").splitlines()[0]
    assert first.startswith("# "), f"{path.name} does not begin with what it is for"
    for where, field in fields(path):
        assert field["comment"], f"{where}: {field['name']} has no comment"


@pytest.mark.parametrize("path", INTERFACES, ids=lambda path: path.name)
def test_every_number_has_its_unit_and_every_header_its_frame(path):
    for where, field in fields(path):
        comment = (field["comment"] or "").lstrip("# ")
        if field["type"].startswith("float64"):
            assert UNIT.match(comment), f"{where}: the unit of {field['name']} is missing"
        if field["type"] == "std_msgs/Header":
            assert "frame_id" in comment, f"{where}: the frame is missing"


def test_there_are_interfaces_to_look_at():
    assert len(INTERFACES) >= 15
