#!/usr/bin/env python3
"""Node: solves for the volumetric errors after every finished line."""

import sys
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import chain_from_text, plan_from_text, plausible_from_text
from stepdiag_ros.evaluation.solving import SolvedSoFar, solve_run
from stepdiag_ros.messages.positioning import from_positioning_test
from stepdiag_ros.messages.volumetric import from_volumetric_errors
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement, latest_attempts
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.plausible import ORDINARY, Plausible
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.lines import LineNode
from stepdiag_ros.run.health import HealthFinding
from stepdiag_ros.run.supervision import WORK_LEFT
from stepdiag_ros.run.work_health import Work

PUBLISH_PERIOD = 0.01
"""Real seconds between two looks at what has been solved."""


def _solve_first(
    plan: Plan, chain: str, plausible: Plausible, lines: Sequence[MeasuredLine], count: int
) -> SolvedSoFar:
    """Solve the first lines of a run; what waits for that holds no copy of them."""
    taken = tuple(lines[:count])
    measurement = Measurement(plan.volume, latest_attempts(taken), chain, plausible)
    return solve_run(plan, measurement, taken[-1])


class SolverNode(LineNode):
    """Publishes what each method makes of the lines so far, with its uncertainty.

    A large volume takes seconds to solve. That is done in a thread of its own, line after line, so
    that the node's heartbeat goes on; a node that falls silent stops the run.
    """

    role = "solver"

    def __init__(self) -> None:
        super().__init__("solver")
        self._plan: Plan
        self._chain = ""
        self._plausible = ORDINARY
        self._results = self.announce(topics.VOLUMETRIC_ERRORS)
        self._tests = self.announce(topics.POSITIONING_TEST)
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="solver")
        self._solving: deque[tuple[str, int, MeasuredLine, Future[SolvedSoFar]]] = deque()
        self.facts[WORK_LEFT] = "0"
        self._work = Work("solution")
        self.health.add_task("work", self._judge_work)
        self.follow_lines()
        self.every(PUBLISH_PERIOD, self._publish_solved, real=True)

    def take_up(self, description: Any) -> None:
        """Start again with the box and the chain of the run."""
        self._plan = plan_from_text(description.plan, "plan of the run")
        self._chain = chain_from_text(description.machine, "machine of the run")
        self._plausible = plausible_from_text(description.machine, "machine of the run")

    def on_line(self, line: MeasuredLine) -> None:
        """Solve all lines so far."""
        run = (self._plan, self._chain, self._plausible)
        solved = self._worker.submit(_solve_first, *run, self.lines, len(self.lines))
        if not self._solving:
            self._work.begin(self.real_time())
        self._solving.append((self.run_id, len(self.lines), line, solved))
        self._say_work_left()

    def _publish_solved(self) -> None:
        """Publish what is solved by now, in the order of the lines."""
        while self._solving and self._solving[0][-1].done():
            run_id, count, line, solved = self._solving.popleft()
            self._work.end(self.real_time())
            try:
                found = solved.result()
            except ValueError as error:
                self.unwell(f"the lines cannot be solved: {error}")
                self._say_work_left()
                continue
            for result in found.results.values():
                self._results.publish(from_volumetric_errors(result, run_id, line.end_time))
            for test in found.tests:
                self._tests.publish(from_positioning_test(test, run_id, line.end_time))
            self.get_logger().info(f"{count} lines solved; last: {line.line}")
            self._say_work_left()

    def _say_work_left(self) -> None:
        before, self.facts[WORK_LEFT] = self.facts[WORK_LEFT], str(len(self._solving))
        if "0" in (before, self.facts[WORK_LEFT]):
            self.beat()

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
