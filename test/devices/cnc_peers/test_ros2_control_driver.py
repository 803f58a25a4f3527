"""The ros2_control driver: its goals, its limits, and each fault of controller and robot."""

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from cnc_conformance import add
from refused import a_fault, refused
from trajectory_rig import LEAD, MACHINE, SECOND, URDF, TrajectoryRig, operator_of, settings

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import CncState, MoveRefused
from stepdiag_ros.devices.cnc.joint_axes import (
    Joint,
    JointAxes,
    JointLimits,
    limits_from_urdf,
    straight_move,
)
from stepdiag_ros.metrology.refusal import Refusal

AXES = JointAxes(((Joint("x"),), (Joint("left"), Joint("right")), (Joint("z", -0.002, 0.1),)))


def along(axes, points, start):
    """Return times, X, Y and Z, and their velocities, of a trajectory; its start comes first."""
    times = [0.0, *(point.time for point in points)]
    joints = np.array([axes.positions(start), *(point.positions for point in points)])
    rates = np.array([np.zeros(joints.shape[1]), *(point.velocities for point in points)])
    names = axes.names
    places = np.array([axes.point(dict(zip(names, row, strict=True))) for row in joints])
    factors = np.array([joint.factor for joint in axes.joints])
    picked = [names.index(joints[0].name) for joints in axes.of_axes]
    return np.array(times), places, (rates * factors)[:, picked]


@pytest.mark.parametrize("length", [1e-6, 1e-3, 0.02, 0.4])
@pytest.mark.parametrize("way", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (1, -2, 3)])
def test_a_move_is_straight_and_as_fast_as_feed_and_acceleration_allow(length, way):
    start, limits = (0.1, 0.2, -0.05), (0.5, 0.25, 1.0)
    unit = np.array(way) / np.linalg.norm(way)
    target = tuple(np.array(start) + length * unit)
    feed = 0.05
    times, places, velocities = along(AXES, straight_move(AXES, start, target, feed, limits), start)
    assert places[-1] == pytest.approx(target, abs=1e-12) and not velocities[-1].any()
    spans, ways = np.diff(times), np.diff(places, axis=0)
    assert np.all(spans > 0.0)
    # Each part has a constant acceleration: its way is the mean velocity times its duration.
    means = (velocities[1:] + velocities[:-1]) / 2.0
    assert ways == pytest.approx(means * spans[:, None], abs=1e-12)
    assert np.linalg.norm(velocities, axis=1).max() <= feed * (1 + 1e-12)
    rises = np.abs(np.diff(velocities, axis=0)) / spans[:, None]
    assert np.all(rises <= np.array(limits) * (1 + 1e-9))
    # The axis that limits it is used to its limit, and the feed where the way is long enough.
    assert (rises.max(axis=0) / np.array(limits)).max() == pytest.approx(1.0)
    if length > 0.1:
        assert np.linalg.norm(velocities, axis=1).max() == pytest.approx(feed)
    assert np.cross(places - places[0], unit) == pytest.approx(0.0, abs=1e-12)


def test_joints_are_axes_by_factor_and_offset():
    where = {"x": 0.3, "left": 0.1, "right": 0.1004, "z": 25.0}
    assert AXES.point(where) == pytest.approx((0.3, 0.1002, 0.05))
    assert AXES.apart(where) == pytest.approx((0.0, 0.0004, 0.0))
    assert AXES.positions((0.3, 0.1, 0.05)) == pytest.approx((0.3, 0.1, 0.1, 25.0))
    assert AXES.rates((0.1, 0.2, 0.01)) == pytest.approx((0.1, 0.2, 0.2, -5.0))
    assert AXES.tolerances(1e-3) == pytest.approx((1e-3, 1e-3, 1e-3, 0.5))


def test_limits_of_the_urdf_are_those_of_the_axes():
    limits = {
        "x": JointLimits(-1.0, 1.0, 0.3),
        "left": JointLimits(0.0, 0.9, 0.4),
        "right": JointLimits(-0.1, 0.8, 0.2),
        "z": JointLimits(0.0, 50.0, 10.0),
    }
    low, high = AXES.travel(limits)
    assert low == pytest.approx((-1.0, 0.0, 0.0)) and high == pytest.approx((1.0, 0.8, 0.1))
    assert AXES.speeds(limits) == pytest.approx((0.3, 0.2, 0.02))
    free = AXES.travel(dict.fromkeys(AXES.names, JointLimits()))
    assert free == ((-inf,) * 3, (inf,) * 3)


