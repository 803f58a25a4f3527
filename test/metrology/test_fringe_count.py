"""A count that does not fit the way of the axes is found; one that does is left alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag_ros.metrology.beam import FixedBeam
from stepdiag_ros.metrology.fringe_count import FLOOR, CountCheck

MS = 1_000_000
BEAM = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)


def course(steps=6, step=0.02, feed=0.03, rest=0.4):
    """Return knots of time (s) and place (m) of single-axis moves with rests between."""
    time, place = 0.0, np.zeros(3)
    knots = [(time, place.copy())]
    for number in range(steps):
        time += rest
        knots.append((time, place.copy()))
        time += step / feed
        place[number % 3] += step
        knots.append((time, place.copy()))
    knots.append((time + rest, place.copy()))
    return knots


def measured(
    slip=0.0,
    at=1e9,
    tilt=(0.0, 0.0, 0.0),
    offset=0.0,
    noise=0.2e-6,
    lost=(),
    every=2,
    knots=None,
):
    """Feed a check with a whole course; return what it says, and at which time it said so first."""
    knots = course() if knots is None else knots
    times = np.array([time for time, _ in knots])
    places = np.array([place for _, place in knots])
    random = np.random.default_rng(5)

    def place(time):
        return np.array([np.interp(time, times, places[:, axis]) for axis in range(3)])

    check = CountCheck()
    check.begin(FixedBeam(BEAM), -1)
    said = None
    for tick in range(round(times[-1] * 100)):
        time = tick * 0.01
        if tick % every == 0:
            check.add_position(round(time * 1e9), tuple(place(time)))
        length = float((BEAM + tilt) @ place(time - offset)) + noise * random.standard_normal()
        length += slip * (time >= at)
        check.add_reading(round(time * 1e9) + 1, length, tick not in lost)
        if check.check() and said is None:
            said = time
    return check.trouble, said


def test_a_good_count_is_left_alone():
    assert measured()[0] == ""


@settings(max_examples=25)
@given(
    st.tuples(*[st.floats(-2e-3, 2e-3)] * 3),
    st.floats(-0.03, 0.03),
)
def test_misalignment_and_a_delay_between_the_clocks_are_no_errors(tilt, offset):
    assert measured(tilt=tilt, offset=offset)[0] == ""


@pytest.mark.parametrize(("every", "enough"), [(1, True), (5, True), (7, False), (20, False)])
def test_positions_that_come_rarely_prove_nothing(every, enough):
    assert measured(every=every)[0] == ""
    assert (measured(3e-4, at=0.7, every=every)[0] != "") is enough


@pytest.mark.parametrize("slip", [8e-6, -8e-6, 1e-3])
def test_a_jump_while_the_axes_stand_is_found_at_once(slip):
    trouble, said = measured(slip, at=0.2)
    assert f"the count jumped by {abs(slip) * 1e6:.1g}"[:20] in trouble
    assert said is not None and said - 0.2 < 0.1


def test_a_jump_in_a_move_is_found_at_the_next_standstill():
    trouble, said = measured(0.12e-3, at=0.7)
    assert "the displacement changed by" in trouble
    assert said is not None and 1.0 < said < 1.3


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (2e-3, -1e-3, 1e-3)])
def test_once_the_alignment_is_known_a_smaller_jump_is_found(tilt):
    trouble, said = measured(-3e-5, at=3.9, tilt=tilt)
    assert "the displacement changed by" in trouble and 4.2 < said < 4.5


@pytest.mark.parametrize(("slip", "good"), [(1.5e-6, True), (3e-4, False)])
def test_an_overrun_does_not_show_the_alignment_of_the_line(slip, good):
    """What an axis settles by after 2 mm is a large part of these, and none of 80 mm."""
    knots, time, place = [(0.0, np.zeros(3))], 0.0, np.zeros(3)
    for way in (0.002, 0.08, 0.08):
        for after, step in ((0.4, 0.0), (way / 0.03, way)):
            time, place = time + after, place + np.array([step, 0.0, 0.0])
            knots.append((time, place))
    knots.append((time + 0.4, place))
    at = 0.41 if good else 1.5
    assert (measured(slip, at, knots=knots)[0] == "") == good


def test_a_large_jump_in_a_move_is_found_at_once():
    trouble, said = measured(1e-3, at=0.7)
    assert "the count jumped by" in trouble and said < 0.8


def test_what_the_instrument_itself_calls_lost_is_not_judged():
    assert measured(1.0, at=0.2, lost=(20,))[0] == ""


def test_vibration_below_the_floor_is_none_of_its_business():
    assert measured(0.5 * FLOOR, at=0.2)[0] == ""


def test_it_holds_until_the_next_zero():
    check = CountCheck()
    check.begin(FixedBeam(BEAM), 0)
    for tick in range(1, 100):
        check.add_position(tick * 10 * MS, (0.0, 0.0, 0.0))
        check.add_reading(tick * 10 * MS, 1e-4 * (tick > 50), True)
        check.check()
    assert check.trouble
    check.begin(FixedBeam(BEAM), 1000 * MS)
    for tick in range(99, 200):
        check.add_position(tick * 10 * MS, (0.0, 0.0, 0.0))
        # The readings before the new zero may still come.
        check.add_reading(tick * 10 * MS, 1.0 * (tick > 100), True)
        assert check.check() == "" or tick > 100


def test_without_positions_nothing_is_judged():
    check = CountCheck()
    check.begin(FixedBeam(BEAM), 0)
    for tick in range(1, 20_000):
        check.add_reading(tick * MS, float(tick), True)
        assert check.check() == ""
