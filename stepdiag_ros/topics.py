"""The topics of a run: names, types, quality of service, and which of them a bag keeps.

Names are relative: a node started in a namespace uses them below it. Plain data, no ROS client.
"""

from dataclasses import dataclass
from enum import Enum
from math import ceil

KEPT_SECONDS = 1.0
"""s: what a publisher sends in this time at its highest rate is kept for a slow subscriber."""


class Qos(Enum):
    """Quality of service of a topic by what its messages mean; every kind is reliable.

    Attributes:
        depth: how many messages are kept, at least, for a slow subscriber (or, where it is
            transient local, for a late one).
        transient_local: a late subscriber receives what was published before it came.
        repeated: messages that still hold are repeated slowly, for late subscribers over a bridge.
    """

    STREAM = (10, False, False)
    """Many messages a second, none of which may be lost; the rate determines how many are kept."""
    COMMAND = (100, False, False)
    """Single events; a late subscriber must not receive an old one."""
    EVENTS = (1000, True, False)
    """Events, one after another. A node that acts on them receives those from now on; a viewer also
    requests the earlier ones."""
    LATCHED = (1, True, True)
    """What takes the place of all before: descriptions, states, whole pictures for viewers."""
    RESULTS = (20, True, True)
    """What holds side by side, each in place of the one of its kind before."""
    HISTORY = (1000, True, True)
    """Lines and their tests: a solver that is started again during a run needs all of them."""

    def __init__(self, depth: int, transient_local: bool, repeated: bool) -> None:
        self.depth = depth
        self.transient_local = transient_local
        self.repeated = repeated


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: relative to the namespace, or absolute.
        type_name: ROS type, for example ``stepdiag_ros/msg/RunState``.
        qos: quality of service of publishers and subscribers.
        recorded: the recorder keeps it.
        derived: follows from the other topics; a replay publishes it only where the bag lacks the
            readings that it is derived from.
        conclusive: field of the message that is true in what follows from the recording alone; how
            many others come before it depends on the speed of the computer. Empty: all messages do.
        highest_rate: messages in a second, at most; no parameter of a node allows more.
        newest_of_each: fields of the message that distinguish messages that hold side by side, such
            as the results of several methods; empty where each message takes the place of the one
            before.
    """

    name: str
    type_name: str
    qos: Qos
    recorded: bool = True
    derived: bool = False
    conclusive: str = ""
    highest_rate: float = 0.0
    newest_of_each: tuple[str, ...] = ()

    @property
    def depth(self) -> int:
        """Return how many messages publishers and subscribers keep."""
        return max(self.qos.depth, ceil(self.highest_rate * KEPT_SECONDS))


RUN_DESCRIPTION = Topic("run/description", "stepdiag_ros/msg/RunDescription", Qos.LATCHED)
RUN_STATE = Topic("run/state", "stepdiag_ros/msg/RunState", Qos.LATCHED)
MACHINE_COMMAND = Topic("machine/command", "stepdiag_ros/msg/StepCommand", Qos.COMMAND)
MOTION_PERMIT = Topic(
    "machine/permit", "stepdiag_ros/msg/MotionPermit", Qos.COMMAND, recorded=False
)
COMMAND_STATUS = Topic("machine/command_status", "stepdiag_ros/msg/CommandStatus", Qos.COMMAND)
MACHINE_STATE = Topic("machine/state", "stepdiag_ros/msg/MachineState", Qos.LATCHED)
JOINT_STATES = Topic(
    "joint_states", "sensor_msgs/msg/JointState", Qos.STREAM, highest_rate=10_000.0
)
READING = Topic(
    "interferometer/reading",
    "stepdiag_ros/msg/InterferometerReading",
    Qos.STREAM,
    highest_rate=10_000.0,
)
SAMPLES = Topic(
    "interferometer/samples",
    "stepdiag_ros/msg/InterferometerSamples",
    Qos.STREAM,
    highest_rate=500.0,
)
AIR_TEMPERATURE = Topic(
    "weather/air_temperature", "sensor_msgs/msg/Temperature", Qos.STREAM, highest_rate=1000.0
)
MATERIAL_TEMPERATURE = Topic(
    "weather/material_temperature", "sensor_msgs/msg/Temperature", Qos.STREAM, highest_rate=1000.0
)
AIR_PRESSURE = Topic(
    "weather/air_pressure", "sensor_msgs/msg/FluidPressure", Qos.STREAM, highest_rate=1000.0
)
RELATIVE_HUMIDITY = Topic(
    "weather/relative_humidity", "sensor_msgs/msg/RelativeHumidity", Qos.STREAM, highest_rate=1000.0
)
STOP = Topic("measurement/stop", "stepdiag_ros/msg/SettledStop", Qos.EVENTS, derived=True)
BLOCK = Topic("measurement/block", "stepdiag_ros/msg/BlockDisplacement", Qos.EVENTS, derived=True)
LINE = Topic(
    "measurement/line",
    "stepdiag_ros/msg/MeasuredLine",
    Qos.HISTORY,
    derived=True,
    newest_of_each=("line_index", "attempt"),
)
VOLUMETRIC_ERRORS = Topic(
    "result/volumetric_errors",
    "stepdiag_ros/msg/VolumetricErrors",
    Qos.RESULTS,
    derived=True,
    newest_of_each=("method",),
)
POSITIONING_TEST = Topic(
    "result/positioning_test",
    "stepdiag_ros/msg/PositioningTest",
    Qos.HISTORY,
    derived=True,
    newest_of_each=("standard", "name", "kind", "setup"),
)
DIAGNOSIS = Topic(
    "result/diagnosis",
    "stepdiag_ros/msg/Diagnosis",
    Qos.LATCHED,
    derived=True,
    conclusive="run_over",
)
RUN_VERDICT = Topic(
    "result/verdict",
    "stepdiag_ros/msg/RunVerdict",
    Qos.LATCHED,
    derived=True,
    conclusive="run_over",
)
ERROR_MARKERS = Topic(
    "result/error_markers", "visualization_msgs/msg/MarkerArray", Qos.LATCHED, recorded=False
)
RUN_MARKERS = Topic(
    "run/markers", "visualization_msgs/msg/MarkerArray", Qos.LATCHED, recorded=False
)
FRAMES = Topic("/tf", "tf2_msgs/msg/TFMessage", Qos.COMMAND, recorded=False)
FIXED_FRAMES = Topic("/tf_static", "tf2_msgs/msg/TFMessage", Qos.LATCHED, recorded=False)
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", Qos.COMMAND)
CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock", Qos.STREAM, recorded=False, highest_rate=2000.0)

TOPICS = (
    RUN_DESCRIPTION,
    RUN_STATE,
    MACHINE_COMMAND,
    MOTION_PERMIT,
    COMMAND_STATUS,
    MACHINE_STATE,
    JOINT_STATES,
    READING,
    SAMPLES,
    AIR_TEMPERATURE,
    MATERIAL_TEMPERATURE,
    AIR_PRESSURE,
    RELATIVE_HUMIDITY,
    STOP,
    BLOCK,
    LINE,
    VOLUMETRIC_ERRORS,
    POSITIONING_TEST,
    DIAGNOSIS,
    RUN_VERDICT,
    ERROR_MARKERS,
    RUN_MARKERS,
    FRAMES,
    FIXED_FRAMES,
    DIAGNOSTICS,
    CLOCK,
)
WEATHER = {
    "air_temperature": (AIR_TEMPERATURE, "temperature"),
    "air_pressure": (AIR_PRESSURE, "fluid_pressure"),
    "relative_humidity": (RELATIVE_HUMIDITY, "relative_humidity"),
    "material_temperature": (MATERIAL_TEMPERATURE, "temperature"),
}
"""Field of ``measurement.Environment`` → topic and field of its message."""
COMMANDING = (MACHINE_COMMAND, MOTION_PERMIT)
"""What moves a machine: in a graph with a bridge the sequencer alone publishes these."""
RECORDED = tuple(topic for topic in TOPICS if topic.recorded)


def absolute(topic: Topic, namespace: str = "/") -> str:
    """Return the full name of a topic in a namespace, for example ``/cell/run/state``."""
    if topic.name.startswith("/"):
        return topic.name
    return "/" + f"{namespace.strip('/')}/{topic.name}".lstrip("/")


def topic_of(full_name: str) -> tuple[Topic, str] | None:
    """Return the topic that a full name stands for and its namespace; None for a foreign one."""
    for topic in TOPICS:
        if topic.name.startswith("/"):
            if full_name == topic.name:
                return topic, "/"
        elif full_name.endswith("/" + topic.name):
            return topic, full_name[: -len(topic.name) - 1] or "/"
    return None
