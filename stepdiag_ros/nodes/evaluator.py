#!/usr/bin/env python3
"""Node: evaluates each test of positioning (ISO 230-2, ISO 230-6) when its last pass is done."""

import sys
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.messages.positioning import from_positioning_test
from stepdiag_ros.messages.target import target_of
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns, begun, completed_by
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.metrology.target import TargetState
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.lines import LineNode


class EvaluatorNode(LineNode):
    """Publishes the parameters of a line's test once all its planned passes are measured.

    In a run that ends before, since it has reached its target, those of the passes there are.
    """

    role = "evaluator"

    def __init__(self) -> None:
        super().__init__("evaluator")
        self._plan: Plan
        self._ended_after: int | None = None
        self._told_begun = False
        self._tests = self.announce(topics.POSITIONING_TEST)
        self.follow_lines()

    def take_up(self, description: Any) -> None:
        """Start again with the plan of the run."""
        self._plan = plan_from_text(description.plan, "plan of the run")
        self._ended_after, self._told_begun = None, False

    def on_line(self, line: MeasuredLine) -> None:
        """Evaluate the test that this line completes, if it does.

        The lines of a tracker are evaluated by the solver, which knows where the tracker stands.
        """
        if self._plan.tracker is not None:
            return
        runs = completed_by(line, tuple(self.lines), self._plan)
        if runs is not None:
            self._evaluate(runs)
        self._evaluate_begun()

    def on_run_state(self, state: Any) -> None:
        """Take note that the run has reached its target, and after how many lines."""
        standing = target_of(state)
        reached = standing is not None and standing.state is TargetState.REACHED
        if reached and state.run_id == self.run_id and state.state == state.STATE_FINISHED:
            self._ended_after = int(state.line_index)
            self._evaluate_begun()

    def _evaluate_begun(self) -> None:
        """Evaluate what passes there are of the other tests, once the last line has come."""
        come = len({line.line_index for line in self.lines})
        if self._told_begun or self._ended_after is None or come < self._ended_after:
            return
        self._told_begun = True
        for runs in begun(tuple(self.lines), self._plan):
            self._evaluate(runs)

    def _evaluate(self, runs: BidirectionalRuns) -> None:
        test, time = evaluate(runs), self.lines[-1].end_time
        self._tests.publish(from_positioning_test(test, self.run_id, time))
        self.get_logger().info(f"{test.standard} test of {test.name} evaluated")


def main() -> int:
    """Run the node."""
    return spin(EvaluatorNode)


if __name__ == "__main__":
    sys.exit(main())
