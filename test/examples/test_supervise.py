"""The examples of supervisors in a simulated cell: runs with setups, and a sequencer that dies."""

import re
import runpy
import subprocess
import sys
from math import isnan
from pathlib import Path
from signal import SIGINT, SIGTERM

import fake_launch
import pytest
from patience import PATIENCE
from running_cell import TWO_LINES, RunningCell

from stepdiag_ros import topics
from stepdiag_ros.run.sequence import State

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs/examples"
EXAMPLE = EXAMPLES / "supervise.py"
TREE = EXAMPLES / "behaviour_tree.py"
CELL_TEST = EXAMPLES / "test_cell.launch.py"
NO_RESULT = 3
"""Exit code of the example where it has no result."""
ACTIVE_TEST = """
import runpy, sys, unittest, fake_launch
sys.modules.update(fake_launch.modules())
tests = unittest.defaultTestLoader.loadTestsFromTestCase(runpy.run_path(sys.argv[1])["TestRun"])
sys.exit(not unittest.TextTestRunner().run(tests).wasSuccessful())
"""
"""Executes the part of the launch test that ROS 2 executes while the nodes run."""


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    with RunningCell(folder, [topics.RUN_VERDICT], plan="quick") as made:
        yield made


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    """Return the file of a plan that pauses for setups."""
    path = tmp_path_factory.mktemp("plan") / "plan.yaml"
    path.write_text(TWO_LINES.replace("pause_for_setup: false", "pause_for_setup: true"))
    return path


def started(*command):
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    folder = ROOT / "test"
    return subprocess.Popen([sys.executable, *map(str, command)], cwd=folder, text=True, **pipes)


def ended(cell, process):
    """Return what a process has written, when it has ended."""
    cell.wait(lambda: process.poll() is not None, "the process has ended")
    return process.communicate(timeout=PATIENCE)


def test_the_active_test_of_the_launch_test_passes(cell):
    test = started("-c", ACTIVE_TEST, CELL_TEST)
    _, err = ended(cell, test)
    assert test.returncode == 0 and "Ran 1 test" in err, err
    assert cell.said[topics.RUN_VERDICT][-1].lines == 6


def test_the_launch_test_starts_the_simulated_cell_with_arguments_that_it_has(monkeypatch):
    for name, module in fake_launch.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    (entities,) = runpy.run_path(str(CELL_TEST))["generate_test_description"]().arguments
    included, ready = entities
    (file,) = included.arguments
    assert type(ready).__name__ == "ReadyToTest" and file[0].arguments == ("stepdiag_ros",)
    launch_file = ROOT / file[1].removeprefix("/")
    arguments = set(re.findall(r'^    "(\w+)": Argument\(', launch_file.read_text(), re.MULTILINE))
    assert {name for name, _ in included.options["launch_arguments"]} < arguments


def test_a_behaviour_tree_measures_and_acts_on_the_verdict(cell, plan):
    behaviour = started(TREE, plan, "generic")
    out, err = ended(cell, behaviour)
    assert cell.state() is State.FINISHED, err
    # Two lines determine no largest error, so the tree may neither go on nor compensate.
    assert behaviour.returncode == 1 and "call service: " in out
    last = cell.said[topics.RUN_VERDICT][-1]
    assert last.run_id in out and statuses(out)["measure the machine"] == "✓"

    behaviour = started(TREE, "quick", "generic")
    cell.wait(lambda: cell.state() is State.RUNNING, "the second run is on")
    behaviour.send_signal(SIGINT)
    _, err = ended(cell, behaviour)
    cell.wait(lambda: cell.state() is State.ABORTED, "the halted tree has cancelled its run")
    assert behaviour.returncode == 1 and "Traceback" not in err


def statuses(shown):
    """Return the status signs of a printed tree by the names of its leaves."""
    found = re.findall(r"--> (.+?) \[(.)\]", re.sub(r"\x1b\[[0-9;]*m", "", shown))
    return dict(found)


def test_a_run_is_supervised_to_its_end_and_a_silent_sequencer_is_a_fault(cell, plan):
    supervisor = started(EXAMPLE, plan)
    out, err = ended(cell, supervisor)
    assert cell.state() is State.FINISHED, err
    # Two lines do not determine the largest error in the volume.
    last = cell.said[topics.RUN_VERDICT][-1]
    assert last.run_over and isnan(last.worst_error) and last.lines == last.lines_planned == 2
    assert any(str(bag) in out and last.run_id in bag.name for bag in cell.folder.glob("*.mcap"))
    assert supervisor.returncode == 1 and "unknown" in out and "NOT TESTABLE" in out

    supervisor = started(EXAMPLE, "nonsense")
    out, err = ended(cell, supervisor)
    # Of a refused goal only the reason is of use: there is no run, no verdict and no bag.
    assert supervisor.returncode == NO_RESULT and not out and "nonsense" in err
    assert "Traceback" not in err

    for end in (SIGINT, SIGTERM):
        supervisor = started(EXAMPLE, plan)
        cell.wait(lambda: cell.state() is State.RUNNING, "another run is on")
        supervisor.send_signal(end)
        _, err = ended(cell, supervisor)
        cell.wait(lambda: cell.state() is State.ABORTED, "the run is cancelled")
        assert supervisor.returncode == NO_RESULT and "Traceback" not in err
        # The client library names itself; the example says why it ends, and where the bag is.
        assert len(err.splitlines()) == 3 and "stepdiag recover" in err, err

    supervisor = started(EXAMPLE, plan)
    cell.wait(lambda: cell.state() is State.RUNNING, "the last run is on")
    cell.processes.running["sequencer"].kill()
    _, err = supervisor.communicate(timeout=PATIENCE)
    assert supervisor.returncode == NO_RESULT and "sequencer" in err and "Traceback" not in err
    assert re.search(r"run \d{8}T\d{6}Z-\w+: ", err) and "stepdiag recover" in err
