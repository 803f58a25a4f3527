"""The action ``~/measure`` of the sequencer: a run as a goal, beside the simple services."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future

from stepdiag_ros import topics
from stepdiag_ros.messages.target import write_target
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.base import StepdiagNode
from stepdiag_ros.run.conclusion import UNKNOWN, Aftermath, Outcome
from stepdiag_ros.run.sequence import Progress, State
from stepdiag_ros.run.supervision import START_PATIENCE

RESULT_KEPT = 24 * 3600
"""ROS seconds for which a result is kept for a client that asks late."""
RETRY_PERIOD = 0.2
"""Real seconds between two looks whether a goal that waits can begin."""
CANCELLED = "cancelled by the client that requested the run"


def measure_type() -> Any:
    """Return the class of the action, of the ROS client that runs here."""
    return import_module("stepdiag_ros.action").Measure


class NotReadyYet(Refusal):
    """No run can begin because of nodes that may be starting still: a refusal that may pass."""


@dataclass
class _Waiting:
    """The goal whose run is to begin.

    Attributes:
        handle: rclpy's.
        since: real time, s, at which it came.
        tried: real time, s, at which its run was asked for last.
        why: it has not begun; empty if it was not asked for yet.
        given_up: why it is not to begin any more; empty while it may.
    """

    handle: Any
    since: float
    tried: float
    why: str = ""
    given_up: str = ""


@dataclass
class _Goal:
    """The goal whose run goes on or is being evaluated.

    Attributes:
        handle: rclpy's.
        aftermath: of its run.
        told: what the run waits for by the last feedback.
        impatient: the client no longer waits for the evaluation of the run.
    """

    handle: Any
    aftermath: Aftermath
    told: str = ""
    impatient: bool = False


class MeasureAction:
    """Starts a run for a goal, reports its progress, and ends the goal once the run is evaluated.

    At most one goal is open, as there is at most one run. A goal that comes while the nodes are
    starting waits for them, for ``START_PATIENCE`` at most; one at a time, and nothing moves before
    its run begins. No call here waits: a timer of the node calls ``update``.

    Args:
        node: the sequencer.
        begin: starts a run of a plan to a target (as Measure.action says; empty for the node's
            own) and returns its identity, or raises ValueError; NotReadyYet if the same goal may be
            taken later.
        abort: stops the machine and ends the run for a reason, or raises ValueError.
        progress: says where the run is.
        incomplete: says which lines of the run lack a stop, and why.
    """

    def __init__(
        self,
        node: StepdiagNode,
        begin: Callable[[str, str], str],
        abort: Callable[[str], object],
        progress: Callable[[], Progress],
        incomplete: Callable[[], list[str]],
    ) -> None:
        self._node = node
        self._begin = begin
        self._abort = abort
        self._progress = progress
        self._incomplete = incomplete
        self._messages = measure_type()
        self._goal: _Goal | None = None
        self._waiting: _Waiting | None = None
        self._results: dict[bytes, Future] = {}
        self._server = ActionServer(
            node,
            self._messages,
            "~/measure",
            self._execute,
            handle_accepted_callback=self._on_goal,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_KEPT,
        )
        node.listen(topics.DIAGNOSIS, self._on_diagnosis)

    # What the sequencer says --------------------------------------------------------------------

    def run_begins(self) -> None:
        """End the goal of the run before, if a fault has held it: another run is beginning."""
        if self._goal is not None:
            self._end(Outcome.ABORTED, "stopped by a fault and given up: another run was started")

    def update(self) -> None:
        """Begin what waits; say where the run is; end its goal when all is known of the run."""
        waiting = self._waiting
        if waiting is not None and waiting.given_up:
            self._waiting = None
            self._refuse(waiting.handle, waiting.given_up)
        elif waiting is not None and self._node.real_time() - waiting.tried >= RETRY_PERIOD:
            self._try_to_begin(waiting)
        goal = self._goal
        if goal is None:
            return
        progress = self._progress()
        if progress.state not in (State.FINISHED, State.ABORTED):
            return
        real = self._node.real_time()
        goal.aftermath.over(real)
        awaited = "" if goal.impatient else goal.aftermath.awaited(self._node.watch, real)
        if not awaited:
            finished = progress.state is State.FINISHED
            self._end(Outcome.FINISHED if finished else Outcome.ABORTED, progress.text)
        elif awaited != goal.told:
            goal.told = awaited
            self.tell()

    def tell(self) -> None:
        """Publish the feedback of the open goal, if there is one."""
        goal = self._goal
        if goal is None:
            return
        progress = self._progress()
        message = self._messages.Feedback()
        message.run_id = goal.aftermath.run_id
        write_progress(message, progress)
        message.block = progress.block
        message.block_count = progress.block_count
        if goal.told:
            message.text = f"{progress.text}; {goal.told}"
        goal.handle.publish_feedback(message)

    def give_up(self, reason: str) -> bool:
        """Let the goal that waits for nodes never begin, for a reason; say whether one waited."""
        if self._waiting is None:
            return False
        self._waiting.given_up = f"{reason}, before it began"
        return True

    # What clients ask for -----------------------------------------------------------------------

    def _on_goal(self, handle: Any) -> None:
        """Begin the run of a goal, at once or when the nodes answer; or refuse it."""
        self._results[_key(handle)] = Future()
        real = self._node.real_time()
        handle.execute()
        if self._waiting is not None:
            self._refuse(handle, "another goal waits for the nodes: cancel it first")
        else:
            self._waiting = _Waiting(handle, real, real)
            self._try_to_begin(self._waiting)

    def _try_to_begin(self, waiting: _Waiting) -> None:
        handle, real = waiting.handle, self._node.real_time()
        waiting.tried = real
        try:
            run_id = self._begin(handle.request.plan, handle.request.until)
        except ValueError as error:
            patient = real - waiting.since < START_PATIENCE
            if isinstance(error, NotReadyYet) and patient:
                self._tell_why(waiting, str(error))
            else:
                self._waiting = None
                self._refuse(handle, str(error))
        else:
            self._waiting = None
            self._goal = _Goal(handle, Aftermath(run_id, self._node.parameter("result_limit")))
            self.tell()

    def _tell_why(self, waiting: _Waiting, why: str) -> None:
        """Say why a goal waits, if that is new; its feedback names no run yet."""
        if why == waiting.why:
            return
        waiting.why = why
        text = f"waiting for nodes that may be starting, for {START_PATIENCE:.0f} s at most: {why}"
        self._node.get_logger().info(f"a goal of ~/measure: {text}")
        waiting.handle.publish_feedback(
            self._messages.Feedback(remaining_time=float("nan"), text=text)
        )

    def _refuse(self, handle: Any, why: str) -> None:
        """End a goal whose run has not begun, with the reason in its result."""
        self._node.get_logger().warning(f"a goal of ~/measure is refused: {why}")
        result = self._messages.Result(outcome=int(Outcome.REFUSED), text=why)
        result.verdict, result.sentence = UNKNOWN, "nothing was measured"
        result.bag_text = "no bag: nothing was measured"
        self._results[_key(handle)].set_result(result)

    def _on_cancel(self, handle: Any) -> CancelResponse:
        waiting, goal = self._waiting, self._goal
        if waiting is not None and _key(waiting.handle) == _key(handle):
            self.give_up(CANCELLED)
        elif goal is not None and _key(goal.handle) == _key(handle):
            try:
                self._abort(CANCELLED)
            except ValueError:
                # The run is over; only its evaluation is waited for.
                goal.impatient = True
        return CancelResponse.ACCEPT

    def _on_diagnosis(self, message: Any) -> None:
        if self._goal is not None:
            self._goal.aftermath.diagnosed(
                message.run_id, message.verdict, message.sentence, message.run_over
            )

    async def _execute(self, handle: Any) -> Any:
        """Wait for the result of a goal, without keeping the node from its work."""
        key = _key(handle)
        result = await self._results[key]
        del self._results[key]
        if handle.is_cancel_requested:
            handle.canceled()
        elif result.outcome == Outcome.FINISHED:
            handle.succeed()
        else:
            handle.abort()
        return result

    def _end(self, outcome: Outcome, text: str) -> None:
        goal, self._goal = self._goal, None
        assert goal is not None
        progress, known = self._progress(), goal.aftermath.conclusion(self._node.watch)
        result = self._messages.Result(outcome=int(outcome), text=text)
        result.run_id = goal.aftermath.run_id
        result.stops_done, result.stops_total = progress.stops_done, progress.stops_total
        result.incomplete = self._incomplete()
        result.verdict, result.sentence = known.verdict, known.sentence
        result.bag, result.bag_closed = known.bag, known.bag_closed
        result.bag_text = known.bag_text
        self._results[_key(goal.handle)].set_result(result)


def _key(handle: Any) -> bytes:
    return bytes(handle.goal_id.uuid)


def write_progress(message: Any, progress: Progress) -> None:
    """Write where a run is into the fields that RunState and the feedback have in common."""
    message.state = int(progress.state)
    message.line_index = progress.line_index
    message.line_count = progress.line_count
    message.line = progress.line
    message.stop = progress.stop
    message.stop_count = progress.stop_count
    message.stops_done = progress.stops_done
    message.stops_total = progress.stops_total
    message.remaining_time = progress.remaining_time
    message.text = progress.text
    write_target(message, progress.target)
