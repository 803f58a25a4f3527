"""Bags of simulated lines, without nodes: for the tests of what is made from finished lines."""

from cells_for_tests import make_cell

from stepdiag_ros import __version__, topics
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.configuration import load_machine, plan_from_text
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.messages.positioning import from_positioning_test
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.standards.axis_test import completed_by
from stepdiag_ros.metrology.standards.iso230_2 import evaluate

RUN_ID = "20260102T030405-abcd"
START = 1_000_000_000

PLAN = """\
name: diagonals
step_m: [0.03, 0.02, 0.025]
blocks: 5
repeats: 5
directions: [forward, backward]
overrun_m: 0.002
feed_m_per_s: 0.05
lines:
  - {kind: diagonal, names: [ppp, npp, pnp, ppn, pp0, np0]}
  - {kind: linear, names: [x, y, z]}
"""


def cell(**options):
    given = {"high": (0.15, 0.10, 0.125), "noise": 0.05e-6, "tilt": 100e-6, "held": 0.0}
    return make_cell(**given | options)


def measured(plan_text=PLAN, seed=1, **options):
    plan = plan_from_text(plan_text, "test plan")
    return plan, simulate(plan, cell(**options), seed=seed)


def write_bag(path, plan_text=PLAN, with_tests=True, **options):
    plan, measurement = measured(plan_text, **options)
    lines = measurement.lines
    messages = []
    for count, line in enumerate(lines, start=1):
        messages.append(message_of(line))
        runs = completed_by(line, lines[:count], plan)
        if runs is not None and with_tests:
            new = own_types().new
            message = from_positioning_test(evaluate(runs), RUN_ID, line.end_time, new=new)
            messages.append((START + line.end_time, topics.POSITIONING_TEST, message))
    return write_messages(path, messages, plan_text, load_machine("demo")[1], plan.name)


def message_of(line):
    """Return time, topic and message of a measured line."""
    message = conversion.from_measured_line(line, RUN_ID, new=own_types().new)
    return START + line.end_time, topics.LINE, message


def write_messages(path, messages, plan_text, machine_text="", name="run"):
    """Write the bag of a run: its description, then messages, each with its time and topic."""
    types = own_types()
    description = types.new(topics.RUN_DESCRIPTION.type_name)
    set_header(description, START)
    description.schema_version = types.constant(topics.RUN_DESCRIPTION.type_name, "SCHEMA_VERSION")
    description.run_id, description.software_version = RUN_ID, __version__
    description.plan, description.machine = plan_text, machine_text
    header = RunHeader(RUN_ID, name, __version__, 1, "none", START, plan_text, machine_text, "")
    with BagWriter(path, header) as bag:
        for stamp, topic, message in ((START, topics.RUN_DESCRIPTION, description), *messages):
            data = types.encode(topic.type_name, message)
            bag.write(topics.absolute(topic), topic.type_name, data, stamp)
    return path
