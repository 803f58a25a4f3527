"""The topics of a run: names, types, quality of service, and which of them a bag keeps.

Names are relative: a node started in a namespace uses them below it. Plain data, no ROS client.
"""

from dataclasses import dataclass
from enum import Enum


class Qos(Enum):
    """Quality of service of a topic; every kind is reliable and keeps the last ``depth`` messages.

    Attributes:
        depth: how many messages are kept for a slow subscriber (or, latched, for a late one).
        transient_local: a late subscriber receives what was published before it came.
    """

    STREAM = (2000, False)
    """Many messages a second, none of which may be lost."""
    COMMAND = (100, False)
    """Single events; a late subscriber must not receive an old one."""
    LATCHED = (10, True)
    """States and descriptions that a late subscriber needs."""
    HISTORY = (1000, True)
    """Lines: a solver that is started again during a run needs all of them."""

    def __init__(self, depth: int, transient_local: bool) -> None:
        self.depth = depth
        self.transient_local = transient_local


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
    """

    name: str
    type_name: str
    qos: Qos
    recorded: bool = True
    derived: bool = False
    conclusive: str = ""


RUN_DESCRIPTION = Topic("run/description", "stepdiag_ros/msg/RunDescription", Qos.LATCHED)
RUN_STATE = Topic("run/state", "stepdiag_ros/msg/RunState", Qos.LATCHED)
MACHINE_COMMAND = Topic("machine/command", "stepdiag_ros/msg/StepCommand", Qos.COMMAND)
COMMAND_STATUS = Topic("machine/command_status", "stepdiag_ros/msg/CommandStatus", Qos.COMMAND)
MACHINE_STATE = Topic("machine/state", "stepdiag_ros/msg/MachineState", Qos.LATCHED)
JOINT_STATES = Topic("joint_states", "sensor_msgs/msg/JointState", Qos.STREAM)
READING = Topic("interferometer/reading", "stepdiag_ros/msg/InterferometerReading", Qos.STREAM)
AIR_TEMPERATURE = Topic("weather/air_temperature", "sensor_msgs/msg/Temperature", Qos.STREAM)
MATERIAL_TEMPERATURE = Topic(
    "weather/material_temperature", "sensor_msgs/msg/Temperature", Qos.STREAM
)
AIR_PRESSURE = Topic("weather/air_pressure", "sensor_msgs/msg/FluidPressure", Qos.STREAM)
RELATIVE_HUMIDITY = Topic(
    "weather/relative_humidity", "sensor_msgs/msg/RelativeHumidity", Qos.STREAM
)
STOP = Topic("measurement/stop", "stepdiag_ros/msg/SettledStop", Qos.COMMAND, derived=True)
BLOCK = Topic("measurement/block", "stepdiag_ros/msg/BlockDisplacement", Qos.COMMAND, derived=True)
LINE = Topic("measurement/line", "stepdiag_ros/msg/MeasuredLine", Qos.HISTORY, derived=True)
VOLUMETRIC_ERRORS = Topic(
    "result/volumetric_errors", "stepdiag_ros/msg/VolumetricErrors", Qos.LATCHED, derived=True
)
POSITIONING_TEST = Topic(
    "result/positioning_test", "stepdiag_ros/msg/PositioningTest", Qos.HISTORY, derived=True
)
DIAGNOSIS = Topic(
    "result/diagnosis",
    "stepdiag_ros/msg/Diagnosis",
    Qos.LATCHED,
    derived=True,
    conclusive="run_over",
)
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", Qos.COMMAND)
CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock", Qos.STREAM, recorded=False)

TOPICS = (
    RUN_DESCRIPTION,
    RUN_STATE,
    MACHINE_COMMAND,
    COMMAND_STATUS,
    MACHINE_STATE,
    JOINT_STATES,
    READING,
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
    DIAGNOSTICS,
    CLOCK,
)
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
