import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from refused import refused

from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    DIAGONAL,
    FORWARD,
    LEAVE,
    LINEAR,
    STEP_DIAGONAL,
    Line,
    Plan,
    Sampling,
    Volume,
)
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.run.feasibility import beyond_machine, out_of_limits
from stepdiag_ros.run.sequence import (
    ANSWER_LIMIT,
    Answer,
    Command,
    Purpose,
    Sequence,
    State,
)

SECOND = 1_000_000_000
ORIGIN = (0.0, 0.0, 0.0)


def a_plan(pause_for_setup=False):
    return Plan(
        name="two short lines",
        volume=Volume((0.0, 0.0, 0.0), (0.01, 0.02, 0.03), 2),
        lines=(
            Line(LINEAR, "x", "", 0, FORWARD),
            Line(STEP_DIAGONAL, "npp", "YZX", 0, FORWARD),
        ),
        feed=0.01,
        sampling=Sampling(dwell=0.5),
        pause_for_setup=pause_for_setup,
    )


class Rig:
    """A sequence with a machine that obeys at once, on a clock that the test moves."""

    def __init__(self, plan=None):
        self.sent: list[Command] = []
        self.stops = 0
        self.now = 0
        self.real = 0.0
        self.sequence = Sequence(plan or a_plan(), ORIGIN, self.sent.append, self._stop)

    def _stop(self):
        self.stops += 1

    def start(self):
        self.sequence.start(self.now, self.real)
        self.align()

    def align(self):
        """Let the interferometer say that its beam stands for the present setup."""
        self.sequence.beam_ready(self.sequence.progress(self.now).setup)
        self.sequence.update(self.now, self.real)

    def wait(self, seconds):
        self.now += round(seconds * SECOND)
        self.real += seconds
        self.sequence.update(self.now, self.real)

    def answer(self, answer, reason="", command=None):
        command = command or self.sent[-1]
        self.sequence.answered(command.command_id, answer, reason, self.now, self.real)

    def settle(self, rejection=""):
        command = self.sent[-1]
        self.sequence.settled(command.line_index, command.attempt, command.stop, rejection)
        self.sequence.stored(command.command_id)

    def obey(self, rejection=""):
        """Bring the last command to its end."""
        command = self.sent[-1]
        self.answer(Answer.ACCEPTED)
        self.answer(Answer.IN_POSITION)
        if command.purpose is Purpose.STOP:
            self.settle(rejection)
            self.wait(0.6)
        if self.sequence.state is State.RUNNING:
            self.align()

    def finish(self, limit=200):
        for _ in range(limit):
            if self.sequence.state is not State.RUNNING:
                return
            self.obey()
        raise AssertionError("the run does not end")


def test_nothing_moves_before_the_start():
    rig = Rig()
    rig.wait(100.0)
    assert rig.sent == []
    assert rig.sequence.state is State.IDLE


def test_every_command_moves_one_axis_at_most_and_ends_at_the_stops_of_the_plan():
    rig = Rig()
    rig.start()
    rig.finish()
    assert rig.sequence.state is State.FINISHED
    position = list(ORIGIN)
    for command in rig.sent:
        moved = [axis for axis in range(3) if command.target[axis] != position[axis]]
        assert len(moved) <= 1
        assert command.axis == ("XYZ"[moved[0]] if moved else "")
        position = list(command.target)
    plan = a_plan()
    for index, line in enumerate(plan.lines):
        targets = [
            command.target
            for command in rig.sent
            if command.line_index == index and command.purpose is Purpose.STOP
        ]
        assert targets == [tuple(stop) for stop in line.stops(plan.volume)]
    assert [command.command_id for command in rig.sent] == list(range(1, len(rig.sent) + 1))


def overrun_plan(overrun=0.003):
    both = (FORWARD, BACKWARD)
    lines = [Line(LINEAR, "x", "", 0, way) for way in both]
    lines += [Line(DIAGONAL, "npp", "", 0, way) for way in both]
    lines += [Line(DIAGONAL, "p0n", "", 0, way, (0.0, 0.01, 0.0)) for way in both]
    lines.append(Line(STEP_DIAGONAL, "ppp", "XYZ", 0, FORWARD))
    return replace(a_plan(), lines=tuple(lines), overrun=overrun)


