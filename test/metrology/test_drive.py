"""Trajectories and drives against their definitions: limits, differential equation, integration."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from refused import refused

from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.drive import AxisMotion, StraightMove, Trajectory
from stepdiag_ros.metrology.refusal import Refusal

LAG = DriveModel(lag_s=0.01)
IDEAL = DriveModel(lag_s=0.0)
positions = st.floats(-1, 1)
feeds = st.floats(1e-3, 1)
accelerations = st.floats(0.05, 20)


@given(positions, positions, feeds, accelerations)
def test_trapezoid_keeps_its_limits_and_ends_exactly(start, target, feed, acceleration):
    assume(start == target or abs(target - start) > 1e-9)
    path = Trajectory.trapezoid(start, target, feed, acceleration)
    times = np.union1d(np.linspace(0.0, path.duration, 2001), path.times)
    found = path.position(times)
    velocity = path.velocity(times)
    assert found[0] == start
    assert path.position(path.duration) == target == path.end
    assert path.position(path.duration + 100.0) == target
    assert path.position(-1.0) == start
    sense = np.sign(target - start)
    assert np.all(sense * velocity >= -1e-12)
    assert np.max(np.abs(velocity)) <= feed * (1 + 1e-12)
    changes = np.abs(np.diff(velocity))
    # Times of long moves are themselves rounded, to 4e-13 s at 2,000 s.
    rounding = acceleration * np.spacing(path.duration) + 1e-12
    assert np.all(changes <= acceleration * np.diff(times) * (1 + 1e-9) + rounding)
    # The velocity is the derivative of the position (trapezoidal rule is exact within a piece).
    way = np.sum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(times))
    assert way == pytest.approx(target - start, rel=1e-9, abs=1e-15)


def test_trapezoid_takes_the_least_time():
    path = Trajectory.trapezoid(0.0, 0.01, feed=0.1, acceleration=2.0)
    assert path.duration == pytest.approx(0.01 / 0.1 + 0.1 / 2.0)
    short = Trajectory.trapezoid(0.0, 1e-4, feed=0.1, acceleration=2.0)
    assert short.duration == pytest.approx(2 * np.sqrt(1e-4 / 2.0))


@pytest.mark.parametrize("limits", [(0.0, 1.0), (1.0, 0.0), (-1.0, 1.0), (float("nan"), 1.0)])
def test_limits_that_allow_no_motion_are_refused(limits):
    with refused(Refusal, "out_of_range"):
        Trajectory.trapezoid(0.0, 1.0, *limits)


@given(positions, positions, feeds, accelerations, st.floats(0, 1.2))
def test_a_stop_keeps_the_past_and_brakes_at_the_limit(start, target, feed, acceleration, share):
    assume(abs(target - start) > 1e-6)
    path = Trajectory.trapezoid(start, target, feed, acceleration)
    when = share * path.duration
    stopped = path.stopped(when, acceleration)
    before = np.linspace(0.0, when, 50)
    assert stopped.position(before) == pytest.approx(path.position(before), abs=1e-15)
    speed = abs(float(path.velocity(when)))
    if when < path.duration:
        assert stopped.duration == pytest.approx(when + speed / acceleration)
        distance = abs(stopped.end - float(path.position(when)))
        assert distance == pytest.approx(speed**2 / 2 / acceleration, abs=1e-12)
    assert stopped.velocity(stopped.duration + 1.0) == 0.0
    assert min(start, target) - 1e-12 <= stopped.end <= max(start, target) + 1e-12


@pytest.mark.parametrize("braked", [False, True])
@pytest.mark.parametrize("beginning", [None, 0.0995])
def test_lag_obeys_its_differential_equation(braked, beginning):
    path = Trajectory.trapezoid(0.1, 0.16, feed=0.05, acceleration=1.0)
    if braked:
        path = path.stopped(0.7, 1.0)
    motion = AxisMotion(path, LAG, start=beginning)
    assert motion.position(0.0) == pytest.approx(0.1 if beginning is None else beginning, abs=1e-15)
    step = 1e-5
    times = np.arange(step, 1.6, 7.3e-4)
    slope = (motion.position(times + step) - motion.position(times - step)) / (2 * step)
    missing = LAG.lag_s * slope + motion.position(times) - path.position(times)
    # Only the finite difference is in error, where the acceleration jumps.
    assert np.max(np.abs(missing)) < 2e-7
    assert np.max(np.abs(np.diff(motion.position(np.arange(0, 1.6, 1e-4))))) < 0.06 * 1e-4


def test_without_lag_the_axis_is_where_it_is_commanded():
    path = Trajectory.trapezoid(0.0, 0.01, 0.033, 2.0)
    times = np.linspace(-0.1, 1.0, 500)
    assert np.array_equal(AxisMotion(path, IDEAL).position(times), path.position(times))


@given(
    st.floats(0, 0.05),
    st.floats(0, 1e-5),
    st.floats(0.005, 0.1),
    st.floats(1e-8, 1e-4),
    st.sampled_from([0.01, -0.01, 0.0]),
)
def test_time_within_is_never_too_early(lag, amplitude, decay, distance, way):
    drive = DriveModel(lag, amplitude, decay, 25.0)
    motion = AxisMotion(Trajectory.trapezoid(0.2, 0.2 + way, 0.1, 2.0), drive)
    after = motion.time_within(distance) + np.linspace(0, 1, 4000)
    assert np.max(np.abs(motion.position(after) - (0.2 + way))) <= distance * (1 + 1e-6)


def test_time_within_is_exact_for_a_lag():
    motion = AxisMotion(Trajectory.trapezoid(0.0, 0.01, 0.1, 2.0), LAG)
    time = motion.time_within(0.5e-6)
    assert abs(float(motion.position(time)) - 0.01) == pytest.approx(0.5e-6, rel=1e-6)


def test_vibration_begins_at_the_end_in_the_sense_of_the_move():
    drive = DriveModel(0.0, 2e-6, 0.02, 25.0)
    for way in (0.01, -0.01):
        path = Trajectory.trapezoid(0.0, way, 0.1, 2.0)
        motion = AxisMotion(path, drive)
        assert motion.position(path.duration) == path.end
        quarter = path.duration + 0.01
        expected = np.sign(way) * 2e-6 * np.exp(-0.5)
        assert motion.position(quarter) - path.end == pytest.approx(expected, rel=1e-9)
    still = AxisMotion(Trajectory.trapezoid(0.1, 0.1, 0.1, 2.0), drive)
    assert np.all(still.position(np.linspace(0, 1, 100)) == 0.1)


def test_braking_keeps_where_the_axis_has_been():
    motion = AxisMotion(Trajectory.trapezoid(0.0, 0.1, 0.1, 2.0), LAG, start=1e-5)
    braked = motion.braked(0.5, 2.0)
    times = np.linspace(0, 0.5, 100)
    assert braked.position(times) == pytest.approx(motion.position(times), abs=1e-15)
    assert braked.position(10.0) == pytest.approx(0.05, abs=0.01)


@given(st.tuples(positions, positions, positions), st.tuples(positions, positions, positions))
def test_a_straight_move_ends_exactly_with_all_axes_and_brakes_on_its_line(start, target):
    start, target = np.array(start), np.array(target)
    way = target - start
    assume(np.all((way == 0.0) | (np.abs(way) > 1e-6)) and np.any(way))
    move = StraightMove.between(start, target, 0.3, 2.0)
    assert sorted(move.trajectories) == np.flatnonzero(way).tolist()
    length = np.linalg.norm(way)
    for axis, path in move.trajectories.items():
        assert (path.positions[0], path.end) == (start[axis], target[axis])
        assert np.max(np.abs(path.velocities)) <= 0.3 * abs(way[axis]) / length * (1 + 1e-12)
    assert max(move.accelerations.values()) == pytest.approx(2.0)
    duration = path.duration
    for time in np.linspace(0.0, duration, 7):
        stopped = {
            axis: path.stopped(time, move.accelerations[axis]).end
            for axis, path in move.trajectories.items()
        }
        shares = [(stopped[axis] - start[axis]) / way[axis] for axis in stopped]
        assert shares == pytest.approx(np.full(len(shares), shares[0]), abs=1e-8)


def test_a_straight_move_of_one_axis_is_its_trapezoid():
    move = StraightMove.between(np.array([0.1, 0.2]), np.array([0.1, -0.3]), 0.3, 2.0)
    (path,) = move.trajectories.values()
    alone = Trajectory.trapezoid(0.2, -0.3, 0.3, 2.0)
    assert path.times == pytest.approx(alone.times, abs=1e-15)
    times = np.linspace(0.0, alone.duration, 101)
    assert path.position(times) == pytest.approx(alone.position(times), abs=1e-15)


def test_a_straight_move_of_no_length_moves_nothing():
    here = np.array([0.1, 0.2, 0.3])
    assert StraightMove.between(here, here, 0.3, 2.0) == StraightMove({}, {})
