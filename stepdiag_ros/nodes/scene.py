#!/usr/bin/env python3
"""Node: shows frames, measured lines and errors to RViz and Foxglove."""

import sys
from collections import deque
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from stepdiag_ros import topics
from stepdiag_ros.configuration import chain_from_text, plan_from_text
from stepdiag_ros.messages.conversion import axis_positions
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.messages.volumetric import to_volumetric_errors
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.lines import LineNode
from stepdiag_ros.nodes.links import message_class
from stepdiag_ros.viewers.scene.conversion import from_placements, from_shapes
from stepdiag_ros.viewers.scene.run_picture import Part, RunPicture, View

DRAW_PERIOD = 0.5
"""Real seconds between two pictures, at least; many results in a row make one."""


class SceneNode(LineNode):
    """Publishes frames on /tf and /tf_static, and markers of the run and of its results."""

    role = "scene"

    def __init__(self) -> None:
        super().__init__("scene")
        self._prefix: str = self.parameter("frame_prefix")
        self._picture, self._begun = RunPicture(), False
        self._early_results: deque[Any] = deque(maxlen=topics.VOLUMETRIC_ERRORS.depth)
        self._position_time = 0
        self._tool = self.announce(topics.FRAMES)
        self._fixed = self.announce(topics.FIXED_FRAMES)
        self._error_markers = self.announce(topics.ERROR_MARKERS)
        self._run_markers = self.announce(topics.RUN_MARKERS)
        for name in ("method", "exaggeration"):
            self.on_change(name, lambda _: self._picture.redraw(Part.ERRORS))
        for name in ("laser_distance", *(f"mirror_offset_{axis}" for axis in "xyz")):
            self.on_change(name, lambda _: self._picture.redraw(Part.SETUP, Part.PROGRESS))
        self.follow_lines()
        self.listen(topics.VOLUMETRIC_ERRORS, self._on_result)
        # The newest position is enough, and a slow viewer must never hold the bridge up.
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        positions = topics.JOINT_STATES
        self.create_subscription(message_class(positions), positions.name, self._on_joints, newest)
        self.every(1.0 / self.parameter("tool_rate"), self._publish_tool, real=True)
        self.every(DRAW_PERIOD, self._draw, real=True)

    def take_up(self, description: Any) -> None:
        """Begin a new picture."""
        plan = plan_from_text(description.plan, "plan of the run")
        chain = chain_from_text(description.machine, "machine of the run")
        self._picture.begin(plan, chain)
        self._begun = True

    def on_run(self, description: Any) -> None:
        """Take up the run, and the results that came before its description."""
        super().on_run(description)
        for _ in range(len(self._early_results)):
            result = self._early_results.popleft()
            self.try_with(topics.VOLUMETRIC_ERRORS.name, self._on_result, result)

    def on_line(self, line: MeasuredLine) -> None:
        """Show the line as measured."""
        self._picture.take_line(line)

    def on_run_state(self, state: Any) -> None:
        """Show which line is being measured, with laser and mirror set up for it."""
        if self._begun and state.run_id == self.run_id:
            self._picture.take_present(None if self.run_over else int(state.line_index))

    def _on_result(self, message: Any) -> None:
        if not self._begun or message.run_id != self.run_id:
            self._early_results.append(message)
            return
        self._picture.take_result(to_volumetric_errors(message))

    def _on_joints(self, message: Any) -> None:
        position = axis_positions(message)
        if position is None:
            return
        self._picture.take_position(position)
        self._position_time = to_nanoseconds(message.header.stamp)

    def _view(self) -> View:
        x, y, z = (self.parameter(f"mirror_offset_{axis}") for axis in "xyz")
        return View(
            self.parameter("laser_distance"),
            (x, y, z),
            self.parameter("method"),
            self.parameter("exaggeration"),
        )

    def _publish_tool(self) -> None:
        if not self.context.ok():
            return
        tool = self._picture.tool()
        if tool is not None:
            self._tool.publish(from_placements(tool, self._position_time, self._prefix))

    def _draw(self) -> None:
        if not self.context.ok():
            return
        view, now = self._view(), self.now()
        setup = self._picture.setup(view)
        if setup is not None:
            self._fixed.publish(from_placements(setup, now, self._prefix))
        for publisher, shapes in (
            (self._run_markers, self._picture.progress(view)),
            (self._error_markers, self._picture.errors(view)),
        ):
            if shapes is not None:
                publisher.publish(from_shapes(shapes, now, self._prefix))


def main() -> int:
    """Run the node."""
    return spin(SceneNode)


if __name__ == "__main__":
    sys.exit(main())
