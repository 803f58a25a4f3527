"""All kinds of lines on the fly in the simulated cell, without nodes."""

from dataclasses import replace

import numpy as np
from live_cell import MS, LiveCell

from stepdiag_ros.configuration import load_cell
from stepdiag_ros.metrology.plan import FORWARD, ON_THE_FLY, Plan

PLAN = Plan.from_mapping(
    {
        "step_m": [0.02, 0.015, 0.01],
        "blocks": 3,
        "feed_m_per_s": 0.06,
        "pause_for_setup": False,
        "directions": ["forward", "backward"],
        "measurement": ON_THE_FLY,
        "sampling": {"dwell_s": 0.3, "window_s": 0.2},
        "lines": [
            {"kind": "linear", "names": ["y"]},
            {"kind": "step_diagonal", "names": ["npp"], "orders": ["YZX"]},
            {"kind": "diagonal", "names": ["ppp"]},
        ],
    },
    "test plan",
)


def run_of(plan, position_rate):
    cell = load_cell("moving")[0]
    live = LiveCell(plan, cell, 4 * MS, rate=1000.0, position_rate=position_rate)
    return cell, live, live.measure()


def test_every_kind_of_line_is_measured_on_the_fly():
    cell, live, lines = run_of(PLAN, 500.0)
    assert all(line.complete for line in lines.lines) and len(lines.lines) == 6
    assert {line.attempt for line in lines.lines} == {1}
    for line in lines.lines:
        start = replace(line.line, direction=FORWARD).stops(PLAN.volume)[0]
        alignment = cell.alignment(line.setup, line.line.name, PLAN.volume.step, start)
        error = line.displacement - cell.displacement(line.target, alignment)
        # What the sensors do not know of the air is beside the readings.
        assert np.max(np.abs(error - error[0])) < 60e-9
        assert np.max(line.standard_uncertainty) < 20e-9
    stays = [stop.command.stop for stop in live.stops]
    assert stays == [stop for line in lines.lines for stop in range(len(line.displacement))]


def test_a_controller_with_few_positions_is_measured_with_stops():
    plan = replace(PLAN, lines=PLAN.lines[:2])
    _, live, lines = run_of(plan, 50.0)
    assert [line.attempt for line in lines.lines] == [2, 1]
    assert all(line.complete for line in lines.lines)
    by_stop = [stop for stop in live.stops if stop.command.attempt == 2]
    gaps = np.diff([stop.in_position_time for stop in by_stop])
    assert np.min(gaps) > 0.3e9
