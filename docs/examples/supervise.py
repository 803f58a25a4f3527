#!/usr/bin/env python3
"""Measures as a robot cell does: starts a run, follows it, and prints what it came to.

    python3 supervise.py quick                                # a plan that the sequencer knows
    python3 supervise.py quick --ros-args -r __ns:=/cell      # of the nodes in the namespace /cell

The exit code is 0 if all lines were measured, 1 otherwise. It runs with and without ROS 2.
"""

import sys
import time

import stepdiag_ros.client  # noqa: F401 - without ROS 2, this makes the next imports possible

# isort: split
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from std_srvs.srv import Trigger
from stepdiag_ros.action import Measure
from stepdiag_ros.msg import RunState, VolumetricErrors

SILENCE_LIMIT = 2.0
"""Seconds without run/state, which comes twice a second, after which the sequencer is gone."""
LATCHED = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Supervisor(Node):
    """Starts one run and resumes it after each setup."""

    def __init__(self) -> None:
        super().__init__("supervisor")
        self.worst: dict[str, str] = {}  # identity of a run: its largest error
        self._asked = (0, 0)
        self._heard = time.monotonic() + 10.0  # discovery of the nodes takes a while
        self._measure = ActionClient(self, Measure, "sequencer/measure")
        self._services = {
            name: self.create_client(Trigger, f"sequencer/{name}") for name in ("resume", "abort")
        }
        self.create_subscription(RunState, "run/state", self._on_state, LATCHED)
        self.create_subscription(
            VolumetricErrors, "result/volumetric_errors", self._on_errors, LATCHED
        )

    def measure(self, plan: str) -> Measure.Result:
        """Execute a plan and return its result; TimeoutError if the sequencer falls silent."""
        while not self._measure.server_is_ready():
            self._spin()
        goal = self._wait(self._measure.send_goal_async(Measure.Goal(plan=plan), self._on_feedback))
        return self._wait(goal.get_result_async()).result

    def _wait(self, future: Future) -> object:
        while not future.done():
            self._spin()
        return future.result()

    def _spin(self) -> None:
        rclpy.spin_once(self, timeout_sec=0.1)
        # A sequencer that is gone never sends the result: a future alone would wait for ever.
        if time.monotonic() - self._heard > SILENCE_LIMIT:
            raise TimeoutError("the sequencer is silent: treat the measurement as a fault")

    def _on_state(self, _: RunState) -> None:
        self._heard = time.monotonic()

    def _on_feedback(self, message: Measure.Impl.FeedbackMessage) -> None:
        run = message.feedback
        name = {RunState.STATE_WAITING_FOR_SETUP: "resume", RunState.STATE_FAULT: "abort"}
        if run.state in name and self._asked != (run.state, run.line_index):
            self._asked = run.state, run.line_index
            print(f"{run.text}: {name[run.state]}", flush=True)  # align laser and mirror here
            self._services[name[run.state]].call_async(Trigger.Request())

    def _on_errors(self, errors: VolumetricErrors) -> None:
        if errors.method == "least_squares":  # the method that uses all lines
            names = [f"e_{error}{axis}" for axis in "xyz" for error in "xyz"]
            known = [(abs(e), name) for name in names for e in getattr(errors, name) if e == e]
            size, name = max(known)  # NaN, not equal to itself, is unknown
            self.worst[errors.run_id] = f"{name.upper()} {size * 1e6:.2f} µm"


def main() -> int:
    """Measure, and print verdict, largest error and bag."""
    rclpy.init()
    supervisor = Supervisor()
    try:
        result = supervisor.measure("".join(remove_ros_args(sys.argv)[1:]))
    except TimeoutError as error:
        sys.exit(str(error))
    worst = supervisor.worst.get(result.run_id, "unknown")
    print(f"{result.text}; {result.verdict}; largest error: {worst}; bag: {result.bag}")
    return 0 if result.outcome == Measure.Result.OUTCOME_FINISHED else 1


if __name__ == "__main__":
    sys.exit(main())
