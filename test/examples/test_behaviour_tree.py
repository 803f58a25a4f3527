"""The behaviour tree of docs/examples: its nodes, ports and numbers are those of the interfaces."""

import re
from pathlib import Path
from xml.etree import ElementTree

import stepdiag_ros.client  # noqa: F401 - makes the interfaces importable

# isort: split
from stepdiag_ros.action import Measure
from stepdiag_ros.msg import RunVerdict

FILE = Path(__file__).parents[2] / "docs/examples/measure_machine.xml"
ROOT = ElementTree.fromstring(FILE.read_text(encoding="utf-8"))
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
