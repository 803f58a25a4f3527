"""A recorder that is killed or stopped while a run begins: said within seconds, with what to do."""

import os
import signal
import time
from pathlib import Path

import pytest

from stepdiag_ros.run.sequence import State
from stepdiag_ros.session.cell import simulated_cell
from stepdiag_ros.session.following import RunFailed
from stepdiag_ros.session.measure import Session

AT_ONCE = 3.0
"""Real seconds within which it must be said what is wrong."""
LATE = 3.0
"""Real seconds that a loaded computer may add."""


def process_of(node: str) -> int | None:
    """Return the process of a node that this process has started."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            command = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if parent == os.getpid() and f"stepdiag_ros.nodes.{node}".encode() in command:
            return int(folder.name)
    return None


class Onlooker:
    """Hears what a session tells, and sends the recorder a signal as soon as it is there."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number
        self.process: int | None = None
        self.sent = 0.0
        self.said: list[tuple[float, str]] = []

    def __call__(self, told) -> None:
        self.said.append((time.monotonic(), told.text))
        if self.process is None and (found := process_of("recorder")) is not None:
            self.process, self.sent = found, time.monotonic()
            os.kill(found, self.number)

    def first(self, words: str) -> float:
        """Return how many s after the signal these words were said first."""
        return next(when for when, text in self.said if words in text) - self.sent


def nodes(folder: Path, factor: float = 20.0):
    return simulated_cell("quick", "demo", "demo", folder, factor, 0.0, 1)


def test_a_recorder_that_is_killed_before_its_bag_exists_is_said_to_be_killed(tmp_path):
    looking = Onlooker(signal.SIGKILL)
    with pytest.raises(RunFailed) as failed:
        Session(nodes(tmp_path), tmp_path, looking).measure()
    # Ending the other nodes takes time too, but no run was begun that would have to be stopped.
    assert time.monotonic() - looking.sent < AT_ONCE + LATE + 5.0
    said = str(failed.value)
    assert "recorder" in said and "SIGKILL" in said and "no bag" in said
    assert "it said nothing" not in said
    assert not list(tmp_path.glob("*.mcap"))


def test_a_recorder_that_is_stopped_while_it_starts_is_named_and_the_run_goes_on(tmp_path):
    looking = Onlooker(signal.SIGSTOP)

    def tell(told) -> None:
        looking(told)
        if looking.process and time.monotonic() - looking.sent > 8.0 and looking.number:
            looking.number = 0
            os.kill(looking.process, signal.SIGCONT)

    bag = Session(nodes(tmp_path), tmp_path, tell).measure()
    assert looking.first(f"kill -CONT {looking.process}") < AT_ONCE + LATE
    assert bag.is_file()


def start_with_stopped(cell, process: int) -> float:
    """Start a run whose recorder was ready and is stopped; return when it was, s.

    A recorder may be stopped in the moment in which it asks a node that it has heard only now:
    then it is not ready, the run is not begun, and another moment has to be found.
    """
    for _ in range(10):
        os.kill(process, signal.SIGSTOP)
        stopped = time.monotonic()
        try:
            cell.operator.start()
            return stopped
        except ValueError as refused:
            os.kill(process, signal.SIGCONT)
            if "recorder" not in str(refused):
                raise
            cell.operator.spin_until(lambda: False, 1.0)
    raise AssertionError("the recorder is never ready")


def test_a_recorder_that_is_stopped_as_a_run_begins_holds_it_until_it_wakes(make_cell):
    with make_cell(factor=20.0) as cell:
        recorder = cell.processes.running["recorder"]
        stopped = start_with_stopped(cell, recorder.pid)
        try:
            cell.wait(
                lambda: "kill -CONT" in cell.operator.text and "recorder" in cell.operator.text,
                AT_ONCE + LATE,
                "it is said that the recorder is silent",
            )
            assert cell.state() == State.IDLE
            # Longer than a node that is awake may take: the run is still to begin.
            cell.operator.spin_until(lambda: False, 8.0 - (time.monotonic() - stopped))
            assert cell.state() == State.IDLE and cell.operator.result is None
        finally:
            os.kill(recorder.pid, signal.SIGCONT)
        cell.wait_for_state(State.RUNNING, 20.0)
        cell.wait_for_state(State.FINISHED, 120.0)
        cell.wait(cell.bag_is_closed, 30.0, "the bag is closed")
