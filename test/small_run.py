"""A small run that is whole: every stream that the evaluation reads, a few hundred messages.

It is simulated at its stops and takes no node; every number follows from the seed in the cell.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
from standard_runs import cell

from stepdiag_ros import __version__, topics
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.configuration import load_machine, plan_from_text
from stepdiag_ros.evaluation.build import build_report
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header, set_stamp
from stepdiag_ros.messages.volumetric import from_volumetric_errors
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.measurement import (
    Arrival,
    BlockDisplacement,
    Environment,
    MeasuredLine,
    Measurement,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.plan import moved_axes
from stepdiag_ros.metrology.simulation import simulate

RUN_ID = "20260203T040506Z-abcdef"
START = 1_700_000_000_000_000_000
PLAN = """\
name: small
step_m: [0.03, 0.02, 0.025]
blocks: 2
feed_m_per_s: 0.05
sampling: {dwell_s: 0.4, settle_s: 0.05, window_s: 0.2, longest_wait_s: 0.5}
lines:
  - {kind: linear, names: [x, y, z]}
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}
"""
_PERIOD = 25_000_000
_MOVE, _STAY = 100_000_000, 300_000_000
_AIR = Environment(20.0, 101_325.0, 0.5, 20.5)
_RUNNING, _FINISHED = 1, 4
_NEW = own_types().new


def write_small_run(path: Path) -> Path:
    """Write the bag; its chunks are small, so that there are many to be doubled and dropped."""
    machine = load_machine("demo")[1]
    header = RunHeader(
        RUN_ID, "small", __version__, 1, "none", START, PLAN, machine, parameters="assembler: {}\n"
    )
    with BagWriter(path, header, chunk_size=12_000) as bag:
        for time, topic, data in small_stream():
            bag.write(topics.absolute(topic), topic.type_name, data, time, time)
    return path


@lru_cache
def small_stream():
    """Return what is published in the run, in order: time (ns), topic, CDR bytes."""
    made = sorted(_messages(load_machine("demo")[1]), key=lambda one: one[0])
    return [
        (time, topic, own_types().encode(topic.type_name, message)) for time, topic, message in made
    ]


def _messages(machine):
    plan = plan_from_text(PLAN, "small plan")
    commands, arrivals, readings = _streams(plan)
    yield START, topics.RUN_DESCRIPTION, _description(machine)
    for command in commands:
        message = conversion.from_stop_command(command, RUN_ID, command.time, 0.05, new=_NEW)
        yield command.time, topics.MACHINE_COMMAND, message
    for arrival in arrivals:
        for status in (0, 1, conversion.STATUS_IN_POSITION):
            time = arrival.time - (conversion.STATUS_IN_POSITION - status) * 10_000_000
            message = conversion.from_command_status(
                arrival.command_id, RUN_ID, time, status, arrival.position, arrival.position,
                new=_NEW,
            )  # fmt: skip
            yield time, topics.COMMAND_STATUS, message
    for reading in readings:
        message = conversion.from_reading(reading, "laser", _NEW)
        yield reading.time, topics.READING, message
    events = assemble(plan, START, commands, arrivals, readings)
    lines = tuple(event for event in events if isinstance(event, MeasuredLine))
    for event in events:
        yield _derived(event)
    end = readings[-1].time + _PERIOD
    for result in build_report(Measurement(plan.volume, lines, "YXZ")).results:
        message = from_volumetric_errors(result, RUN_ID, end, _NEW)
        yield end, topics.VOLUMETRIC_ERRORS, message
    for line in lines:
        yield line.end_time + 2, topics.RUN_STATE, _state(line.end_time + 2, _RUNNING, line)
    yield end + 1, topics.RUN_STATE, _state(end + 1, _FINISHED, lines[-1])
    yield end + 2, topics.DIAGNOSTICS, _diagnostics(end + 2)


def _streams(plan):
    """Return commands, arrivals and readings of a run in which every stop is at rest."""
    random = np.random.default_rng(11)
    measured = simulate(plan, cell(noise=7e-9), seed=4)
    commands, arrivals, readings, now = [], [], [], START + _PERIOD
    for line in measured.lines:
        for stop, target in enumerate(line.target):
            before = line.target[max(stop - 1, 0)]
            place = tuple(float(value) for value in target)
            number = len(commands) + 1
            commands.append(
                StopCommand(
                    *(number, line.line_index, 1, line.setup, stop),
                    *(moved_axes(before, target), place, now),
                )
            )
            arrivals.append(Arrival(number, now + _MOVE, place))
            value = 0.1 + line.displacement[stop]
            for time in range(now, now + _MOVE + _STAY, _PERIOD):
                noisy = value + 2e-8 * float(random.standard_normal())
                readings.append(
                    Reading(time, len(readings) + 1, 1.00027 * noisy, noisy, 0.9, 0, _AIR)
                )
            now += _MOVE + _STAY
    return commands, arrivals, readings


def _derived(event):
    if isinstance(event, SettledStop):
        message = conversion.from_settled_stop(event, RUN_ID, _NEW)
        return event.window_end + 1, topics.STOP, message
    if isinstance(event, BlockDisplacement):
        return event.time + 200_000_001, topics.BLOCK, conversion.from_block(event, RUN_ID, _NEW)
    message = conversion.from_measured_line(event, RUN_ID, _NEW)
    return event.end_time + 200_000_002, topics.LINE, message


def _description(machine):
    message = _NEW(topics.RUN_DESCRIPTION.type_name)
    set_header(message, START)
    message.schema_version, message.run_id = 1, RUN_ID
    message.software_version, message.plan, message.machine = __version__, PLAN, machine
    return message


def _state(time, state, line):
    message = _NEW(topics.RUN_STATE.type_name)
    set_header(message, time)
    message.run_id, message.state, message.line_index = RUN_ID, state, line.line_index
    message.text = "all lines are measured" if state == _FINISHED else "measuring"
    return message


def _diagnostics(time):
    message = _NEW(topics.DIAGNOSTICS.type_name)
    set_stamp(message.header.stamp, time)
    status = _NEW("diagnostic_msgs/msg/DiagnosticStatus")
    status.name, status.message = "assembler", "ok"
    message.status = [status]
    return message