def test_several_axes_move_at_once_on_diagonals_only():
    plan = overrun_plan()
    rig = Rig(plan)
    rig.start()
    rig.finish()
    assert rig.sequence.state is State.FINISHED
    position = np.array(ORIGIN)
    at_once = set()
    for command in rig.sent:
        target = np.array(command.target)
        line = plan.lines[command.line_index]
        moved = "".join(axis for axis, way in zip("XYZ", target - position, strict=True) if way)
        assert command.axis == moved
        if len(moved) > 1:
            assert line.kind == DIAGONAL
            at_once.add((line.name, moved))
            # Along the line itself, in either sense.
            direction = beam_direction(line.name, np.array(plan.volume.step))
            assert np.cross(target - position, direction) == pytest.approx(np.zeros(3), abs=1e-12)
        position = target
    assert at_once == {("npp", "XYZ"), ("p0n", "XZ")}


@pytest.mark.parametrize("overrun", [0.003, 0.0])
def test_with_an_overrun_every_stop_is_approached_in_the_direction_of_its_pass(overrun):
    plan = overrun_plan(overrun)
    rig = Rig(plan)
    rig.start()
    rig.finish()
    position = np.array(ORIGIN)
    wrong = 0
    for command in rig.sent:
        line, target = plan.lines[command.line_index], np.array(command.target)
        if command.purpose is Purpose.STOP and line.kind != STEP_DIAGONAL:
            stops = line.stops(plan.volume)
            towards = (stops[1] - stops[0]) / np.linalg.norm(stops[1] - stops[0])
            way = target - position
            right = towards @ way >= (overrun or 1e-9) - 1e-12
            wrong += not (right and np.cross(towards, way) == pytest.approx(np.zeros(3), abs=1e-12))
        position = target
    # Without one, the first stop of each of the six passes is not.
    assert wrong == (0 if overrun else 6)


@pytest.mark.parametrize(("kind", "order"), [(STEP_DIAGONAL, "ZXY"), (DIAGONAL, ""), (LINEAR, "")])
def test_between_passes_of_one_alignment_the_mirror_stays_in_the_beam(kind, order):
    """Otherwise the fringe count, and with it the common zero, is lost between the passes."""
    name = "x" if kind == LINEAR else "pnp"
    passes = tuple(Line(kind, name, order, repeat, FORWARD) for repeat in range(3))
    plan = replace(a_plan(), lines=passes)
    rig = Rig(plan)
    rig.start()
    rig.finish()
    places = {tuple(stop) for stop in passes[0].stops(plan.volume)}
    before = [command.target for command in rig.sent if command.line_index == 0]
    first = before.index(tuple(passes[0].stops(plan.volume)[0]))
    sent = [*before[first:], *(c.target for c in rig.sent if c.line_index > 0)]
    assert set(sent) == places
    moves = [np.abs(np.subtract(a, b)) for a, b in pairwise(sent)]
    longest = np.max(np.asarray(plan.volume.step))
    assert max(move.max() for move in moves) <= longest + 1e-12
    assert [c.stop for c in rig.sent if c.purpose is Purpose.STOP] == [*range(len(places))] * 3


def test_a_line_that_is_measured_again_begins_with_its_overrun_again():
    plan = overrun_plan()
    rig = Rig(replace(plan, lines=plan.lines[2:3]))
    rig.start()
    while rig.sent[-1].stop < 1:
        rig.obey()
    before = len(rig.sent)
    rig.answer(Answer.FAULT, "servo")
    assert rig.sequence.state is State.FAULT
    rig.sequence.resume(rig.now, rig.real, (0.015, 0.013, 0.021))
    rig.align()
    rig.finish()
    again = rig.sent[before:]
    assert [command.axis for command in again] == ["X", "Y", "Z", "XYZ", "XYZ", "XYZ", "XYZ"]
    assert {command.attempt for command in again} == {2}


