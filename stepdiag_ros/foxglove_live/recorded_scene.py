"""Frames and markers of a recorded run, made as the scene node makes them of a live one."""

from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.configuration import chain_from_text, plan_from_text
from stepdiag_ros.conversion import (
    axis_positions,
    to_measured_line,
    to_nanoseconds,
    to_volumetric_errors,
)
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.run.sequence import State
from stepdiag_ros.scene.error_markers import Options, chosen_results, picture
from stepdiag_ros.scene.frames import (
    Triple,
    setup_placements,
    tool_placement,
    workpiece_placement,
)
from stepdiag_ros.scene.progress_markers import Progress, progress_markers
from stepdiag_ros.scene_conversion import from_placements, from_shapes
from stepdiag_ros.topics import Topic

SOURCES = (
    topics.RUN_STATE,
    topics.JOINT_STATES,
    topics.LINE,
    topics.VOLUMETRIC_ERRORS,
)
"""What the picture is made of, besides the run's description."""
MADE = (topics.FRAMES, topics.FIXED_FRAMES, topics.RUN_MARKERS, topics.ERROR_MARKERS)
"""What is made."""


class RecordedScene:
    """Follows a recorded run and draws what has changed since it was last asked.

    Args:
        description: RunDescription of the run.
    """

    def __init__(self, description: Any) -> None:
        self._plan = plan_from_text(description.plan, "plan of the run")
        self._chain = chain_from_text(description.machine, "machine of the run")
        self.begin_anew()

    def begin_anew(self) -> None:
        """Go back to before the first message of the run."""
        self._results: dict[str, VolumetricErrors] = {}
        self._measured: dict[int, bool] = {}
        self._line_index = 0
        self._present: int | None = None
        self._position: Triple | None = None
        self._position_time = 0
        self._changed = {topics.FIXED_FRAMES, topics.RUN_MARKERS, topics.ERROR_MARKERS}

    def take(self, topic: Topic, message: Any) -> None:
        """Take note of a message of one of ``SOURCES``."""
        if topic is topics.JOINT_STATES:
            position = axis_positions(message)
            if position is not None:
                self._position = position
                self._position_time = to_nanoseconds(message.header.stamp)
                self._changed |= {topics.FRAMES, topics.RUN_MARKERS}
        elif topic is topics.LINE:
            line = to_measured_line(message)
            self._measured[line.line_index] = line.complete
            self._changed.add(topics.RUN_MARKERS)
        elif topic is topics.VOLUMETRIC_ERRORS:
            result = to_volumetric_errors(message)
            self._results[result.method] = result
            self._changed.add(topics.ERROR_MARKERS)
        elif topic is topics.RUN_STATE:
            self._follow(message)

    def _follow(self, state: Any) -> None:
        over = State(state.state) in (State.FINISHED, State.ABORTED)
        present = None if over else int(state.line_index)
        if present != self._present and (present or 0) < len(self._plan.lines):
            self._present = present
            self._line_index = self._line_index if present is None else present
            self._changed |= {topics.FIXED_FRAMES, topics.RUN_MARKERS}

    def tool(self) -> bytes | None:
        """Return where the tool is, if it has moved: CDR of a TFMessage."""
        if topics.FRAMES not in self._changed or self._position is None:
            return None
        self._changed.discard(topics.FRAMES)
        placements = [tool_placement(self._position)]
        message = from_placements(placements, self._position_time)
        return own_types().encode(topics.FRAMES.type_name, message)

    def drawn(self, time: int) -> dict[Topic, bytes]:
        """Return what is to be drawn anew: CDR of fixed frames and markers.

        Args:
            time: of the recording, ns.
        """
        made: dict[Topic, Any] = {}
        if topics.FIXED_FRAMES in self._changed:
            made[topics.FIXED_FRAMES] = from_placements(self._fixed(), time)
        if topics.RUN_MARKERS in self._changed:
            progress = Progress(dict(self._measured), self._present, self._position)
            made[topics.RUN_MARKERS] = from_shapes(progress_markers(self._plan, progress), time)
        if topics.ERROR_MARKERS in self._changed:
            chosen = chosen_results(self._results, "preferred")
            shapes = picture(chosen, self._plan, Options(chain=self._chain))
            made[topics.ERROR_MARKERS] = from_shapes(shapes, time)
        self._changed &= {topics.FRAMES}
        types = own_types()
        return {topic: types.encode(topic.type_name, one) for topic, one in made.items()}

    def _fixed(self) -> tuple[Any, ...]:
        plan, like_live = self._plan, Progress()
        setup = setup_placements(
            plan.lines[self._line_index],
            plan.volume,
            like_live.laser_distance,
            like_live.mirror_offset,
        )
        return (workpiece_placement(plan.volume), *setup)
