"""The behaviour trees of docs/examples: the XML fits the interfaces, py_trees decides as told."""

import os
import re
import runpy
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
import standard_runs
from py_trees.common import Status

import stepdiag_ros.client  # noqa: F401 - makes the interfaces importable

# isort: split
from stepdiag_ros.action import Measure
from stepdiag_ros.msg import RunVerdict

EXAMPLES = Path(__file__).parents[2] / "docs/examples"
ROOT = ElementTree.fromstring((EXAMPLES / "measure_machine.xml").read_text(encoding="utf-8"))
MODELS = {node.get("ID"): node for node in ROOT.find("TreeNodesModel")}
OF_BTCPP = {"Sequence": set(), "Fallback": set(), "ScriptCondition": {"code"}}
KINDS = {"string": "std::string", "uint8": "uint8_t", "double": "double"}


def ports(node, kind):
    return {port.get("name"): port.get("type") for port in node.findall(f"{kind}_port")}


def test_each_node_of_the_tree_is_declared_with_its_ports():
    tree = ROOT.find("BehaviorTree")
    assert tree.get("ID") == ROOT.get("main_tree_to_execute") and ROOT.get("BTCPP_format") == "4"
    used = [node for node in tree.iter() if node is not tree]
    for node in used:
        if node.tag in OF_BTCPP:
            assert set(node.attrib) == OF_BTCPP[node.tag]
        else:
            model = MODELS[node.tag]
            assert set(node.attrib) == set(ports(model, "input") | ports(model, "output")), node.tag
    assert set(MODELS) == {node.tag for node in used} - set(OF_BTCPP)


def test_the_ports_are_fields_of_the_action_and_of_the_verdict():
    def fields(kind):
        return {name: KINDS.get(text) for name, text in kind.get_fields_and_field_types().items()}

    action, verdict = MODELS["MeasureMachine"], MODELS["ReadVerdict"]
    assert ports(action, "input").items() <= fields(Measure.Goal).items()
    assert ports(action, "output").items() <= fields(Measure.Result).items()
    for kind in ("input", "output"):
        assert ports(verdict, kind).items() <= fields(RunVerdict).items()


def test_the_numbers_that_decide_are_those_of_the_constants():
    codes = " ".join(node.get("code") for node in ROOT.iter("ScriptCondition"))
    found = set(re.findall(r"(\w+) == (\d+)", codes))
    assert found == {
        ("diagnosis", str(RunVerdict.DIAGNOSIS_CONSISTENT)),
        ("conformity", str(RunVerdict.CONFORMITY_WITHIN)),
        ("conformity", str(RunVerdict.CONFORMITY_NOT_WITHIN)),
    }


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Return a measurement whose verdict allows its compensation."""
    steps = "step_diagonal, orders: [XYZ], names: [ppp, npp, pnp, ppn]"
    plan = standard_runs.PLAN.replace("diagonal, names: [ppp, npp, pnp, ppn, pp0, np0]", steps)
    plan = plan.replace("repeats: 5", "repeats: 2")
    return standard_runs.write_bag(tmp_path_factory.mktemp("bag") / "run.mcap", plan)


@pytest.fixture
def acted(bag, monkeypatch):
    """Return what lets the tree act on a verdict: it returns the child that has succeeded."""
    monkeypatch.syspath_prepend(EXAMPLES)
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    example = runpy.run_path(str(EXAMPLES / "behaviour_tree.py"))

    def act(diagnosis, conformity, answer):
        cell = example["Cell"].__new__(example["Cell"])  # no node: all is decided by what it knows
        cell.result = SimpleNamespace(bag=str(bag))
        cell.verdict = RunVerdict(
            run_over=True,
            outcome=RunVerdict.OUTCOME_FINISHED,
            diagnosis=diagnosis,
            conformity=conformity,
        )
        reading, writing = os.pipe()
        os.write(writing, f"{answer}\n".encode())
        with os.fdopen(reading) as stdin, os.fdopen(writing, "w"):
            monkeypatch.setattr(sys, "stdin", stdin)
            root = example["tree"](cell, "quick", "generic").children[-1]
            while root.status not in (Status.SUCCESS, Status.FAILURE):
                root.tick_once()
                time.sleep(0.02)
        (done,) = [child.name for child in root.children if child.status == Status.SUCCESS]
        return done

    return act


AGREE, MORE = RunVerdict.DIAGNOSIS_CONSISTENT, RunVerdict.DIAGNOSIS_NAMED
WITHIN, NOT_WITHIN = RunVerdict.CONFORMITY_WITHIN, RunVerdict.CONFORMITY_NOT_WITHIN


@pytest.mark.parametrize(
    ("diagnosis", "conformity", "done"),
    [
        (AGREE, WITHIN, "within the tolerance"),
        (AGREE, RunVerdict.CONFORMITY_UNDECIDED, "call service"),
        (AGREE, RunVerdict.CONFORMITY_NOT_ASKED, "call service"),
        (MORE, WITHIN, "within the tolerance"),
        (MORE, RunVerdict.CONFORMITY_UNDECIDED, "call service"),
        (RunVerdict.DIAGNOSIS_DESCRIBED, WITHIN, "call service"),
        (MORE, NOT_WITHIN, "call service"),
    ],
)
def test_the_tree_goes_on_or_calls_service(acted, bag, diagnosis, conformity, done):
    assert acted(diagnosis, conformity, "y") == done
    assert [file.name for file in bag.parent.iterdir()] == [bag.name]


def test_a_machine_beyond_the_tolerance_is_compensated_if_the_operator_says_so(acted, bag):
    assert acted(AGREE, NOT_WITHIN, "y") == "compensate, then measure again"
    tables = bag.with_name("run_for_generic")
    assert (tables / "volumetric_map.json").is_file()
    # The command overwrites no tables and fails, whatever the operator says.
    assert acted(AGREE, NOT_WITHIN, "y") == "call service"
    tables.rename(tables.with_name("before"))
    assert acted(AGREE, NOT_WITHIN, "n") == "call service"
    assert tables.is_dir()


def test_without_a_plan_and_a_control_the_usage_is_told():
    command = [sys.executable, EXAMPLES / "behaviour_tree.py", "quick"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1 and "behaviour_tree.py quick linuxcnc" in done.stderr