def test_the_device_has_the_tighter_limits_of_machine_file_and_urdf():
    operator, _ = operator_of()
    device = operator.ready().device
    low, high = device.soft_limits
    # Y runs from -0.05 (left) to 0.25 (right); Z has no limits in the URDF.
    assert low == pytest.approx((-0.05, -0.05, -0.3)) and high == pytest.approx((0.45, 0.25, 0.1))
    speeds = device.traits.feed_limit
    assert speeds == pytest.approx((0.4, 0.2, 300 * LEAD / (2 * pi)))
    operator, _ = operator_of(robot_description="")
    device = operator.ready().device
    assert device.soft_limits == (MACHINE.travel_low_m, MACHINE.travel_high_m)


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ("<robot", a_fault("malformed")),
        ("y_right", a_fault("unknown")),
        ('type="continuous"', a_fault("mismatch")),
        ('lower="-0.05"', a_fault("malformed")),
        ('upper="0.45"', a_fault("out_of_range")),
    ],
)
def test_a_wrong_robot_description_is_refused(changed, fault):
    wrong = {
        "<robot": "robot",
        "y_right": "y_wrong",
        'type="continuous"': 'type="fixed"',
        'lower="-0.05"': 'lower="left"',
        'upper="0.45"': 'upper="-0.45"',
    }[changed]
    names = JointAxes.names.fget(
        JointAxes(((Joint("x"),), (Joint("y_left"), Joint("y_right")), (Joint("z_screw"),)))
    )
    with refused(Refusal, fault):
        limits_from_urdf(URDF.replace(changed, wrong), names)


def test_a_machine_file_beyond_the_robot_is_refused():
    rig = TrajectoryRig(replace(MACHINE, travel_low_m=(0.46, -0.1, -0.3)))
    device = rig.opened()
    with refused(Refusal, "mismatch", about="X"):
        device.poll(rig.now())


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({"controller": "gantry_controller"}, a_fault("malformed", about="controller")),
        ({"joints": {"X": [{"name": "x"}]}}, a_fault("missing", about="Y")),
        ({"joints": {"X": [], "Y": [], "Z": []}}, a_fault("malformed", about="X")),
        ({"joints": {a: [{"name": "x"}] for a in "XYZ"}}, a_fault("twice", about="x")),
        (
            {"joints": {a: [{"name": a.lower()}] * (1 + (a == "Y")) for a in "XYZ"}},
            a_fault("twice", about="y"),
        ),
        (
            {"joints": {a: [{"name": f"{a}{n}"} for n in "123"] for a in "XYZ"}},
            a_fault("too_many"),
        ),
        (
            {"joints": {a: [{"name": a, "factor": 0.0}] for a in "XYZ"}},
            a_fault("out_of_range"),
        ),
        ({"acceleration_m_per_s2": [0.0, 1.0, 1.0]}, a_fault("out_of_range")),
        ({"tolerance": 1e-3}, a_fault("unknown", about="tolerance")),
    ],
)
def test_wrong_settings_are_refused(changed, fault):
    with refused(Refusal, fault):
        prepare("cnc", "ros2_control", settings(**changed), Surroundings(MACHINE, None, id))


def test_without_a_node_the_driver_says_what_it_needs():
    with refused(Refusal, "missing", about="node"):
        prepare("cnc", "ros2_control", settings(), Surroundings(MACHINE))


def test_a_goal_has_the_move_and_its_tolerances():
    operator, rig = operator_of(path_tolerance_m=3e-3, resolution_m=1e-6)
    start = operator.ready().position
    operator.moved(add(start, z=-0.02), "Z")
    (sent,) = rig.controller.sent
    assert sent.joints == ("x", "y_left", "y_right", "z_screw")
    *_, end = sent.points
    assert end.positions == pytest.approx((0.0, 0.0, 0.0, 0.02 * 2 * pi / LEAD))
    screw = 2 * pi / LEAD
    assert sent.path_tolerance == pytest.approx((3e-3, 3e-3, 3e-3, 3e-3 * screw))
    near = MACHINE.position_window_m + 1e-6
    assert sent.goal_tolerance == pytest.approx((near, near, near, near * screw))


def test_axes_that_do_not_move_keep_the_place_that_they_were_sent_to():
    """The servo error of one move is not the target of the next one."""
    operator, rig = operator_of(resolution_m=1e-5)
    start = operator.ready().position
    rig.controller.robot.offsets = {"x": 3e-6}
    for target in ((0.01, 0.0), (0.01, 0.01), (0.0, 0.01), (0.0, 0.0)):
        operator.moved(add(start, *target), "XY")
    xs = [sent.points[-1].positions[0] for sent in rig.controller.sent]
    assert xs == pytest.approx([0.01, 0.01, 0.0, 0.0], abs=1e-12)


