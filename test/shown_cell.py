"""A simulated cell, what shows it, and an operator who hears it: for tests of all that shows."""

import re

import pytest
from patience import PATIENCE

import stepdiag_ros  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.run.sequence import State


class ShownCell:
    """All nodes of a simulated cell and those that show it; what was said on some topics."""

    def __init__(self, folder, kept, shown=()):
        import rclpy

        from stepdiag_ros.nodes.operator import OperatorNode
        from stepdiag_ros.session.cell import simulated_cell
        from stepdiag_ros.session.processes import NodeProcess, Processes

        self.folder = folder
        cell = simulated_cell("quick", "demo", "demo", folder, 10.0, 0.0, 1)
        more = [NodeProcess(name, {"use_sim_time": True, **given}) for name, given in shown]
        self._shown = [name for name, _ in shown]
        self.count = len(cell) + len(more)
        self.processes = Processes([*cell, *more], folder / "logs")
        rclpy.init(args=[])
        self.operator = OperatorNode()
        self.said = {topic: [] for topic in kept}
        for topic, heard in self.said.items():
            self.operator.listen(topic, heard.append)

    def __enter__(self):
        self.processes.__enter__()
        peers = self.operator.watch.peers
        self.wait(
            lambda: len(peers) == self.count and not any(one.faulty for one in peers.values()),
            "all nodes are up",
        )
        return self

    def __exit__(self, *_):
        import rclpy

        self.processes.end()
        rclpy.try_shutdown()

    def wait(self, condition, what):
        if not self.operator.spin_until(condition, PATIENCE):
            raise AssertionError(f"not in {PATIENCE} s: {what}\n{self.last_words()}")

    def last_words(self):
        """Return what is to be read where something does not come."""
        return "\n".join(self.log(name)[-3000:] for name in self._shown)

    def log(self, name):
        return (self.folder / "logs" / f"{name}.log").read_text(errors="replace")

    def logged_once(self, name, pattern):
        """Return what the one group of a pattern holds in the log of a node."""
        return re.search(pattern, self.log(name)).group(1)

    def state(self):
        states = self.said[topics.RUN_STATE]
        return State(states[-1].state) if states else None

    def bag(self):
        return next(iter(self.folder.glob("*.mcap")))


def fixture_of(kind):
    """Return a fixture that holds a cell of this kind for a module."""

    @pytest.fixture(scope="module")
    def cell(tmp_path_factory):
        with kind(tmp_path_factory.mktemp("cell")) as made:
            yield made

    return cell
