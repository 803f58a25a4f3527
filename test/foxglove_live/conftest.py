"""A simulated cell with the scene and the server for Foxglove, and an operator who leads it."""

import os
import re
import signal

import pytest

import stepdiag_ros  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.run.sequence import State

DOMAIN = os.getpid() % 30 + 201


@pytest.fixture(scope="module", autouse=True)
def domain():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)


class ServedCell:
    """All nodes of a simulated cell, what shows it, and the state of its run."""

    def __init__(self, folder):
        import rclpy

        from stepdiag_ros.nodes.operator import OperatorNode
        from stepdiag_ros.session.cell import simulated_cell
        from stepdiag_ros.session.processes import NodeProcess, Processes

        self.folder = folder
        cell = simulated_cell("quick", "demo", "demo", folder, 10.0, 0.0, 1)
        simulated = {"use_sim_time": True}
        shown = [
            NodeProcess("scene", simulated),
            NodeProcess("foxglove_server", {**simulated, "port": 0}),
        ]
        self.count = len(cell) + len(shown)
        self.processes = Processes([*cell, *shown], folder / "logs")
        rclpy.init(args=[])
        self.operator = OperatorNode()
        self.states = []
        self.operator.listen(topics.RUN_STATE, self.states.append)

    def __enter__(self):
        self.processes.__enter__()
        peers = self.operator.watch.peers
        self.wait(
            lambda: len(peers) == self.count and not any(one.faulty for one in peers.values()),
            "all nodes are up",
            120.0,
        )
        return self

    def __exit__(self, *_):
        import rclpy

        self.processes.end()
        rclpy.try_shutdown()

    def wait(self, condition, what, limit=90.0):
        if not self.operator.spin_until(condition, limit):
            raise AssertionError(f"not in {limit} s: {what}\n{self.log()[-3000:]}")

    def log(self):
        path = self.folder / "logs" / "foxglove_server.log"
        return path.read_text(errors="replace")

    @property
    def port(self):
        return int(re.search(r"viewers connect to ws://127\.0\.0\.1:(\d+)", self.log()).group(1))

    def state(self):
        return State(self.states[-1].state) if self.states else None

    def bag(self):
        return next(iter(self.folder.glob("*.mcap")))


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    with ServedCell(tmp_path_factory.mktemp("cell")) as made:
        yield made