def test_a_run_up_beyond_the_soft_limits_is_named():
    plan = overrun_plan()
    high = (0.0235, 0.042, 0.063)
    assert out_of_limits(plan, (-0.003, -0.003, -0.003), high, "here") == ""
    text = out_of_limits(plan, (-0.002, -0.003, -0.003), high, "here")
    assert "line x runs X from -0.003 m" in text and "overrun of 0.003 m included" in text
    last = replace(plan, lines=plan.lines[4:])
    text = out_of_limits(last, (-0.003, -0.003, -0.003), ORIGIN, "here")
    assert "line p0n runs X" in text
    assert out_of_limits(replace(plan, overrun=0.0), ORIGIN, (0.02, 0.04, 0.06), "here") == ""


def test_waits_for_the_assembler_and_for_the_dwell():
    rig = Rig()
    rig.start()
    rig.answer(Answer.ACCEPTED)
    rig.answer(Answer.IN_POSITION)
    rig.wait(1.0)
    assert len(rig.sent) == 1, "went on before the stop was assembled"
    rig.settle()
    rig.wait(0.0)
    assert len(rig.sent) == 2
    rig.answer(Answer.IN_POSITION)
    rig.settle()
    rig.wait(0.4)
    assert len(rig.sent) == 2, "went on before the dwell was over"
    rig.wait(0.2)
    assert len(rig.sent) == 3


def test_the_assembler_may_speak_before_the_bridge():
    rig = Rig()
    rig.start()
    rig.answer(Answer.ACCEPTED)
    rig.settle()
    rig.answer(Answer.IN_POSITION)
    rig.wait(0.6)
    assert len(rig.sent) == 2


def test_moves_on_only_when_the_stop_is_on_the_disk():
    rig = Rig()
    rig.start()
    rig.answer(Answer.IN_POSITION)
    first = rig.sent[-1]
    rig.sequence.settled(first.line_index, first.attempt, first.stop, "")
    rig.wait(1.0)
    assert len(rig.sent) == 1
    rig.sequence.stored(first.command_id)
    rig.wait(0.0)
    assert len(rig.sent) == 2


def test_a_recorder_that_does_not_store_is_a_fault():
    rig = Rig()
    rig.start()
    rig.answer(Answer.IN_POSITION)
    first = rig.sent[-1]
    rig.sequence.settled(first.line_index, first.attempt, first.stop, "")
    rig.wait(60.0)
    assert rig.sequence.state is State.FAULT
    assert "recorder" in rig.sequence.text


def test_does_not_move_without_a_beam_for_the_setup():
    rig = Rig()
    rig.sequence.start(rig.now, rig.real)
    rig.sequence.beam_ready("another setup")
    rig.wait(5.0)
    assert rig.sent == []
    rig.wait(10.0)
    assert rig.sequence.state is State.FAULT
    assert "no beam" in rig.sequence.text


def test_pause_takes_effect_after_the_stop_and_resume_goes_on():
    rig = Rig()
    rig.start()
    rig.sequence.pause()
    assert rig.sequence.state is State.RUNNING
    rig.obey()
    assert rig.sequence.state is State.PAUSED
    count = len(rig.sent)
    rig.wait(50.0)
    assert len(rig.sent) == count
    rig.sequence.resume(rig.now, rig.real, rig.sent[-1].target)
    rig.finish()
    assert rig.sequence.state is State.FINISHED


@pytest.mark.parametrize(("off", "again"), [(0.9e-3, False), (-1.1e-3, True), (0.05, True)])
def test_a_machine_that_was_moved_in_a_pause_measures_the_line_again(off, again):
    rig = Rig()
    rig.start()
    rig.obey()
    before = rig.sent[-1]
    rig.sequence.pause()
    rig.obey()
    x, y, z = rig.sent[-1].target
    rig.sequence.resume(rig.now, rig.real, (x + off, y, z))
    if not again:
        rig.finish()
        assert {command.attempt for command in rig.sent} == {before.attempt}
        return
    assert rig.sequence.state is State.FAULT and f"X was moved by {off * 1e3:.1f} mm" in (
        rig.sequence.text
    )
    rig.sequence.resume(rig.now, rig.real, (x + off, y, z))
    rig.align()
    assert rig.sent[-1].attempt == before.attempt + 1
    assert rig.sent[-1].setup != before.setup


