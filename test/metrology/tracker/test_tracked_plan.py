"""A tracker's test as a plan: its file, its ways, a whole run, and what a lost zero leaves."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from refused import refused

from stepdiag_ros.configuration import load_cell, load_tracker, plan_from_text
from stepdiag_ros.devices.cnc import Traits
from stepdiag_ros.metrology.measurement import latest_attempts
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.result import NotDeterminable
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.campaign import grid_readings, true_values
from stepdiag_ros.metrology.tracker.measured_lines import plan_of, readings_of
from stepdiag_ros.metrology.tracker.run_result import (
    evaluate_station,
    solve_station,
    station_runs,
    verdict_on_run,
)
from stepdiag_ros.metrology.tracker.seven_lines import make_test
from stepdiag_ros.planning.plan_text import plan_text
from stepdiag_ros.run.permission import CommandedMove, MotionPermission

sys.path.insert(0, str(Path(__file__).parents[2] / "devices"))

from live_cell import MACHINE, LiveCell

STATION = np.array([-0.15, 0.15, -0.15])
BOX = Box(np.zeros(3), np.full(3, 0.12))
TRACKER = load_tracker("demo")[0]


def seven_lines(targets=5, runs=1, stations=(STATION,), overrun=2e-3):
    readings = []
    for number, station in enumerate(stations, start=1):
        test = make_test(
            BOX, station, TRACKER, targets=targets, runs=runs, locating=8, overrun=overrun
        )
        readings += test.readings(str(number))
    places = {str(number): station for number, station in enumerate(stations, start=1)}
    return plan_of(readings, places, TRACKER, BOX, name="Seven lines", feed=0.2, overrun=overrun)


@pytest.fixture(scope="module")
def plan():
    return seven_lines()


def changed(plan, change):
    """Return the plan read from its file, changed as a person may change it."""
    mapping = yaml.safe_load(plan_text(plan))
    change(mapping)
    return plan_from_text(yaml.safe_dump(mapping), "plan.yaml")


def test_the_file_of_a_plan_is_read_as_the_same_plan(plan):
    again = plan_from_text(plan_text(plan), "plan.yaml")
    assert again == plan
    assert [line.tracked for line in again.lines] == [line.tracked for line in plan.lines]
    assert plan_text(again) == plan_text(plan)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda m: m.pop("tracker"), "tracker"),
        (lambda m: m["lines"].append({"kind": "linear", "names": ["x"]}), "tracker"),
        (lambda m: m["lines"].append(m["lines"][-1]), "twice"),
        (lambda m: m["lines"][0].update(station_m=[0.0, 0.0, -1.0]), "station_m"),
        (lambda m: m["lines"][0].update(station="a:b"), "station"),
        (lambda m: m["lines"][0].update(overrun_m=0.001), "overrun_m"),
        (
            lambda m: (
                m["lines"][1]["targets_m"].reverse()
                or m["lines"][1]["targets_m"].append([0.0, 0.0, 0.0])
            ),
            "targets_m",
        ),
        (lambda m: m["lines"][1].update(targets_m=[[0.0, 0.0]]), "targets_m"),
        (lambda m: m["lines"][1].update(targets_m="x"), "targets_m"),
        (lambda m: m["lines"][1].update(names=["w"]), "names"),
        (lambda m: m["tracker"].update(minimum_range_m=99.0), "minimum_range_m"),
    ],
)
def test_a_wrong_plan_is_refused_with_its_key(plan, change, named):
    with refused(Refusal, None, "plan.yaml") as caught:
        changed(plan, change)
    assert named in str(caught.value)


def test_a_plan_without_tracker_lines_has_no_tracker():
    text = "step_m: [0.1, 0.1, 0.1]\nblocks: 1\nfeed_m_per_s: 0.1\ntracker: {}\nlines:\n"
    with refused(Refusal, "mismatch", aspect="tracker"):
        plan_from_text(text + "  - {kind: linear, names: [x]}\n", "plan.yaml")


class Watched(LiveCell):
    """A run whose every command is put to the bridge's check and to the tracker's sight."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        limits = tuple([np.nan] * 3), tuple([np.nan] * 3)
        traits = Traits((np.nan,) * 3, (np.nan,) * 3, (np.nan,) * 3, 0.1, True)
        self.permission = MotionPermission(self.plan, MACHINE, limits, traits)
        self.refusals, self.unseen = [], []

    def _send(self, command):
        at_stop = command.purpose == 0
        move = CommandedMove(
            *(command.line_index, at_stop, command.stop, command.axis),
            *(self.position, command.target, command.feed),
        )
        self.refusals.append(self.permission.refusal(move))
        station = np.array(self.plan.lines[command.line_index].tracked.station)
        start, end = np.array(self.position), np.array(command.target)
        self.unseen.append(self.plan.tracker.unseen_on_the_way(start, end, station))
        if not at_stop:
            assert len(command.axis) <= 1
        super()._send(command)


@pytest.fixture(scope="module")
def run():
    live = Watched(seven_lines(targets=6, runs=2), load_cell("demo")[0])
    live.measure()
    return live


def test_every_move_of_a_run_is_allowed_and_in_sight(run):
    assert len(run.refusals) > 150
    assert not any(run.refusals)
    assert not any(run.unseen)
    assert all(stop.settled for stop in run.stops)


