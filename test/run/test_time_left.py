"""How long the rest of a run takes: standing time is no pace of measuring."""

import math

import pytest

from stepdiag_ros.run.time_left import TimeLeft

SECOND = 1_000_000_000


def test_it_is_unknown_before_the_first_stop_and_counts_measuring_alone():
    left = TimeLeft()
    left.look(0, True)
    left.look(4 * SECOND, True)
    assert math.isnan(left.estimate(10))
    for number in range(1, 5):
        left.stop_measured()
        left.look((4 + 2 * number) * SECOND, True)
    assert left.estimate(10) == pytest.approx(12.0 / 4 * 10)
    # A pause of an hour, in which it is looked at now and then.
    paused = 12 * SECOND
    for moment in range(0, 3600, 600):
        left.look(paused + moment * SECOND, False)
    assert left.estimate(10) == pytest.approx(30.0)
    left.look(paused + 3600 * SECOND, True)
    assert left.estimate(10) == pytest.approx(30.0)
    left.look(paused + 3603 * SECOND, True)
    left.stop_measured()
    assert left.estimate(10) == pytest.approx(15.0 / 5 * 10)


def test_a_clock_that_steps_back_takes_nothing_away():
    left = TimeLeft()
    left.look(10 * SECOND, True)
    left.stop_measured()
    left.look(5 * SECOND, True)
    left.look(7 * SECOND, True)
    assert left.estimate(1) == pytest.approx(2.0)
