"""``stepdiag cell`` waits for the run of another process, and ends with all its nodes."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from patience import PATIENCE

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.run.sequence import State

pytestmark = pytest.mark.usefixtures("room")
CLI = (sys.executable, "-m", "stepdiag_ros.cli")


def is_running(process_id):
    """Say whether a process is there and is more than an entry that waits for its parent."""
    try:
        return Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def children_of(process_id):
    return Path(f"/proc/{process_id}/task/{process_id}/children").read_text().split()


def started(*arguments):
    return subprocess.Popen([*CLI, "cell", *map(str, arguments)], stderr=subprocess.PIPE, text=True)


def ended(cell, nodes, number=signal.SIGINT, code=130):
    """Interrupt a cell; see that it and all its nodes end."""
    cell.send_signal(number)
    _, said = cell.communicate(timeout=PATIENCE)
    assert cell.returncode == code, said
    leave(nodes)


def leave(nodes):
    """See that no node stays behind."""
    deadline = time.monotonic() + PATIENCE
    while any(map(is_running, nodes)):
        assert time.monotonic() < deadline, "the cell has left nodes behind"
        time.sleep(0.05)


def test_a_run_of_another_process_and_an_end_with_all_nodes(tmp_path):
    of_cell = ("--namespace", "/cell_1")
    cell, nodes = started("--plan", "quick", "--factor", "20", "-o", tmp_path, *of_cell), []
    try:
        assert any("nodes are up" in line for line in cell.stderr), "the cell has ended"
        nodes = children_of(cell.pid)
        assert len(nodes) > 5
        assert not list(tmp_path.glob("*.mcap")), "a run has begun that nobody started"
        # Another namespace does not help: both would publish simulated time.
        second = subprocess.run([*CLI, "cell"], capture_output=True, text=True, timeout=PATIENCE)
        assert second.returncode == 1 and "/cell_1/clock" in second.stderr
        done = subprocess.run(
            [*CLI, "measure", "--json", *of_cell], capture_output=True, text=True, timeout=PATIENCE
        )
        assert done.returncode == 0, done.stderr
        document = json.loads(done.stdout)
        assert document["outcome"] == "finished"
        assert Path(document["bag"]).parent == tmp_path
        assert any(document["bag"] in line for line in cell.stderr), "the cell names no bag"
    finally:
        ended(cell, nodes)


def parameter_file(folder):
    """Return a cell of simulated devices as a machine would be described, on the real clock."""
    given = {name: {"device": "simulated"} for name in ("cnc_bridge", "weather", "interferometer")}
    given |= {"recorder": {"folder": str(folder / "bags")}, "sequencer": {"plan": "quick"}}
    given |= {"assembler": {}}
    # A computer that is busy with all nodes at once is no danger to this machine.
    for name in ("interferometer", "assembler", "recorder"):
        given[name]["reading_timeout"] = 30.0
    given["cnc_bridge"] |= {"silence_limit": 10.0, "position_timeout": 30.0}
    given["recorder"]["position_timeout"] = 30.0
    for own in given.values():
        own["heartbeat_timeout"] = 30.0
    path = folder / "cell.yaml"
    path.write_text(
        json.dumps({f"/**/{name}": {"ros__parameters": own} for name, own in given.items()})
    )
    return path


def asked(command):
    return subprocess.run(
        [*CLI, command, "--namespace", "/cell_1"], capture_output=True, text=True, timeout=PATIENCE
    )


def test_the_nodes_of_a_machine_wait_for_a_run_and_end_together(tmp_path):
    path = parameter_file(tmp_path)
    cell, nodes = started("--parameters", path, "--namespace", "cell_1"), []
    try:
        said = next(line for line in cell.stderr if "nodes are up" in line)
        assert "/cell_1" in said and f"{tmp_path}/bags" in said
        nodes = children_of(cell.pid)
        asked_too_soon = asked("pause")
        assert asked_too_soon.returncode == 1, "a run has begun that nobody started"
        assert not asked_too_soon.stdout and asked_too_soon.stderr.count("\n") == 1
        measuring = subprocess.Popen(
            [*CLI, "measure", "--namespace", "/cell_1"], stderr=subprocess.PIPE, text=True
        )
        assert any("stops are measured" in line for line in measuring.stderr), "no run"
        # What is told before the first move is of a run that may still wait for nodes.
        end = time.monotonic() + PATIENCE
        while asked("pause").returncode:
            assert time.monotonic() < end, "a run that cannot be paused"
        assert asked("abort").returncode == 0
        measuring.communicate(timeout=PATIENCE)
        assert measuring.returncode == 1
        # A dispensable node ends nothing, and is named.
        for node in nodes:
            if Path(f"/proc/{node}/fd/1").readlink().name == "diagnosis.log":
                os.kill(int(node), signal.SIGKILL)
        assert "diagnosis" in next(line for line in cell.stderr if "SIGKILL" in line)
        assert cell.poll() is None
    finally:
        ended(cell, nodes, signal.SIGTERM, -signal.SIGTERM)
    assert [path.parent.name for path in tmp_path.rglob("*.mcap")] == ["bags"]


@pytest.mark.parametrize("victim", ["interferometer", "sequencer"])
def test_a_node_that_is_killed_ends_the_run_for_all_who_follow_it(tmp_path, victim):
    cell = started("--plan", "quick", "--factor", "5", "-o", tmp_path, "--namespace", "/cell_1")
    try:
        assert any("nodes are up" in line for line in cell.stderr), "the cell has ended"
        nodes = children_of(cell.pid)
        measuring = subprocess.Popen(
            [*CLI, "measure", "--namespace", "/cell_1"], stderr=subprocess.PIPE, text=True
        )
        going = (line for line in measuring.stderr if "stops are measured" in line)
        assert any(": 0 of " not in line for line in going), "no run"
        (process,) = (
            node for node in nodes if Path(f"/proc/{node}/fd/1").readlink().name == f"{victim}.log"
        )
        os.kill(int(process), signal.SIGKILL)
        measuring.communicate(timeout=PATIENCE)
        assert measuring.returncode == 1
    finally:
        _, said = cell.communicate(timeout=PATIENCE)
    assert cell.returncode == 1 and "SIGKILL" in said
    leave(nodes)
    # What everybody heard last of the run is that it has ended.
    (bag,) = tmp_path.glob("*.mcap")
    last = State(load_run(bag).states[-1].state)
    # What the sequencer commands it reports itself: where it is killed, nobody can.
    assert last is (State.RUNNING if victim == "sequencer" else State.ABORTED)
