"""The ROS side of the driver ``ros2_control``: topics, services and the action of a controller.

Everything happens in the callbacks of the node that owns the driver; no call waits.
"""

import uuid
from collections import deque
from collections.abc import Iterator
from functools import partial
from typing import Any

from action_msgs.msg import GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectoryPoint
from unique_identifier_msgs.msg import UUID

from stepdiag_ros.devices.cnc.joint_controller import (
    ControllerNames,
    GoalAnswer,
    GoalEnd,
    Hardware,
    JointSample,
    ManagerReport,
    News,
    OtherGoals,
    Outcome,
    RobotDescription,
    Trajectory,
)
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.topics import JOINT_STATES

try:
    from control_msgs.action import FollowJointTrajectory
    from control_msgs.msg import JointTolerance
    from controller_manager_msgs.srv import ListControllers, ListHardwareComponents
except ImportError as error:
    raise Refusal(
        "the driver 'ros2_control' needs control_msgs and controller_manager_msgs, which are not"
        " installed: sudo apt install ros-$ROS_DISTRO-control-msgs"
        " ros-$ROS_DISTRO-controller-manager-msgs",
        fault="not_installed",
    ) from error

ACTION = "follow_joint_trajectory"
ACTION_TYPE = "control_msgs/action/FollowJointTrajectory"
LISTING, LISTING_TYPE = "list_controllers", "controller_manager_msgs/srv/ListControllers"
DEPTH = 1000
"""Messages: a second of the fastest controllers that are usual."""
_ACTIVE = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)
"""Of goals that move joints. One that is being cancelled does not: it may remain so for ever."""
_OUTCOMES = {
    GoalStatus.STATUS_SUCCEEDED: Outcome.SUCCEEDED,
    GoalStatus.STATUS_CANCELED: Outcome.CANCELED,
}