def test_a_run_tells_the_errors_of_its_machine(run):
    """All six within their uncertainty, the tracker where it really stands."""
    cell = load_cell("demo")[0]
    lines = latest_attempts(tuple(run.lines))
    (station,) = station_runs(run.plan, lines)
    joint = evaluate_station(station, run.plan, cell.chain).joint
    away = joint.values - true_values(cell, joint.machine.box)
    assert np.all(np.abs(away) < 2.5 * joint.standard_uncertainty)
    place = joint.position - cell.station("station 1", STATION)
    assert np.all(np.abs(place) < 3.0 * np.sqrt(np.diag(joint.place_covariance)[:3]) + 20e-6)
    assert verdict_on_run(run.plan, lines, cell.chain)[0] == "CONSISTENT"


def test_a_run_is_solved_when_its_last_line_is_there(run):
    lines = latest_attempts(tuple(run.lines))
    result, tests = solve_station(lines[-1], lines, run.plan, "YXZ")
    assert {figure.name for figure in result.figures} >= {"C0Y", "B0Z", "A0Z", "positioning E_XX"}
    assert {test.name for test in tests} >= {"X", "xyz"}
    with refused(NotDeterminable, "too_few", "1"):
        solve_station(lines[-2], lines[:-1], run.plan, "YXZ")
    assert verdict_on_run(run.plan, lines[:-1], "YXZ")[0] == "NOT TESTABLE"


def test_nominal_displacements_are_changes_of_the_length(run):
    lines = latest_attempts(tuple(run.lines))
    for line in lines[:3]:
        length = np.linalg.norm(line.target - STATION, axis=1)
        known = length - length[0]
        # A tracker stands up to some millimetres beside its planned place.
        assert line.displacement - line.displacement[0] == pytest.approx(known, abs=2e-3)


def test_what_follows_a_lost_zero_is_left_out_and_said(run):
    lines = latest_attempts(tuple(run.lines))
    cut = 9
    shifted = [
        replace(line, setup=f"{line.setup} #2", displacement=line.displacement - 0.05)
        if number >= cut
        else line
        for number, line in enumerate(lines)
    ]
    (station,) = station_runs(run.plan, shifted)
    assert len(station.readings) == sum(len(line.target) for line in lines[:cut])
    (remark,) = station.remarks
    assert "1 #2" in remark
    holed = replace(
        lines[3], displacement=np.where(np.arange(6) == 2, np.nan, lines[3].displacement)
    )
    (station,) = station_runs(run.plan, [*lines[:3], holed, *lines[4:]])
    assert len(station.readings) == sum(len(line.target) for line in lines) - 6
    assert str(lines[3].line) in station.remarks[0]


def test_two_stations_have_zeros_of_their_own():
    plan = seven_lines(stations=(STATION, np.array([0.3, -0.2, -0.15])))
    assert {plan.setup_of(line) for line in plan.lines} == {"station 1", "station 2"}
    live = LiveCell(plan, load_cell("demo")[0])
    live.measure()
    runs = station_runs(plan, latest_attempts(tuple(live.lines)))
    assert [one.station for one in runs] == ["1", "2"]
    assert all(len({reading.station for reading in one.readings}) == 1 for one in runs)


def test_a_beam_break_costs_no_more_than_its_line():
    plan = replace(seven_lines(), lines=seven_lines().lines[:4])
    live = LiveCell(plan, load_cell("demo")[0])

    def break_once(stop):
        if stop.command.line_index == 2 and stop.command.attempt == 1 and stop.command.stop == 2:
            live.laser.inject_beam_break(live.now, live.now + 100_000_000)

    live.watchers.append(break_once)
    live.measure()
    lines = latest_attempts(tuple(live.lines))
    assert [line.attempt for line in lines] == [1, 1, 2, 1]
    assert [line.setup for line in lines][2:] == ["station 1 #2", "station 1 #2"]
    assert all(line.complete for line in lines)
    assert {one.station for one in readings_of(plan, lines)} == {"1", "1 #2"}


def test_a_grid_from_four_stations_becomes_error_curves():
    stations = [
        np.array(place)
        for place in ([-0.2, -0.2, 0.02], [0.35, -0.2, 0.05], [0.05, 0.4, 0.0], [0.05, 0.05, -0.3])
    ]
    readings = grid_readings(BOX, stations, TRACKER, 3)
    places = {str(number): place for number, place in enumerate(stations, start=1)}
    plan = plan_of(readings, places, TRACKER, BOX, name="grid", feed=0.3)
    cell = load_cell("demo")[0]
    live = LiveCell(plan, cell)
    live.measure()
    lines = latest_attempts(tuple(live.lines))
    result, _ = solve_station(lines[-1], lines, plan, cell.chain)
    truth = cell.truth(replace(plan.volume, step=(0.06, 0.06, 0.06), blocks=2))
    for name in ("E_XX", "E_YY", "E_ZZ"):
        spread = np.maximum(result.standard_uncertainty[name], 0.3e-6)
        assert np.all(np.abs(result.curves[name] - truth[name]) < 4.0 * spread)


def test_a_cell_with_effects_cannot_be_measured_with_a_tracker(plan):
    cell = load_cell("hidden_backlash")[0]
    assert cell.effects
    with refused(Refusal, "unsupported"):
        LiveCell(plan, cell).measure()


def test_a_tracker_is_put_up_where_nobody_can_put_it_exactly():
    cell = load_cell("demo")[0]
    place = cell.station("station 1", STATION)
    assert np.array_equal(place, cell.station("station 1 #3", STATION))
    assert 1e-5 < np.max(np.abs(place - STATION)) < 5e-3
    assert not np.array_equal(place, cell.station("station 2", STATION))
