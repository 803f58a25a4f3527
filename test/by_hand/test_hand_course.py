"""A run measured by hand, followed live: every stop at once, and what does not fit at once, too."""

from dataclasses import replace

import numpy as np
from exact_drive import driven, plan_of, stays_of
from hand_values import stops_by_hand
from program_run import Instrument, run_program
from refused import refused

from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.metrology.assembly import Assembler
from stepdiag_ros.metrology.by_hand import plan_by_hand
from stepdiag_ros.metrology.measurement import MeasuredLine, SettledStop
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.planning.moves import moves_of
from stepdiag_ros.run.hand_course import HandCourse
from stepdiag_ros.run.sequence import State


def quick():
    plan = load_plan("quick")[0]
    return replace(plan, sampling=replace(plan.sampling, dwell=1.0))


class Live:
    """A run with its assembler, fed with the readings of a program."""

    def __init__(self, plan, moves=None):
        self.plan = plan
        self.moves = moves_of(plan) if moves is None else moves
        self.seen = run_program(
            plan, self.moves, load_cell("demo")[0], 2.0, Instrument(rate=50.0, seed=4, work=5.0)
        )
        self.events, self.told, self.texts = [], [], []
        self.now = 0
        self.assembler = Assembler(plan_by_hand(plan), 0)
        self.course = HandCourse(plan, self.tell)
        self.course.start()
        self.run()

    def tell(self, command, arrival):
        self.told.append((command, self.now))
        self.events += self.assembler.add_command(command)
        self.events += self.assembler.add_arrival(arrival)

    def run(self):
        # The operator says so four seconds after the beam is set up, with a second to go.
        aligned = [
            time + 9_000_000_000
            for time, move in zip(self.seen.arrivals, self.moves, strict=True)
            if move.program_stop.startswith("Align")
        ]
        for reading in self.seen.readings:
            self.now = reading.time
            if aligned and reading.time >= aligned[0]:
                aligned.pop(0)
                if self.course.state is State.WAITING_FOR_SETUP:
                    self.course.resume()
            self.course.take(reading)
            self.events += self.assembler.add_reading(reading)
            if not self.texts or self.texts[-1] != self.course.text:
                self.texts.append(self.course.text)
            if self.course.state is State.FAULT:
                return

    @property
    def lines(self):
        return [event for event in self.events if isinstance(event, MeasuredLine)]


def test_every_stop_is_told_while_the_machine_stands_there():
    live = Live(quick())
    assert live.course.state is State.FINISHED
    assert [line.line_index for line in live.lines] == list(range(6))
    assert all(line.complete for line in live.lines)
    stops = [n for n, move in enumerate(live.moves) if move.dwell_s > 0.0]
    for number, (command, told) in zip(stops, live.told, strict=True):
        left = live.seen.arrivals[number] + 1_000_000_000
        # The first stop of a line is told when it is left, the others before.
        if command.stop:
            assert live.seen.arrivals[number] < told < left
    assert live.texts[0].startswith("by hand: align laser and mirror for x, stand at the first")
    assert "by hand: stop 2 of x forward, repeat 0 found" in live.texts


def test_live_and_from_the_recording_the_values_are_the_same():
    plan = quick()
    live = Live(plan)
    offline = stops_by_hand(plan, live.seen.readings)
    stops = [event for event in live.events if isinstance(event, SettledStop)]
    assert len(stops) == len(offline) == 42
    for stop in stops:
        other = offline[(stop.command.line_index, stop.command.stop)]
        uncertainty = np.hypot(stop.standard_uncertainty, other.standard_uncertainty)
        assert abs(stop.displacement - other.displacement) < 4.0 * uncertainty


def changed(plan, edit):
    moves = moves_of(plan)
    stops = [n for n, move in enumerate(moves) if move.dwell_s > 0.0]
    edit(moves, stops)
    return Live(plan, moves)


def test_a_missed_stop_is_said_at_the_next():
    def miss(moves, stops):
        moves[stops[14]] = replace(moves[stops[14]], dwell_s=0.0)

    live = changed(quick(), miss)
    wanted = "by hand: stop 3 of ppp XYZ forward, repeat 0 found; missed before it: 1"
    assert wanted in live.texts
    assert [line.complete for line in live.lines] == [True, True, True, False, True, True]


def test_a_rest_that_is_no_stop_is_said_and_left_out():
    def hold(moves, stops):
        between = np.mean([moves[stops[13]].target_m, moves[stops[14]].target_m], axis=0)
        moves.insert(stops[14], replace(moves[stops[14]], target_m=tuple(between.tolist())))

    live = changed(quick(), hold)
    assert any(text.startswith("a rest that is not a stop, +2.88") for text in live.texts)
    assert all(line.complete for line in live.lines) and len(live.lines) == 6


def test_a_wrong_direction_stops_the_run_until_the_line_is_begun_again():
    def turn(moves, stops):
        own = stops[12:22]
        for number, place in zip(own, [moves[n].target_m for n in own[::-1]], strict=True):
            moves[number] = replace(moves[number], target_m=place)

    live = changed(quick(), turn)
    assert live.course.state is State.FAULT
    assert "are not stops" in live.course.text
    assert "go back to the first stop of ppp XYZ forward, repeat 0" in live.course.text
    assert [line.line_index for line in live.lines] == [0, 1, 2]
    live.course.resume()
    assert live.course.state is State.RUNNING
    assert live.course.progress().setup == "ppp XYZ #2"


def test_a_stop_that_is_not_where_the_plan_has_it_stops_the_run():
    plan = plan_of("x")
    told = []
    course = HandCourse(plan, lambda command, _: told.append(command.stop))
    course.start()
    course.resume()
    for reading in driven([(1.02 * place, dwell) for place, dwell in stays_of(plan)]):
        course.take(reading)
    assert course.state is State.FAULT
    assert course.text.startswith("stop 1 of x forward, repeat 0 stands +0.2000 mm from where")
    assert told == [0]


def test_a_lost_zero_stops_the_run():
    plan = quick()
    course = HandCourse(plan, lambda *_: None)
    course.start()
    course.resume()
    seen = run_program(
        plan, moves_of(plan), load_cell("demo")[0], 2.0, Instrument(rate=50.0, seed=4, work=5.0)
    )
    begin = seen.arrivals[1] + 9_000_000_000
    for reading in seen.readings:
        lost = begin + 4e9 < reading.time < begin + 4.5e9
        if reading.time >= begin:
            course.take(reading._replace(status=2 if lost else 0))
    assert course.state is State.FAULT
    assert course.text.startswith("the zero is lost")


def test_what_cannot_be_asked_is_refused():
    course = HandCourse(quick(), lambda *_: None)
    with refused(Refusal, "not_ready", "idle", aspect="resume"):
        course.resume()
    course.start()
    with refused(Refusal, "busy"):
        course.start()
    course.abort("aborted by the operator")
    with refused(Refusal, "not_ready", "aborted", aspect="abort"):
        course.abort("again")
