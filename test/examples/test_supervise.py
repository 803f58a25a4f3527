"""The example of a supervisor in a simulated cell: a run with setups, and a sequencer that dies."""

import subprocess
import sys
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

    with RunningCell(tmp_path, [topics.VOLUMETRIC_ERRORS], plan="quick") as cell:
        yield cell, start


def test_a_run_is_supervised_to_its_end_and_a_silent_sequencer_is_a_fault(supervised):
    cell, start = supervised
    supervisor = start()
    cell.wait(lambda: supervisor.poll() is not None, "the supervisor has ended")
    out, err = supervisor.communicate(timeout=PATIENCE)
    assert supervisor.returncode == 0, err
    assert cell.state() is State.FINISHED and str(cell.bag()) in out
    solved = [one for one in cell.said[topics.VOLUMETRIC_ERRORS] if one.method == "least_squares"]
    curves = [getattr(solved[-1], f"e_{error}{axis}") for axis in "xyz" for error in "xyz"]
    worst = max(abs(value) for curve in curves for value in curve if value == value)
    assert f"{worst * 1e6:.2f} µm" in out and "NOT TESTABLE" in out

    supervisor = start()
    cell.wait(lambda: cell.state() is State.RUNNING, "the second run is on")
    cell.processes.running["sequencer"].kill()
    _, err = supervisor.communicate(timeout=PATIENCE)
    assert supervisor.returncode == 1 and "sequencer" in err and "Traceback" not in err
