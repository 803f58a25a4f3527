"""What nodes share that work on the finished lines of a run, one after another."""

from collections import deque
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.messages.conversion import to_measured_line
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import MOST_STOPS
from stepdiag_ros.nodes.base import StepdiagNode

MOST_KEPT = 2 * MOST_STOPS
"""Stops of all lines of a run, every attempt; of more, lines are refused."""
_FEWEST_STOPS = 2


class LineNode(StepdiagNode):
    """Follows a run and collects its lines; those that come before the run's description wait.

    Args:
        name: default name of the node.

    Attributes:
        lines: of the present run, every attempt, in the order in which they were finished.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.lines: list[MeasuredLine] = []
        self._kept = 0
        self._described = False
        self._early: deque[Any] = deque(maxlen=topics.LINE.depth)

    def follow_lines(self) -> None:
        """Call ``take_up`` when a run begins and ``on_line`` with each of its lines."""
        self.follow_run()
        self.listen(topics.LINE, self._hear_line)

    def take_up(self, description: Any) -> None:
        """Called with the RunDescription of a new run, before its lines.

        Raises:
            ValueError: the node cannot take up this run.
        """

    def on_line(self, line: MeasuredLine) -> None:
        """Called with each line, which is in ``lines`` already."""

    def on_run(self, description: Any) -> None:
        """Start again; lines that came before the description are taken up now."""
        self.take_up(description)
        self.lines, self._kept = [], 0
        self.run_id, self._described = description.run_id, True
        for _ in range(len(self._early)):
            self.try_with(topics.LINE.name, self._hear_line, self._early.popleft())

    def _hear_line(self, message: Any) -> None:
        if not self._described or message.run_id != self.run_id:
            self._early.append(message)
            return
        line = to_measured_line(message)
        stops = max(len(line.time), _FEWEST_STOPS)
        if self._kept + stops > MOST_KEPT:
            raise ValueError(f"the lines of run {self.run_id} have more than {MOST_KEPT} stops")
        self._kept += stops
        self.lines.append(line)
        self.on_line(line)
