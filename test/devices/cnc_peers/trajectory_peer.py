"""ros2_control as other nodes see it: the action, services and topics around a robot.

They are those of the joint trajectory controller, the joint state broadcaster, the controller
manager and the robot state publisher; docs/ros2_control.md compares it with the real ones.
"""

import threading
import time

import rclpy
from control_msgs.action import FollowJointTrajectory
from controller_manager_msgs.msg import ControllerState, HardwareComponentState, HardwareInterface
from controller_manager_msgs.srv import ListControllers, ListHardwareComponents
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_robot import CANCELED, SUCCEEDED, TrajectoryRobot

PERIOD = 0.004
"""s: between two cycles of the controller."""
REPORTING = 0.05
"""s: between two reports of goals that have ended (``action_monitor_rate`` of Jazzy: 20 Hz)."""
URDF = """\
<robot name="gantry">
  <joint name="x" type="prismatic"><limit lower="-0.01" upper="1" velocity="1" effort="1"/></joint>
  <joint name="y1" type="prismatic"><limit lower="-0.01" upper="1" velocity="1" effort="1"/></joint>
  <joint name="y2" type="prismatic"><limit lower="-0.01" upper="1" velocity="1" effort="1"/></joint>
  <joint name="z" type="prismatic"><limit lower="-1" upper="0.01" velocity="1" effort="1"/></joint>
</robot>
"""


class TrajectoryPeer:
    """A gantry under ros2_control in ``namespace``; a context in whose block it is in the graph.

    Attributes:
        robot: behind it.
        sampling: joint states are published.
        managing: the controller manager answers (late, once it does again).
        during: number of a goal, from 1 → part of its time, and what happens, once, after it.
        reported: when ends of goals were last reported, s of the monotonic clock.
        targets: end of each goal of the action that was reached, in the units of the joints.
    """

    def __init__(self, namespace="/gantry"):
        self.namespace = namespace
        self.robot = TrajectoryRobot({"x": 0.0, "y1": 0.0, "y2": 0.0, "z": 0.0})
        self.sampling = self.managing = True
        self.during = {}
        self.lock = threading.RLock()
        self._ends, self._orphans = {}, []
        self.reported = 0.0

    @property
    def targets(self):
        return [place for key, place in self.robot.done if isinstance(key, bytes)]

    def __enter__(self):
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node(
            "ros2_control", namespace=self.namespace, context=self._context
        )
        self._make()
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._over = False
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over = True
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.shutdown()

    def _spin(self):
        while not self._over:
            self._executor.spin_once(timeout_sec=0.05)

    def _make(self):
        node = self._node
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_publisher(String, "robot_description", latched).publish(String(data=URDF))
        self._joints = node.create_publisher(JointState, "joint_states", 10)
        node.create_service(
            ListControllers, "controller_manager/list_controllers", self._controllers
        )
        node.create_service(
            ListHardwareComponents, "controller_manager/list_hardware_components", self._hardware
        )
        self._server = ActionServer(
            node,
            FollowJointTrajectory,
            "gantry_controller/follow_joint_trajectory",
            self._execute,
            goal_callback=self._on_goal,
            cancel_callback=self._on_cancel,
        )
        node.create_timer(PERIOD, self._cycle)

    def _cycle(self):
        with self.lock:
            robot = self.robot
            robot.step(time.monotonic())
            share, happens = self.during.get(robot.accepted, (2.0, None))
            if robot.share >= share:
                del self.during[robot.accepted]
                happens()
            if time.monotonic() - self.reported >= REPORTING:
                self._report()
            positions = robot.positions()
        if self.sampling:
            message = JointState(name=list(positions), position=list(positions.values()))
            message.header.stamp = self._node.get_clock().now().to_msg()
            self._joints.publish(message)

    def _report(self):
        self.reported = time.monotonic()
        for key, outcome, code, words in self.robot.ended:
            if key in self._ends:
                self._ends.pop(key).set_result((outcome, code, words))
        self.robot.ended.clear()

    def _controllers(self, _request, response):
        self._wait()
        for name, state in (
            ("joint_state_broadcaster", "active"),
            ("gantry_controller", self.robot.controller),
        ):
            response.controller.append(ControllerState(name=name, state=state))
        return response

    def _hardware(self, _request, response):
        part = HardwareComponentState(name="drives", type="system")
        part.state.label = self.robot.hardware
        part.command_interfaces = [
            HardwareInterface(name=f"{name}/position") for name in self.robot.names
        ]
        response.component.append(part)
        return response

    def _wait(self):
        while not self.managing and not self._over:
            self._cycle()
            time.sleep(PERIOD)

    def _on_goal(self, goal):
        with self.lock:
            names = goal.trajectory.joint_names
            known = self.robot.controller == "active" and sorted(names) == sorted(self.robot.names)
        return GoalResponse.ACCEPT if known else GoalResponse.REJECT

    def _on_cancel(self, handle):
        with self.lock:
            key, ended = bytes(handle.goal_id.uuid), self.robot.ended
            # As in Jazzy: a goal that is cancelled between its end and the report ends only when
            # the next one is accepted.
            self._orphans += [one[0] for one in ended if one[0] == key]
            ended[:] = [one for one in ended if one[0] != key]
            self.robot.cancel(time.monotonic(), key)
        return CancelResponse.ACCEPT

    async def _execute(self, handle):
        key, goal = bytes(handle.goal_id.uuid), handle.request
        points = [
            (
                point.time_from_start.sec + point.time_from_start.nanosec * 1e-9,
                list(point.positions),
                list(point.velocities),
            )
            for point in goal.trajectory.points
        ]
        allowed = goal.goal_time_tolerance
        tolerances = (
            [one.position for one in goal.path_tolerance],
            [one.position for one in goal.goal_tolerance],
            allowed.sec + allowed.nanosec * 1e-9,
        )
        end = self._ends[key] = Future()
        with self.lock:
            names = list(goal.trajectory.joint_names)
            self.robot.accept(key, names, points, tolerances, time.monotonic())
            while self._orphans:
                self._ends.pop(self._orphans.pop()).set_result((CANCELED, 0, ""))
        outcome, code, words = await end
        if outcome == SUCCEEDED:
            handle.succeed()
        elif outcome == CANCELED:
            handle.canceled()
        else:
            handle.abort()
        return FollowJointTrajectory.Result(error_code=code, error_string=words)
