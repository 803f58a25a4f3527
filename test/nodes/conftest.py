"""A simulated cell of real node processes, watched by an operator in the test."""

import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from domains import own_domain
from patience import PATIENCE

import stepdiag_ros  # noqa: F401 - makes rclpy importable
from stepdiag_ros.run.sequence import State


@pytest.fixture(autouse=True)
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Give each test a ROS domain of its own, and leave nothing there.

    A node that is only forgotten goes on speaking, to the test that gets its domain next.
    """
    from rclpy.node import Node

    made: list[weakref.ref[Node]] = []
    begin = Node.__init__

    def noted(self: Node, *arguments: object, **options: object) -> None:
        begin(self, *arguments, **options)
        made.append(weakref.ref(self))

    monkeypatch.setattr(Node, "__init__", noted)
    with own_domain() as number:
        yield number
    for one in made:
        node = one()
        if node is not None:
            node.destroy_node()


class CellUnderTest:
    """All nodes of the simulated cell, and what they said."""

    def __init__(
        self, folder: Path, plan: str, factor: float, rate: float = 0.0, cell: str = "demo"
    ) -> None:
        import rclpy

        from stepdiag_ros import topics
        from stepdiag_ros.nodes.operator import OperatorNode
        from stepdiag_ros.session.cell import simulated_cell
        from stepdiag_ros.session.processes import Processes

        self.folder = folder
        self.nodes = {
            node.name: node for node in simulated_cell(plan, "demo", cell, folder, factor, rate, 1)
        }
        self.processes = Processes(list(self.nodes.values()), folder / "logs")
        self.stops, self.lines, self.positions, self.statuses = [], [], [], []
        self.machine = None
        self.said: dict[str, list[tuple[float, str]]] = {}
        rclpy.init(args=[])
        self.operator = OperatorNode()
        self.operator.listen(topics.STOP, self.stops.append)
        self.operator.listen(topics.LINE, self.lines.append)
        self.operator.listen(topics.JOINT_STATES, self.positions.append)
        self.operator.listen(topics.COMMAND_STATUS, self.statuses.append)
        self.operator.listen(
            topics.MACHINE_STATE, lambda message: setattr(self, "machine", message)
        )
        self.operator.listen(topics.DIAGNOSTICS, self._hear)

    def __enter__(self) -> "CellUnderTest":
        self.processes.__enter__()
        peers = self.operator.watch.peers
        self.wait(
            lambda: len(peers) == len(self.nodes) and not any(p.faulty for p in peers.values()),
            "all nodes are up",
        )
        return self

    def __exit__(self, *_: object) -> None:
        import rclpy

        self.processes.end()
        rclpy.try_shutdown()

    def _hear(self, array) -> None:
        for status in array.status:
            values = {entry.key: entry.value for entry in status.values}
            if "role" in values:
                said = self.said.setdefault(values["role"], [])
                said.append((time.monotonic(), status.message))

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        if not self.operator.spin_until(condition, PATIENCE):
            logs = "\n".join(
                f"== {log.name}\n{log.read_text()[-1500:]}"
                for log in sorted((self.folder / "logs").glob("*.log"))
            )
            raise AssertionError(f"not in {PATIENCE} s: {what}\n{logs}")

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

    def state(self) -> int:
        return -1 if self.operator.state is None else self.operator.state.state

    def wait_for_state(self, state: int) -> None:
        """Wait for a state of the run; a run that is to finish must not be stopped on the way."""
        stopped = {State.FAULT, State.ABORTED} if state == State.FINISHED else set()
        self.wait(lambda: self.state() in {state, *stopped}, f"run state {state}")
        assert self.state() == state, self.operator.text

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
        return [text for when, text in self.said.get(role, []) if when >= since]


@pytest.fixture
def make_cell(tmp_path: Path) -> Iterator[Callable[..., CellUnderTest]]:
    def make(
        plan: str = "quick", factor: float = 10.0, rate: float = 0.0, cell: str = "demo"
    ) -> CellUnderTest:
        return CellUnderTest(tmp_path, plan, factor, rate, cell)

    return make
