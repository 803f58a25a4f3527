"""The simulated controller: exact events in order of time, limits, stop, fault."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell
from hypothesis import given, settings
from hypothesis import strategies as st
from refused import a_fault, refused

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import CncState, MoveRefused, PositionSample, StateChange
from stepdiag_ros.devices.cnc.simulated import SimulatedCnc
from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.drive import AxisMotion, Trajectory
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Refusal

START = 1_700_000_000_000_000_123
MS = 1_000_000
SECOND = 1_000_000_000
MACHINE = Machine("m", "YXZ", (-0.1, -0.1, -0.1), (0.5, 0.4, 0.3), 0.5, 2.0)
DRIVE = DriveModel(lag_s=0.01)


def controller(drive=DRIVE, machine=MACHINE, **options):
    return SimulatedCnc(machine, drive, START, **options)


def changes(events):
    return [event for event in events if isinstance(event, StateChange)]


def samples(events):
    return [event for event in events if isinstance(event, PositionSample)]


def test_a_move_ends_in_position_when_the_actual_position_has_stayed_in_the_window():
    cnc = controller()
    begin = START + 7 * MS + 77
    cnc.start_move(begin, (0.01, 0.0, 0.0), 0.033, "X")
    events = cnc.poll(begin + 2 * SECOND)
    moving, arrived = changes(events)
    assert (moving.time, moving.state) == (begin, CncState.MOVING)
    assert arrived.state is CncState.READY is cnc.state
    motion = AxisMotion(Trajectory.trapezoid(0.0, 0.01, 0.033, 2.0), DRIVE)
    enters = begin + motion.time_within(0.5e-6) * SECOND
    # Found on the next servo cycle, then held for 20 ms.
    assert 20 * MS <= arrived.time - enters <= 21 * MS + 1
    assert arrived.position[0] == pytest.approx(0.01, abs=0.5e-6)
    assert arrived.position[1:] == (0.0, 0.0)


def test_lag_makes_done_later_than_the_command():
    slow, fast = controller(DriveModel(lag_s=0.05)), controller(DriveModel(lag_s=0.0))
    ends = []
    for cnc in (slow, fast):
        cnc.start_move(START, (0.0, 0.01, 0.0), 0.1, "Y")
        ends.append(changes(cnc.poll(START + 5 * SECOND))[1].time)
    assert ends[0] - ends[1] > 0.3 * SECOND
    duration = Trajectory.trapezoid(0.0, 0.01, 0.1, 2.0).duration
    assert ends[1] == START + round(duration * SECOND) + 20 * MS


def test_vibration_can_leave_the_window_again():
    shaky = DriveModel(0.0, 5e-6, 0.05, 10.0)
    cnc = controller(shaky)
    cnc.start_move(START, (0.01, 0.0, 0.0), 0.1, "X")
    arrived = changes(cnc.poll(START + 5 * SECOND))[1]
    motion = AxisMotion(Trajectory.trapezoid(0.0, 0.01, 0.1, 2.0), shaky)
    held = (arrived.time - START - np.arange(0, 20) * MS) * 1e-9
    assert np.all(np.abs(motion.position(held) - 0.01) <= 0.5e-6)
    assert (arrived.time - START) * 1e-9 > motion.trajectory.duration + 0.05


def test_position_samples_lie_on_their_own_grid_and_follow_the_axis():
    cnc = controller(sample_rate=300.0)
    events = cnc.poll(START)
    cnc.start_move(START + 5 * MS, (0.0, 0.0, 0.02), 0.1, "Z")
    events += cnc.poll(START + SECOND)
    found = samples(events)
    assert [s.time for s in found] == [START + round(k * SECOND / 300) for k in range(301)]
    motion = AxisMotion(Trajectory.trapezoid(0.0, 0.02, 0.1, 2.0), DRIVE)
    since = np.array([s.time - START - 5 * MS for s in found]) * 1e-9
    expected = motion.position(since)
    assert np.array([s.position[2] for s in found]) == pytest.approx(expected, abs=2e-13)
    assert {s.position[:2] for s in found} == {(0.0, 0.0)}


@settings(max_examples=20)
@given(st.lists(st.integers(0, 200 * MS), max_size=30))
def test_events_do_not_depend_on_when_they_are_asked_for(waits):
    whole, parts = controller(), controller()
    for cnc in (whole, parts):
        cnc.inject_fault(START + 900 * MS, "broken")
        cnc.start_move(START + MS, (0.2, 0.0, 0.0), 0.1, "X")
    events, now = [], START + MS
    for wait in waits:
        now += wait
        events += parts.poll(now)
    end = max(now, START + 2 * SECOND)
    events += parts.poll(end)
    expected = whole.poll(end)
    assert events == expected
    times = [event.time for event in events]
    assert times == sorted(times)


def test_successive_moves_start_where_the_axis_really_is():
    cnc = controller()
    now = START
    position = 0.0
    for target in (0.01, 0.02, 0.01):
        cnc.start_move(now, (target, 0.0, 0.0), 0.1, "X")
        events = cnc.poll(now + SECOND // 2)
        path = [s.position[0] for s in samples(events)]
        assert abs(path[0] - position) < 1e-6
        assert np.max(np.abs(np.diff(path))) <= 0.1 / 200 * 1.01
        now = changes(events)[-1].time
        now = max(now, START) + SECOND // 2
        position = path[-1]
        assert position == pytest.approx(target, abs=1e-12)


def test_a_move_may_begin_before_the_last_one_has_wholly_settled():
    machine = replace(MACHINE, position_window_m=20e-6)
    cnc = controller(DriveModel(lag_s=0.05), machine)
    cnc.start_move(START, (0.01, 0.0, 0.0), 0.1, "X")
    arrived = changes(cnc.poll(START + SECOND))[1]
    behind = 0.01 - arrived.position[0]
    cnc = controller(DriveModel(lag_s=0.05), machine)
    cnc.start_move(START, (0.01, 0.0, 0.0), 0.1, "X")
    cnc.poll(arrived.time)
    cnc.start_move(arrived.time, (0.005, 0.0, 0.0), 0.1, "X")
    moving = changes(cnc.poll(arrived.time + SECOND))[0]
    assert behind > 1e-6
    assert moving.position[0] == pytest.approx(arrived.position[0], abs=1e-12)


def test_a_move_of_no_length_is_in_position_after_the_hold():
    cnc = controller()
    cnc.start_move(START, (0.0, 0.0, 0.0), 0.1, "X")
    moving, arrived = changes(cnc.poll(START + SECOND))
    assert moving.time == START
    assert arrived.time == START + 20 * MS
    assert arrived.position == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("target", "feed", "axes", "words"),
    [
        (
            (0.51, 0.0, 0.0),
            0.1,
            "X",
            a_fault("out_of_range", "X", "0.51", "-0.1", "0.5", aspect="limits"),
        ),
        ((0.0, -0.2, 0.0), 0.1, "Y", a_fault("out_of_range", "Y", "-0.2", aspect="limits")),
        ((0.0, 0.0, 0.1), 0.0, "Z", a_fault("out_of_range", "0", "m/s", aspect="feed")),
        (
            (0.0, 0.0, 0.1),
            0.6,
            "Z",
            a_fault("out_of_range", "0.6", "m/s", "0", "0.5", aspect="feed"),
        ),
        ((0.0, 0.0, 0.1), float("nan"), "Z", a_fault("out_of_range", aspect="feed")),
        ((0.0, 0.1, 0.1), 0.1, "Y", a_fault("mismatch", "Y", "Z", aspect="axes")),
        ((0.0, 0.1, 0.1), 0.1, "", a_fault("mismatch", "Y", "Z", aspect="axes")),
        ((0.1, 0.1, 0.1), 0.1, "XY", a_fault("mismatch", "X", "Y", "Z", aspect="axes")),
        ((0.1, 0.1, 0.35), 0.1, "XYZ", a_fault("out_of_range", "Z", "0.35", aspect="limits")),
        ((float("nan"), 0.0, 0.0), 0.1, "X", a_fault("malformed", aspect="target")),
    ],
)
def test_forbidden_moves_are_refused_and_nothing_moves(target, feed, axes, words):
    cnc = controller()
    with refused(MoveRefused, words):
        cnc.start_move(START, target, feed, axes)
    events = cnc.poll(START + SECOND)
    assert not changes(events)
    assert {s.position for s in samples(events)} == {(0.0, 0.0, 0.0)}
    assert cnc.state is CncState.READY


def test_axes_that_move_at_once_stay_on_the_straight_line_and_within_their_limits():
    cnc = controller(sample_rate=1000.0)
    target = np.array([-0.05, 0.03, 0.1])
    cnc.start_move(START, tuple(target), 0.4, "XYZ")
    events = cnc.poll(START + 2 * SECOND)
    moving, arrived = changes(events)
    assert (moving.state, arrived.state) == (CncState.MOVING, CncState.READY)
    assert arrived.position == pytest.approx(tuple(target), abs=0.5e-6)
    times = np.array([sample.time - START for sample in samples(events)]) * 1e-9
    places = np.array([sample.position for sample in samples(events)])
    direction = target / np.linalg.norm(target)
    along = places @ direction
    assert places == pytest.approx(np.outer(along, direction), abs=1e-12)
    speed = np.diff(along) / np.diff(times)
    # The path itself keeps the feed, the fastest axis the acceleration.
    assert np.max(speed) == pytest.approx(0.4, rel=1e-3)
    fastest = np.abs(np.diff(speed)) / 1e-3 * np.max(np.abs(direction))
    assert np.max(fastest) <= 2.0 * (1.0 + 1e-3)
    assert np.max(fastest) > 1.7
    way, ramp = np.linalg.norm(target), 0.4 * np.max(np.abs(direction)) / 2.0
    duration = way / 0.4 + ramp
    assert arrived.time * 1e-9 - START * 1e-9 > duration + MACHINE.position_hold_s


def test_in_position_waits_for_all_axes_of_a_move():
    """The axis with the longest way enters the window last and decides."""
    ends = {}
    for axes, target in (("X", (0.001, 0.0, 0.0)), ("XZ", (0.001, 0.0, 0.1))):
        cnc = controller(DriveModel(lag_s=0.05))
        cnc.start_move(START, target, 0.1, axes)
        event = changes(cnc.poll(START + 9 * SECOND))[-1]
        assert event.position == pytest.approx(target, abs=0.5e-6)
        ends[axes] = event.time
    assert ends["XZ"] - ends["X"] > 0.9 * SECOND


def test_braking_keeps_to_the_straight_line():
    cnc = controller(sample_rate=1000.0)
    cnc.start_move(START, (0.3, 0.03, 0.0), 0.3, "XY")
    cnc.stop(START + 500 * MS, "operator")
    events = cnc.poll(START + 3 * SECOND)
    assert changes(events)[-1].state is CncState.STOPPED
    places = np.array([sample.position for sample in samples(events)])
    assert 0.1 < places[-1, 0] < 0.2
    assert places[:, 1] == pytest.approx(0.1 * places[:, 0], abs=1e-12)
    cnc.reset(START + 3 * SECOND)
    cnc.start_move(START + 3 * SECOND, (0.0, float(places[-1, 1]), 0.0), 0.1, "X")


def test_a_second_move_is_refused_while_the_first_goes_on():
    cnc = controller()
    cnc.start_move(START, (0.1, 0.0, 0.0), 0.1, "X")
    with refused(MoveRefused, "not_ready", "moving", aspect="state"):
        cnc.start_move(START + 100 * MS, (0.1, 0.1, 0.0), 0.1, "X")
    assert changes(cnc.poll(START + 3 * SECOND))[-1].position[0] == pytest.approx(0.1, abs=1e-6)


def test_stop_brakes_tells_when_the_axes_stand_and_wants_a_reset():
    cnc = controller()
    cnc.start_move(START, (0.4, 0.0, 0.0), 0.2, "X")
    cnc.stop(START + SECOND, "operator")
    assert cnc.state is CncState.MOVING
    events = cnc.poll(START + 3 * SECOND)
    stopped = changes(events)[-1]
    assert (stopped.state, stopped.reason) == (CncState.STOPPED, "operator")
    braking = 0.2 / 2.0
    assert stopped.time > START + SECOND + braking * SECOND
    after = {s.position for s in samples(events) if s.time > stopped.time + SECOND}
    assert len(after) == 1
    # 0.2 m/s from 0.05 s on, then 0.1 s of braking.
    assert after.pop()[0] == pytest.approx(0.2 * 0.95 + 0.2**2 / 2 / 2.0, abs=1e-3)
    assert len(changes(events)) == 2
    with refused(MoveRefused, "not_ready", "stopped", aspect="state"):
        cnc.start_move(START + 3 * SECOND, (0.0, 0.0, 0.0), 0.1, "X")
    cnc.reset(START + 3 * SECOND)
    # A target made from the encoders of the standing axes is a single-axis move.
    x, _, _ = stopped.position
    cnc.start_move(START + 3 * SECOND, (x, 0.1, 0.0), 0.1, "Y")
    arrived = changes(cnc.poll(START + 6 * SECOND))[-1]
    assert arrived.state is CncState.READY
    assert arrived.position == pytest.approx((x, 0.1, 0.0), abs=1e-6)
    assert samples(cnc.poll(START + 7 * SECOND))[-1].position == (x, 0.1, 0.0)


def test_stop_at_rest_is_at_once_and_reset_while_moving_is_refused():
    cnc = controller()
    cnc.stop(START + MS, "watchdog")
    (change,) = changes(cnc.poll(START + MS))
    assert change == StateChange(START + MS, CncState.STOPPED, (0.0, 0.0, 0.0), "watchdog")
    cnc.reset(START + 2 * MS)
    cnc.start_move(START + 3 * MS, (0.1, 0.0, 0.0), 0.1, "X")
    with refused(MoveRefused, "busy", aspect="motion"):
        cnc.reset(START + 100 * MS)


def test_a_fault_brakes_and_is_told_at_its_time():
    cnc = controller()
    cnc.start_move(START, (0.4, 0.0, 0.0), 0.2, "X")
    cnc.inject_fault(START + SECOND, "joint 0 following error")
    events = cnc.poll(START + SECOND + 10 * MS)
    fault = changes(events)[-1]
    assert (fault.time, fault.state) == (START + SECOND, CncState.FAULT)
    assert fault.reason == "joint 0 following error"
    with refused(MoveRefused, "busy", aspect="motion"):
        cnc.reset(START + SECOND + 20 * MS)
    with refused(MoveRefused, "not_ready", "fault", aspect="state"):
        cnc.start_move(START + SECOND + 30 * MS, (0.0, 0.0, 0.0), 0.1, "X")
    events = cnc.poll(START + 3 * SECOND)
    assert not changes(events)
    assert samples(events)[-1].position[0] < 0.21
    cnc.reset(START + 3 * SECOND)
    assert cnc.state is CncState.READY


def test_time_never_runs_backwards():
    cnc = controller()
    cnc.poll(START + SECOND)
    cnc.start_move(START, (0.01, 0.0, 0.0), 0.1, "X")
    assert changes(cnc.poll(START))[0].time == START + SECOND


def test_created_by_name_with_checked_settings():
    cell = make_cell(high=(1.0,) * 3)
    around = Surroundings(MACHINE, cell)
    cnc = prepare("cnc", "simulated", {"start_position_m": [0.1, 0.2, 0.3]}, around)(START)
    assert samples(cnc.poll(START))[0].position == (0.1, 0.2, 0.3)
    assert cnc.soft_limits == ((-0.1, -0.1, -0.1), (0.5, 0.4, 0.3))
    with refused(Refusal, "unknown", "position_rate_hz", about="position_rate"):
        prepare("cnc", "simulated", {"position_rate": 100}, around)
    with refused(Refusal, "out_of_range", "Z", "0.31"):
        prepare("cnc", "simulated", {"start_position_m": [0.0, 0.0, 0.31]}, around)
    with refused(Refusal, "missing"):
        prepare("cnc", "simulated", {}, Surroundings())
    with refused(Refusal, "unknown", "linuxcnx"):
        prepare("cnc", "linuxcnx", {}, around)
