"""A command moves the machine once, when it is new, released for, and wanted."""

from math import nan

import pytest

from stepdiag_ros.run.entitlement import Entitlement, Silence


def entitlement(**changed):
    made = Entitlement(**{"silence_limit": 0.5, "age_limit": 2.0, **changed})
    made.begin_run("run")
    made.release()
    return made


def test_nothing_moves_before_the_bridge_is_released_and_after_it_was_withdrawn():
    made = Entitlement(0.5)
    made.begin_run("run")
    assert "was not released" in made.refusal("run", 1, 0.0)
    made.release()
    assert made.refusal("run", 1, 0.0) == ""
    made.withdraw("somebody meddles")
    # What follows from it is no other reason.
    made.withdraw()
    assert "an operator has to start or resume" in made.refusal("run", 1, 0.0)
    assert "somebody meddles" in made.refusal("run", 1, 0.0)
    made.release()
    made.withdraw()
    assert "somebody meddles" not in made.refusal("run", 1, 0.0)
    made.release()
    made.begin_run("another run")
    assert "was not released" in made.refusal("another run", 1, 0.0)


def test_a_command_is_never_executed_twice():
    made = entitlement()
    made.take_up(5, 0.0)
    for number in (5, 4, 1, 0):
        assert made.refusal("run", number, 0.0) == "command 5 was executed already"
    assert made.refusal("run", 6, 0.0) == ""
    assert made.is_repetition("run", 5)
    assert not made.is_repetition("run", 6) and not made.is_repetition("old", 5)


def test_commands_of_another_run_are_refused():
    made = entitlement()
    assert "belongs to run old" in made.refusal("old", 1, 0.0)


@pytest.mark.parametrize("age", [2.1, -2.1, 86400.0, nan])
def test_a_recorded_or_late_command_is_refused(age):
    assert "it is late, recorded, or clocks differ" in entitlement().refusal("run", 1, age)
    assert entitlement().refusal("run", 1, 1.9) == ""


def test_a_command_is_confirmed_by_the_permit_before_or_after_it():
    made = entitlement()
    made.permit("run", 1, 10.0)
    made.take_up(1, 10.01)
    assert made.confirmed
    made.take_up(2, 10.2)
    assert not made.confirmed
    made.permit("run", 2, 10.3)
    assert made.confirmed


@pytest.mark.parametrize(("run", "number"), [("old", 1), ("run", 2)])
def test_a_permit_for_something_else_confirms_nothing(run, number):
    made = entitlement()
    made.permit(run, number, 10.0)
    made.take_up(1, 10.0)
    made.permit(run, number, 10.1)
    assert not made.confirmed


def test_an_old_permit_does_not_confirm_a_command_that_comes_late():
    made = entitlement()
    made.permit("run", 1, 10.0)
    made.take_up(1, 10.6)
    assert not made.confirmed


def test_motion_lapses_when_nobody_wants_it_any_more():
    made = entitlement()
    made.permit("run", 1, 0.0)
    made.take_up(1, 0.0)
    time = 0.0
    for step in range(100):
        time = step * 0.01
        # Neither words for another command nor for another run keep this one alive.
        made.permit("run", 2, time)
        made.permit("old", 1, time)
        if made.lapsed(time):
            break
    assert time == pytest.approx(0.51, abs=0.011)
    assert made.lapsed(time) == "the sequencer has not confirmed command 1 for 0.5 s"


def test_motion_goes_on_while_it_is_wanted():
    made = entitlement()
    made.take_up(1, 0.0)
    for step in range(300):
        if step % 10 == 0:
            made.permit("run", 1, step * 0.01)
        assert made.lapsed(step * 0.01) == ""


def test_a_process_that_slept_listens_before_it_judges():
    silence = Silence()
    silence.heard(0.0)
    assert silence.look(0.01) == pytest.approx(0.01)
    assert silence.look(5.0) == pytest.approx(0.11)
    assert silence.look(4.0) == pytest.approx(0.11), "a clock that steps back counts nothing"
    fresh = Silence()
    assert fresh.look(100.0) == 0.0