def test_abort_stops_the_machine_for_good():
    rig = Rig()
    rig.start()
    rig.answer(Answer.MOVING)
    rig.sequence.abort("by the test")
    assert rig.stops == 1
    rig.answer(Answer.IN_POSITION)
    rig.settle()
    rig.wait(10.0)
    assert len(rig.sent) == 1
    with refused(Refusal, "not_ready", "aborted", aspect="resume"):
        rig.sequence.resume(rig.now, rig.real, ORIGIN)


@pytest.mark.parametrize("answer", [Answer.REJECTED, Answer.STOPPED, Answer.FAULT])
def test_a_refused_move_is_a_fault_and_resume_measures_the_line_again(answer):
    rig = Rig()
    rig.start()
    rig.obey()
    rig.answer(answer, "for the test")
    assert rig.sequence.state is State.FAULT
    assert "for the test" in rig.sequence.text
    assert rig.stops == 1
    before = rig.sent[-1]
    rig.sequence.resume(rig.now, rig.real, (0.003, 0.0, 0.0))
    assert rig.sent[-1] is before, "moves before the beam stands for the new setup"
    rig.align()
    again = rig.sent[-1]
    assert again.attempt == before.attempt + 1
    assert again.setup != before.setup, "the zero is lost, so it is another setup"
    assert again.purpose is Purpose.POSITION
    rig.finish()
    assert rig.sequence.state is State.FINISHED


def test_a_silent_bridge_is_a_fault():
    rig = Rig()
    rig.start()
    rig.wait(ANSWER_LIMIT - 0.1)
    assert rig.sequence.state is State.RUNNING
    rig.wait(0.2)
    assert rig.sequence.state is State.FAULT
    assert "not answered" in rig.sequence.text


def test_a_move_that_never_ends_is_a_fault():
    rig = Rig()
    rig.start()
    rig.answer(Answer.MOVING)
    rig.wait(60.0)
    assert rig.sequence.state is State.FAULT
    assert "move has not ended" in rig.sequence.text


def test_a_stop_that_is_never_assembled_is_a_fault():
    rig = Rig()
    rig.start()
    rig.answer(Answer.IN_POSITION)
    rig.wait(60.0)
    assert rig.sequence.state is State.FAULT
    assert "not been assembled" in rig.sequence.text


def test_a_hurried_clock_alone_is_no_fault():
    rig = Rig()
    rig.start()
    rig.answer(Answer.MOVING)
    rig.now += 60 * SECOND
    rig.real += 0.1
    rig.sequence.update(rig.now, rig.real)
    assert rig.sequence.state is State.RUNNING


LOST = "the zero is lost: the beam was interrupted"
RESTLESS = "not settled within 3 s after in position: the readings scatter"


def reject(rig, reason, when, limit=200):
    """Run until another line, or until the run holds, rejecting the stops of the first line."""
    for _ in range(limit):
        if rig.sequence.state is not State.RUNNING or rig.sent[-1].line_index:
            return
        command = rig.sent[-1]
        rig.obey(reason if command.purpose is Purpose.STOP and when(command) else "")
    raise AssertionError("the line does not end")


def policy(**sampling):
    plan = a_plan()
    return Rig(replace(plan, sampling=replace(plan.sampling, **sampling)))


def test_a_line_whose_zero_is_lost_is_begun_anew_at_once():
    rig = policy(line_attempts=3)
    rig.start()
    reject(rig, LOST, lambda command: command.stop == 1 and command.attempt < 3)
    stops = [(c.attempt, c.stop) for c in rig.sent if c.line_index == 0 and not c.purpose]
    assert stops == [(1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2)]
    setups = {command.attempt: command.setup for command in rig.sent if command.line_index == 0}
    assert len(set(setups.values())) == 3, "a lost zero is another setup"
    rig.finish()
    assert rig.sequence.state is State.FINISHED and rig.sequence.incomplete == []


