"""Small deterministic bags for the tests."""

from pathlib import Path

from stepdiag_ros import topics
from stepdiag_ros.bags.header import Attachment, RunHeader
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.metrology.measurement import Environment, Reading

START = 1_700_000_000_000_000_000
PERIOD = 1_000_000
RUN_ID = "20260101-000000-abcd"
READING = "/interferometer/reading"
PLAN = """\
name: three lines
step_m: [0.01, 0.02, 0.03]
blocks: 2
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x, y, z]}
"""
MACHINE = "name: test machine\nchain: YXZ\n"


def header(**changes):
    values = {
        "run_id": RUN_ID,
        "plan_name": "three lines",
        "software_version": "0.1.0",
        "schema_version": 1,
        "middleware": "none",
        "start_time": START,
        "plan": PLAN,
        "machine": MACHINE,
        "parameters": "assembler: {}\n",
        "facts": {"site": "bench"},
        "further": (Attachment("note.txt", "text/plain", b"hello"),),
    }
    return RunHeader(**{**values, **changes})


def reading(number):
    wave = (number * 7919 % 1000) * 1e-9
    air = Environment(20.0 + wave, 101325.0, 0.5, 20.0)
    return Reading(START + number * PERIOD, number, wave, 2 * wave, 0.9, 0, air)


def reading_cdr(number):
    message = conversion.from_reading(reading(number), "laser", own_types().new)
    return own_types().encode(topics.READING.type_name, message)


def description(run_id=RUN_ID, plan=PLAN):
    message = own_types().new(topics.RUN_DESCRIPTION.type_name)
    set_header(message, START)
    message.schema_version = 1
    message.run_id, message.software_version = run_id, "0.1.0"
    message.plan, message.machine = plan, MACHINE
    return message


def put(bag, topic, message, time, namespace="/"):
    data = own_types().encode(topic.type_name, message)
    bag.write(topics.absolute(topic, namespace), topic.type_name, data, time, time)


def write_readings(path: Path, count: int, flush_every: int = 500, **options) -> Path:
    """Write a description and a number of readings, flushed as a recorder does it at each block."""
    with BagWriter(path, header(), **options) as bag:
        put(bag, topics.RUN_DESCRIPTION, description(), START)
        for number in range(count):
            time = START + number * PERIOD
            bag.write(
                READING, topics.READING.type_name, reading_cdr(number), time + 5, time, number
            )
            if number % flush_every == 0:
                bag.flush()
    return path
