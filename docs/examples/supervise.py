#!/usr/bin/env python3
"""Measures as a robot cell does: starts a run, follows it, and decides by its verdict.

    python3 supervise.py quick                                # a plan that the sequencer knows
    python3 supervise.py quick --ros-args -r __ns:=/cell      # of the nodes in the namespace /cell

The exit code is 0 if all lines were measured and the machine may go on, 1 if service is to be
called, 2 if the machine is to be compensated and measured again, and 3 if there is no result: the
goal was refused or cancelled, or the sequencer is gone. The machine may go on only where the solver
has a tolerance (its parameter) and the plan can test the model; 'quick' cannot.
Ctrl-C and SIGTERM cancel the run: the machine stops. Nothing does so if this program is killed.
It runs with and without ROS 2. It resumes after each setup at once, as a simulated
cell may: on a real machine, "resume" means that somebody has aligned laser and mirror.
"""

import os
import signal
import sys
import threading
import time
from math import isnan
from typing import NamedTuple

import stepdiag_ros.client  # noqa: F401 - without ROS 2, this makes the next imports possible

# isort: split
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from std_srvs.srv import Trigger
from stepdiag_ros.action import Measure
from stepdiag_ros.msg import RunState, RunVerdict

DISCOVERY_LIMIT = 10.0
"""Seconds in which the sequencer must be discovered."""
SILENCE_LIMIT = 2.0
"""Seconds without run/state, which comes twice a second, after which the sequencer is gone."""
VERDICT_LIMIT = 5.0
"""Seconds after the result of the action in which the verdict on the whole run comes."""
CANCEL_LIMIT = 0.5
"""Seconds for which a silent sequencer is asked to cancel the run."""
LATCHED = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Halted(Exception):
    """Somebody wants this program to end."""


class Supervisor(Node):
    """Starts one run and resumes it after each setup."""

    def __init__(self) -> None:
        super().__init__("supervisor")
        self.verdict = RunVerdict()
        self.halt = threading.Event()
        self.run_id = ""
        self._asked = (0, 0)
        self._line = ""
        self._found = False
        self._text = ""
        self._heard = time.monotonic()
        self.action = ActionClient(self, Measure, "sequencer/measure")
        self._triggers = {
            name: self.create_client(Trigger, f"sequencer/{name}") for name in ("resume", "abort")
        }
        self.create_subscription(RunState, "run/state", self._on_state, LATCHED)
        self.create_subscription(RunVerdict, "result/verdict", self._on_verdict, LATCHED)

    def measure(self, plan: str) -> Measure.Result:
        """Execute a plan and return its result.

        TimeoutError if the sequencer falls silent, Halted on a signal; both cancel the run.
        """
        while not self.action.server_is_ready():
            self._spin()
        sent = self.send(plan)
        try:
            result = self._wait(self._wait(sent).get_result_async()).result
        except Halted:
            self.cancel(sent)
            raise
        except TimeoutError:
            self.cancel(sent, CANCEL_LIMIT)
            raise
        until = time.monotonic() + VERDICT_LIMIT
        while result.run_id and not self.decided(result.run_id) and time.monotonic() < until:
            self._spin()
        return result

    def send(self, plan: str) -> Future:
        """Return the future goal of a run of this plan, which is resumed after each setup."""
        return self.action.send_goal_async(Measure.Goal(plan=plan), self._on_feedback)

    def cancel(self, sent: Future, limit: float = VERDICT_LIMIT) -> None:
        """Cancel the run of this future goal: the machine stops."""
        rclpy.spin_until_future_complete(self, sent, timeout_sec=limit)
        if sent.done():
            stopping = sent.result().cancel_goal_async()
            rclpy.spin_until_future_complete(self, stopping, timeout_sec=limit)

    def check(self) -> None:
        """Raise TimeoutError if there is no sequencer, which then never sends the result."""
        limit = SILENCE_LIMIT if self._found else DISCOVERY_LIMIT
        if time.monotonic() - self._heard <= limit:
            return
        if self._found:
            raise TimeoutError(
                "the sequencer is silent: treat the measurement as a fault, and see why in the"
                f" terminal of the nodes. It last reported: {self._text}"
            )
        nodes = self.get_node_names_and_namespaces()
        elsewhere = sorted({space for name, space in nodes if name == "sequencer"})
        found = f"; there is one in {', '.join(elsewhere)}" if elsewhere else ""
        raise TimeoutError(
            f"no sequencer found in the namespace {self.get_namespace()} with ROS_DOMAIN_ID"
            f" {os.environ.get('ROS_DOMAIN_ID', '0')} within {limit:g} s{found}: check both"
        )

    def decided(self, run_id: str) -> bool:
        """Return whether the verdict on the whole of this run is here."""
        return self.verdict.run_id == run_id and self.verdict.run_over

    def _wait(self, future: Future) -> object:
        while not future.done():
            self._spin()
        return future.result()

    def _spin(self) -> None:
        rclpy.spin_once(self, timeout_sec=0.1)
        if self.halt.is_set():
            raise Halted("the run is cancelled: the machine stops")
        self.check()

    def _on_state(self, state: RunState) -> None:
        self._found = True
        self._text = state.text
        self._heard = time.monotonic()

    def _on_feedback(self, message: Measure.Impl.FeedbackMessage) -> None:
        run = message.feedback
        self.run_id = run.run_id
        if run.line and run.line != self._line:
            self._line = run.line
            print(
                f"{run.line} begins, {run.stops_done} of {run.stops_total} stops done", flush=True
            )
        name = {RunState.STATE_WAITING_FOR_SETUP: "resume", RunState.STATE_FAULT: "abort"}
        if run.state in name and self._asked != (run.state, run.line_index):
            self._asked = run.state, run.line_index
            print(f"{run.text}: {name[run.state]}", flush=True)  # align laser and mirror here
            self._triggers[name[run.state]].call_async(Trigger.Request())

    def _on_verdict(self, verdict: RunVerdict) -> None:
        self.verdict = verdict


