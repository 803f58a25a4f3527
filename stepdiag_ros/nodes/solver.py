#!/usr/bin/env python3
"""Node: solves for the volumetric errors after every finished line."""

import sys
from collections import deque
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import chain_from_text, plan_from_text
from stepdiag_ros.conversion import from_volumetric_errors, to_measured_line
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement, latest_attempts
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.solving import solve_reproducibly


class SolverNode(StepdiagNode):
    """Publishes what each method makes of the lines so far, with its uncertainty."""

    role = "solver"

    def __init__(self) -> None:
        super().__init__("solver")
        self._volume: Volume | None = None
        self._chain = ""
        self._lines: list[MeasuredLine] = []
        self._early: deque[Any] = deque(maxlen=topics.LINE.qos.depth)
        self._results = self.announce(topics.VOLUMETRIC_ERRORS)
        self.follow_run()
        self.listen(topics.LINE, self._on_line)

    def on_run(self, description: Any) -> None:
        """Begin anew; lines that came before the description are taken up now."""
        self._volume = plan_from_text(description.plan, "plan of the run").volume
        self._chain = chain_from_text(description.machine, "machine of the run")
        self._lines = []
        self.run_id = description.run_id
        for _ in range(len(self._early)):
            self._on_line(self._early.popleft())

    def _on_line(self, message: Any) -> None:
        if self._volume is None or message.run_id != self.run_id:
            self._early.append(message)
            return
        self._lines.append(to_measured_line(message))
        measurement = Measurement(self._volume, latest_attempts(tuple(self._lines)), self._chain)
        results, _ = solve_reproducibly(measurement)
        for result in results.values():
            time = self._lines[-1].end_time
            self._results.publish(from_volumetric_errors(result, self.run_id, time))
        self.get_logger().info(f"{len(self._lines)} lines solved; last: {self._lines[-1].line}")


def main() -> int:
    """Run the node."""
    return spin(SolverNode)


if __name__ == "__main__":
    sys.exit(main())
