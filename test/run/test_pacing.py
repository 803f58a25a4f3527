import pytest

from stepdiag_ros.run.pacing import (
    FOLLOWER_LAG,
    FOLLOWER_PATIENCE,
    RECORDER_LAG,
    GovernedTime,
    Pace,
)

SECOND = 1_000_000_000


def test_pace_and_its_inverse():
    pace = Pace(factor=30.0, origin=5 * SECOND, real_start=100.0)
    assert pace.time(102.0) == 65 * SECOND
    assert pace.real(65 * SECOND) == pytest.approx(102.0)
    assert pace.part(35 * SECOND, 65 * SECOND) == pytest.approx(0.5)
    assert pace.span(65 * SECOND) == pytest.approx(60.0)


def test_time_runs_free_without_followers():
    time = GovernedTime(factor=20.0, origin=0, real_start=0.0)
    assert time.advance(3.0) == 60 * SECOND


def test_another_factor_holds_from_when_it_is_set():
    time = GovernedTime(factor=20.0, origin=0, real_start=0.0)
    time.run_at(0.5, 3.0)
    assert time.advance(3.0) == 60 * SECOND
    assert time.advance(5.0) == 61 * SECOND


def test_time_waits_for_a_follower_and_does_not_jump_afterwards():
    time = GovernedTime(factor=20.0, origin=0, real_start=0.0)
    time.heard(0, 0.0)
    assert time.advance(0.01) == pytest.approx(0.2 * SECOND)
    held = time.advance(0.1)
    for real in (0.2, 0.3, 0.5):
        assert time.advance(real) == held
    time.heard(held, 0.5)
    assert time.advance(0.51) == held + round(0.01 * 20 * SECOND)
    assert held <= (FOLLOWER_LAG + 0.1) * 20 * SECOND


def test_a_dead_follower_does_not_stop_time():
    time = GovernedTime(factor=20.0, origin=0, real_start=0.0)
    time.heard(0, 0.0)
    held = time.advance(0.5)
    assert time.advance(FOLLOWER_PATIENCE + 0.1) > held


def test_simulated_time_waits_for_each_follower():
    time = GovernedTime(factor=20.0, origin=0, real_start=0.0)
    time.heard(0, 0.0, "recorder", RECORDER_LAG)
    reached = time.advance(RECORDER_LAG * 0.5)
    time.heard(reached, RECORDER_LAG * 0.5)
    # The fast follower is there, the recorder is not too far behind yet.
    assert time.advance(RECORDER_LAG * 0.51) > reached
    time = GovernedTime(factor=20.0, origin=0, real_start=0.0)
    time.heard(0, 0.0, "recorder", RECORDER_LAG)
    ahead = time.advance(RECORDER_LAG * 1.01)
    time.heard(ahead, RECORDER_LAG * 1.01)
    assert time.advance(RECORDER_LAG * 1.02) == ahead
    time.heard(ahead, RECORDER_LAG * 1.02, "recorder", RECORDER_LAG)
    assert time.advance(RECORDER_LAG * 1.03) > ahead


def test_a_follower_that_says_the_same_again_has_not_come_on():
    time = GovernedTime(factor=20.0, origin=0, real_start=0.0)
    time.heard(0, 0.0, "recorder", 0.1)
    ahead = time.advance(0.2)
    time.heard(0, FOLLOWER_PATIENCE, "recorder", 0.1)
    assert time.advance(FOLLOWER_PATIENCE * 1.01) > ahead
