"""A simulated cell of real node processes, watched by an operator in the test."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from domains import own_domain
from patience import PATIENCE
from ros_processes import nodes_ended
from running_cell import RunningCell

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.run.sequence import State

VIBRATION = 1e-9
"""m: an axis that has come to rest swings by less."""


@pytest.fixture(autouse=True)
def domain() -> Iterator[int]:
    """Give each test a ROS domain of its own, and leave nothing there."""
    with own_domain() as number, nodes_ended():
        yield number


class CellUnderTest(RunningCell):
    """The cell; stops, lines, positions and answers that were heard, and what its nodes said."""

    def __init__(self, folder: Path, **options: Any) -> None:
        from stepdiag_ros import topics

        kept = (topics.STOP, topics.LINE, topics.JOINT_STATES, topics.COMMAND_STATUS)
        super().__init__(folder, kept, **options)
        self.stops, self.lines, self.positions, self.statuses = (self.said[one] for one in kept)
        self.machine = None
        self.told: dict[str, list[tuple[float, str]]] = {}
        self.operator.listen(
            topics.MACHINE_STATE, lambda message: setattr(self, "machine", message)
        )
        self.operator.listen(topics.DIAGNOSTICS, self._hear)

    def _hear(self, array: Any) -> None:
        for status in array.status:
            values = {entry.key: entry.value for entry in status.values}
            if "role" in values:
                told = self.told.setdefault(values["role"], [])
                told.append((time.monotonic(), status.message))

    def start(self, plan: str = "") -> str:
        return self._insist(lambda: self.operator.start(plan))

    def resume(self) -> None:
        """Resume as an operator would: again, until the node that was started is up."""
        self._insist(lambda: self.operator.call("sequencer/resume"))
        self.wait_for_state(State.RUNNING)

    def _insist(self, ask: Callable[[], str]) -> str:
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                return ask()
            except ValueError:
                if time.monotonic() > deadline:
                    raise
                self.operator.spin_until(lambda: False, 0.2)

    def state(self) -> State | None:
        """Return the state of the run that this operator has started."""
        return None if self.operator.state is None else State(self.operator.state.state)

    def wait_for_state(self, state: int) -> None:
        """Wait for a state of the run; a run that is to finish must not be stopped on the way."""
        stopped = {State.FAULT, State.ABORTED} if state == State.FINISHED else set()
        self.wait(lambda: self.state() in {state, *stopped}, f"run state {state}")
        assert self.state() == state, f"{self.operator.state}\n{self.last_words()}"

    def stands_still_after(self, said: Any) -> None:
        """Assert that the machine has come to rest, from its own encoders.

        Args:
            said: message after which it must; on a busy computer positions come long after it.
        """
        rest = to_nanoseconds(said.header.stamp) + 500_000_000
        heard = len(self.positions)
        while heard and to_nanoseconds(self.positions[heard - 1].header.stamp) > rest:
            heard -= 1

        def after() -> list[tuple[float, ...]]:
            late = (m for m in self.positions[heard:] if to_nanoseconds(m.header.stamp) > rest)
            return [tuple(message.position) for message in late]

        self.wait(lambda: len(after()) > 10, "positions go on")
        assert np.ptp(after(), axis=0).max() < VIBRATION, "the machine moves"

    def bag_is_closed(self) -> bool:
        recorders = [p for p in self.operator.watch.peers.values() if p.role == "recorder"]
        return any(peer.text.startswith("ready; recorded") for peer in recorders)

    def kill(self, name: str) -> None:
        process = self.processes.running[name]
        process.kill()
        process.wait()

    def restart(self, name: str) -> None:
        self.processes.start(self.nodes[name])

    def said_since(self, role: str, since: float) -> list[str]:
        return [text for when, text in self.told.get(role, []) if when >= since]


@pytest.fixture
def make_cell(tmp_path: Path) -> Iterator[Callable[..., CellUnderTest]]:
    def make(**options: Any) -> CellUnderTest:
        return CellUnderTest(tmp_path, **options)

    return make
