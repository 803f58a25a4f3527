"""What the live page says of a run with a tracker, and the terminal with it."""

from dataclasses import replace

import numpy as np
import pytest
from shown_run import settled_stops
from tracker_runs import BESIDE, STATIONS, tracker_run

from stepdiag_ros.metrology.measurement import (
    BlockDisplacement,
    Environment,
)
from stepdiag_ros.metrology.tracker.run_result import solve_station
from stepdiag_ros.run.sequence import State as RunState
from stepdiag_ros.viewers.page.items import RunBegin, RunStatus
from stepdiag_ros.viewers.page.state import PageState
from stepdiag_ros.viewers.terminal.glyphs import UNICODE
from stepdiag_ros.viewers.terminal.sections import curve_lines, run_lines, stop_lines

RUN_ID = "20260102T030405-abcd"
AIR = Environment(20.0, 101_325.0, 0.5, 20.0)


def bare(line):
    """Return a line as messages tell it: without its places."""
    return replace(line, tracked=None)


def blocks_of(lines, index):
    line = lines[index]
    for k in range(1, len(line.target)):
        change = float(line.displacement[k] - line.displacement[k - 1])
        yield BlockDisplacement(
            index, 1, bare(line.line), k, k, "XYZ", k - 1, k, change + 1e-3, change, 7e-9
        )


def status(plan, **fields):
    told = {
        "time": 0,
        "run_id": RUN_ID,
        "state": RunState.RUNNING,
        "line_index": 2,
        "line_count": len(plan.lines),
        "line": str(plan.lines[2]),
        "setup": "station 1",
        "stop": 3,
        "stop_count": 5,
        "stops_done": 16,
        "stops_total": plan.stop_count,
        "remaining_time": 60.0,
        "text": "measuring",
    }
    return RunStatus(**(told | fields))


@pytest.fixture
def state():
    made = PageState()
    made.take(RunBegin(RUN_ID, 0, tracker_run()[0], "YXZ", simulated=True))
    return made


def test_the_volume_has_the_lines_and_where_the_tracker_stands(state):
    told = state.document("volume")
    assert told["stations"] == [{"name": "1", "at": [1e3 * value for value in BESIDE]}]
    assert {one["name"]: one["places"] for one in told["courses"]} == {
        "1:locate": True,
        **dict.fromkeys(("1:x", "1:z", "1:xy", "1:xz", "1:yz", "1:xyz"), False),
    }
    places = next(one for one in told["courses"] if one["places"])
    assert len(places["path"]) == 8
    four = PageState()
    plan = tracker_run(stations=STATIONS, nodes=4)[0]
    four.take(RunBegin(RUN_ID, 0, plan, "YXZ", simulated=True))
    assert len(four.document("volume")["stations"]) == 4


def test_where_the_run_is_has_stops_and_no_block_of_a_box(state):
    plan, _ = tracker_run()
    state.take(status(plan))
    told = state.document("run")
    assert (told["line"], told["stop"], told["block_count"]) == (str(plan.lines[2]), 3, 0)
    first, *_ = run_lines(told, state.document("progress"), UNICODE)[1:]
    assert "stop 3 (0 to 4)" in first.plain and "block" not in first.plain
    assert state.document("progress")["block"] is not None
    # Between places that do not follow each other there is no move along a line.
    state.take(status(plan, line_index=0, stop=3))
    assert state.document("progress")["block"] is None
    state.take(status(plan, state=RunState.WAITING_FOR_SETUP))
    assert "tracker" in state.document("run")["words"]
    assert "mirror" not in state.document("run")["words"]


def test_a_stop_tells_the_length_change_and_not_how_far_it_is_off(state):
    plan, lines = tracker_run()
    for index in (0, 1):
        for stop in settled_stops(lines[index], index):
            state.take(stop, RUN_ID)
    last = state.document("stop")["last"]
    assert last["line"] == str(plan.lines[1])
    assert last["zero_known"] is True
    first = lines[0].displacement[0]
    assert last["displacement_m"] == pytest.approx(lines[1].displacement[-1] - first, abs=1e-12)
    way = [
        np.linalg.norm(np.array(target) - BESIDE)
        for target in (lines[0].target[0], lines[1].target[-1])
    ]
    assert float(last["nominal"].split()[0]) == pytest.approx(1e3 * (way[1] - way[0]), abs=1e-5)
    assert last["from_nominal"] == last["from_expected"] == "unknown"
    assert "tracker" in last["note"]
    shown = [line.plain for line in stop_lines(state.document("stop"), 60)]
    assert last["note"] in shown
    assert not any("perfect" in line for line in shown)


def test_blocks_of_another_line_of_the_station_are_no_pass_before(state):
    _, lines = tracker_run()
    for block in blocks_of(lines, 1):
        state.take(block, RUN_ID)
    told = state.document("blocks")
    assert [place for place, *_ in told["blocks"]] == [0.5, 1.5, 2.5, 3.5]
    assert all(deviation is None for _, _, deviation, _ in told["blocks"])
    assert told["last"]["deviation"] == "unknown"
    for block in blocks_of(lines, 2):
        state.take(block, RUN_ID)
    told = state.document("blocks")
    # Backward, counted forward.
    assert [place for place, *_ in told["blocks"]] == [3.5, 2.5, 1.5, 0.5]
    assert len(told["before"]) == 4
    other = next(k for k, line in enumerate(lines) if line.line.name == "1:z")
    for block in blocks_of(lines, other):
        state.take(block, RUN_ID)
    assert state.document("blocks")["before"] == []


def test_the_result_tells_squareness_and_positioning_and_no_curves(state):
    plan, lines = tracker_run()
    result, _ = solve_station(lines[-1], lines, plan, "YXZ")
    state.take(result, RUN_ID)
    told = state.document("curves")
    assert told["curves"] == [] and told["method"] and told["lines"] == len(lines)
    (row,) = curve_lines(told, 60, UNICODE)
    assert "no result" not in row.plain
    figures = {one.name: one for one in result.figures}
    shown = {one["name"]: one for one in state.document("squareness")["figures"]}
    assert list(shown) == ["C0Y", "B0Z", "A0Z", "E_XX", "E_YY", "E_ZZ"]
    assert shown["C0Y"]["value"] == pytest.approx(figures["C0Y"].value * 1e6, rel=1e-5)
    assert shown["C0Y"]["text"].endswith("µm/m")
    positioning = figures["positioning E_ZZ"]
    assert shown["E_ZZ"]["value"] == pytest.approx(positioning.value * 1e6, rel=1e-5)
    assert shown["E_ZZ"]["text"].endswith(" µm")
