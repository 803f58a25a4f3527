"""A run with a target ends at the first line end at which the solver says that it is reached."""

from dataclasses import replace
from math import nan

import pytest
from test_sequence import ORIGIN, Rig, a_plan

from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, LINEAR, Line
from stepdiag_ros.metrology.target import TargetStanding, TargetState
from stepdiag_ros.run.sequence import TARGET_LIMIT, Purpose, Sequence, State

OPEN = TargetStanding("E_XX", "m", 1e-6, nan, 9e-7, 60.0, TargetState.OPEN, 0, "nothing yet")
ENDS = {2, 4, 6}


def reached(lines):
    return replace(OPEN, state=TargetState.REACHED, reached=8e-7, lines=lines, text="")


class TargetRig(Rig):
    """A run of six passes that may have reached its target after every second one."""

    def __init__(self, ends=frozenset(ENDS), pause_for_setup=False):
        lines = [
            Line(LINEAR, "xyz"[i], "", 0, way) for i in range(3) for way in (FORWARD, BACKWARD)
        ]
        super().__init__()
        plan = replace(a_plan(pause_for_setup), lines=tuple(lines))
        self.sequence = Sequence(plan, ORIGIN, self.sent.append, self._stop, ends=ends)

    def solve(self, lines, **told):
        self.sequence.solved(replace(OPEN, lines=lines, **told))
        self.sequence.update(self.now, self.real)

    def measure_line(self):
        """Obey until the present line is over; whether the next is begun or not."""
        line, before = self.line, len(self.sent)
        while self.line == line and self.sequence.state is State.RUNNING:
            if len(self.sent) == before and self.sent[-1].line_index != line:
                raise AssertionError("nothing is commanded")
            self.obey()

    @property
    def line(self):
        return self.sequence.progress(self.now).line_index


def begun(**options):
    rig = TargetRig(**options)
    rig.start()
    return rig


def test_the_run_waits_for_the_solution_where_it_may_end_and_nowhere_else():
    rig = begun()
    rig.measure_line()
    assert rig.sent[-1].line_index == 1
    rig.measure_line()
    count = len(rig.sent)
    rig.wait(1.0)
    assert len(rig.sent) == count and rig.sequence.wanted == 0 and rig.sequence.waits_for
    rig.solve(1)
    assert len(rig.sent) == count
    rig.solve(2)
    rig.align()
    assert rig.sent[-1].line_index == 2


def test_it_ends_where_the_target_is_reached_and_moves_no_more():
    rig = begun()
    rig.measure_line()
    rig.measure_line()
    count = len(rig.sent)
    rig.sequence.solved(reached(2))
    rig.sequence.update(rig.now, rig.real)
    assert rig.sequence.state is State.FINISHED
    rig.wait(100.0)
    assert len(rig.sent) == count and rig.stops == 0
    told = rig.sequence.progress(rig.now)
    assert (told.line_index, told.line_count) == (2, 6) and told.target == reached(2)
    assert told.stops_done < told.stops_total and "0.8 µm" in told.text


def test_a_solution_that_never_comes_hangs_nothing():
    rig = begun()
    for _ in range(2):
        rig.measure_line()
    rig.wait(TARGET_LIMIT + 1.0)
    rig.align()
    assert rig.sent[-1].line_index == 2
    for line in range(3, 7):
        rig.measure_line()
        if line in ENDS:
            rig.wait(TARGET_LIMIT + 1.0)
        if rig.sequence.state is State.RUNNING:
            rig.align()
    assert rig.sequence.state is State.FINISHED
    assert rig.line == 6 and "unknown" in rig.sequence.text


def test_a_solution_that_comes_late_ends_the_run_at_the_next_line_end():
    rig = begun()
    for _ in range(2):
        rig.measure_line()
    rig.wait(TARGET_LIMIT + 1.0)
    rig.align()
    rig.obey()
    rig.sequence.solved(reached(2))
    assert rig.sequence.state is State.RUNNING
    rig.measure_line()
    assert rig.sequence.state is State.FINISHED and rig.line == 3


def test_a_target_that_is_not_reached_is_said_at_the_end():
    rig = begun()
    for count in range(1, 7):
        rig.measure_line()
        rig.solve(count, state=TargetState.BEYOND_PLAN, reached=3e-6)
        if rig.sequence.state is State.RUNNING:
            rig.align()
    assert rig.sequence.state is State.FINISHED and rig.line == 6
    assert "3 µm" in rig.sequence.text and "1 µm" in rig.sequence.text


def test_pause_abort_and_resume_keep_the_target():
    rig = begun()
    rig.obey()
    rig.sequence.pause()
    rig.obey()
    assert rig.sequence.state is State.PAUSED
    rig.sequence.solved(OPEN)
    assert rig.sequence.state is State.PAUSED
    rig.sequence.resume(rig.now, rig.real, rig.sent[-1].target)
    rig.align()
    rig.measure_line()
    rig.measure_line()
    rig.sequence.solved(reached(2))
    rig.sequence.update(rig.now, rig.real)
    assert rig.sequence.state is State.FINISHED
    other = begun()
    other.obey()
    other.sequence.abort("by hand")
    other.sequence.solved(reached(2))
    assert other.sequence.state is State.ABORTED


def test_a_pause_at_the_end_of_a_line_may_be_the_end_of_the_run():
    rig = begun()
    rig.measure_line()
    while rig.line == 1 and rig.sequence.progress(rig.now).stop < 2:
        rig.obey()
    rig.sequence.pause()
    rig.measure_line()
    rig.solve(2)
    assert rig.sequence.state is State.PAUSED
    rig.sequence.solved(reached(2))
    assert rig.sequence.state is State.FINISHED


@pytest.mark.parametrize("lines", [2, 6])
def test_a_fault_while_the_run_waits_for_a_solution_loses_nothing(lines):
    rig = begun()
    for count in range(1, lines + 1):
        rig.measure_line()
        if count < lines and count in ENDS:
            rig.solve(count)
            rig.align()
    rig.sequence.fault("the weather is lost")
    rig.sequence.resume(rig.now, rig.real, ORIGIN)
    rig.solve(lines)
    assert rig.line == lines
    if lines == 6:
        assert rig.sequence.state is State.FINISHED
    else:
        rig.align()
        assert rig.sent[-1].line_index == 2


def test_nobody_aligns_for_a_line_that_is_not_wanted_any_more():
    rig = TargetRig(pause_for_setup=True)
    rig.start()
    rig.sequence.resume(rig.now, rig.real, ORIGIN)
    rig.align()
    rig.measure_line()
    rig.measure_line()
    rig.solve(2)
    assert rig.sequence.state is State.WAITING_FOR_SETUP
    rig.sequence.solved(reached(2))
    assert rig.sequence.state is State.FINISHED


def test_a_run_without_a_target_waits_for_no_solution():
    rig = begun(ends=frozenset())
    rig.finish()
    assert rig.sequence.state is State.FINISHED and rig.sequence.progress(rig.now).target is None
    stops = [one for one in rig.sent if one.purpose is Purpose.STOP]
    assert len(stops) == 18
