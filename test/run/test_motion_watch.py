"""In position by actual positions, whatever the controller says."""

from math import nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.run.motion_watch import SETTLE_LIMIT, MotionWatch

MS = 1_000_000
MACHINE = Machine("m", "YXZ", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.5, 2.0, 0.5e-6, 0.02)
HOME, TARGET = (0.0, 0.0, 0.0), (0.01, 0.0, 0.0)
EXACT = (0.0, 0.0, 0.0)


def a_watch(resolution=EXACT, target=TARGET):
    watch = MotionWatch(MACHINE, resolution)
    watch.begin(HOME, target)
    return watch


def at(x, y=0.0, z=0.0):
    return (x, y, z)


def test_the_word_of_the_controller_alone_is_not_believed():
    watch = a_watch()
    assert watch.take(0, at(0.009)) is None
    assert watch.done(1 * MS) is None
    # The drives lag 20 ms behind.
    assert watch.take(10 * MS, at(0.0099)) is None
    assert watch.take(20 * MS, at(0.01)) is None
    ending = watch.take(40 * MS, at(0.0100003))
    assert ending is not None and ending.trouble == ""
    assert (ending.time, ending.position) == (40 * MS, at(0.0100003))
    assert watch.take(60 * MS, at(0.5)) is None, "the move has ended"


def test_what_was_held_before_the_controller_says_so_counts():
    watch = a_watch()
    for time in (0, 10, 20, 30):
        assert watch.take(time * MS, at(0.01)) is None
    ending = watch.done(33 * MS)
    assert ending is not None and (ending.time, ending.trouble) == (33 * MS, "")


def test_the_window_must_be_held_without_a_break():
    watch = a_watch()
    watch.done(0)
    assert watch.take(0, at(0.01)) is None
    assert watch.take(15 * MS, at(0.0100006)) is None
    assert watch.take(19 * MS, at(0.01)) is None
    assert watch.take(38 * MS, at(0.01)) is None
    assert watch.take(39 * MS, at(0.01)) is not None


def test_one_sample_is_no_proof_however_short_the_hold_time():
    machine = Machine("m", "YXZ", HOME, (1.0, 1.0, 1.0), 0.5, 2.0, 0.5e-6, 0.0)
    watch = MotionWatch(machine, EXACT)
    watch.begin(HOME, TARGET)
    watch.done(0)
    assert watch.take(1, at(0.01)) is None
    assert watch.take(1, at(0.01)) is None, "the same sample once more"
    assert watch.take(2, at(0.01)) is not None


@pytest.mark.parametrize(
    ("off", "words"),
    [
        (at(0.010004), "X is 4 µm off its target; within 0.5 µm"),
        (at(0.01, -3e-6), "Y is 3 µm off"),
        (at(nan), "X is nan µm off"),
    ],
)
def test_a_machine_that_does_not_get_there_is_a_fault(off, words):
    watch = a_watch()
    watch.done(7 * MS)
    for time in range(10, 1000, 10):
        assert watch.take(time * MS, off) is None
    ending = watch.take(round(SETTLE_LIMIT * 1e9) + 8 * MS, off)
    assert ending is not None and words in ending.trouble
    assert "the controller says that the move is done" in ending.trouble


def test_the_window_is_widened_by_the_step_in_which_positions_are_told():
    for resolution, arrives in (((1e-6, nan, nan), True), ((nan, nan, nan), False)):
        watch = a_watch(resolution)
        watch.done(0)
        watch.take(0, at(0.010001))
        assert (watch.take(30 * MS, at(0.010001)) is not None) is arrives


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (at(-0.0011), "X is 1.10 mm off the straight way"),
        (at(0.0112), "X is 1.20 mm off"),
        (at(0.005, 0.0015), "Y is 1.50 mm off"),
    ],
)
def test_a_machine_that_goes_elsewhere_is_a_fault_at_once(place, words):
    watch = a_watch()
    assert watch.take(0, at(0.001)) is None
    ending = watch.take(1, place)
    assert ending is not None and words in ending.trouble


@given(
    st.lists(st.tuples(st.integers(1, 30), st.floats(-1e-6, 1e-6)), max_size=40),
    st.integers(0, 600),
)
def test_in_position_is_said_only_where_it_is_true(steps, done):
    """Whatever comes: at the end of a move all samples of the hold time were in the window."""
    watch = a_watch()
    seen, time, said = [], 0, False
    for step, off in steps:
        if not said and time >= done:
            ending, said = watch.done(time * MS), True
            if ending:
                break
        time += step
        seen.append((time, off))
        ending = watch.take(time * MS, at(0.01 + off))
        if ending:
            break
    else:
        return
    assert said and ending.trouble == ""
    first_out = max((time for time, off in seen if abs(off) > 0.5e-6 + 1e-15), default=-1)
    inside = [time for time, _ in seen if time > first_out]
    assert inside[-1] - inside[0] >= 20
