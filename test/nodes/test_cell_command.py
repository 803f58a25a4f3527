"""``stepdiag cell`` waits for the run of another process, and ends with all its nodes."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from patience import PATIENCE

CLI = (sys.executable, "-m", "stepdiag_ros.cli")


def is_running(process_id):
    """Say whether a process is there and is more than an entry that waits for its parent."""
    try:
        return Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def children_of(process_id):
    return Path(f"/proc/{process_id}/task/{process_id}/children").read_text().split()


def test_a_run_of_another_process_and_an_end_with_all_nodes(tmp_path):
    cell = subprocess.Popen(
        [*CLI, "cell", "--plan", "quick", "--factor", "20", "-o", str(tmp_path)],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert any("nodes are up" in line for line in cell.stderr), "the cell has ended"
        nodes = children_of(cell.pid)
        assert len(nodes) > 5
        assert not list(tmp_path.glob("*.mcap")), "a run has begun that nobody started"
        second = subprocess.run([*CLI, "cell"], capture_output=True, text=True, timeout=PATIENCE)
        assert second.returncode == 1 and "another measurement" in second.stderr
        done = subprocess.run(
            [*CLI, "measure", "--json"], capture_output=True, text=True, timeout=PATIENCE
        )
        assert done.returncode == 0, done.stderr
        document = json.loads(done.stdout)
        assert document["outcome"] == "finished"
        assert Path(document["bag"]).parent == tmp_path
    finally:
        cell.send_signal(signal.SIGINT)
        cell.communicate(timeout=PATIENCE)
    assert cell.returncode == 130
    deadline = time.monotonic() + PATIENCE
    while any(map(is_running, nodes)):
        assert time.monotonic() < deadline, "the cell has left nodes behind"
        time.sleep(0.05)
