"""A small run as those hear of it who show it: what the nodes would publish, without nodes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from standard_runs import RUN_ID, START, write_messages

from stepdiag_ros import topics
from stepdiag_ros.configuration import load_cell, load_machine, plan_from_text
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.conversion import new_message
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.messages.volumetric import from_volumetric_errors
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.measurement import (
    BlockDisplacement,
    Environment,
    Measurement,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve_all
from stepdiag_ros.run.sequence import State as RunState
from stepdiag_ros.viewers.page.items import RunBegin, RunStatus

SECOND = 1_000_000_000
MACHINE = load_machine("demo")[1]
AIR = Environment(20.5, 101_325.0, 0.45, 20.1)
PLAN = """\
name: a small box
origin_m: [0.01, 0.02, 0.03]
step_m: [0.01, 0.02, 0.01]
blocks: 3
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x, y, z]}
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn]}
"""


def settled_stops(line, index, zero=0.0):
    """Return the stops of a measured line as messages tell them: without places of a tracker.

    Args:
        line: as it was measured.
        index: of the line in its plan.
        zero: of the instrument, m.
    """
    return [
        SettledStop(
            command=StopCommand(100 * index + k, index, 1, line.setup, k, "X", tuple(target), 0),
            line=replace(line.line, tracked=None),
            position=tuple(target),
            settled=True,
            reason="",
            time=k,
            displacement=float(line.displacement[k]) + zero,
            raw_displacement=float(line.displacement[k]) + zero,
            standard_uncertainty=5e-9,
            standard_deviation=2e-8,
            readings=20,
            first_sequence=0,
            last_sequence=19,
            in_position_time=0,
            window_start=0,
            window_end=0,
            environment=AIR,
        )
        for k, target in enumerate(line.target)
    ]


class SmallRun:
    """A simulated measurement, and the items that tell of it."""

    def __init__(self):
        self.plan = plan_from_text(PLAN, "test plan")
        simulated = simulate(self.plan, load_cell("demo")[0])
        self.measurement = Measurement(self.plan.volume, simulated.lines, "YXZ")
        self.results, _ = solve_all(self.measurement)
        self.begin = RunBegin(RUN_ID, 0, self.plan, "YXZ", simulated=True)

    def stops(self, index):
        """Return the settled stops of a line; the zero of the instrument is anywhere."""
        return settled_stops(self.measurement.lines[index], index, zero=0.123)

    def blocks(self, index):
        line = self.measurement.lines[index]
        beam = beam_direction(line.line.name, np.asarray(self.plan.volume.step))
        made = []
        for k in range(1, len(line.target)):
            way = line.target[k] - line.target[k - 1]
            made.append(
                BlockDisplacement(
                    line_index=index,
                    attempt=1,
                    line=line.line,
                    time=k,
                    block=line.line.block_of(k),
                    axis="XYZ"[int(np.argmax(np.abs(way)))],
                    from_stop=k - 1,
                    to_stop=k,
                    nominal_displacement=float(beam @ way),
                    displacement=float(line.displacement[k] - line.displacement[k - 1]),
                    standard_uncertainty=7e-9,
                )
            )
        return made

    def status(self, **fields):
        told = {
            "time": 0,
            "run_id": RUN_ID,
            "state": RunState.RUNNING,
            "line_index": 0,
            "line_count": len(self.plan.lines),
            "line": str(self.plan.lines[fields.get("line_index", 0)]),
            "setup": "x",
            "stop": 1,
            "stop_count": 4,
            "stops_done": 1,
            "stops_total": self.plan.stop_count,
            "remaining_time": math.nan,
            "text": "measuring",
        }
        return RunStatus(**(told | fields))

    def write(self, path):
        """Write the bag of the run."""
        return write_messages(path, _messages(self), PLAN, MACHINE, self.plan.name)


def _messages(run):
    """Yield (time, topic, message): a run of a minute, told as its nodes tell it."""
    now = START
    for index, line in enumerate(run.measurement.lines):
        yield now, topics.RUN_STATE, _state(now, RunState.RUNNING, index)
        for target in line.target:
            for _ in range(4):
                now += SECOND // 5
                reading = Reading(now, now // SECOND, 0.1, 0.1, 0.9, 0, AIR)
                yield now, topics.READING, conversion.from_reading(reading, "laser")
                joints = new_message(topics.JOINT_STATES.type_name)
                set_header(joints, now)
                joints.name, joints.position = ["X", "Y", "Z"], [float(one) for one in target]
                yield now, topics.JOINT_STATES, joints
        yield now, topics.LINE, conversion.from_measured_line(line, RUN_ID)
    for result in run.results.values():
        made = from_volumetric_errors(result, RUN_ID, now)
        yield now, topics.VOLUMETRIC_ERRORS, made
    now += SECOND
    yield now, topics.RUN_STATE, _state(now, RunState.FINISHED, index)


def _state(time, what, index):
    message = new_message(topics.RUN_STATE.type_name)
    set_header(message, time)
    message.run_id, message.state, message.line_index = RUN_ID, int(what), index
    return message


@pytest.fixture(scope="session")
def small_run():
    return SmallRun()
