"""A simulated cell of real node processes, and an operator who hears it."""

import re
import time
from contextlib import ExitStack

import pytest
from domains import room_for_a_cell
from patience import PATIENCE

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.run.sequence import State

TICK = 0.01
"""Seconds between two ticks of simulated time.

Every tick wakes ten nodes: at the default of 4 ms that is a third of what a run costs.
"""


BUSY = 20.0
"""Seconds for which a computer that runs several cells may let a node wait."""


def nodes_of(
    folder, plan="quick", factor=10.0, cell="demo", rate=0.0, tick=TICK, heartbeat_timeout=BUSY
):
    """Return the nodes of a simulated cell, for a run that takes little of the processor.

    ``heartbeat_timeout``: after which a node counts as lost, s.
    """
    from stepdiag_ros.processes.cell import simulated_cell

    nodes = simulated_cell(plan, "demo", cell, folder, factor, rate, 1)
    (clock,) = (node for node in nodes if node.name == "clock")
    clock.parameters["period"] = tick
    for node in nodes:
        node.parameters["heartbeat_timeout"] = heartbeat_timeout
    return nodes


TWO_LINES = """
name: two lines
step_m: [0.02, 0.02, 0.02]
blocks: 2
feed_m_per_s: 0.1
pause_for_setup: false
lines:
  - {kind: linear, names: [x]}
  - {kind: step_diagonal, names: [ppp]}
sampling: {dwell_s: 0.1, settle_s: 0.1, window_s: 0.1}
"""
"""A plan for what only has to begin and to end."""


class RunningCell:
    """All nodes of a simulated cell and those that show it; what was said on some topics.

    Args:
        folder: for bags and logs.
        kept: topics of which every message is kept in ``said``, beside the state of the run.
        shown: name and parameters of each node that shows the cell.
        options: of ``nodes_of``.
    """

    def __init__(self, folder, kept, shown=(), **options):
        import rclpy

        from stepdiag_ros.nodes.operator import OperatorNode
        from stepdiag_ros.processes.node_process import NodeProcess, Processes

        self.folder = folder
        more = [NodeProcess(name, {"use_sim_time": True, **given}) for name, given in shown]
        self._shown = [name for name, _ in shown]
        self.nodes = {node.name: node for node in (*nodes_of(folder, **options), *more)}
        self.processes = Processes(list(self.nodes.values()), folder / "logs")
        rclpy.init(args=[])
        self.operator = OperatorNode()
        self.said = {topic: [] for topic in {topics.RUN_STATE, *kept}}
        for topic, heard in self.said.items():
            self.operator.listen(topic, heard.append, keep_all=True)

    def __enter__(self):
        with ExitStack() as begun:
            begun.enter_context(room_for_a_cell())
            begun.callback(self._end)
            self.processes.__enter__()
            peers = self.operator.watch.peers
            self.wait(
                lambda: len(peers) == len(self.nodes) and not any(p.faulty for p in peers.values()),
                "all nodes are up",
            )
            self._begun = begun.pop_all()
        return self

    def __exit__(self, *_):
        self._begun.close()

    def _end(self):
        import rclpy

        self.processes.end()
        rclpy.try_shutdown()

    def wait(self, condition, what):
        """Wait until a condition holds.

        A look at it may take long, as one into a browser does on a busy computer: the operator
        listens for as long after it, so that what is heard does not fall behind what is said.
        """

        def holds():
            begun = time.monotonic()
            if condition():
                return True
            self.operator.spin_until(lambda: False, time.monotonic() - begun)
            return False

        if not self.operator.spin_until(holds, PATIENCE):
            raise AssertionError(f"not in {PATIENCE} s: {what}\n{self.last_words()}")

    def last_words(self):
        """Return what is to be read where something does not come."""
        names = self._shown or self.nodes
        return "\n".join(f"== {name}\n{self.log(name)[-1500:]}" for name in names)

    def log(self, name):
        return (self.folder / "logs" / f"{name}.log").read_text(errors="replace")

    def logged_once(self, name, pattern):
        """Return what the one group of a pattern holds in the log of a node."""
        return re.search(pattern, self.log(name)).group(1)

    def state(self):
        """Return the state that was heard last; None before."""
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
