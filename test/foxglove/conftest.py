"""A server on a free port that offers what a node offers, and a bag of a small run."""

from functools import partial

import pytest
import standard_runs

from stepdiag_ros import __version__, conversion, topics
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.configuration import load_machine
from stepdiag_ros.conversion import new_message
from stepdiag_ros.foxglove_live.server import FoxgloveServer, Place
from stepdiag_ros.metrology.measurement import Environment, Measurement, Reading
from stepdiag_ros.metrology.solvers import solve_all
from stepdiag_ros.run.sequence import State

SHOWN = (topics.RUN_DESCRIPTION, topics.READING, topics.LINE, topics.FIXED_FRAMES, topics.STOP)


class Served:
    """A server, and what was sent on it."""

    def __init__(self):
        self.told, self.count = [], 0
        self.server = FoxgloveServer("test", Place(port=0), self.told.append)
        types = own_types()
        for topic in SHOWN:
            kind = topic.type_name
            decode = partial(types.decode, kind)
            name = topics.absolute(topic)
            self.server.offer(name, kind, types.schema(kind), decode, topic)
        self.server.start()

    @property
    def port(self):
        return int(self.server.url.rpartition(":")[2])

    def send(self, topic, **fields):
        """Send a message; return its time and its bytes."""
        message = new_message(topic.type_name)
        for name, value in fields.items():
            setattr(message, name, value)
        data = own_types().encode(topic.type_name, message)
        self.count += 1
        self.server.send(topics.absolute(topic), data, self.count)
        return self.count, data


@pytest.fixture
def served():
    made = Served()
    yield made
    made.server.close()


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
SECOND = 1_000_000_000
RUN_ID = "20260102T030405-abcd"


def messages_of_a_run():
    """Yield (time, topic, message): a run of a minute, told as its nodes tell it."""
    plan, measurement = standard_runs.measured(PLAN)
    machine_text = load_machine("demo")[1]
    start = standard_runs.START
    description = new_message(topics.RUN_DESCRIPTION.type_name)
    conversion.set_header(description, start)
    description.schema_version, description.run_id = 1, RUN_ID
    description.software_version = __version__
    description.plan, description.machine = PLAN, machine_text
    yield start, topics.RUN_DESCRIPTION, description
    now, lines = start, []
    for index, line in enumerate(measurement.lines):
        yield now, topics.RUN_STATE, state(now, State.RUNNING, index)
        for target in line.target:
            for _ in range(4):
                now += SECOND // 5
                air = Environment(20.0, 101_325.0, 0.5, 20.0)
                reading = Reading(now, now // SECOND, 0.1, 0.1, 0.9, 0, air)
                yield now, topics.READING, conversion.from_reading(reading, "laser")
                joints = new_message(topics.JOINT_STATES.type_name)
                conversion.set_header(joints, now)
                joints.name, joints.position = ["X", "Y", "Z"], [float(one) for one in target]
                yield now, topics.JOINT_STATES, joints
        lines.append(line)
        yield now, topics.LINE, conversion.from_measured_line(line, RUN_ID)
    results, _ = solve_all(Measurement(plan.volume, tuple(lines), "YXZ"))
    for result in results.values():
        made = conversion.from_volumetric_errors(result, RUN_ID, now)
        yield now, topics.VOLUMETRIC_ERRORS, made
    now += SECOND
    yield now, topics.RUN_STATE, state(now, State.FINISHED, len(lines) - 1)


def state(time, what, index):
    message = new_message(topics.RUN_STATE.type_name)
    conversion.set_header(message, time)
    message.run_id, message.state, message.line_index = RUN_ID, int(what), index
    return message


@pytest.fixture(scope="package")
def bag(tmp_path_factory):
    """A bag of that run."""
    path = tmp_path_factory.mktemp("bag") / "run.mcap"
    machine_text = load_machine("demo")[1]
    header = RunHeader(
        RUN_ID, "a small box", __version__, 1, "none", standard_runs.START, PLAN, machine_text, ""
    )
    with BagWriter(path, header) as writer:
        for time, topic, message in messages_of_a_run():
            data = own_types().encode(topic.type_name, message)
            writer.write(topics.absolute(topic), topic.type_name, data, time)
    return path
