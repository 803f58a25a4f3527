"""What every driver of a controller must do: one list of checks, for a rig around any of them.

A rig opens the device, tells the time and lets it pass: in a simulation by adding, on a real peer
by sleeping. Use: ``@pytest.mark.parametrize("check", CHECKS)`` and ``check(rig)``.
"""

import time
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite, nan

import pytest
from patience import PATIENCE
from refused import a_fault, refused

from stepdiag_ros.devices.cnc import (
    CncState,
    MoveRefused,
    PositionSample,
    StateChange,
    traits_of,
)
from stepdiag_ros.metrology.machine import Machine

SECOND = 1_000_000_000
SLOWLY = 0.001
"""m/s: a move of 10 mm goes on for long enough that a busy computer can meddle with it."""


@dataclass
class Rig:
    """A driver and its peer, ready to be opened.

    Attributes:
        machine: as its file describes it; the checks move by 10 mm from where it stands, upwards in
            X and Y, and need limits farther than that.
        opened: returns the device, newly opened.
        now: ns.
        sleep: lets some seconds pass.
        feed: for the moves, m/s.
        inaccuracy: of a position in rest, beside the window, m.
    """

    machine: Machine
    opened: object
    now: object
    sleep: object
    feed: float = 0.02
    inaccuracy: float = 0.0


class Operator:
    """Uses a device as the bridge does, and keeps what it says."""

    def __init__(self, rig, device=None):
        self.rig = rig
        self.device = rig.opened() if device is None else device
        self.events = []

    def poll(self):
        new = self.device.poll(self.rig.now())
        self.events += new
        return new

    def until(self, condition, limit=PATIENCE):
        end = self.rig.now() + limit * SECOND
        while True:
            self.poll()
            if condition():
                return
            assert self.rig.now() < end, f"not in {limit} s; last: {self.events[-3:]}"
            self.rig.sleep(0.004)

    def watch(self, seconds):
        end = self.rig.now() + seconds * SECOND
        self.until(lambda: self.rig.now() >= end)

    def until_state(self, state, limit=PATIENCE):
        self.until(lambda: self.device.state is state, limit)
        return self.changes[-1] if self.changes else None

    def ready(self):
        self.until(lambda: self.device.state is CncState.READY and self.position is not None)
        self.events.clear()
        self.until(lambda: self.position is not None)
        return self

    def move(self, target, axes, feed=None):
        self.device.start_move(
            self.rig.now(), target, self.rig.feed if feed is None else feed, axes
        )

    def moved(self, target, axes, feed=None):
        """Make a move to its end; return the events of it."""
        self.events.clear()
        self.move(target, axes, feed)
        self.until(lambda: self.device.state is not CncState.MOVING)
        return list(self.events)

    def reset(self, limit=PATIENCE):
        end = self.rig.now() + limit * SECOND
        while True:
            try:
                return self.device.reset(self.rig.now())
            except MoveRefused as refused:
                if self.rig.now() > end:
                    raise
                assert str(refused)
                self.watch(0.1)

    @property
    def changes(self):
        return [event for event in self.events if isinstance(event, StateChange)]

    @property
    def samples(self):
        return [event for event in self.events if isinstance(event, PositionSample)]

    @property
    def position(self):
        return self.samples[-1].position if self.samples else None

    def near(self):
        """Return what a position in rest may differ by, m."""
        resolution = max((r for r in traits_of(self.device).resolution if isfinite(r)), default=0)
        return self.rig.machine.position_window_m + resolution + self.rig.inaccuracy + 1e-9


def add(position, x=0.0, y=0.0, z=0.0):
    return position[0] + x, position[1] + y, position[2] + z


def check_a_single_axis_move(rig):
    operator = Operator(rig).ready()
    start = operator.position
    target = add(start, x=0.01)
    events = operator.moved(target, "X")
    moving, arrived = [event for event in events if isinstance(event, StateChange)]
    assert (moving.state, arrived.state) == (CncState.MOVING, CncState.READY)
    assert arrived.position == pytest.approx(target, abs=operator.near())
    assert arrived.reason == ""
    # It took the time that the feed needs, and the hold.
    assert arrived.time - moving.time >= (0.01 / rig.feed + rig.machine.position_hold_s) * SECOND
    paths = [[s.position for s in operator.samples]]
    # On a busy computer so short a move may be over before its position is asked for again.
    while not any(start[0] + 1e-3 < p[0] < target[0] - 1e-3 for p in paths[-1]):
        assert len(paths) < 6, "no position was seen on the way"
        operator.moved(target if len(paths) % 2 == 0 else start, "X")
        paths.append([s.position for s in operator.samples])
    assert all(p[1:] == start[1:] for path in paths for p in path)
    operator.moved(add(target, x=-0.01), "X")
    assert operator.device.state is CncState.READY, operator.changes[-1:]
    operator.device.close()


def check_two_axes_move_together(rig):
    operator = Operator(rig).ready()
    start = operator.position
    target = add(start, x=0.01, y=0.005)
    operator.moved(target, "XY")
    assert operator.changes[-1].position == pytest.approx(target, abs=operator.near())
    for sample in operator.samples:
        x, y = sample.position[0] - start[0], sample.position[1] - start[1]
        # Axes may be told one after the other; a way around the corner would differ by 5 mm.
        assert y == pytest.approx(x / 2, abs=1e-3)
    operator.moved(start, "XY")
    operator.device.close()


def check_a_move_of_no_length_ends_after_the_hold(rig):
    operator = Operator(rig).ready()
    moving, arrived = (
        event for event in operator.moved(operator.position, "") if isinstance(event, StateChange)
    )
    assert (moving.state, arrived.state) == (CncState.MOVING, CncState.READY)
    assert arrived.time - moving.time >= rig.machine.position_hold_s * SECOND
    operator.device.close()


