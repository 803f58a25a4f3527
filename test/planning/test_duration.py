"""Durations against the motion of the simulated controller, and by hand."""

from dataclasses import replace

import numpy as np
import pytest
from refused import refused

from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.devices.cnc import CncState, StateChange
from stepdiag_ros.devices.cnc.simulated import SimulatedCnc
from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.plan import Line, Plan, Sampling, Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.planning.duration import Assumptions, MoveTimes, duration
from stepdiag_ros.planning.moves import passes_of

MACHINE = load_machine("demo")[0]
RIGID = DriveModel(lag_s=0.0)
NOTHING = Assumptions(0.0, 0.0, 0.0)


def controller_time(target, feed, drive, machine=MACHINE):
    cnc = SimulatedCnc(machine, drive, 0)
    cnc.start_move(0, target, feed, "".join(a for a, way in zip("XYZ", target, strict=True) if way))
    return end_of_move(cnc, 0) * 1e-9


def end_of_move(cnc, now):
    """Return when the controller is ready again, ns; its milliseconds after that are not made."""
    for second in range(1, 200):
        for event in cnc.poll(now + second * 10**9):
            if isinstance(event, StateChange) and event.state is CncState.READY:
                return event.time
    raise AssertionError("the move does not end")


@pytest.mark.parametrize("distance", [1e-5, 0.001, 0.0333, 0.4])
@pytest.mark.parametrize("feed", [0.033, 0.4])
def test_a_move_takes_as_long_as_on_the_simulated_controller(distance, feed):
    clock = MoveTimes(MACHINE, feed, settling=0.0)
    # The controller looks once in a millisecond, and an axis is early in its window.
    assert clock.move(distance) == pytest.approx(
        controller_time((distance, 0.0, 0.0), feed, RIGID), abs=0.0021
    )


@pytest.mark.parametrize("target", [(0.1, 0.05, 0.02), (0.001, 0.0, 0.001)])
def test_axes_that_move_at_once_take_as_long_as_on_the_simulated_controller(target):
    clock = MoveTimes(MACHINE, 0.4, settling=0.0)
    taken = controller_time(target, 0.4, RIGID)
    assert clock.between((0.0, 0.0, 0.0), target, at_once=True) == pytest.approx(taken, abs=0.0021)
    assert clock.between((0.0, 0.0, 0.0), target, at_once=False) > 1.1 * taken


def test_the_default_settling_covers_the_drives_of_the_demonstration():
    from stepdiag_ros.configuration import load_cell

    drive = load_cell("demo")[0].drive
    clock = MoveTimes(MACHINE, 0.033, Assumptions().settling_s)
    taken = controller_time((0.01, 0.0, 0.0), 0.033, drive)
    assert taken <= clock.move(0.01) <= taken + 0.1


def test_a_line_by_hand():
    volume = Volume((0.0, 0.0, 0.0), (0.1, 0.1, 0.05), 3)
    lines = (
        Line("linear", "x", "", 0, "forward"),
        Line("step_diagonal", "npp", "XYZ", 0, "forward"),
    )
    machine = replace(MACHINE, position_hold_s=0.0, acceleration_m_per_s2=1.0)
    plan = Plan("", volume, lines, 0.1, Sampling(dwell=2.0))
    found = duration(plan, machine, Assumptions(60.0, 120.0, 0.0))
    # 0.1 m at 0.1 m/s with ramps of 0.1 s: 1.1 s; 0.05 m: 0.6 s.
    first, second = found.lines
    assert first.moves == pytest.approx(3 * 1.1)
    assert first.dwells == 4 * 2.0
    assert (first.alignment, second.alignment) == (60.0, 120.0)
    assert second.positioning == pytest.approx(0.0)
    assert second.moves == pytest.approx(3 * (1.1 + 1.1 + 0.6))
    assert second.dwells == 10 * 2.0
    assert found.total == pytest.approx(60 + 120 + 3.3 + 8.4 + 14 * 2.0)
    assert (found.stops, found.alignments) == (14, 2)


def test_the_window_counts_where_it_is_longer_than_the_dwell():
    plan = load_plan("demo")[0]
    long = replace(plan, sampling=Sampling(dwell=0.1, settle=1.0, window=2.0))
    found = duration(long, MACHINE, NOTHING)
    assert sum(line.dwells for line in found.lines) == pytest.approx(3.0 * plan.stop_count)


def test_nobody_aligns_where_the_plan_does_not_wait():
    plan = load_plan("demo")[0]
    waits = replace(plan, pause_for_setup=True)
    assert duration(plan, MACHINE).alignments == 0
    found = duration(waits, MACHINE)
    assert found.alignments == 7
    assert found.alignment == 3 * 600.0 + 4 * 1200.0
    assert found.running == pytest.approx(duration(plan, MACHINE).total)


def test_a_setup_that_comes_back_is_aligned_again():
    plan = replace(load_plan("demo")[0], pause_for_setup=True)
    split = replace(plan, lines=(*plan.lines[1:], plan.lines[0]))
    assert [one.new_setup for one in passes_of(split)][-1]
    assert duration(split, MACHINE).alignments == 8


def test_the_whole_demonstration_takes_what_the_simulated_machine_takes():
    """All moves of a small plan, one after the other, on the controller."""
    plan = replace(load_plan("quick")[0], sampling=Sampling(dwell=0.4))
    cnc = SimulatedCnc(MACHINE, RIGID, 0)
    now, place = 0, np.zeros(3)
    for one in passes_of(plan):
        for index, target in enumerate(one.targets):
            ways = np.flatnonzero(np.asarray(target) != place)
            steps = [int(axis) for axis in ways] or [0]
            for axis in steps:
                place[axis] = target[axis]
                cnc.start_move(now, tuple(place.tolist()), plan.feed, "XYZ"[axis])
                now = end_of_move(cnc, now)
                cnc = SimulatedCnc(MACHINE, RIGID, now, tuple(place.tolist()))
            assert index >= 0
            now += round(0.4e9)
    found = duration(plan, MACHINE, Assumptions(0.0, 0.0, 0.0), start=(0.0, 0.0, 0.0))
    assert found.total == pytest.approx(now * 1e-9, rel=0.01)


def test_the_plan_for_a_first_run_takes_the_machine_a_few_minutes():
    found = duration(load_plan("check")[0], MACHINE)
    assert found.running < 5 * 60.0
    assert found.alignments == 6


def test_a_plan_without_feed_has_no_duration():
    with refused(Refusal, "missing", "feed_m_per_s"):
        duration(replace(load_plan("demo")[0], feed=float("nan")), MACHINE)


def test_negative_assumptions_are_refused():
    with refused(Refusal, "out_of_range", "settling_s", "-1"):
        Assumptions(settling_s=-1.0)