# Before the first move ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("broken", "about"),
    [
        ({"manager": False}, "/cell/controller_manager"),
        ({"reachable": False}, "/cell/gantry_controller"),
        ({"sampling": False}, "/joint_states"),
        ({"description": ""}, "robot_state_publisher"),
        ({"clock_off": 12.5}, "ahead"),
        ({"clock_off": -12.5}, "after"),
        ({"unknown": ("x",)}, "x"),
        ({"left_out": ("y_left",)}, "y_left"),
        ({"others": 1}, "another"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_it_is_not_ready_before_all_is_there_and_says_what_is_missing(broken, about):
    mended = {}

    def break_(controller):
        mended.update({name: getattr(controller, name) for name in broken})
        vars(controller).update(broken)

    operator, rig = operator_of(break_)
    operator.watch(3.0)
    assert operator.device.state is CncState.FAULT
    assert about in operator.changes[-1].reason
    with refused(MoveRefused, None):
        operator.move((0.01, 0.0, 0.0), "X")
    vars(rig.controller).update(mended)
    assert operator.ready()


@pytest.mark.parametrize("part", ["controller", "hardware"])
def test_a_controller_or_hardware_that_is_not_active_is_named(part):
    operator, rig = operator_of(lambda controller: setattr(controller.robot, part, "inactive"))
    operator.watch(1.0)
    named = {"controller": "gantry_controller", "hardware": "drives"}[part]
    assert f"'{named}'" in operator.changes[-1].reason and "inactive" in operator.changes[-1].reason
    setattr(rig.controller.robot, part, "active")
    assert operator.ready()


@pytest.mark.parametrize("instant", ["at rest", "in a move"])
def test_a_fault_at_rest_ends_with_its_cause_and_one_in_a_move_with_a_reset(instant):
    operator, rig = operator_of()
    start = operator.ready().position
    if instant == "in a move":
        operator.move(add(start, x=0.04), "X", 0.01)
        operator.until(lambda: operator.position[0] > start[0] + 0.01)
    rig.controller.robot.deactivate(rig.now() / SECOND)
    operator.until_state(CncState.FAULT, limit=10.0)
    operator.watch(0.5)
    mend(rig)
    operator.watch(0.5)
    # A cause that comes and goes is not gone.
    assert operator.device.state is CncState.FAULT
    operator.watch(2.0)
    ends = operator.device.state is CncState.READY
    assert ends == (instant == "at rest")


def test_positions_that_come_late_are_reported_once_however_late_each_is():
    operator, rig = operator_of(lambda controller: setattr(controller, "clock_off", -12.5))
    for number in range(20):
        rig.controller.clock_off = -12.5 - 0.1 * number
        operator.watch(0.2)
    said = [change.reason for change in operator.changes if "after" in change.reason]
    assert len(said) == 1


# In a move ----------------------------------------------------------------------------------------


def preempt(rig):
    robot, now = rig.controller.robot, rig.now() / SECOND
    here = list(robot.positions().values())
    tolerances = ([1.0] * 4, [1.0] * 4, 1.0)
    robot.accept("other", robot.names, [(0.5, here, [0.0] * 4)], tolerances, now)


def command_by_topic(rig):
    """Move X by 5 mm, as a trajectory on the controller's topic does."""
    rig.controller.robot.offsets = {"x": 0.005}


FAULTS = {
    "other goal": (preempt, "preempted"),
    "other client": (lambda rig: setattr(rig.controller, "others", 1), "another"),
    "deactivated": (lambda rig: rig.controller.robot.deactivate(rig.now() / SECOND), "deactivate"),
    "hardware": (lambda rig: setattr(rig.controller.robot, "hardware", "unconfigured"), "drives"),
    "path": (lambda rig: setattr(rig.controller.robot, "lag", 1.0), "path"),
    "goal": (command_by_topic, "tolerance"),
    "silence": (lambda rig: setattr(rig.controller, "sampling", False), "/joint_states"),
    "manager": (
        lambda rig: setattr(rig.controller, "manager", False),
        "/gantry/controller_manager",
    ),
    "gone": (lambda rig: setattr(rig.controller, "reachable", False), "follow_joint_trajectory"),
    "gantry": (lambda rig: rig.controller.robot.offsets.update(y_left=6e-4), "apart"),
    "clock": (lambda rig: setattr(rig.controller, "clock_off", 9.0), "clocks"),
}


def mend(rig):
    controller, robot = rig.controller, rig.controller.robot
    controller.sampling = controller.manager = controller.reachable = True
    controller.clock_off, controller.others = 0.0, 0
    robot.controller = robot.hardware = "active"
    robot.lag, robot.offsets = 0.0, {}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_a_move_brakes_it_and_wants_a_reset(fault):
    break_, words = FAULTS[fault]
    operator, rig = operator_of()
    start = operator.ready().position
    target = add(start, x=0.04)
    operator.move(target, "X", 0.01)
    operator.until(lambda: operator.position[0] > start[0] + 0.01)
    break_(rig)
    operator.until_state(CncState.FAULT, limit=10.0)
    assert words in operator.changes[-1].reason
    operator.watch(0.2)
    with refused(MoveRefused, "not_ready", aspect="state"):
        operator.move(target, "X")
    mend(rig)
    operator.watch(0.2)
    operator.reset()
    operator.events.clear()
    operator.watch(0.3)
    # Nothing of the old goal is left, and it stands short of its target.
    still = operator.samples[0].position
    assert still[0] < target[0] - 1e-3
    assert all(sample.position == still for sample in operator.samples)
    operator.moved(start, "X")
    assert operator.position == pytest.approx(start, abs=operator.near())


def test_a_goal_that_is_rejected_has_moved_nothing():
    operator, rig = operator_of()
    start = operator.ready().position
    rig.controller.robot.controller = "inactive"
    operator.move(add(start, x=0.01), "X")
    operator.until_state(CncState.FAULT)
    assert "rejected" in operator.changes[-1].reason
    assert {sample.position for sample in operator.samples} == {start}


def test_a_goal_that_is_not_answered_fails_the_device():
    operator, rig = operator_of()
    start = operator.ready().position
    rig.controller.answering = False
    operator.move(add(start, x=0.4), "X", 0.01)
    with pytest.raises(TimeoutError) as raised:
        operator.watch(5.0)
    assert raised.value.fault == "undetermined"
    operator.device.close()
    assert rig.controller.closed


def test_axes_that_go_on_after_a_stop_fail_the_device():
    operator, rig = operator_of(stop_limit_s=0.5)
    start = operator.ready().position
    operator.move(add(start, x=0.4), "X", 0.05)
    operator.watch(0.5)
    rig.controller.robot.cancel = lambda *_: None
    operator.device.stop(rig.now(), "the operator")
    with pytest.raises(TimeoutError):
        operator.watch(2.0)


def test_a_goal_that_is_never_ended_after_a_stop_does_not_keep_axes_that_stand():
    operator, rig = operator_of()
    start = operator.ready().position
    rig.controller.ending = False
    operator.move(add(start, x=0.01), "X", 0.1)
    operator.until(lambda: rig.controller.robot.done)
    begun = rig.now()
    operator.device.stop(begun, "the operator")
    operator.until_state(CncState.STOPPED)
    assert 2.0 <= (rig.now() - begun) / SECOND < 3.0  # answer_limit_s, stop_limit_s
    rig.controller.ending = True
    operator.device.reset(rig.now())
    operator.move(start, "X", 0.1)
    operator.until_state(CncState.READY)


@pytest.mark.parametrize("deceleration", [0.1, 1.0, 10.0])
def test_after_a_stop_the_axes_stand_as_soon_as_the_controller_can_brake(deceleration):
    operator, rig = operator_of()
    start = operator.ready().position
    rig.controller.robot.deceleration = deceleration
    operator.move(add(start, x=0.4), "X", 0.1)
    operator.watch(1.0)
    begun = rig.now()
    operator.device.stop(begun, "the operator")
    operator.until(lambda: not rig.controller.robot.moving)
    stood = rig.now()
    assert (stood - begun) / SECOND <= 0.1 / deceleration + 0.05
    operator.until_state(CncState.STOPPED)
    # It is reported when the axes have stood for the hold time.
    hold = MACHINE.position_hold_s
    assert hold <= (rig.now() - stood) / SECOND + 0.005 <= hold + 0.03


def test_an_axis_that_moves_by_itself_is_a_fault():
    operator, rig = operator_of()
    operator.ready()
    rig.controller.robot.offsets = {"x": 2e-4}
    operator.until_state(CncState.FAULT)
    assert "command" in operator.changes[-1].reason


def test_a_sagging_servo_is_not_a_fault():
    operator, rig = operator_of()
    operator.ready()
    rig.controller.robot.offsets = {"z_screw": -2e-5 * 2 * pi / LEAD}
    operator.watch(1.0)
    assert operator.device.state is CncState.READY


def test_a_fault_that_lasts_cancels_the_goal_once():
    operator, rig = operator_of()
    start = operator.ready().position
    operator.move(add(start, x=0.4), "X", 0.01)
    operator.watch(0.5)
    cancelled = []
    rig.controller.cancel = lambda: cancelled.append(rig.now())
    rig.controller.robot.offsets = {"y_left": 6e-4}
    operator.watch(1.0)
    assert len(cancelled) == 1
    assert [change.state for change in operator.changes].count(CncState.FAULT) == 1