def test_a_line_that_fails_again_and_again_holds_the_run_until_an_operator_resumes():
    rig = policy(line_attempts=2)
    rig.start()
    reject(rig, LOST, lambda command: command.stop == 1)
    assert rig.sequence.state is State.FAULT and rig.stops == 1
    assert "measured 2 times in vain, stop 1: the zero is lost" in rig.sequence.text
    rig.wait(1000.0)
    count = len(rig.sent)
    assert rig.sequence.state is State.FAULT and rig.sent[-1].attempt == 2
    rig.sequence.resume(rig.now, rig.real, rig.sent[-1].target)
    rig.align()
    assert len(rig.sent) > count and rig.sent[-1].attempt == 3
    reject(rig, LOST, lambda command: command.stop == 1)
    assert rig.sent[-1].attempt == 4, "whoever resumes grants as many attempts as before"
    assert rig.sequence.state is State.FAULT


def test_a_line_may_be_left_incomplete_instead():
    rig = policy(line_attempts=2, after_attempts=LEAVE)
    rig.start()
    reject(rig, LOST, lambda command: command.stop == 1)
    assert [c.stop for c in rig.sent if c.attempt == 2 and not c.purpose][:3] == [0, 1, 2]
    rig.finish()
    assert rig.sequence.state is State.FINISHED
    assert "left incomplete: x forward, repeat 0: stop 1: the zero is lost" in rig.sequence.text
    assert len(rig.sequence.incomplete) == 1


@pytest.mark.parametrize("index", [0, 1])
def test_a_stop_that_does_not_settle_is_approached_again_in_the_same_direction(index):
    plan = a_plan()
    rig = Rig(replace(plan, lines=plan.lines[index:]))
    rig.start()
    reject(rig, RESTLESS, lambda c: c.stop == 1 and [s.stop for s in rig.sent].count(1) == 1)
    rig.finish()
    assert rig.sequence.state is State.FINISHED
    sent = [command for command in rig.sent if command.line_index == 0]
    assert {command.attempt for command in sent} == {1} and len({c.setup for c in sent}) == 1
    first = next(i for i, c in enumerate(sent) if c.stop == 1)
    way = [(c.purpose, c.stop, c.target) for c in sent[first : first + 3]]
    stops = [tuple(stop) for stop in plan.lines[index].stops(plan.volume)]
    assert way == [
        (Purpose.STOP, 1, stops[1]),
        (Purpose.POSITION, 0, stops[0]),
        (Purpose.STOP, 1, stops[1]),
    ]
    assert sent[first + 1].axis == sent[first].axis


def test_a_first_stop_that_does_not_settle_is_approached_with_its_run_up_again():
    plan = overrun_plan()
    rig = Rig(plan)
    rig.start()
    reject(rig, RESTLESS, lambda _: [s.purpose for s in rig.sent].count(Purpose.STOP) == 1)
    targets = [command.target[0] for command in rig.sent[:4]]
    assert targets == [-0.003, 0.0, -0.003, 0.0]


def test_a_stop_that_never_settles_lets_the_line_begin_anew():
    rig = policy(stop_attempts=3, line_attempts=2)
    rig.start()
    reject(rig, RESTLESS, lambda command: command.stop == 1)
    measured = [c.attempt for c in rig.sent if c.stop == 1 and not c.purpose]
    assert measured == [1, 1, 1, 2, 2, 2]
    assert rig.sequence.state is State.FAULT


def test_a_pause_is_heeded_before_a_stop_is_measured_again():
    rig = policy()
    rig.start()
    rig.sequence.pause()
    rig.obey(RESTLESS)
    assert rig.sequence.state is State.PAUSED
    rig.sequence.resume(rig.now, rig.real, ORIGIN)
    assert rig.sent[-1].stop == 0 and rig.sent[-1].attempt == 1


