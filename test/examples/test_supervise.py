"""The example of a supervisor in a simulated cell: a run with setups, and a sequencer that dies."""

import runpy
import subprocess
import sys
from math import isnan, nan
from pathlib import Path

import pytest
from patience import PATIENCE
from ros_processes import domain
from running_cell import TWO_LINES, RunningCell

from stepdiag_ros import topics
from stepdiag_ros.run.sequence import State

__all__ = ["domain"]
EXAMPLE = Path(__file__).parents[2] / "docs/examples/supervise.py"


@pytest.fixture
def supervised(tmp_path):
    """Return a running cell and what starts the supervisor of its plan, which pauses for setups."""
    plan = tmp_path / "plan.yaml"
    plan.write_text(TWO_LINES.replace("pause_for_setup: false", "pause_for_setup: true"))

    def start():
        told = [sys.executable, str(EXAMPLE), str(plan)]
        return subprocess.Popen(told, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    with RunningCell(tmp_path, [topics.RUN_VERDICT], plan="quick") as cell:
        yield cell, start


def test_a_run_is_supervised_to_its_end_and_a_silent_sequencer_is_a_fault(supervised):
    cell, start = supervised
    supervisor = start()
    cell.wait(lambda: supervisor.poll() is not None, "the supervisor has ended")
    out, err = supervisor.communicate(timeout=PATIENCE)
    assert cell.state() is State.FINISHED and str(cell.bag()) in out, err
    # Two lines do not determine the largest error in the volume.
    last = cell.said[topics.RUN_VERDICT][-1]
    assert last.run_over and isnan(last.worst_error) and last.lines == last.lines_planned == 2
    assert supervisor.returncode == 1 and "unknown" in out and "NOT TESTABLE" in out

    supervisor = start()
    cell.wait(lambda: cell.state() is State.RUNNING, "the second run is on")
    cell.processes.running["sequencer"].kill()
    _, err = supervisor.communicate(timeout=PATIENCE)
    assert supervisor.returncode == 1 and "sequencer" in err and "Traceback" not in err


@pytest.mark.parametrize(
    ("changed", "starts"),
    [
        ({}, "go on"),
        ({"conformity": "NOT_ASKED"}, "go on"),
        ({"conformity": "NOT_WITHIN"}, "compensate"),
        ({"conformity": "UNDECIDED"}, "call a metrologist"),
        ({"diagnosis": "NAMED", "conformity": "UNDECIDED"}, "call service"),
        ({"diagnosis": "NOT_TESTABLE"}, "go on, but"),
        ({"worst_error": nan}, "measure again"),
        ({"run_over": False}, "measure again"),
    ],
)
def test_the_cell_decides_by_the_verdict_alone(changed, starts):
    example = runpy.run_path(str(EXAMPLE))
    kind = example["RunVerdict"]
    given = {"run_over": True, "worst_error": 3e-6} | changed
    codes = {"conformity": given.pop("conformity", "WITHIN")}
    codes["diagnosis"] = given.pop("diagnosis", "CONSISTENT")
    numbers = {name: getattr(kind, f"{name.upper()}_{code}") for name, code in codes.items()}
    decided = example["decision"](kind(**given, **numbers))
    assert decided.startswith(starts) and (decided == "go on") == (starts == "go on")
