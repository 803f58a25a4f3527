#!/usr/bin/env python3
"""Node: solves for the volumetric errors after every finished line."""

import sys
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from math import nan
from typing import Any, NamedTuple

from stepdiag_ros import topics
from stepdiag_ros.bags.passes import Completeness
from stepdiag_ros.configuration import (
    chain_from_text,
    plan_from_text,
    plausible_from_text,
)
from stepdiag_ros.evaluation.decision import decide, lead_of_results
from stepdiag_ros.evaluation.lead import RunLead
from stepdiag_ros.evaluation.pursuit import Pursuit, outlook, pursuit_from_text, standing
from stepdiag_ros.evaluation.solving import SolvedSoFar, solve_run
from stepdiag_ros.messages.decision import from_decision
from stepdiag_ros.messages.diagnosis import to_diagnosis
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.messages.positioning import from_positioning_test
from stepdiag_ros.messages.volumetric import from_volumetric_errors
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement, latest_attempts
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.solvers.catalogue import to_rely_on
from stepdiag_ros.metrology.target import TargetStanding
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.lines import LineNode
from stepdiag_ros.planning.undetermined import refuse_undetermined
from stepdiag_ros.run.conclusion import LastWord, Outcome
from stepdiag_ros.run.health import HealthFinding
from stepdiag_ros.run.supervision import WORK_LEFT
from stepdiag_ros.run.target_words import standing_words
from stepdiag_ros.run.work_health import Work

PUBLISH_PERIOD = 0.01
"""Real seconds between two looks at what has been solved."""


class _Solved(NamedTuple):
    """What some lines have come to, and how many they are; one measured again counts once."""

    found: SolvedSoFar
    lead: RunLead
    lines: int
    target: TargetStanding | None


class _Run(NamedTuple):
    """What is known of a run before its first line; ``pursuit`` is None without a target."""

    plan: Plan
    chain: str
    plausible: Plausible
    pursuit: Pursuit | None


def _solve_first(run: _Run, lines: Sequence[MeasuredLine], count: int) -> _Solved:
    """Solve the first lines of a run; what waits for that holds no copy of them."""
    taken = tuple(lines[:count])
    measurement = Measurement(run.plan.volume, latest_attempts(taken), run.chain, run.plausible)
    found = solve_run(run.plan, measurement, taken[-1])
    passes = Completeness(len(run.plan.lines), len(measurement.lines))
    lead = lead_of_results(found.results, measurement, passes)
    target = None
    if run.pursuit is not None:
        target = standing(run.pursuit, measurement, found.results, lead)
    return _Solved(found, lead, len(measurement.lines), target)


def _look_ahead(pursuit: Pursuit) -> _Solved:
    """Foretell a run before its first line."""
    return _Solved(SolvedSoFar({}, {}), RunLead(), 0, outlook(pursuit))


