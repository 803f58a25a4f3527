"""Checks a machine with a behaviour tree of py_trees: the tree of measure_machine.xml.

    python3 behaviour_tree.py quick linuxcnc     # a plan, and the control to write tables for

It parks the robot, measures, reads the verdict and decides on conformity (ISO 14253-1). Within the
tolerance (of the solver): go on, exit code 0. Not within: write tables and ask the operator to load
them. Nothing proven, or more acts than the errors: call service. Ctrl-C stops the machine.
"""

import select
import signal
import subprocess
import sys
from collections.abc import Callable, Generator

import py_trees
from py_trees.common import Status
from py_trees.composites import Selector, Sequence
from supervise import COMPENSATE, GO_ON, VERDICT_LIMIT, Supervisor, decision

# isort: split
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from stepdiag_ros.action import Measure

Steps = Generator[None, None, bool]


class Leaf(py_trees.behaviour.Behaviour):
    """Runs a generator: RUNNING at each yield, then SUCCESS if it returns True."""

    def __init__(self, name: str, steps: Callable[..., Steps], *arguments: str | int) -> None:
        super().__init__(name)
        self.steps = steps(*arguments)

    def update(self) -> Status:
        """Go on to the next yield."""
        try:
            next(self.steps)
        except (StopIteration, TimeoutError) as end:
            return Status.SUCCESS if getattr(end, "value", False) else Status.FAILURE
        return Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        """Clean up if the tree is halted."""
        if new_status == Status.INVALID:
            self.steps.close()


class Cell(Supervisor):
    """What the leaves do."""

    result = Measure.Result()

    def until(self, condition: Callable[[], bool]) -> Generator[None, None, None]:
        """Wait for a condition; TimeoutError if the sequencer falls silent."""
        while not condition():
            self.check()
            yield

    def measured(self, plan: str) -> Steps:
        """Execute a plan; True if all lines are measured. If it is given up, the machine stops."""
        yield from self.until(self.action.server_is_ready)
        sent = self.send(plan)
        try:
            yield from self.until(sent.done)
            run = sent.result().get_result_async()
            yield from self.until(run.done)
        except (GeneratorExit, TimeoutError):
            self.cancel(sent)
            raise
        self.result = run.result().result
        return self.result.outcome == Measure.Result.OUTCOME_FINISHED

    def verdict_read(self) -> Steps:
        """Wait for the verdict on the whole run."""
        yield from self.until(lambda: self.decided(self.result.run_id))
        return True

    def next_is(self, step: str) -> Steps:
        """Return whether the verdict asks for this step."""
        yield
        return decision(self.verdict).step == step

    def tables_written(self, control: str) -> Steps:
        """Write the tables beside the bag; False if the command refuses."""
        process = subprocess.Popen(["stepdiag", "compensate", self.result.bag, "--for", control])
        while process.poll() is None:
            yield
        return process.returncode == 0

    def tables_loaded(self) -> Steps:
        """Ask the operator, and wait for an answer."""
        print("Load the tables into the control. Are they loaded? [y/n] ", end="", flush=True)
        while not select.select([sys.stdin], [], [], 0.0)[0]:
            yield
        return sys.stdin.readline().strip() == "y"

    def service_called(self) -> Steps:
        """Say why the machine needs a person; the call itself is your cell's own."""
        print(f"{': '.join(decision(self.verdict))}; bag: {self.result.bag}")
        yield
        return True


def tree(cell: Cell, plan: str, control: str) -> Sequence:
    """Return the tree; its last child acts on the verdict."""
    verdict = Leaf("read the verdict", cell.verdict_read)
    compensate = [
        Leaf("not within the tolerance", cell.next_is, COMPENSATE),
        Leaf("write compensation tables", cell.tables_written, control),
        Leaf("ask the operator", cell.tables_loaded),
    ]
    act = [
        Leaf("within the tolerance", cell.next_is, GO_ON),
        Sequence("compensate, then measure again", True, compensate),
        Leaf("call service", cell.service_called),
    ]
    steps = [
        py_trees.behaviours.Success("park the robot"),  # your cell's own
        Leaf("measure the machine", cell.measured, plan),
        py_trees.decorators.Timeout("in time", verdict, VERDICT_LIMIT),
        Selector("act on the verdict", True, act),
    ]
    return Sequence("check the machine", True, steps)


def main() -> int:
    """Tick the tree to its end, and show it."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    cell = Cell()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: cell.halt.set())
    root = tree(cell, *remove_ros_args(sys.argv)[1:])
    while root.status not in (Status.SUCCESS, Status.FAILURE) and not cell.halt.is_set():
        rclpy.spin_once(cell, timeout_sec=0.1)
        root.tick_once()
    if cell.halt.is_set():
        root.stop(Status.INVALID)
    print(py_trees.display.unicode_tree(root, show_status=True))
    return 0 if root.children[-1].children[0].status == Status.SUCCESS else 1


if __name__ == "__main__":
    sys.exit(main() if len(remove_ros_args(sys.argv)) == 3 else __doc__)
