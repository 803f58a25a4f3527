"""One run on nodes that are there: started, followed to its end, stopped where it must be."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from stepdiag_ros.messages.target import target_of
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.target import TargetStanding, TargetState
from stepdiag_ros.run.conclusion import Outcome
from stepdiag_ros.run.sequence import State
from stepdiag_ros.run.taking_up import Patience

if TYPE_CHECKING:
    from stepdiag_ros.nodes.operator import OperatorNode

Granted = TypeVar("Granted")

SETTLE_LIMIT = 3.0
"""Real seconds in which a refused start is tried again."""
REOPEN_LIMIT = 12.0
"""Real seconds in which a refused resumption is tried again: a device that has failed is opened
again after ``retry_after``, and until then the run that waits for it need not be lost."""
RESUME_LIMIT = 5.0
"""Real seconds in which the run must go on after it was resumed."""
GONE_LIMIT = 10.0
"""Real seconds of silence after which the sequencer counts as gone; a busy computer delays it."""
STOP_LIMIT = 60.0
"""Real seconds in which a run that was stopped must be recorded and evaluated."""
ENDED = (State.FINISHED, State.ABORTED)
HELD = (State.PAUSED, State.WAITING_FOR_SETUP, State.FAULT)
"""States in which nothing moves until somebody resumes the run."""


class RunFailed(Refusal):
    """The run did not finish; the text says why, and what was recorded."""


@dataclass(frozen=True)
class RunNews:
    """What a view of the run is given (fields of RunState.msg).

    Attributes:
        text: what is going on, in words.
        done: stops measured.
        total: stops of the plan; 0 while the nodes start.
        remaining: s of ROS time; NaN if not known.
        target: how far the run is from its target; None if it has none.
    """

    text: str
    done: int = 0
    total: int = 0
    remaining: float = float("nan")
    target: TargetStanding | None = None


@dataclass(frozen=True)
class RunOutcome:
    """What a run has come to (fields of the result of Measure.action).

    Attributes:
        bag: path on the recorder's computer; None if not known.
        standing: how far the run came to its target; None if it has none.
        largest_error: length of the longest error vector in the measured box, m; NaN if not known.
        expanded_uncertainty: of that (95 %), m; NaN if not known.
        budgeted: an uncertainty budget is in it.
        largest_at: where it is, machine coordinates, m.
        not_determined: names of the error curves (of nine) and squareness errors that are unknown.
    """

    outcome: Outcome
    text: str
    run_id: str
    stops_done: int
    stops_total: int
    incomplete: tuple[str, ...]
    verdict: str
    sentence: str
    bag: Path | None
    bag_closed: bool
    bag_text: str
    standing: TargetStanding | None = None
    largest_error: float = nan
    expanded_uncertainty: float = nan
    budgeted: bool = False
    largest_at: tuple[float, float, float] = (nan, nan, nan)
    not_determined: tuple[str, ...] = ()

    @property
    def stops_asked_for(self) -> int:
        """Return the stops that the run had to measure: those to its target, if it reached it."""
        if self.standing is not None and self.standing.state is TargetState.REACHED:
            return self.stops_done
        return self.stops_total


class FollowedRun:
    """Starts a run by the sequencer's action and follows it.

    Args:
        operator: the node that does so.
        tell: called with the progress of the run.
        check: is called several times a second; raises RunFailed if the run cannot go on, and
            returns True while a node is stopped that may yet wake.
        on_hold: is called several times a second while the run is held (``HELD``), with what it
            says of itself; returns True to have it resumed, or raises RunFailed to have it ended.
        on_plan: is called once, with the YAML text of the plan, as soon as the run publishes it.

    Attributes:
        run_id: identity of the run; empty before it has started.
        measured: what it has come to; None before that is known.
    """

    def __init__(
        self,
        operator: "OperatorNode",
        tell: Callable[[RunNews], None],
        check: Callable[[], bool],
        on_hold: Callable[[State, str], bool],
        on_plan: Callable[[str], None] | None = None,
    ) -> None:
        self._operator = operator
        self._on_plan = on_plan
        self._tell = tell
        self._check = check
        self._on_hold = on_hold
        self.run_id = ""
        self.measured: RunOutcome | None = None

    def measure(self, plan: str = "", until: str = "") -> RunOutcome:
        """Start a run and follow it until it is recorded and evaluated.

        Args:
            plan: as the sequencer knows it, or the YAML text; empty for the sequencer's own.
            until: uncertainty to be reached, as in Measure.action; empty for the sequencer's own.

        Raises:
            RunFailed: it was refused, or it was ended before all lines were measured; the machine
                stands still, unless the text states that it could not be stopped.
            KeyboardInterrupt: as asked; the machine stands still.
        """
        self.run_id = self._until_granted(lambda: self._operator.start(plan, until), SETTLE_LIMIT)
        try:
            self._follow()
        except BaseException as error:
            if isinstance(error, RunFailed):
                # Said before the run is stopped, which may take a while.
                self._tell(RunNews(str(error)))
            self._stop()
            raise
        measured = self.measured
        assert measured is not None
        if measured.outcome is not Outcome.FINISHED:
            raise RunFailed(f"the run has stopped: {measured.text}", fault="stopped")
        return measured

    def _until_granted(self, ask: Callable[[], Granted], limit: float) -> Granted:
        """Ask until it is granted, for ``limit`` real seconds and while a node may yet wake.

        Raises:
            RunFailed: it was refused for too long.
        """
        operator, patience = self._operator, Patience(limit)
        held = self._check()
        patience.is_over(held, operator.real_time())
        while True:
            try:
                return ask()
            except ValueError as error:
                # The sequencer may not have heard yet what this node has heard already, and a
                # node may have woken while the sequencer was asked.
                was_held, held = held, self._check()
                if patience.is_over(was_held or held, operator.real_time()):
                    raise RunFailed(str(error)) from None
            operator.spin_until(lambda: False, 0.2)

    def _follow(self) -> None:
        operator = self._operator
        sequencer, heard = operator.sequencer, operator.real_time()
        while not self._has_result():
            operator.spin_until(lambda: operator.result is not None, 0.2)
            self._check()
            # Empty while it is silent, as it may have been when this began.
            present = operator.sequencer
            sequencer = sequencer or present
            if present and present == sequencer:
                heard = operator.real_time()
            elif present:
                raise RunFailed("the sequencer was restarted and has lost the run")
            elif operator.real_time() - heard > GONE_LIMIT:
                raise RunFailed(_gone(operator.state))
            if self._on_plan is not None and operator.plan:
                self._on_plan(operator.plan)
                self._on_plan = None
            if operator.state is None:
                continue
            self._tell(_told(operator.state, operator.text))
            state = State(operator.state.state)
            if state in HELD and self._on_hold(state, str(operator.state.text)):
                self._resume()

    def _resume(self) -> None:
        operator, held = self._operator, self._operator.state
        try:
            self._until_granted(lambda: operator.call("sequencer/resume"), REOPEN_LIMIT)
        except RunFailed as error:
            raise RunFailed(f"{held.text}: {error}") from None
        operator.spin_until(
            lambda: (
                operator.state.state != held.state or operator.state.line_index != held.line_index
            ),
            RESUME_LIMIT,
        )

    def _stop(self) -> None:
        """End the run, and wait until what was measured is recorded."""
        try:
            self._operator.cancel()
        except ValueError as error:
            self._tell(RunNews(f"the run could not be stopped: {error}"))
            if not self._operator.sequencer:
                return
        self._tell(RunNews("the run is stopped; waiting for its bag"))
        self._operator.spin_until(self._has_result, STOP_LIMIT)

    def _has_result(self) -> bool:
        result = self._operator.result
        if result is not None and self.measured is None:
            self.measured = _measured(result, self._operator.state, self._operator.verdict)
        return result is not None


def _measured(result: Any, state: Any, verdict: Any) -> RunOutcome:
    measured = RunOutcome(
        outcome=Outcome(result.outcome),
        text=result.text,
        run_id=result.run_id,
        stops_done=int(result.stops_done),
        stops_total=int(result.stops_total),
        incomplete=tuple(result.incomplete),
        verdict=result.verdict,
        sentence=result.sentence,
        bag=Path(result.bag) if result.bag else None,
        bag_closed=bool(result.bag_closed),
        bag_text=result.bag_text,
        standing=None if state is None else target_of(state),
    )
    if verdict is None:
        return measured
    return replace(
        measured,
        largest_error=verdict.worst_error,
        expanded_uncertainty=verdict.expanded_uncertainty,
        budgeted=bool(verdict.budgeted),
        largest_at=tuple(verdict.worst_place),
        not_determined=tuple(verdict.not_determined),
    )


def _gone(state: Any) -> str:
    """Say what is known of a run whose sequencer is silent, by its last RunState."""
    if state is not None and State(state.state) in ENDED:
        return f"the run has ended ({state.text}), and its sequencer before the results were whole"
    return (
        "the sequencer is gone, and what the machine does is not known: look at the machine, and at"
        " the terminal of the cell"
    )


def _told(state: Any, text: str) -> RunNews:
    words = {
        State.RUNNING: state.line,
        State.IDLE: "waiting until all nodes are ready for the run",
        State.WAITING_FOR_SETUP: f"waiting for the alignment for {state.line}",
        # The run itself knows who is still waited for after its end.
        State.FINISHED: text,
        State.ABORTED: text,
    }
    said = words.get(State(state.state)) or state.text
    done, total = state.stops_done, state.stops_total
    return RunNews(said, done, total, state.remaining_time, target_of(state))
