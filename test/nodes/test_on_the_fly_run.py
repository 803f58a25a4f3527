"""Two lines on the fly on the node graph: delay and vibration present, replayed bit for bit."""

import json
from dataclasses import replace

import numpy as np
from cells_for_tests import ON_THE_FLY

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.configuration import load_cell
from stepdiag_ros.evaluation.flown import flown_run
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.run.sequence import State


def test_lines_on_the_fly(make_cell, tmp_path):
    plan = tmp_path / "plan.yaml"
    plan.write_text(ON_THE_FLY)
    with make_cell(plan=str(plan), cell="moving", factor=2.0, tick=0.004) as cell:
        cell.start()
        cell.wait_for_state(State.FINISHED)
        cell.wait(cell.bag_is_closed, "the bag is closed")
        (bag,) = cell.folder.glob("*.mcap")
    run = load_run(bag)
    assert [line.complete for line in run.lines] == [True] * 3
    truth = simulate(run.plan, replace(load_cell("moving")[0], reading_noise=0.0))
    for line, true in zip(run.lines, truth.lines, strict=True):
        error = line.displacement - true.displacement
        # What the air adds is beside the readings; what a delay would add is far more.
        assert np.max(np.abs(error - error[0])) < 60e-9
        assert np.max(line.standard_uncertainty) < 20e-9
    flown = flown_run(run)
    assert [line.found.reasons for line in flown.lines] == [("",) * 4, ("",) * 10, ("",) * 10]
    assert all(abs(one.delay) < 4.0 * one.standard_uncertainty < 40e-6 for one in flown.delays)
    assert all(abs(one.delay) < 4.0 * one.standard_uncertainty for one in flown.reversals)
    assert [one.axis for one in flown.reversals] == ["X", "Y", "Z"]
    assert abs(flown.vibration.frequency - 40.0) < 0.5
    assert [line.moved for line in run.lines] == [line.found.moved for line in flown.lines]
    assert main(["report", str(bag), "--json", "-o", str(tmp_path / "report")]) == 0
    report = json.loads((tmp_path / "report/report.json").read_text(encoding="utf-8"))
    described = report["sections"]["measurement"]["on_the_fly"]
    assert described["passes"] == 3 and set(described["delays"]) == {"X", "Y", "Z"}
    assert {axis: said["delay"] for axis, said in described["delays"].items()} == {
        one.axis: one.delay for one in flown.delays
    }
    assert described["vibration"]["frequency"] == flown.vibration.frequency
    moving = [stop for stop in run.stops if 0 < stop.command.stop < 9]
    times = np.array([stop.in_position_time for stop in run.stops])
    assert np.median(np.diff(times)) < 0.7e9 and len(moving) > 10
    again = assemble(
        run.plan, run.start_time, run.commands, run.arrivals, run.readings(), run.positions()
    )
    lines = [event for event in again if isinstance(event, MeasuredLine)]
    assert [a.displacement.tolist() for a in lines] == [b.displacement.tolist() for b in run.lines]
