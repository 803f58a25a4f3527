"""The declared parameters: what is refused and in which words, and the documents made of them."""

import ast
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from refused import a_fault, refused

from stepdiag_ros import cli
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.parameters.declaration import (
    COMMON,
    Changeable,
    Declaration,
    DeclaredNode,
    written,
)
from stepdiag_ros.parameters.documents import markdown, parameter_file
from stepdiag_ros.parameters.nodes import NODES, declared_node
from stepdiag_ros.processes.cell import simulated_cell
from stepdiag_ros.processes.node_process import NodeProcess

ROOT = Path(__file__).parents[2]
EVERY = [(node.name, one) for node in NODES for one in node.parameters]
COMMON_NAMES = [one.name for one in COMMON]
NAMES = [f"{node}.{one.name}" for node, one in EVERY]


@pytest.mark.parametrize(("_node", "one"), EVERY, ids=NAMES)
def test_a_range_holds_at_both_ends_and_not_beyond(_node, one):
    assert one.refusal(one.default) == ""
    if one.low is None:
        return
    kind = type(one.default)
    low, high = kind(one.low), kind(one.high)
    assert (one.refusal(low), one.refusal(high)) == ("", "")
    if kind is int:
        beyond = (low - 1, high + 1)
    else:
        beyond = (math.nextafter(low, -math.inf), math.nextafter(high, math.inf))
        beyond += (math.nan, math.inf, -math.inf)
    for value in beyond:
        assert one.refusal(value) == f"{value!r}; expected {one.expected}"
    assert one.limits in one.expected


def test_a_choice_that_yaml_reads_as_false_is_named_as_it_is_to_be_written():
    compensation = declared_node("interferometer").find("compensation")
    assert "'off'" in compensation.refusal(yaml.safe_load("off"))
    assert compensation.refusal(yaml.safe_load("'off'")) == ""


@pytest.mark.parametrize(("_node", "one"), EVERY, ids=NAMES)
def test_a_declaration_says_what_its_user_needs(_node, one):
    assert one.description and not one.description.endswith(".")
    assert "\n" not in one.description


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (2, "2; expected a number with a point, such as 1.0, from 0.5 to 9 s; write 2.0"),
        (20, "20; expected a number with a point, such as 1.0, from 0.5 to 9 s"),
        ("1e0", "'1e0'; expected a number with a point, such as 1.0, from 0.5 to 9 s; write 1.0"),
        ("two", "'two'; expected a number with a point, such as 1.0, from 0.5 to 9 s"),
        (True, "True; expected a number with a point, such as 1.0, from 0.5 to 9 s"),
        ([2.0], "[2.0]; expected a number with a point, such as 1.0, from 0.5 to 9 s"),
        (None, "None; expected a number with a point, such as 1.0, from 0.5 to 9 s"),
        (".nan", "'.nan'; expected a number with a point, such as 1.0, from 0.5 to 9 s"),
    ],
)
def test_a_wrong_number_is_refused_and_the_right_way_to_write_it_said(value, says):
    assert Declaration("t", 1.0, "a time", "s", 0.5, 9.0).refusal(value) == says


@pytest.mark.parametrize("default", [0.0, 0.02])
def test_the_number_that_is_given_as_an_example_would_be_taken(default):
    one = Declaration("tolerance", default, "a tolerance", "m", 0.0, 0.1)
    example = re.search("such as ([0-9.]+),", one.refusal("abc"))[1]
    assert float(example) > 0.0 and one.refusal(float(example)) == ""


COUNT = Declaration("n", 1, "a count", low=0, high=9)
TEXT = Declaration("t", "", "a text")
SWITCH = Declaration("b", False, "a switch")
CHOICE = Declaration("c", "x", "a choice", choices=("x", "y", "long"))
QUOTED = "expected a text; if a text is meant, put it in quotes"


