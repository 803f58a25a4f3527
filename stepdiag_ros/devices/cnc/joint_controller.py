"""What the driver ``ros2_control`` needs of ROS, as plain data: a joint trajectory controller.

The driver does not import ROS: ``RosJointController`` of the nodes has that side.
"""

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple, Protocol


class TrajectoryPoint(NamedTuple):
    """A place on a trajectory.

    Attributes:
        time: since its start, s.
        positions: of the joints, in their own units (m or rad).
        velocities: of the joints, units/s.
    """

    time: float
    positions: tuple[float, ...]
    velocities: tuple[float, ...]


class Trajectory(NamedTuple):
    """A goal of ``control_msgs/action/FollowJointTrajectory``.

    Attributes:
        joints: their names.
        points: in the order of their times; the first is not the start.
        path_tolerance: of each joint on its way, in its unit.
        goal_tolerance: of each joint at the end, in its unit.
        goal_time_tolerance: after the last point, in which the joints arrive, s.
    """

    joints: tuple[str, ...]
    points: tuple[TrajectoryPoint, ...]
    path_tolerance: tuple[float, ...]
    goal_tolerance: tuple[float, ...]
    goal_time_tolerance: float


class JointSample(NamedTuple):
    """Actual positions of some joints at a time (ns), in their own units."""

    time: int
    positions: Mapping[str, float]


class GoalAnswer(NamedTuple):
    """Whether the controller accepts a goal, by the number that ``send`` was given."""

    number: int
    accepted: bool


class Outcome(Enum):
    """How a goal has ended."""

    SUCCEEDED = "succeeded"
    CANCELED = "was cancelled"
    ABORTED = "was aborted"


class GoalEnd(NamedTuple):
    """A goal has ended, with the controller's code and words."""

    number: int
    outcome: Outcome
    code: int
    text: str


class OtherGoals(NamedTuple):
    """How many goals of other clients the controller works at."""

    active: int


class Hardware(NamedTuple):
    """A hardware component: its name, its state, and the joints that it moves."""

    name: str
    state: str
    joints: frozenset[str]


class ManagerReport(NamedTuple):
    """States of the controllers by name, and of the hardware."""

    controllers: Mapping[str, str]
    hardware: tuple[Hardware, ...]


class RobotDescription(NamedTuple):
    """The robot's URDF."""

    text: str


News = JointSample | GoalAnswer | GoalEnd | OtherGoals | ManagerReport | RobotDescription


class ControllerNames(NamedTuple):
    """Absolute ROS names of a controller and of what belongs to it.

    Attributes:
        controller: node of the joint trajectory controller, such as ``/gantry_controller``.
        manager: node of the controller manager.
        joint_states: topic of the actual positions.
        description: topic of the URDF; empty if limits come from the machine file alone.
    """

    controller: str
    manager: str
    joint_states: str
    description: str


class JointController(Protocol):
    """A joint trajectory controller and its controller manager; no call waits for an answer."""

    @property
    def reachable(self) -> bool:
        """Whether the action server of the controller is there."""
        ...

    def alternatives(self) -> list[str]:
        """Return the controllers that could have been meant: those whose action is on the graph."""
        ...

    def managers(self) -> list[str]:
        """Return the controller managers that are on the graph."""
        ...

    def ask_manager(self) -> None:
        """Ask for the states of controllers and hardware; ``ManagerReport`` comes as news."""
        ...

    def send(self, number: int, trajectory: Trajectory) -> None:
        """Send a goal; ``GoalAnswer`` and ``GoalEnd`` with its number come as news."""
        ...

    def cancel(self) -> None:
        """Cancel the goal that was sent last, as soon as the controller has it."""
        ...

    def news(self) -> list[News]:
        """Return what has come since the last call, in its order."""
        ...

    def close(self) -> None:
        """Let the controller go; a goal that is at work is cancelled."""
        ...