class RosJointController:
    """A joint trajectory controller as a node sees it (protocol: ``JointController``).

    Args:
        node: that owns the driver.
        names: of the controller and what belongs to it.

    Raises:
        ValueError: the controller's joint states come on the topic on which the node publishes.
    """

    def __init__(self, node: Any, names: ControllerNames) -> None:
        if node.resolve_topic_name(JOINT_STATES.name) == names.joint_states:
            raise Refusal(
                f"the nodes of this package publish on {names.joint_states} as well: start them in"
                " a namespace of their own, such as /stepdiag (launch argument namespace)",
                fault="ambiguous",
                about="joint_states",
            )
        self._node, self._names = node, names
        self._news: list[News] = []
        self._goals: deque[bytes] = deque(maxlen=10)
        self._number = 0
        self._handle: Any = None
        self._answered, self._cancelled = True, False
        self._others = 0
        self._asking: list[Any] = []
        self._hardware: tuple[Hardware, ...] = ()
        self._action = ActionClient(node, FollowJointTrajectory, f"{names.controller}/{ACTION}")
        self._controllers = node.create_client(ListControllers, f"{names.manager}/{LISTING}")
        self._components = node.create_client(
            ListHardwareComponents, f"{names.manager}/list_hardware_components"
        )
        self._cancels = node.create_client(
            CancelGoal, f"{names.controller}/{ACTION}/_action/cancel_goal"
        )
        self._subscriptions = list(self._subscribe())

    def _subscribe(self) -> Iterator[Any]:
        latched = QoSProfile(
            depth=1,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        # A reader that does not insist is served by publishers of both kinds.
        stream = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        subscribe, names = self._node.create_subscription, self._names
        yield subscribe(JointState, names.joint_states, self._on_joints, stream)
        status = f"{names.controller}/{ACTION}/_action/status"
        yield subscribe(GoalStatusArray, status, self._on_status, latched)
        if names.description:
            yield subscribe(String, names.description, self._on_description, latched)

    @property
    def reachable(self) -> bool:
        """Whether the action server of the controller is there."""
        return bool(self._action.server_is_ready())

    def alternatives(self) -> list[str]:
        """Return the controllers whose action is on the graph, but for the one that is missing."""
        own = f"{self._names.controller}/{ACTION}"
        return sorted(
            name.removesuffix(f"/{ACTION}")
            for name, types in get_action_names_and_types(self._node)
            if ACTION_TYPE in types and name != own
        )

    def managers(self) -> list[str]:
        """Return the controller managers that are on the graph."""
        return sorted(
            name.removesuffix(f"/{LISTING}")
            for name, types in self._node.get_service_names_and_types()
            if LISTING_TYPE in types
        )

    def ask_manager(self) -> None:
        """Ask for the states of hardware and controllers, one question at a time."""
        if any(not future.done() for future in self._asking):
            return
        if not (self._controllers.service_is_ready() and self._components.service_is_ready()):
            return
        hardware = self._components.call_async(ListHardwareComponents.Request())
        hardware.add_done_callback(self._on_hardware)
        controllers = self._controllers.call_async(ListControllers.Request())
        controllers.add_done_callback(self._on_controllers)
        self._asking = [hardware, controllers]

    def send(self, number: int, trajectory: Trajectory) -> None:
        """Send a goal; what becomes of it comes as news."""
        goal_id = uuid.uuid4().bytes
        self._goals.append(goal_id)
        self._number = number
        self._handle, self._answered, self._cancelled = None, False, False
        future = self._action.send_goal_async(
            goal_message(trajectory), goal_uuid=UUID(uuid=list(goal_id))
        )
        future.add_done_callback(partial(self._on_answer, number))

    def cancel(self) -> None:
        """Cancel the goal that was sent last, as soon as the controller has it."""
        self._cancelled = True
        if self._handle is not None:
            self._handle.cancel_goal_async()

    def news(self) -> list[News]:
        """Return what has come since the last call, in its order."""
        news, self._news = self._news, []
        return news

    def close(self) -> None:
        """Let the controller go; a goal that is at work is cancelled."""
        if self._handle is not None:
            self._handle.cancel_goal_async()
        elif not self._answered and self._cancels.service_is_ready():
            # The goal has no handle yet: an empty request cancels all goals of the controller.
            self._cancels.call_async(CancelGoal.Request())
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        for client in (self._controllers, self._components, self._cancels):
            self._node.destroy_client(client)
        self._action.destroy()

    # What comes -----------------------------------------------------------------------------------

    def _on_joints(self, message: Any) -> None:
        positions = dict(zip(message.name, message.position, strict=False))
        self._news.append(JointSample(to_nanoseconds(message.header.stamp), positions))

    def _on_description(self, message: Any) -> None:
        self._news.append(RobotDescription(message.data))

    def _on_status(self, message: Any) -> None:
        others = sum(
            entry.status in _ACTIVE and bytes(entry.goal_info.goal_id.uuid) not in self._goals
            for entry in message.status_list
        )
        if others != self._others:
            self._others = others
            self._news.append(OtherGoals(others))

    def _on_answer(self, number: int, future: Any) -> None:
        handle = future.result()
        self._answered = True
        self._news.append(GoalAnswer(number, handle.accepted))
        if not handle.accepted:
            return
        self._handle = handle
        handle.get_result_async().add_done_callback(partial(self._on_result, number))
        if self._cancelled:
            handle.cancel_goal_async()

    def _on_result(self, number: int, future: Any) -> None:
        # A goal cancelled between its end and the report ends only as the next one is accepted.
        if number == self._number:
            self._handle = None
        response = future.result()
        outcome = _OUTCOMES.get(response.status, Outcome.ABORTED)
        result = response.result
        self._news.append(GoalEnd(number, outcome, result.error_code, result.error_string))

    def _on_hardware(self, future: Any) -> None:
        self._hardware = tuple(
            Hardware(
                part.name,
                part.state.label,
                frozenset(end.name.rpartition("/")[0] for end in part.command_interfaces),
            )
            for part in future.result().component
        )

    def _on_controllers(self, future: Any) -> None:
        states = {one.name: one.state for one in future.result().controller}
        self._news.append(ManagerReport(states, self._hardware))


def goal_message(trajectory: Trajectory) -> Any:
    """Return the goal message of a trajectory; it begins when the controller has it."""
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = list(trajectory.joints)
    for point in trajectory.points:
        goal.trajectory.points.append(
            JointTrajectoryPoint(
                positions=list(point.positions),
                velocities=list(point.velocities),
                time_from_start=Duration(nanoseconds=round(point.time * 1e9)).to_msg(),
            )
        )
    for tolerances, given in (
        (goal.path_tolerance, trajectory.path_tolerance),
        (goal.goal_tolerance, trajectory.goal_tolerance),
    ):
        for name, tolerance in zip(trajectory.joints, given, strict=True):
            tolerances.append(JointTolerance(name=name, position=tolerance))
    goal.goal_time_tolerance = Duration(
        nanoseconds=round(trajectory.goal_time_tolerance * 1e9)
    ).to_msg()
    return goal
