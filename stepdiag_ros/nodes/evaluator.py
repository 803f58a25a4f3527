#!/usr/bin/env python3
"""Node: evaluates each test of positioning (ISO 230-2, ISO 230-6) when its last pass is done."""

import sys
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.messages.positioning import from_positioning_test
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.standards.axis_test import completed_by
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.lines import LineNode


class EvaluatorNode(LineNode):
    """Publishes the parameters of a line's test once all its planned passes are measured."""

    role = "evaluator"

    def __init__(self) -> None:
        super().__init__("evaluator")
        self._plan: Plan
        self._tests = self.announce(topics.POSITIONING_TEST)
        self.follow_lines()

    def take_up(self, description: Any) -> None:
        """Start again with the plan of the run."""
        self._plan = plan_from_text(description.plan, "plan of the run")

    def on_line(self, line: MeasuredLine) -> None:
        """Evaluate the test that this line completes, if it does.

        The lines of a tracker are evaluated by the solver, which knows where the tracker stands.
        """
        if self._plan.tracker is not None:
            return
        runs = completed_by(line, tuple(self.lines), self._plan)
        if runs is not None:
            test = evaluate(runs)
            self._tests.publish(from_positioning_test(test, self.run_id, line.end_time))
            self.get_logger().info(f"{test.standard} test of {test.name} evaluated")


def main() -> int:
    """Run the node."""
    return spin(EvaluatorNode)


if __name__ == "__main__":
    sys.exit(main())
