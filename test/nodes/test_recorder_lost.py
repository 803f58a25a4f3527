"""A recorder that is killed or stopped while a run begins: it is said, with what to do.

How soon it is said, and how long a run waits, is tested in ``run/test_taking_up.py``.
"""

import os
import signal
from collections.abc import Callable

import pytest
from running_cell import TWO_LINES, nodes_of

from stepdiag_ros.processes.following import RunFailed
from stepdiag_ros.processes.measure import MeasuringSession
from stepdiag_ros.processes.node_process import NodeProcess, Processes
from stepdiag_ros.run.sequence import State

pytestmark = pytest.mark.usefixtures("room")


@pytest.fixture
def meddle(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], list[int]]:
    """Return a function that sends a signal to the recorder's process as soon as there is one."""

    def meddle(number: int) -> list[int]:
        process: list[int] = []
        start = Processes.start

        def started(processes: Processes, node: NodeProcess) -> None:
            start(processes, node)
            if node.name == "recorder":
                process.append(processes.running["recorder"].pid)
                os.kill(process[0], number)

        monkeypatch.setattr(Processes, "start", started)
        return process

    return meddle


@pytest.fixture
def nodes(tmp_path):
    plan = tmp_path / "plan.yaml"
    plan.write_text(TWO_LINES)
    return nodes_of(tmp_path, plan=str(plan))


def test_a_recorder_that_is_killed_before_its_bag_exists_is_said_to_be_killed(
    tmp_path, meddle, nodes
):
    meddle(signal.SIGKILL)
    said: list[str] = []
    with pytest.raises(RunFailed) as failed:
        MeasuringSession(nodes, tmp_path, lambda told: said.append(told.text)).measure()
    told = str(failed.value)
    assert "recorder" in told and "SIGKILL" in told and "no bag" in told
    assert "it said nothing" not in told
    # No run was begun that would have to be stopped.
    assert "the run is stopped; waiting for its bag" not in said
    assert not list(tmp_path.glob("*.mcap"))


def test_a_recorder_that_is_stopped_while_it_starts_is_named_and_the_run_goes_on(
    tmp_path, meddle, nodes
):
    process = meddle(signal.SIGSTOP)
    said: list[str] = []

    def tell(told) -> None:
        said.append(told.text)
        if process and f"kill -CONT {process[0]}" in told.text:
            os.kill(process[0], signal.SIGCONT)

    # It is named, or this would never end well.
    assert MeasuringSession(nodes, tmp_path, tell).measure().is_file()
    assert any("the recorder node is stopped" in text for text in said)


def start_with_stopped(cell, process: int) -> None:
    """Start a run whose recorder was ready and is stopped.

    A recorder may be stopped in the moment in which it asks a node that it has heard only now:
    then it is not ready, the run is not begun, and another moment has to be found.
    """
    for _ in range(10):
        os.kill(process, signal.SIGSTOP)
        try:
            cell.operator.start()
            return
        except ValueError as refused:
            os.kill(process, signal.SIGCONT)
            if "recorder" not in str(refused):
                raise
            cell.operator.spin_until(lambda: False, 1.0)
    raise AssertionError("the recorder is never ready")


def test_a_recorder_that_is_stopped_as_a_run_begins_holds_it_until_it_wakes(make_cell, tmp_path):
    plan = tmp_path / "plan.yaml"
    plan.write_text(TWO_LINES)
    with make_cell(plan=str(plan)) as cell:
        recorder = cell.processes.running["recorder"]
        start_with_stopped(cell, recorder.pid)
        try:
            cell.wait(
                lambda: "kill -CONT" in cell.operator.text and "recorder" in cell.operator.text,
                "it is said that the recorder is silent",
            )
            assert cell.state() == State.IDLE
            assert cell.operator.result is None
        finally:
            os.kill(recorder.pid, signal.SIGCONT)
        cell.wait_for_state(State.RUNNING)
        cell.wait_for_state(State.FINISHED)
        cell.wait(cell.bag_is_closed, "the bag is closed")
