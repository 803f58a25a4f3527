"""A run measured by hand is as one that was commanded, or it is said why not; never shifted."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hand_cases import FAULTS, HARMLESS, judge, make_case
from hand_values import compared
from program_run import Instrument, run_program

from stepdiag_ros.configuration import load_cell, load_plan, plan_from_text
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.by_hand import (
    Numbering,
    as_commanded,
    find_stops,
    objection_to,
    plan_by_hand,
)
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.planning.moves import moves_of
from stepdiag_ros.planning.plan_text import plan_text


@pytest.mark.parametrize(
    ("fault", "seed"),
    [
        *((fault, 1) for fault in FAULTS),
        *((fault, 2) for fault in HARMLESS),
        # Lines of these were once taken at other places than they were measured.
        *(("wrong plan", seed) for seed in (21, 22)),
    ],
)
def test_no_stop_is_ever_taken_for_another(fault, seed):
    case = make_case(fault, seed)
    outcome = judge(case)
    assert outcome.shifted == ()
    if fault in HARMLESS:
        assert outcome.refused == (), outcome.words
        assert len(outcome.taken) == len(case.plan.lines)
    if fault == "wrong plan":
        assert outcome.taken == ()


def quick(dwell=1.0, **changed):
    plan = load_plan("quick")[0]
    return replace(plan, sampling=replace(plan.sampling, dwell=dwell), **changed)


def recorded(plan, moves=None, cell="demo", **instrument):
    moves = moves_of(plan) if moves is None else moves
    given = {"rate": 40.0, "work": 5.0, **instrument}
    return run_program(plan, moves, load_cell(cell)[0], 2.0, Instrument(seed=5, **given))


@cache
def whole():
    """The recording of the plan as it is."""
    return recorded(quick())


def stops_of(plan):
    """Numbers of the moves that are stops, by line."""
    return [n for n, move in enumerate(moves_of(plan)) if move.dwell_s > 0.0]


def found_in(plan, readings, lines=None):
    found = find_stops(plan, range(len(plan.lines)) if lines is None else lines, readings)
    hand = plan_by_hand(plan)
    commands, arrivals = as_commanded(hand, found, 0, Numbering())
    events = assemble(hand, readings[0].time, commands, arrivals, readings)
    return found, events, commands


@pytest.mark.parametrize("cell", ["demo", "hidden_several"])
def test_the_values_are_those_of_a_run_that_was_commanded(cell):
    differences, uncertainties = compared(quick(), load_cell(cell)[0], rate=100.0)
    pulls = differences / uncertainties
    assert len(pulls) == 42
    # Both windows hold nearly the same readings.
    assert np.sqrt(np.mean(pulls**2)) < 1.5
    assert np.max(np.abs(pulls)) < 4.0


def words_of(plan, readings, line):
    found, events, _ = found_in(plan, readings)
    return found.lines[line], [e.line_index for e in events if isinstance(e, MeasuredLine)]


def test_a_missed_stop_is_said_and_has_no_value():
    plan = quick()
    moves = moves_of(plan)
    number = stops_of(plan)[14]  # stop 2 of the first step diagonal, after 3 lines of 4 stops
    moves[number] = replace(moves[number], dwell_s=0.0)
    line, _ = words_of(plan, recorded(plan, moves).readings, 3)
    assert line.refusal == ""
    assert line.remarks == ("missed: no rest at stop 2",)
    assert [taken.stop for taken in line.stops] == [0, 1, 3, 4, 5, 6, 7, 8, 9]


def test_a_hold_between_two_stops_is_said_and_left_out():
    plan = quick()
    moves = moves_of(plan)
    number = stops_of(plan)[14]
    between = tuple(np.mean([moves[number - 1].target_m, moves[number].target_m], axis=0).tolist())
    moves.insert(number, replace(moves[number], target_m=between, dwell_s=3.0))
    line, _ = words_of(plan, recorded(plan, moves).readings, 3)
    assert line.refusal == "" and len(line.stops) == 10
    (remark,) = line.remarks
    assert remark.startswith("extra rest +2.88") and "after stop 1" in remark


def test_a_doubled_stop_is_said_and_does_not_shift():
    plan = quick()
    moves = moves_of(plan)
    number = stops_of(plan)[14]
    x, y, z = moves[number].target_m
    moves[number + 1 : number + 1] = [
        replace(moves[number], target_m=(x, y + 0.002, z), dwell_s=0.0),
        moves[number],
    ]
    line, _ = words_of(plan, recorded(plan, moves).readings, 3)
    assert line.refusal == "" and len(line.stops) == 10
    assert line.remarks[0].startswith("doubled: stands twice at stop 2, once for ")


def test_a_stop_that_lasts_is_said():
    plan = quick()
    moves = moves_of(plan)
    number = stops_of(plan)[14]
    moves[number] = replace(moves[number], dwell_s=7.0)
    line, _ = words_of(plan, recorded(plan, moves).readings, 3)
    assert line.remarks[0].startswith("stands 6.9") and "at stop 2" in line.remarks[0]


def test_a_sequence_that_is_cut_at_its_beginning_gives_nothing():
    plan = quick()
    seen = whole()
    second = seen.arrivals[stops_of(plan)[1]]
    readings = [reading for reading in seen.readings if reading.time > second]
    line, taken = words_of(plan, readings, 0)
    assert "which ones is not certain" in line.refusal
    one_as_good = ("may be stop 0 or stop 1;", "may be stop 1 or stop 0;")
    assert any(words in line.refusal for words in one_as_good)
    # y and z have the same steps, but theirs are whole.
    assert taken == [1, 2, 3, 4, 5]


def test_a_sequence_that_is_cut_at_its_end_gives_nothing():
    plan = quick()
    seen = whole()
    last = seen.arrivals[stops_of(plan)[-1]]
    line, taken = words_of(plan, [one for one in seen.readings if one.time < last - 5e8], 5)
    assert line.refusal
    assert taken == [0, 1, 2, 3, 4]


def test_a_line_run_the_other_way_round_gives_nothing():
    plan = quick()
    moves = moves_of(plan)
    own = stops_of(plan)[12:22]
    for number, place in zip(own, [moves[n].target_m for n in own[::-1]], strict=True):
        moves[number] = replace(moves[number], target_m=place)
    line, taken = words_of(plan, recorded(plan, moves).readings, 3)
    assert line.refusal
    assert 3 not in taken and {0, 1, 2} <= set(taken)


@pytest.mark.parametrize("blocks", [2, 4, 5])
def test_the_program_of_another_plan_gives_nothing(blocks):
    plan = quick()
    other = replace(plan, volume=replace(plan.volume, blocks=blocks))
    found, events, _ = found_in(plan, recorded(other).readings)
    assert all(line.refusal for line in found.lines)
    assert events == []
    assert "rests with steps of mostly" in found.hint and "the plan has 42 stops" in found.hint


def test_the_wrong_sign_is_named():
    plan = quick()
    readings = [
        one._replace(compensated_displacement=-one.compensated_displacement)
        for one in whole().readings
    ]
    found, events, _ = found_in(plan, readings)
    assert events == []
    assert "with the sign of the readings reversed they fit better" in found.hint


@pytest.mark.parametrize(
    ("factor", "asked"), [(1e3, "1000"), (1e-3, "1000"), (25.4, "25.4"), (1 / 25.4, "25.4")]
)
def test_the_wrong_unit_is_seen(factor, asked):
    plan = quick()
    readings = [
        one._replace(compensated_displacement=one.compensated_displacement * factor)
        for one in whole().readings
    ]
    found, events, _ = found_in(plan, readings)
    assert events == []
    assert f"about {asked} times" in found.hint and "1 rests" not in found.hint


def test_a_setup_measured_twice_is_not_chosen_from():
    plan = quick()
    moves = moves_of(plan)
    first, last = stops_of(plan)[12], stops_of(plan)[21] + 1
    again = [replace(move, program_stop="") for move in moves[first:last]]
    line, taken = words_of(plan, recorded(plan, moves[:last] + again + moves[last:]).readings, 3)
    assert "one pass more than planned" in line.refusal or "not certain" in line.refusal
    assert set(taken) == {0, 1, 2}


def test_a_single_line_is_found_where_nobody_looks_for_the_others():
    plan = quick()
    seen = whole()
    numbers = stops_of(plan)
    begin, end = seen.arrivals[numbers[12]], seen.arrivals[numbers[21]] + 3e9
    part = [one for one in seen.readings if begin <= one.time <= end]
    found, events, commands = found_in(plan, part, [3])
    assert found.lines[0].refusal == ""
    assert [e.line_index for e in events if isinstance(e, MeasuredLine) and e.complete] == [3]
    assert {command.line_index for command in commands} == {3}


def test_a_zero_lost_between_passes_is_another_zero_of_the_setup():
    plan = plan_from_text(plan_text(load_plan("demo")[0]).replace("repeats: 2", "repeats: 1"), "p")
    plan = replace(plan, sampling=replace(plan.sampling, dwell=1.0), lines=plan.lines[:2])
    seen = recorded(plan)
    turn = seen.arrivals[stops_of(plan)[13]]
    readings = [
        one
        if one.time < turn + 300_000_000
        else one._replace(compensated_displacement=one.compensated_displacement + 0.5)
        for one in seen.readings
    ]
    found, events, commands = found_in(plan, readings)
    lines = [event for event in events if isinstance(event, MeasuredLine)]
    assert {command.setup for command in commands} <= {"x", "x #2"}
    for line in lines:
        step = np.abs(np.diff(line.displacement[np.isfinite(line.displacement)]))
        assert np.max(np.abs(step - 0.01)) < 1e-4
    assert lines or all(line.refusal for line in found.lines)


def test_a_display_too_slow_for_the_window_is_refused():
    plan = quick()
    seen = recorded(plan, rate=2.0)
    assert "give the plan a window_s of at least 1.8 s" in objection_to(plan, seen.readings)
    assert objection_to(quick(), seen.readings[:2]) == "it holds only 2 readings"
    assert objection_to(plan, whole().readings) == ""


def test_a_dwell_too_short_for_the_window_is_said():
    plan = quick()
    moves = [
        replace(move, dwell_s=0.3) if move.dwell_s else move for move in moves_of(plan)
    ]  # less than window and settling of the drive
    found, events, _ = found_in(plan, recorded(plan, moves).readings)
    assert not [event for event in events if isinstance(event, MeasuredLine)]
    assert all("dwell longer" in line.refusal for line in found.lines)
