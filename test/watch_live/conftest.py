"""A simulated cell with one run, a watch that logs it, and an operator who hears all of it."""

import itertools
import os
import signal
import subprocess
import sys

import pytest

import stepdiag_ros  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.run.sequence import State

_domains = itertools.count(os.getpid())
KEPT = (topics.STOP, topics.LINE, topics.VOLUMETRIC_ERRORS, topics.DIAGNOSIS, topics.RUN_STATE)
WATCH = (sys.executable, "-m", "stepdiag_ros.cli", "watch")


@pytest.fixture(scope="module", autouse=True)
def domain():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(next(_domains) % 30 + 201))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)


class WatchedCell:
    """All nodes of the simulated cell; what was said, and what a watch has written of it."""

    def __init__(self, folder):
        import rclpy

        from stepdiag_ros.nodes.operator import OperatorNode
        from stepdiag_ros.session.cell import simulated_cell
        from stepdiag_ros.session.processes import Processes

        self.folder = folder
        nodes = simulated_cell("quick", "demo", "demo", folder, 10.0, 0.0, 1)
        self.count = len(nodes)
        self.processes = Processes(nodes, folder / "logs")
        rclpy.init(args=[])
        self.operator = OperatorNode()
        self.said = {topic: [] for topic in KEPT}
        for topic, kept in self.said.items():
            self.operator.listen(topic, kept.append)
        self._log = (folder / "watch.log").open("w")
        self.watch = subprocess.Popen(
            WATCH,
            stdout=self._log,
            stderr=subprocess.PIPE,
            text=True,
            # A shell lets what it starts in the background ignore Ctrl-C, and its children too.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

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
        if self.watch.poll() is None:
            self.watch.kill()
        self.watch.communicate()
        self._log.close()
        rclpy.try_shutdown()

    def wait(self, condition, what, limit=60.0):
        if not self.operator.spin_until(condition, limit):
            raise AssertionError(f"not in {limit} s: {what}\n" + "\n".join(self.logged()[-20:]))

    def logged(self):
        """Return the lines of the watch, without the time."""
        lines = (self.folder / "watch.log").read_text().splitlines()
        return [line.partition(" ")[2] for line in lines]

    def state(self):
        states = self.said[topics.RUN_STATE]
        return State(states[-1].state) if states else None

    def measure(self):
        """Start the run and follow it to the end of all that is evaluated."""
        self.operator.start()

        def go_on():
            if self.state() is State.WAITING_FOR_SETUP:
                self.operator.call("sequencer/resume")
            return self.state() is State.FINISHED

        self.wait(go_on, "the run is finished", 180.0)
        last = self.said[topics.RUN_STATE][-1]
        self.wait(
            lambda: (
                any(one.run_over for one in self.said[topics.DIAGNOSIS])
                and len(self.said[topics.STOP]) == last.stops_total
                and self.result().lines == last.line_count
            ),
            "all of the run is heard",
        )

    def result(self):
        """Return the newest result by least squares."""
        found = [
            one for one in self.said[topics.VOLUMETRIC_ERRORS] if one.method == "least_squares"
        ]
        return found[-1]

    def once(self, *arguments):
        """Look on once, as somebody who comes late; return exit code, output, errors."""
        done = subprocess.Popen(
            [*WATCH, "--once", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"COLUMNS": "80"},
        )
        # Who is looked at is heard by this process meanwhile.
        self.wait(lambda: done.poll() is not None, "the view is printed")
        return done.returncode, *done.communicate()


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    with WatchedCell(tmp_path_factory.mktemp("cell")) as made:
        yield made