def check_forbidden_moves_are_refused_and_nothing_moves(rig):
    operator = Operator(rig).ready()
    here = operator.position
    high, limit = operator.device.soft_limits[1], rig.machine.feed_limit_m_per_s
    for target, feed, axes, words in (
        ((high[0] + 1e-3, *here[1:]), rig.feed, "X", a_fault("out_of_range", aspect="limits")),
        (add(here, x=0.001), 0.0, "X", a_fault("out_of_range", aspect="feed")),
        (add(here, x=0.001), limit * 1.01, "X", a_fault("out_of_range", aspect="feed")),
        (add(here, x=0.001), nan, "X", a_fault("out_of_range", aspect="feed")),
        (add(here, x=0.001, y=0.001), rig.feed, "X", a_fault("mismatch", "X", "Y", aspect="axes")),
        (add(here, x=0.001), rig.feed, "", a_fault("mismatch", aspect="axes")),
        ((nan, *here[1:]), rig.feed, "X", a_fault("malformed", aspect="target")),
    ):
        with refused(MoveRefused, words):
            operator.move(target, axes, feed)
    operator.events.clear()
    operator.watch(0.3)
    operator.until(lambda: operator.samples)
    assert not operator.changes
    assert operator.device.state is CncState.READY, operator.changes[-1:]
    assert {sample.position for sample in operator.samples} == {here}
    operator.device.close()


def check_one_move_at_a_time(rig):
    operator = Operator(rig).ready()
    start = operator.position
    operator.move(add(start, x=0.01), "X", 4.0 * SLOWLY)
    operator.watch(0.1)
    with refused(MoveRefused, "not_ready", "moving", aspect="state"):
        operator.move(add(start, y=0.01), "Y")
    with refused(MoveRefused, "busy", aspect="motion"):
        operator.device.reset(rig.now())
    # On a busy computer the last sample may come from the way; the change states where it ended.
    arrived = operator.until_state(CncState.READY)
    assert arrived.position == pytest.approx(add(start, x=0.01), abs=operator.near())
    operator.moved(start, "X")
    operator.device.close()


def check_stop_brakes_and_wants_a_reset(rig):
    operator = Operator(rig).ready()
    start = operator.position
    target = add(start, x=0.01)
    operator.move(target, "X", SLOWLY)
    operator.until(lambda: operator.position and operator.position[0] > start[0] + 2e-4)
    operator.device.stop(rig.now(), "the operator")
    operator.until_state(CncState.STOPPED)
    stopped = operator.changes[-1]
    assert stopped.reason == "the operator"
    assert [change.state for change in operator.changes].count(CncState.STOPPED) == 1
    operator.events.clear()
    operator.watch(0.3)
    operator.until(lambda: operator.samples)
    assert not operator.changes
    # It stands, short of the target.
    for sample in operator.samples:
        assert sample.position == pytest.approx(operator.position, abs=operator.near())
    assert start[0] < operator.position[0] < target[0] - 1e-3
    with refused(MoveRefused, "not_ready", "stopped", aspect="state"):
        operator.move(start, "X")
    operator.reset()
    operator.until_state(CncState.READY)
    # The rest of the old move is gone.
    operator.events.clear()
    operator.watch(0.2)
    operator.until(lambda: operator.samples)
    still = operator.samples[0].position
    assert operator.position == pytest.approx(still, abs=operator.near())
    operator.moved(start, "X")
    assert operator.changes[-1].position == pytest.approx(start, abs=operator.near())
    operator.device.close()


def check_stop_just_after_the_start_leaves_nothing_behind(rig):
    operator = Operator(rig).ready()
    start = operator.position
    operator.move(add(start, x=0.01), "X", SLOWLY)
    operator.device.stop(rig.now(), "at once")
    operator.until_state(CncState.STOPPED)
    operator.reset()
    operator.until_state(CncState.READY)
    operator.events.clear()
    operator.watch(0.3)
    operator.until(lambda: operator.samples)
    still = operator.samples[0].position
    assert operator.position == pytest.approx(still, abs=operator.near())
    assert operator.position[0] < start[0] + 0.009
    operator.moved(start, "X")
    operator.device.close()


def check_stop_at_rest(rig):
    operator = Operator(rig).ready()
    operator.device.stop(rig.now(), "watchdog")
    operator.until_state(CncState.STOPPED)
    assert operator.changes[-1].reason == "watchdog"
    operator.device.stop(rig.now(), "again")
    operator.watch(0.1)
    assert len(operator.changes) == 1
    operator.reset()
    operator.until_state(CncState.READY)
    operator.device.close()


def check_samples_go_on_and_times_never_decrease(rig):
    operator = Operator(rig).ready()
    start = operator.position
    operator.events.clear()
    begin = rig.now()
    operator.move(add(start, x=0.005), "X")
    operator.until_state(CncState.READY)
    operator.watch(0.5)
    operator.moved(start, "X")
    during = len(operator.samples)
    # At rest they go on.
    operator.until(lambda: len(operator.samples) >= during + 3)
    assert during
    times = [event.time for event in operator.events]
    assert times == sorted(times)
    samples = [s.time for s in operator.samples]
    gaps = [b - a for a, b in pairwise(samples)]
    # In real time, a busy computer may let any of them wait.
    assert max(gaps) < (PATIENCE if rig.sleep is time.sleep else 2) * SECOND
    assert begin - SECOND < times[0] and times[-1] <= rig.now()
    operator.device.close()


CHECKS = [value for name, value in list(globals().items()) if name.startswith("check_")]