def test_a_command_is_wanted_until_its_move_has_ended():
    rig = Rig()
    assert rig.sequence.wanted == 0
    rig.start()
    number = rig.sent[-1].command_id
    assert rig.sequence.wanted == number > 0
    rig.answer(Answer.MOVING)
    assert rig.sequence.wanted == number
    rig.answer(Answer.IN_POSITION)
    assert rig.sequence.wanted == 0
    rig.settle()
    rig.wait(0.6)
    assert rig.sequence.wanted == number + 1
    rig.sequence.fault("for the test")
    assert rig.sequence.wanted == 0


def test_waits_for_the_operator_before_each_setup():
    rig = Rig(a_plan(pause_for_setup=True))
    rig.start()
    assert rig.sequence.state is State.WAITING_FOR_SETUP
    assert rig.sent == []
    rig.sequence.resume(rig.now, rig.real, ORIGIN)
    rig.align()
    rig.finish()
    assert rig.sequence.state is State.WAITING_FOR_SETUP
    assert rig.sequence.progress(rig.now).line.startswith("npp")


def test_remaining_time_is_unknown_at_first_and_then_falls():
    rig = Rig()
    rig.start()
    assert math.isnan(rig.sequence.progress(rig.now).remaining_time)
    rig.obey()
    first = rig.sequence.progress(rig.now).remaining_time
    rig.obey()
    assert 0.0 < rig.sequence.progress(rig.now).remaining_time < first


def test_a_pause_and_a_fault_are_no_part_of_the_time_left():
    rig = Rig()
    rig.start()
    for _ in range(3):
        rig.obey()
    rig.sequence.pause()
    rig.obey()
    assert rig.sequence.state is State.PAUSED
    before = rig.sequence.progress(rig.now).remaining_time
    for _ in range(10):
        rig.wait(360.0)
    assert rig.sequence.progress(rig.now).remaining_time == before > 0.0
    rig.sequence.resume(rig.now, rig.real, ORIGIN)
    assert rig.sequence.progress(rig.now).remaining_time == before
    rig.obey()
    rig.sequence.fault("for the test")
    held = rig.sequence.progress(rig.now).remaining_time
    rig.wait(3600.0)
    assert rig.sequence.progress(rig.now).remaining_time == held > 0.0


def test_the_progress_says_in_which_block_of_which_line_the_run_is():
    rig = Rig()
    rig.start()
    places = []
    while rig.sequence.state is State.RUNNING:
        told = rig.sequence.progress(rig.now)
        assert told.line_count == 2 and told.block_count == 2
        if rig.sent[-1].purpose is Purpose.STOP:
            places.append((told.line_index, told.stop, told.block))
        rig.obey()
    # A linear line has a stop at the end of each block, a step diagonal three.
    linear = [(0, 0, 0), (0, 1, 1), (0, 2, 2)]
    diagonal = [(1, 0, 0), (1, 1, 1), (1, 2, 1), (1, 3, 1), (1, 4, 2), (1, 5, 2), (1, 6, 2)]
    assert places == linear + diagonal
    told = rig.sequence.progress(rig.now)
    assert (told.line_count, told.block, told.block_count) == (2, 0, 0)


def test_a_plan_beyond_the_soft_limits_is_named():
    assert out_of_limits(a_plan(), ORIGIN, (1.0, 1.0, 1.0), "here") == ""
    text = out_of_limits(a_plan(), ORIGIN, (1.0, 0.03, 1.0), "here")
    assert "npp" in text and "Y" in text


def test_a_machine_that_cannot_execute_the_plan():
    machine = Machine("small", "XYZ", ORIGIN, (0.1, 0.1, 0.1), 0.01, 1.0)
    assert beyond_machine(a_plan(), machine) == ""
    assert "above the machine's feed limit" in beyond_machine(
        a_plan(), replace(machine, feed_limit_m_per_s=0.0099)
    )
    assert "outside the soft limits" in beyond_machine(
        a_plan(), replace(machine, travel_high_m=(0.1, 0.03, 0.1))
    )
    assert "has no feed" in beyond_machine(replace(a_plan(), feed=math.nan), machine)