@pytest.mark.parametrize(
    ("one", "value", "says"),
    [
        (COUNT, 2.0, "2.0; expected a whole number from 0 to 9; write 2"),
        (COUNT, 2.5, "2.5; expected a whole number from 0 to 9"),
        (COUNT, "3", "'3'; expected a whole number from 0 to 9; write 3"),
        (COUNT, True, "True; expected a whole number from 0 to 9"),
        (COUNT, math.inf, "inf; expected a whole number from 0 to 9"),
        (TEXT, 12, f"12; {QUOTED}: \"'12'\""),
        (TEXT, True, f"True; {QUOTED}: \"'true'\""),
        (SWITCH, 1, "1; expected true or false"),
        (SWITCH, "yes", "'yes'; expected true or false"),
        (CHOICE, "lon", "'lon'; expected x, y or long; did you mean 'long'?"),
        (CHOICE, "", "''; expected x, y or long"),
    ],
)
def test_every_kind_is_refused_in_its_own_words(one, value, says):
    assert one.refusal(value) == says


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("x", 1.0, "no range"), a_fault("mismatch")),
        (("x", "a", "a range for a text", "", 0.0, 1.0), a_fault("mismatch")),
        (("x", 1.0, "half a range", "", 0.0), a_fault("mismatch")),
        (("x", 2.0, "a default beyond", "", 0.0, 1.0), a_fault("malformed", "x", "2.0")),
        (("x", "c", "no choice", "", None, None, ("a", "b")), a_fault("malformed", "c")),
    ],
)
def test_a_declaration_that_contradicts_itself_is_refused(arguments, says):
    with refused(Refusal, says):
        Declaration(*arguments)


def test_names_are_unique_and_mean_the_same_wherever_they_are():
    assert len({node.name for node in NODES}) == len({node.module for node in NODES}) == len(NODES)
    for node in NODES:
        names = [one.name for one in node.parameters]
        assert len(set(names)) == len(names)
        assert not {*COMMON_NAMES} & {*names}


def texts(module):
    """Return the texts in a module as patterns; what an f-string puts in may be any word."""
    for found in ast.walk(ast.parse(module.read_text())):
        if isinstance(found, ast.Constant) and isinstance(found.value, str):
            yield re.escape(found.value)
        elif isinstance(found, ast.JoinedStr):
            parts = (getattr(part, "value", None) for part in found.values)
            yield "".join(re.escape(part) if isinstance(part, str) else "\\w+" for part in parts)


def read_by(module):
    """Return the names that a module reads, as far as they are written out there."""
    for found in ast.walk(ast.parse(module.read_text())):
        if isinstance(found, ast.Call) and isinstance(found.func, ast.Attribute):
            name = found.args[0] if found.args else None
            if found.func.attr in ("parameter", "on_change") and isinstance(name, ast.Constant):
                yield name.value


def test_what_the_nodes_read_is_declared_and_what_is_declared_is_read():
    folder = ROOT / "stepdiag_ros" / "nodes"
    patterns = {text for module in folder.glob("*.py") for text in texts(module)}
    for node in NODES:
        own = {one.name for one in node.parameters}
        assert set(read_by(folder / f"{node.module}.py")) <= own, node.module
        unread = {name for name in own if not any(re.fullmatch(p, name) for p in patterns)}
        assert not unread, f"{node.module} does nothing with {unread}"


def test_every_node_that_can_be_started_is_declared_under_the_role_that_it_has():
    from stepdiag_ros.commands.node import NODES as STARTED

    assert {node.module for node in NODES} == set(STARTED)
    for node in NODES:
        text = (ROOT / "stepdiag_ros" / "nodes" / f"{node.module}.py").read_text()
        assert f'role = "{node.name}"' in text, node.module


def test_the_page_of_all_parameters_is_up_to_date():
    page = (ROOT / "docs" / "parameters.md").read_text(encoding="utf-8")
    assert page == markdown(NODES), (
        "make it anew: stepdiag parameters --markdown > docs/parameters.md"
    )


def test_a_bar_in_a_description_does_not_break_the_table():
    one = Declaration("b", False, "this | that")
    assert "this \\| that |\n" in markdown([DeclaredNode("n", "n", "does", (one,))])


