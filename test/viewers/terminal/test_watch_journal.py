"""The view as a log: a line for each change of what matters, and none for what does not."""

from dataclasses import replace
from datetime import datetime, timezone

import pytest

from stepdiag_ros.run.sequence import State as RunState
from stepdiag_ros.viewers.page.contact import Contact, SilentNode
from stepdiag_ros.viewers.page.items import RunBegin, RunStatus, Said
from stepdiag_ros.viewers.page.state import PageState
from stepdiag_ros.viewers.terminal.glyphs import ASCII, UNICODE
from stepdiag_ros.viewers.terminal.journal import Journal

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=timezone.utc)
STATUS = RunStatus(0, "a", RunState.RUNNING, 0, 6, "x forward", "x", 1, 4, 1, 42, 60.0, "measuring")


@pytest.fixture
def told():
    """Return a state, and the lines that its journal has written."""
    lines, state = [], PageState()
    state.listener = Journal(state, UNICODE, lambda: NOW, lines.append).look
    return state, lines


def taken(lines):
    """Return what was written since the last look, without the time."""
    stamp = "2026-01-02T03:04:05+00:00 "
    assert all(line.startswith(stamp) for line in lines)
    found = [line.removeprefix(stamp) for line in lines]
    lines.clear()
    return found


def test_the_course_of_a_run(told, run):
    state, lines = told
    state.take(RunBegin("a", 0, run.plan, "", simulated=True))
    assert taken(lines) == [f"run a, simulated: {run.plan.name}"]
    state.take(STATUS, "a")
    assert taken(lines) == ["state: measuring (1 of 42 stops)"]
    # That it has gone on is no news; the screen shows it.
    state.take(STATUS._replace(stop=2, stops_done=2), "a")
    assert taken(lines) == []
    line = run.lines[0]
    state.take(line, "a")
    (course,) = (
        one for one in state.document("volume")["courses"] if one["name"] == line.line.name
    )
    assert taken(lines) == [f"line {course['name']}: 1 of {course['passes']} passes"]
    state.take(STATUS._replace(state=RunState.FAULT, text="the beam is lost"), "a")
    assert taken(lines) == [
        "state: stopped by a fault: the beam is lost (1 of 42 stops)",
        "fault: run: the beam is lost",
    ]
    state.take(STATUS, "a")
    assert taken(lines) == [
        "state: measuring (1 of 42 stops)",
        "gone: fault: run: the beam is lost",
    ]


def test_a_line_that_is_not_whole_is_said(told, run):
    state, lines = told
    state.take(RunBegin("a", 0, run.plan, "", simulated=False))
    line = run.lines[0]
    state.take(replace(line, displacement=line.displacement * float("nan")), "a")
    assert taken(lines)[1].endswith("passes, 1 of them incomplete")


def test_results_and_verdict(told, run):
    state, lines = told
    state.take(RunBegin(run.run_id, 0, run.plan, "", simulated=False))
    taken(lines)
    result = run.results[-1]
    state.take(result, run.run_id)
    line, largest = taken(lines)
    worst = state.document("worst")
    assert largest.endswith(f": {worst['text']} at {worst['where']}")
    curves, figures = state.document("curves"), state.document("squareness")["figures"]
    assert line.startswith(f"result: {curves['method']}, {curves['lines']} passes: ")
    worst = curves["curves"][0]["worst"]
    assert f"{curves['curves'][0]['name']} {worst['text']} at {worst['at']:g} mm; " in line
    assert line.endswith(f"; {figures[-1]['name']} {figures[-1]['text']}")
    diagnosis = run.diagnoses[-1]
    for _ in range(2):
        state.take(diagnosis, run.run_id)
    (line,) = taken(lines)
    assert line.startswith(f"verdict: {diagnosis.verdict}, {diagnosis.lines} of ")
    assert diagnosis.sentence in line


def test_faults_come_and_go_and_their_figures_move(told):
    state, lines = told
    state.take(Said("recorder: disk", 1, "1.5 GB are free"))
    assert taken(lines) == ["warning: recorder: disk: 1.5 GB are free"]
    state.take(Said("recorder: disk", 1, "1.4 GB are free"))
    assert taken(lines) == []
    state.take(Said("recorder: disk", 2, "0.4 GB are free"))
    assert taken(lines) == [
        "fault: recorder: disk: 0.4 GB are free",
        "gone: warning: recorder: disk: 1.4 GB are free",
    ]
    state.take(Said("recorder: disk", 2, "the disk is full"))
    assert taken(lines) == ["fault: recorder: disk: the disk is full"]
    state.take(Said("recorder: disk", 2, "0.4 GB are free"))
    assert taken(lines) == ["fault: recorder: disk: 0.4 GB are free"]
    state.take(Said("recorder: disk", 0, "fine"))
    assert taken(lines) == ["gone: fault: recorder: disk: 0.4 GB are free"]


def test_a_start_is_told_once_and_is_no_fault(told):
    state, lines = told
    state.take(Said("laser: heartbeat", 2, "waiting for the clock", starting=True))
    assert taken(lines) == ["starting: laser: waiting for the clock"]
    state.take(Said("laser: beam", 3, "not in use", starting=True))
    state.take(Said("laser: heartbeat", 2, "inactive", starting=True))
    state.take(Said("laser: heartbeat", 0, "ready"))
    assert taken(lines) == []
    state.take(Said("laser: beam", 0, "there"))
    assert taken(lines) == ["ready: laser"]
    state.take(Said("laser: heartbeat", 2, "waiting for the clock", starting=True))
    taken(lines)
    state.take(Said("laser: heartbeat", 2, "waiting for the clock"))
    assert taken(lines) == ["fault: laser: waiting for the clock"], "it has stayed so"


def test_a_log_is_one_line_a_change_and_in_ascii_where_it_must_be():
    lines, state = [], PageState()
    state.listener = Journal(state, ASCII, lambda: NOW, lines.append).look
    state.take(Said("a: b", 2, "20 °C ± 1\nand \x1b[31mmore"))
    assert lines == ["2026-01-02T03:04:05+00:00 fault: a: b: 20 C +- 1 and  [31mmore"]


def test_nodes_that_end_with_their_run_are_told_once(told):
    state, lines = told
    state.take(STATUS._replace(state=RunState.FINISHED, run_id=""))
    taken(lines)
    silent = tuple(SilentNode(f"/{one}", one) for one in ("solver", "recorder"))
    for _ in range(2):
        state.take(Contact(True, frozenset(), silent, False, frozenset()))
    assert taken(lines) == ["the run is over, and its nodes have ended"]
