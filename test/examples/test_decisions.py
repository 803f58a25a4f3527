"""What the examples of supervisors decide: one table, and a sequencer that is not there."""

import runpy
import time
from math import nan
from pathlib import Path
from xml.etree import ElementTree

import pytest
from refused import refused

EXAMPLES = Path(__file__).parents[2] / "docs/examples"
EXAMPLE = runpy.run_path(str(EXAMPLES / "supervise.py"))
VERDICT = EXAMPLE["RunVerdict"]
GO_ON, COMPENSATE, SERVICE = (EXAMPLE[name] for name in ("GO_ON", "COMPENSATE", "CALL_SERVICE"))
CELLS = [
    (conformity, diagnosis)
    for conformity in ("NOT_ASKED", "WITHIN", "NOT_WITHIN", "UNDECIDED")
    for diagnosis in (
        *("UNKNOWN", "CONSISTENT", "NAMED", "AMBIGUOUS"),
        *("UNEXPLAINED", "NOT_TESTABLE", "DESCRIBED"),
    )
]
NOT_SERVICE = {
    ("WITHIN", "CONSISTENT"): GO_ON,
    ("WITHIN", "NAMED"): GO_ON,
    ("WITHIN", "AMBIGUOUS"): GO_ON,
    ("NOT_WITHIN", "CONSISTENT"): COMPENSATE,
}


def verdict_of(conformity, diagnosis, **changed):
    codes = {
        "conformity": getattr(VERDICT, f"CONFORMITY_{conformity}"),
        "diagnosis": getattr(VERDICT, f"DIAGNOSIS_{diagnosis}"),
    }
    ended = {"run_over": True, "outcome": VERDICT.OUTCOME_FINISHED}
    return VERDICT(**{**ended, "worst_error": 3e-6} | codes | changed)


def step_of_the_xml(verdict):
    """Return what measure_machine.xml does with a verdict."""
    known = {"diagnosis": verdict.diagnosis, "conformity": verdict.conformity}

    def holds(node):
        code = node.get("code").replace("&&", "and")
        return eval(code, {"__builtins__": {}}, known)

    fallback = ElementTree.parse(EXAMPLES / "measure_machine.xml").find(".//Fallback")
    for child in fallback:
        if all(map(holds, child.iter("ScriptCondition"))):
            tags = {node.tag for node in child.iter()}
            acts = {"CompensateMachine": COMPENSATE, "CallService": SERVICE}
            return next((step for tag, step in acts.items() if tag in tags), GO_ON)
    raise AssertionError("the tree leaves a verdict open")


@pytest.mark.parametrize(("conformity", "diagnosis"), CELLS)
def test_both_examples_decide_by_the_same_table(conformity, diagnosis):
    verdict = verdict_of(conformity, diagnosis)
    step = NOT_SERVICE.get((conformity, diagnosis), SERVICE)
    assert EXAMPLE["decision"](verdict).step == step
    assert step_of_the_xml(verdict) == step


def test_the_table_has_a_cell_for_each_code():
    names = [name for name in dir(VERDICT) if name.startswith(("CONFORMITY_", "DIAGNOSIS_"))]
    assert len({one for cell in CELLS for one in cell}) == len(names)


@pytest.mark.parametrize(
    "changed",
    [
        {"worst_error": nan},
        {"run_over": False},
        {"outcome": VERDICT.OUTCOME_ABORTED},
        {"outcome": VERDICT.OUTCOME_UNKNOWN},
    ],
)
def test_nothing_goes_on_without_a_figure_on_the_whole_run(changed):
    for conformity, diagnosis in CELLS:
        verdict = verdict_of(conformity, diagnosis, **changed)
        assert EXAMPLE["decision"](verdict).step == SERVICE


def test_a_sequencer_that_was_never_there_is_told_from_one_that_is_silent(monkeypatch):
    supervisor = EXAMPLE["Supervisor"].__new__(EXAMPLE["Supervisor"])
    monkeypatch.setattr(supervisor, "get_namespace", lambda: "/elsewhere", raising=False)
    nodes = [("sequencer", "/cell_1"), ("solver", "/cell_2")]
    monkeypatch.setattr(supervisor, "get_node_names_and_namespaces", lambda: nodes, raising=False)
    supervisor._heard = time.monotonic() - 5.0
    supervisor._found = False
    supervisor.check()  # it may still be discovered
    supervisor._heard = time.monotonic() - 11.0
    with refused(TimeoutError, None, "/elsewhere", "/cell_1", "ROS_DOMAIN_ID"):
        supervisor.check()
    supervisor._found, supervisor._text = True, "measuring"
    supervisor._heard = time.monotonic() - 3.0
    with pytest.raises(TimeoutError) as info:
        supervisor.check()
    assert "/elsewhere" not in str(info.value) and "measuring" in str(info.value)
