"""The ros2_control driver in front of a robot in this process, in simulated time."""

from cnc_conformance import Operator, Rig
from trajectory_robot import ABORTED, CANCELED, SUCCEEDED, TrajectoryRobot

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc.joint_controller import (
    GoalAnswer,
    GoalEnd,
    Hardware,
    JointSample,
    ManagerReport,
    OtherGoals,
    Outcome,
    RobotDescription,
)
from stepdiag_ros.metrology.machine import Machine

MACHINE = Machine("gantry", "YXZ", (-0.1, -0.1, -0.3), (0.5, 0.4, 0.1), 0.5, 2.0)
START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
SAMPLING = 0.004
"""s between two joint states."""
DELAY = 0.002
"""s for which a request or an answer is on its way."""
JOINTS = {"x": 0.0, "y_left": 0.0, "y_right": 0.0, "z_screw": 0.0}
LEAD = 0.01
"""m by turn of the screw of Z, which moves against its joint."""
OUTCOMES = {
    SUCCEEDED: Outcome.SUCCEEDED,
    CANCELED: Outcome.CANCELED,
    ABORTED: Outcome.ABORTED,
}
URDF = """\
<robot name="gantry">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <joint name="x" type="prismatic"><limit lower="-0.05" upper="0.45" velocity="0.4" effort="1"/>
  </joint>
  <joint name="y_left" type="prismatic"><limit lower="0" upper="0.5" velocity="0.4" effort="1"/>
  </joint>
  <joint name="y_right" type="prismatic"><limit lower="-1" upper="0.3" velocity="0.2" effort="1"/>
  </joint>
  <joint name="z_screw" type="continuous"><limit velocity="300" effort="1"/></joint>
  <joint name="table" type="fixed"/>
</robot>
"""


def settings(**changed):
    return {
        "controller": "/gantry/gantry_controller",
        "controller_manager": "/gantry/controller_manager",
        "joints": {
            "X": [{"name": "x"}],
            "Y": [{"name": "y_left", "offset_m": -0.05}, {"name": "y_right", "offset_m": -0.05}],
            "Z": [{"name": "z_screw", "factor": -LEAD / 6.283185307179586}],
        },
        "acceleration_m_per_s2": [0.5, 0.5, 0.5],
        "position_rate_hz": 200.0,
    } | changed


class FakeController:
    """The ROS side, by a robot in this process (protocol: ``JointController``).

    Attributes:
        robot: behind it.
        reachable: the action server is on the graph.
        manager: the controller manager answers.
        sampling: joint states come.
        answering: goals are answered.
        ending: the end of a goal is reported.
        clock_off: s by which the robot's clock is ahead.
        description: URDF that is published.
        others: goals of other clients.
        unknown: joints whose position is not a number.
        closed: it was let go.
    """

    def __init__(self, now):
        self.robot = TrajectoryRobot(JOINTS)
        self.reachable = self.manager = self.sampling = True
        self.answering = self.ending = True
        self.clock_off, self.description, self.others = 0.0, URDF, 0
        self.unknown, self.left_out, self.closed, self.sent = (), (), False, []
        self._now, self._sampled = now, now()
        self._due, self._told_others, self._last = [], 0, None

    def alternatives(self):
        return ["/cell/gantry_controller"]

    def managers(self):
        return ["/cell/controller_manager"]

    def ask_manager(self):
        if self.manager:
            robot = self.robot
            part = Hardware("drives", robot.hardware, frozenset(self.robot.names))
            idle = Hardware("gripper", "inactive", frozenset({"finger"}))
            states = {"gantry_controller": robot.controller, "joint_state_broadcaster": "active"}
            self._later(lambda: ManagerReport(states, (part, idle)))

    def send(self, number, trajectory):
        self.sent.append(trajectory)
        self._last = number
        points = [(point.time, point.positions, point.velocities) for point in trajectory.points]
        tolerances = (
            trajectory.path_tolerance,
            trajectory.goal_tolerance,
            trajectory.goal_time_tolerance,
        )

        def arrive():
            names, now = list(trajectory.joints), self._now() / SECOND
            accepted = self.robot.accept(number, names, points, tolerances, now)
            return GoalAnswer(number, accepted) if self.answering else None

        self._later(arrive)

    def cancel(self):
        number = self._last
        self._later(lambda: self.robot.cancel(self._now() / SECOND, number))

    def news(self):
        news, now = [], self._now()
        if self.description:
            news.append(RobotDescription(self.description))
            self.description = ""
        if self.others != self._told_others:
            self._told_others = self.others
            news.append(OtherGoals(self.others))
        # In steps, as the controller has them, however long nobody asked.
        while self._sampled + SAMPLING * SECOND <= now:
            self._sampled += round(SAMPLING * SECOND)
            news += self._happened(self._sampled)
        return news

    def close(self):
        self.cancel()
        self.closed = True

    def _later(self, what):
        self._due.append((self._now() + DELAY * SECOND, what))

    def _happened(self, instant):
        due = [what for time, what in self._due if time <= instant]
        self._due = [entry for entry in self._due if entry[0] > instant]
        news = [one for one in (what() for what in due) if one is not None]
        self.robot.step(instant / SECOND)
        if self.sampling:
            places = self.robot.positions() | dict.fromkeys(self.unknown, float("nan"))
            places = {name: at for name, at in places.items() if name not in self.left_out}
            news.append(JointSample(instant + round(self.clock_off * SECOND), places))
        for key, outcome, code, words in self.robot.ended:
            if isinstance(key, int) and self.ending:
                news.append(GoalEnd(key, OUTCOMES[outcome], code, words))
        self.robot.ended.clear()
        return news


class TrajectoryRig(Rig):
    """A rig whose time passes by adding, with its controller.

    Attributes:
        broken: is called with a controller before the driver has asked it for anything.
    """

    def __init__(self, machine=MACHINE, **changed):
        self.clock, self.broken = [START], lambda _: None
        self.controllers = []
        surroundings = Surroundings(machine, None, self._connect)
        self._prepared = prepare("cnc", "ros2_control", settings(**changed), surroundings)
        super().__init__(machine, self._opened, lambda: self.clock[0], self._sleep)

    @property
    def controller(self):
        return self.controllers[-1]

    def _connect(self, names):
        self.controllers.append(FakeController(lambda: self.clock[0]))
        self.broken(self.controllers[-1])
        if not names.description:
            self.controllers[-1].description = ""
        return self.controllers[-1]

    def _opened(self):
        return self._prepared(self.clock[0])

    def _sleep(self, seconds):
        self.clock[0] += round(seconds * SECOND)


def operator_of(broken=None, **changed):
    rig = TrajectoryRig(**changed)
    rig.broken = broken or rig.broken
    return Operator(rig), rig


__all__ = ["MACHINE", "SECOND", "URDF", "TrajectoryRig", "operator_of", "settings"]
