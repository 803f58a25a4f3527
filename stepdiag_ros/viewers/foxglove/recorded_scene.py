"""Frames and markers of a recorded run, made as the scene node makes them of a live one."""

from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.configuration import chain_from_text, plan_from_text
from stepdiag_ros.messages.conversion import axis_positions, to_measured_line
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.messages.volumetric import to_volumetric_errors
from stepdiag_ros.run.sequence import State
from stepdiag_ros.topics import Topic
from stepdiag_ros.viewers.scene.conversion import from_placements, from_shapes
from stepdiag_ros.viewers.scene.run_picture import RunPicture, View

SOURCES = (
    topics.RUN_STATE,
    topics.JOINT_STATES,
    topics.LINE,
    topics.VOLUMETRIC_ERRORS,
)
"""What the picture is made of, besides the run's description."""
MADE = (topics.FRAMES, topics.FIXED_FRAMES, topics.RUN_MARKERS, topics.ERROR_MARKERS)
"""What is made."""
_VIEW = View()


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
        self._picture = RunPicture()
        self._picture.begin(self._plan, self._chain)
        self._position_time = 0

    def take(self, topic: Topic, message: Any) -> None:
        """Take note of a message of one of ``SOURCES``."""
        if topic is topics.JOINT_STATES:
            position = axis_positions(message)
            if position is not None:
                self._picture.take_position(position)
                self._position_time = to_nanoseconds(message.header.stamp)
        elif topic is topics.LINE:
            self._picture.take_line(to_measured_line(message))
        elif topic is topics.VOLUMETRIC_ERRORS:
            self._picture.take_result(to_volumetric_errors(message))
        elif topic is topics.RUN_STATE:
            over = State(message.state) in (State.FINISHED, State.ABORTED)
            self._picture.take_present(None if over else int(message.line_index))

    def tool(self) -> bytes | None:
        """Return where the tool is, if it has moved: CDR of a TFMessage."""
        placements = self._picture.tool()
        if placements is None:
            return None
        message = from_placements(placements, self._position_time)
        return own_types().encode(topics.FRAMES.type_name, message)

    def drawn(self, time: int) -> dict[Topic, bytes]:
        """Return what is to be drawn again: CDR of fixed frames and markers.

        Args:
            time: of the recording, ns.
        """
        made: dict[Topic, Any] = {}
        setup = self._picture.setup(_VIEW)
        if setup is not None:
            made[topics.FIXED_FRAMES] = from_placements(setup, time)
        for topic, shapes in (
            (topics.RUN_MARKERS, self._picture.progress(_VIEW)),
            (topics.ERROR_MARKERS, self._picture.errors(_VIEW)),
        ):
            if shapes is not None:
                made[topic] = from_shapes(shapes, time)
        types = own_types()
        return {topic: types.encode(topic.type_name, one) for topic, one in made.items()}
