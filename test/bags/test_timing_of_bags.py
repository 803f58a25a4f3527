"""How late readings are stamped, from a bag: every line counts that has a beam and enough moves."""

import json

import numpy as np
import pytest
from bags_for_tests import RUN_ID, START, description, header, put

from stepdiag_ros import schemas, topics
from stepdiag_ros.bags.info import bag_info
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.timing import timing_of
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.commands.info import _timing
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.measurement import Environment, Reading, SettledStop, StopCommand
from stepdiag_ros.metrology.plan import Line

NEW = own_types().new
PLAN = """\
name: an axis and a diagonal
step_m: [0.01, 0.01, 0.01]
blocks: 2
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x]}
  - {kind: step_diagonal, names: [ppp], orders: [XYZ]}
"""
LATE = 0.0123
LINES = (Line("linear", "x", "", 0, "forward"), Line("step_diagonal", "ppp", "XYZ", 0, "forward"))


def path_of(line, blocks):
    """X, Y, Z (m) at a time in s: 0.7 s at each stop, 0.3 s to the next; and the times of stops."""
    axes = "X" * blocks if line.kind == "linear" else "XYZ" * blocks
    corners = [np.zeros(3)]
    for axis in axes:
        corners.append(corners[-1] + 0.01 * (np.array(list("XYZ")) == axis))
    knots, places = [], []
    for number, corner in enumerate(corners):
        part = np.linspace(0.0, 1.0, 31)
        after = corners[min(number + 1, len(corners) - 1)]
        way = (part - np.sin(2 * np.pi * part) / (2 * np.pi))[:, None] * (after - corner)
        knots += [number, *(number + 0.7 + 0.3 * part)]
        places += [corner, *(corner + way)]
    knots, places = np.array(knots), np.array(places)

    def at(time):
        return np.array([np.interp(time, knots, places[:, axis]) for axis in range(3)])

    return at, len(corners)


def write(path, blocks=5, status_at=lambda time: 0):  # noqa: ARG005
    random = np.random.default_rng(5)
    step = np.full(3, 0.01)
    with BagWriter(path, header()) as bag:
        put(bag, topics.RUN_DESCRIPTION, description(plan=PLAN), START)
        sequence = 0
        for index, line in enumerate(LINES):
            begin = 60.0 * index
            at, stops = path_of(line, blocks)
            beam = beam_direction(line.name, step)
            for time in np.arange(-1.5, stops + 1.5, 0.004):
                stamp = START + round((begin + time) * 1e9)
                value = 0.2 + float(beam @ at(time - LATE)) + 1e-7 * random.standard_normal()
                status = status_at(begin + time)
                reading = Reading(stamp, sequence, value, value, 1.0, status, Environment())
                put(bag, topics.READING, conversion.from_reading(reading, "laser", NEW), stamp)
                sequence += 1
                if sequence % 5 == 0:
                    joints = NEW(topics.JOINT_STATES.type_name)
                    set_header(joints, stamp)
                    joints.name, joints.position = list("XYZ"), conversion.doubles(at(time))
                    put(bag, topics.JOINT_STATES, joints, stamp)
            for stop in range(stops):
                arrival = START + round((begin + stop) * 1e9)
                put(bag, topics.STOP, stop_message(line, index, stop, arrival), arrival)
    return path


def stop_message(line, index, stop, arrival):
    command = StopCommand(100 * index + stop, index, 1, line.setup, stop, "X", (0.0,) * 3, arrival)
    decided = SettledStop(
        command=command, line=line, position=(0.0,) * 3, settled=True, reason="", time=arrival,
        displacement=0.0, raw_displacement=0.0, standard_uncertainty=0.0, standard_deviation=0.0,
        readings=1, first_sequence=0, last_sequence=0, in_position_time=arrival,
        window_start=arrival, window_end=arrival + 600_000_000, environment=Environment(),
    )  # fmt: skip
    return conversion.from_settled_stop(decided, RUN_ID, NEW)


def test_every_line_of_a_bag_tells(tmp_path):
    path = write(tmp_path / "a.mcap")
    timing = timing_of(load_run(path))
    assert [line.moves for line in timing.lines] == [5, 15]
    for found in (*timing.lines, timing.offset):
        assert found.offset == pytest.approx(LATE, abs=2e-5)
    info = bag_info(path)
    assert info.timing == timing
    document = json.loads(schemas.json_text(schemas.document("info", info.document())))
    assert document["timing"]["offset"] == timing.offset.offset
    assert document["timing"]["drift"] is None
    words = _timing(info.timing, 0.1)
    assert words.startswith("readings are stamped 12")
    assert "windows begin 0.087" in words
    assert _timing(info.timing, 0.02).startswith("TOO LATE: ")


def test_a_line_without_a_beam_tells_nothing_and_the_other_does(tmp_path):
    path = write(tmp_path / "a.mcap", status_at=lambda time: 2 * (2.0 < time < 2.01))
    timing = timing_of(load_run(path))
    assert [line.moves for line in timing.lines] == [15]
    lost = write(tmp_path / "b.mcap", status_at=lambda time: 2 * (time % 60.0 < 2.0))
    assert timing_of(load_run(lost)).offset.reason == "the zero was lost on the way"


def test_lines_with_too_few_moves_tell_nothing(tmp_path):
    timing = timing_of(load_run(write(tmp_path / "a.mcap", blocks=2)))
    assert [line.moves for line in timing.lines] == [6]
    reason = timing_of(load_run(write(tmp_path / "b.mcap", blocks=0))).offset.reason
    assert reason == "the line has 0 moves; 3 are needed"