GO_ON = "go on"
COMPENSATE = "compensate, and measure again"
CALL_SERVICE = "call service"
EXIT_CODES = {GO_ON: 0, CALL_SERVICE: 1, COMPENSATE: 2}
NO_RESULT = 3
RECOVER = (
    "its bag begins with this name, in the folder of the recorder. When the recorder has closed it,"
    " 'stepdiag info' says whether it is whole; if not, 'stepdiag recover' saves what it holds"
)


class Decision(NamedTuple):
    """What the cell does next, and why."""

    step: str
    why: str


def decision(verdict: RunVerdict) -> Decision:
    """Decide by the table in docs/how_to/cell.md, which measure_machine.xml contains too."""
    if not verdict.run_over or isnan(verdict.worst_error):
        return Decision(CALL_SERVICE, "the largest error is not known: measure all lines")
    if verdict.outcome != RunVerdict.OUTCOME_FINISHED:
        return Decision(CALL_SERVICE, "the run was aborted: measure again")
    not_within = verdict.conformity == RunVerdict.CONFORMITY_NOT_WITHIN
    error = "the error is beyond the tolerance" if not_within else "the error may be larger"
    if verdict.diagnosis in (RunVerdict.DIAGNOSIS_UNKNOWN, RunVerdict.DIAGNOSIS_NOT_TESTABLE):
        return Decision(
            CALL_SERVICE, f"{error}: the model was not tested, take a plan with repeats"
        )
    found = (RunVerdict.DIAGNOSIS_NAMED, RunVerdict.DIAGNOSIS_AMBIGUOUS)
    if verdict.diagnosis not in (RunVerdict.DIAGNOSIS_CONSISTENT, *found):
        return Decision(CALL_SERVICE, f"{error}, and more acts than the errors contain")
    # Beside an effect that was found this is proven only where the uncertainty contains the effect.
    if verdict.conformity == RunVerdict.CONFORMITY_WITHIN:
        limit = f"{verdict.tolerance * 1e6:g} µm"
        return Decision(GO_ON, f"the error is within the solver's tolerance of {limit}")
    if verdict.diagnosis in found:
        return Decision(CALL_SERVICE, f"{error}, and more acts than the errors contain")
    if not_within:
        return Decision(COMPENSATE, error)
    if verdict.conformity == RunVerdict.CONFORMITY_UNDECIDED:
        return Decision(CALL_SERVICE, "the uncertainty allows no decision")
    return Decision(CALL_SERVICE, "no tolerance is agreed: set the solver's parameter tolerance")


def main() -> int:
    """Measure, and print largest error, decision and bag."""
    arguments = remove_ros_args(sys.argv)[1:]
    if len(arguments) != 1 or arguments[0].startswith("-"):
        sys.exit(f"give one argument, the name or file of the plan\n{__doc__}")
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    supervisor = Supervisor()
    # An exception could strike while the answer to the goal is read: nobody could cancel it then.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: supervisor.halt.set())
    try:
        result = supervisor.measure(arguments[0])
    except (TimeoutError, Halted) as error:
        run = f"run {supervisor.run_id}: {RECOVER}" if supervisor.run_id else "no run had begun"
        print(f"{error}\n{run}", file=sys.stderr)
        return NO_RESULT
    if result.outcome == Measure.Result.OUTCOME_REFUSED:
        print(result.text, file=sys.stderr)
        return NO_RESULT
    verdict = supervisor.verdict
    found = Decision(CALL_SERVICE, "there is no verdict on this run")
    if verdict.run_id and verdict.run_id == result.run_id:
        found = decision(verdict)
        worst = f"{verdict.worst_error * 1e6:.2f} ± {verdict.expanded_uncertainty * 1e6:.2f} µm"
        known = not isnan(verdict.worst_error)
        print(f"largest error: {f'{worst} (U: 95 %)' if known else 'unknown'}")
    print(f"{result.text}; {result.verdict}: {result.sentence}\nbag: {result.bag}")
    if result.outcome != Measure.Result.OUTCOME_FINISHED:
        found = Decision(CALL_SERVICE, "the run did not finish: measure again")
    print(": ".join(found))
    return EXIT_CODES[found.step]


if __name__ == "__main__":
    sys.exit(main())