class SolverNode(LineNode):
    """Publishes what each method makes of the lines so far, and what a supervisor decides on.

    A large volume takes seconds to solve. That is done in a thread of its own, line after line, so
    that the node's heartbeat goes on; a node that falls silent stops the run.
    """

    role = "solver"

    def __init__(self) -> None:
        super().__init__("solver")
        self._run: _Run
        self._results = self.announce(topics.VOLUMETRIC_ERRORS)
        self._tests = self.announce(topics.POSITIONING_TEST)
        self._verdicts = self.announce(topics.RUN_VERDICT)
        self._newest: tuple[_Solved, int] | None = None
        self._verdict, self._verdict_is_last = Verdict(), False
        self._outcome = Outcome.UNKNOWN
        self._last_word = LastWord("")
        self._concluded = True
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="solver")
        self._solving: deque[tuple[str, int, int, Future[_Solved]]] = deque()
        self.facts[WORK_LEFT] = "0"
        self._work = Work("solution")
        self.health.add_task("work", self._judge_work)
        self.follow_lines()
        self.listen(topics.DIAGNOSIS, self._on_diagnosis)
        self.on_change("tolerance", lambda _: self._publish_verdict())
        self.every(PUBLISH_PERIOD, self._publish_solved, real=True)

    def take_up(self, description: Any) -> None:
        """Start again with the box and the chain of the run, and foretell it if it has a target.

        Raises:
            ValueError: the plan does not determine the quantity of the target.
        """
        plan = plan_from_text(description.plan, "plan of the run")
        run = _Run(
            plan,
            chain_from_text(description.machine, "machine of the run"),
            plausible_from_text(description.machine, "machine of the run"),
            pursuit_from_text(description.until, plan, description.machine),
        )
        if run.pursuit is not None:
            refuse_undetermined(run.pursuit.target, plan, run.chain)
        self._run = run
        self._newest, self._concluded = None, False
        self._verdict, self._verdict_is_last = Verdict(), False
        self._outcome = Outcome.UNKNOWN
        self._last_word = LastWord(description.run_id)
        if self._run.pursuit is not None:
            begun = to_nanoseconds(description.header.stamp)
            self._await(description.run_id, 0, begun, _look_ahead, self._run.pursuit)

    def on_line(self, line: MeasuredLine) -> None:
        """Solve all lines so far."""
        count = len(self.lines)
        self._await(self.run_id, count, line.end_time, _solve_first, self._run, self.lines, count)

    def _await(
        self, run_id: str, count: int, time: int, work: Callable[..., _Solved], *given: Any
    ) -> None:
        """Have the worker solve so many lines of a run, of which the last ended at a time, ns."""
        solved = self._worker.submit(work, *given)
        if not self._solving:
            self._work.begin(self.real_time())
        self._solving.append((run_id, count, time, solved))
        self._say_work_left()

    def _publish_solved(self) -> None:
        """Publish what is solved by now, in the order of the lines."""
        while self._solving and self._solving[0][-1].done():
            run_id, count, time, solved = self._solving.popleft()
            self._work.end(self.real_time())
            try:
                done = solved.result()
            except ValueError as error:
                self.unwell(f"the lines cannot be solved: {error}")
                self._say_work_left()
                continue
            for result in done.found.results.values():
                self._results.publish(from_volumetric_errors(result, run_id, time))
            for test in done.found.tests:
                self._tests.publish(from_positioning_test(test, run_id, time))
            said = f"; {standing_words(done.target)}" if done.target is not None else ""
            self.get_logger().info(f"{count} lines solved{said}")
            if run_id == self.run_id:
                self._newest = done, time
                self._publish_verdict()
            self._say_work_left()
        self._conclude()

    def _on_diagnosis(self, message: Any) -> None:
        if message.run_id != self.run_id:
            return
        try:
            found = to_diagnosis(message)
        except ValueError as error:
            self.unwell(f"the diagnosis cannot be read: {error}")
            return
        self._verdict = Verdict.of_effects(
            *(found.verdict, found.sentence, found.findings),
            rotation=self._run.plausible.rotation,
        )
        self._verdict_is_last = message.run_over
        self._publish_verdict()

    def _conclude(self) -> None:
        """Publish the verdict on the whole run, when nothing is missing any more."""
        if self._concluded or not self.run_over or self._solving:
            return
        if not self._verdict_is_last and self._last_word.awaited(self.watch, self.real_time()):
            return
        self._concluded = True
        self._publish_verdict()
        self._say_work_left()

    def _publish_verdict(self) -> None:
        if self._newest is None:
            return
        done, time = self._newest
        decision = decide(
            replace(done.lead, verdict=self._verdict),
            to_rely_on(done.found.results) or "",
            self.parameter("tolerance") or nan,
            done.target,
            self._outcome is Outcome.ABORTED,
        )
        lines = done.lines, len(self._run.plan.lines)
        over = self.run_over and self._concluded
        outcome = self._outcome if over else Outcome.UNKNOWN
        self._verdicts.publish(from_decision(decision, self.run_id, time, lines, over, outcome))

    def _say_work_left(self) -> None:
        owed = self.run_over and not self._concluded and self._newest is not None
        left = len(self._solving) + owed
        before, self.facts[WORK_LEFT] = self.facts[WORK_LEFT], str(left)
        if "0" in (before, self.facts[WORK_LEFT]):
            self.beat()

    def on_run_state(self, state: Any) -> None:
        """Take note of how the run has ended."""
        ends = {state.STATE_FINISHED: Outcome.FINISHED, state.STATE_ABORTED: Outcome.ABORTED}
        if state.run_id == self.run_id and state.state in ends:
            self._outcome = ends[state.state]

    def on_run_end(self) -> None:
        """Say that the verdict on the whole run is still to come, before the bag is closed."""
        self._say_work_left()

    def _judge_work(self) -> HealthFinding:
        return self._work.judge(len(self._solving), len(self.lines))

    def close(self) -> None:
        """Let go of what is not solved yet."""
        self._worker.shutdown(wait=False, cancel_futures=True)


def main() -> int:
    """Run the node."""
    return spin(SolverNode)


if __name__ == "__main__":
    sys.exit(main())
