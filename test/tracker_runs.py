"""Runs of a simulated machine with a tracker, as data and as small bags."""

from functools import cache
from itertools import groupby

import numpy as np
from standard_runs import RUN_ID, START

from stepdiag_ros.bags.imports.writing import ToWrite, write_bag
from stepdiag_ros.configuration import find, load_cell
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.campaign import grid_readings, simulate_readings
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.measured_lines import plan_of
from stepdiag_ros.metrology.tracker.seven_lines import make_test
from stepdiag_ros.planning.plan_text import plan_text

BOX = Box(np.zeros(3), np.array([0.12, 0.12, 0.12]))
TRACKER = Tracker(minimum_range=0.1)
BESIDE = (-0.15, 0.15, -0.15)
STATIONS = (
    (-0.2, -0.2, -0.1),
    (0.3, -0.2, -0.15),
    (0.05, 0.35, -0.1),
    (0.05, -0.3, 0.35),
)
"""Four places from which a grid is multilaterated."""


@cache
def tracker_run(stations=(BESIDE,), targets=5, runs=2, nodes=0):
    """Return plan and lines of a run on the demo machine; of a grid if ``nodes`` is given."""
    places = [np.array(station) for station in stations]
    if nodes:
        planned = grid_readings(BOX, places, TRACKER, nodes)
    else:
        planned = [
            reading
            for number, place in enumerate(places, start=1)
            for reading in make_test(
                BOX, place, TRACKER, targets=targets, runs=runs, locating=8
            ).readings(str(number))
        ]
    named = {str(number): place for number, place in enumerate(places, start=1)}
    plan = plan_of(planned, named, TRACKER, BOX, name="with a tracker", feed=0.05)
    read = simulate_readings(planned, places, TRACKER, load_cell("demo")[0], seed=3)
    lines = []
    passes = groupby(read, key=lambda one: (one.station, one.line, one.run, one.direction))
    for index, (_, group) in enumerate(passes):
        taken = list(group)
        count, line = len(taken), plan.lines[index]
        time = 60.0 * index + np.arange(count)
        lines.append(
            MeasuredLine(
                line=line,
                line_index=index,
                attempt=1,
                setup=line.setup,
                time=time,
                end_time=START + int(time[-1] * 1e9),
                target=line.stops(plan.volume),
                displacement=np.array([one.change for one in taken]),
                standard_uncertainty=np.full(count, 20e-9),
                environment=np.full((count, 4), np.nan),
            )
        )
    return plan, tuple(lines)


def write_tracker_run(path, plan, lines, further=()):
    """Write the lines of a run with a tracker into a bag."""
    machine = find("demo", "machines").read_text()
    content = ToWrite(
        run_id=RUN_ID,
        plan_name=plan.name,
        middleware="none",
        plan=plan_text(plan),
        machine=machine,
        lines=tuple(lines),
        further=tuple(further),
        start_time=START,
    )
    write_bag(path, content)
    return path
