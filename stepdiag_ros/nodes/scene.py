#!/usr/bin/env python3
"""Node: shows frames, measured lines and errors to RViz and Foxglove."""

import sys
from collections import deque
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from stepdiag_ros import topics
from stepdiag_ros.configuration import chain_from_text, plan_from_text
from stepdiag_ros.conversion import axis_positions, to_nanoseconds, to_volumetric_errors
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.lines import LineNode
from stepdiag_ros.nodes.links import message_class
from stepdiag_ros.scene.error_markers import Options, chosen_results, picture
from stepdiag_ros.scene.frames import (
    Triple,
    setup_placements,
    tool_placement,
    workpiece_placement,
)
from stepdiag_ros.scene.progress_markers import Progress, progress_markers
from stepdiag_ros.scene_conversion import from_placements, from_shapes

DRAW_PERIOD = 0.5
"""Real seconds between two pictures, at least; many results in a row make one."""


class SceneNode(LineNode):
    """Publishes frames on /tf and /tf_static, and markers of the run and of its results."""

    role = "scene"

    def __init__(self) -> None:
        super().__init__("scene")
        self._prefix: str = self.parameter("frame_prefix")
        self._plan: Plan | None = None
        self._chain = ""
        self._results: dict[str, VolumetricErrors] = {}
        self._early_results: deque[Any] = deque(maxlen=topics.VOLUMETRIC_ERRORS.depth)
        self._measured: dict[int, bool] = {}
        self._line_index = 0
        self._present: int | None = None
        self._position: Triple | None = None
        self._position_time = 0
        # What is drawn anew at the next look.
        self._errors_changed = self._run_changed = self._tool_moved = False
        self._tool = self.announce(topics.FRAMES)
        self._fixed = self.announce(topics.FIXED_FRAMES)
        self._error_markers = self.announce(topics.ERROR_MARKERS)
        self._run_markers = self.announce(topics.RUN_MARKERS)
        for name in ("method", "exaggeration"):
            self.on_change(name, lambda _: self._redraw(errors=True))
        for name in ("laser_distance", *(f"mirror_offset_{axis}" for axis in "xyz")):
            self.on_change(name, lambda _: self._redraw(setup=True))
        self.follow_lines()
        self.listen(topics.VOLUMETRIC_ERRORS, self._on_result)
        # The newest position is enough, and a slow viewer must never hold the bridge up.
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        positions = topics.JOINT_STATES
        self.create_subscription(message_class(positions), positions.name, self._on_joints, newest)
        self.every(1.0 / self.parameter("tool_rate"), self._publish_tool, real=True)
        self.every(DRAW_PERIOD, self._draw, real=True)

    def take_up(self, description: Any) -> None:
        """Begin a new picture: the box and the lines of the plan, and the first setup."""
        plan = plan_from_text(description.plan, "plan of the run")
        self._chain = chain_from_text(description.machine, "machine of the run")
        self._plan = plan
        self._results, self._measured = {}, {}
        self._line_index, self._present = 0, None
        self._redraw(errors=True, setup=True)

    def on_run(self, description: Any) -> None:
        """Take up the run, and the results that came before its description."""
        super().on_run(description)
        for _ in range(len(self._early_results)):
            self._on_result(self._early_results.popleft())

    def on_line(self, line: MeasuredLine) -> None:
        """Show the line as measured."""
        self._measured[line.line_index] = line.complete
        self._run_changed = True

    def on_run_state(self, state: Any) -> None:
        """Show which line is being measured, with laser and mirror set up for it."""
        if self._plan is None or state.run_id != self.run_id:
            return
        present = None if self.run_over else int(state.line_index)
        if present == self._present or (present or 0) >= len(self._plan.lines):
            return
        self._present = present
        if present is not None:
            self._line_index = present
        self._redraw(setup=True)

    def _on_result(self, message: Any) -> None:
        if self._plan is None or message.run_id != self.run_id:
            self._early_results.append(message)
            return
        try:
            result = to_volumetric_errors(message)
        except ValueError as error:
            self.unwell(f"a result cannot be shown: {error}")
            return
        self._results[result.method] = result
        self._errors_changed = True

    def _on_joints(self, message: Any) -> None:
        position = axis_positions(message)
        if position is None:
            return
        self._position = position
        self._position_time = to_nanoseconds(message.header.stamp)
        self._tool_moved = self._run_changed = True

    def _redraw(self, errors: bool = False, setup: bool = False) -> None:
        self._errors_changed |= errors
        if setup:
            self._run_changed = True
            self._publish_fixed()

    @property
    def _mirror_offset(self) -> Triple:
        x, y, z = (self.parameter(f"mirror_offset_{axis}") for axis in "xyz")
        return x, y, z

    def _publish_fixed(self) -> None:
        if self._plan is None:
            return
        line, volume = self._plan.lines[self._line_index], self._plan.volume
        distance = self.parameter("laser_distance")
        placements = (
            workpiece_placement(volume),
            *setup_placements(line, volume, distance, self._mirror_offset),
        )
        self._fixed.publish(from_placements(placements, self.now(), self._prefix))

    def _publish_tool(self) -> None:
        if self._tool_moved and self._position is not None and self.context.ok():
            self._tool_moved = False
            placement = tool_placement(self._position)
            self._tool.publish(from_placements([placement], self._position_time, self._prefix))

    def _draw(self) -> None:
        if self._plan is None or not self.context.ok():
            return
        if self._run_changed:
            self._run_changed = False
            progress = Progress(
                self._measured,
                self._present,
                self._position,
                self.parameter("laser_distance"),
                self._mirror_offset,
            )
            shapes = progress_markers(self._plan, progress)
            self._run_markers.publish(from_shapes(shapes, self.now(), self._prefix))
        if self._errors_changed:
            self._errors_changed = False
            results = chosen_results(self._results, self.parameter("method"))
            options = Options(self.parameter("exaggeration"), self._chain)
            shapes = picture(results, self._plan, options)
            self._error_markers.publish(from_shapes(shapes, self.now(), self._prefix))


def main() -> int:
    """Run the node."""
    return spin(SceneNode)


if __name__ == "__main__":
    sys.exit(main())
