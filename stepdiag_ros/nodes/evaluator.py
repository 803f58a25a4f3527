#!/usr/bin/env python3
"""Node: evaluates each test of positioning (ISO 230-2, ISO 230-6) when its last pass is done."""

import sys
from collections import deque
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.conversion import to_measured_line
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.standards.axis_test import completed_by
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.positioning_conversion import from_positioning_test


class EvaluatorNode(StepdiagNode):
    """Publishes the parameters of a line's test once all its planned passes are measured."""

    role = "evaluator"

    def __init__(self) -> None:
        super().__init__("evaluator")
        self._plan: Plan | None = None
        self._lines: list[MeasuredLine] = []
        self._early: deque[Any] = deque(maxlen=topics.LINE.qos.depth)
        self._tests = self.announce(topics.POSITIONING_TEST)
        self.follow_run()
        self.listen(topics.LINE, self._on_line)

    def on_run(self, description: Any) -> None:
        """Begin anew; lines that came before the description are taken up now."""
        self._plan = plan_from_text(description.plan, "plan of the run")
        self._lines = []
        self.run_id = description.run_id
        for _ in range(len(self._early)):
            self._on_line(self._early.popleft())

    def _on_line(self, message: Any) -> None:
        if self._plan is None or message.run_id != self.run_id:
            self._early.append(message)
            return
        line = to_measured_line(message)
        self._lines.append(line)
        runs = completed_by(line, tuple(self._lines), self._plan)
        if runs is not None:
            test = evaluate(runs)
            self._tests.publish(from_positioning_test(test, self.run_id, line.end_time))
            self.get_logger().info(f"{test.standard} test of {test.name} evaluated")


def main() -> int:
    """Run the node."""
    return spin(EvaluatorNode)


if __name__ == "__main__":
    sys.exit(main())