def test_the_parameter_file_is_one_that_every_node_takes():
    content = yaml.safe_load(parameter_file(NODES))
    assert set(content) == {f"/**/{node.name}" for node in NODES}
    for node in NODES:
        given = content[f"/**/{node.name}"]["ros__parameters"]
        assert list(given) == [*COMMON_NAMES, *(one.name for one in node.parameters)]
        for name, value in given.items():
            node.check(name, value)
            assert value == node.find(name).default and type(value) is type(node.find(name).default)
    lines = parameter_file(NODES).splitlines()
    assert all(len(line) <= 100 for line in lines)
    remarks = " ".join(line.strip().removeprefix("# ") for line in lines)
    for node in NODES:
        for one in node.parameters:
            limits = f"; {one.limits} {one.unit}".rstrip() if one.limits else ""
            described = f"{one.description[0].upper()}{one.description[1:]}"
            assert f"{described}{limits}; can be set {one.change.value}. {one.name}:" in remarks


@pytest.mark.parametrize(
    "value", [1e-05, 2.5e-7, 1e16, 0.0, -3.0, 100000.0, 7, True, "it's", "on", ""]
)
def test_a_value_is_written_as_every_yaml_reader_takes_it(value):
    read = yaml.safe_load(written(value))
    assert read == value and type(read) is type(value)


def test_the_embedded_client_takes_the_parameter_file_in_any_namespace(tmp_path):
    from stepdiag_ros.embedded.arguments import parse

    path = tmp_path / "all.yaml"
    path.write_text(parameter_file(NODES))
    arguments = parse(["--ros-args", "--params-file", str(path)])
    defaults = {one.name: one.default for one in (*COMMON, *declared_node("diagnosis").parameters)}
    for name in ("/diagnosis", "/cell/diagnosis"):
        assert arguments.overrides(name) == defaults


def test_the_command_prints_table_file_and_page(capsys):
    assert cli.main(["parameters", "cnc_bridge"]) == 0
    table = capsys.readouterr().out
    for text in ("position_rate", "1 to 10000", "Hz", "at start only", "driver of the controller"):
        assert text in table
    assert cli.main(["parameters", "evaluator"]) == 0
    assert "no parameters of its own" in capsys.readouterr().out
    assert cli.main(["parameters", "clock", "--yaml"]) == 0
    assert list(yaml.safe_load(capsys.readouterr().out)) == ["/**/clock"]
    assert cli.main(["parameters", "--markdown"]) == 0
    assert capsys.readouterr().out == markdown(NODES)
    assert cli.main(["parameters", "nonsense"]) == 1
    assert "'nonsense'" in capsys.readouterr().err


def test_a_session_can_give_no_parameter_that_its_node_would_refuse(tmp_path):
    made = simulated_cell("quick", "demo", "demo", tmp_path, 10.0, 0.0, 1)
    assert {node.name for node in made} <= {node.module for node in NODES}
    with refused(Refusal, "unknown", "seeed", "seed"):
        NodeProcess("interferometer", {"seeed": 1})
    with refused(Refusal, "out_of_range", "factor", "0.0"):
        NodeProcess("clock", {"factor": 0.0})
    with refused(Refusal, "unknown", "plan"):
        NodeProcess("solver", {"plan": "demo"})


def test_a_node_without_declarations_has_the_common_ones_alone():
    node = declared_node("nobody")
    assert node.parameters == ()
    node.check("use_sim_time", True)
    with refused(Refusal, "unknown", "a", *COMMON_NAMES):
        node.check("a", 1)


def test_declarations_are_plain_data():
    """No client library, no numpy: the command line and CI read them on any machine."""
    code = "import sys, stepdiag_ros.parameters.nodes, stepdiag_ros.parameters.documents;" \
        "print([name for name in ('rclpy', 'numpy', 'scipy') if name in sys.modules])"  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_what_is_opened_with_a_device_cannot_be_changed_while_the_node_runs():
    what, how = ("device", "machine", "cell", "autostart"), ("rate", "seed", "position_rate")
    for node in ("cnc_bridge", "interferometer", "weather"):
        for one in declared_node(node).parameters:
            assert one.name not in what or one.change is Changeable.AT_START, f"{node}.{one.name}"
            assert one.name not in how or one.change is Changeable.WHILE_CLOSED, (
                f"{node}.{one.name}"
            )
