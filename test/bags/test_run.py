"""A recorded run as data classes."""

import numpy as np
from bags_for_tests import (
    MACHINE,
    PLAN,
    RUN_ID,
    START,
    description,
    header,
    put,
    reading,
    reading_cdr,
)
from refused import refused

from stepdiag_ros import topics
from stepdiag_ros.bags.errors import BagCutError, BagError
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header, set_stamp
from stepdiag_ros.metrology.measurement import (
    BlockDisplacement,
    Environment,
    MeasuredLine,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.plan import Line

NEW = own_types().new
X = Line("linear", "x", "", 0, "forward")


def command(number):
    return StopCommand(number, 0, 1, "x", number, "X", (0.01 * number, 0.0, 0.0), START + number)


def stop(number):
    return SettledStop(
        command(number),
        X,
        (0.01 * number, 0.0, 0.0),
        True,
        "",
        START + number,
        0.01 * number,
        0.01 * number,
        1e-8,
        1e-7,
        100,
        1,
        100,
        START,
        START,
        START,
        Environment(20.0, 101325.0, 0.5, 20.0),
    )


def line(index, attempt, start=0.0):
    ramp = np.arange(3) * 0.01
    return MeasuredLine(
        X,
        index,
        attempt,
        "x",
        start + np.arange(3.0),
        START + attempt,
        np.column_stack([ramp, 0 * ramp, 0 * ramp]),
        ramp + attempt * 1e-6,
        np.full(3, 1e-8),
        np.full((3, 4), np.nan),
    )


def state(value, text, time, run_id=RUN_ID):
    message = NEW(topics.RUN_STATE.type_name)
    set_header(message, time)
    message.run_id, message.state, message.text = run_id, value, text
    return message


def diagnostics(level, text, time):
    message = NEW(topics.DIAGNOSTICS.type_name)
    set_stamp(message.header.stamp, time)
    status = NEW("diagnostic_msgs/msg/DiagnosticStatus")
    status.level, status.name, status.message = level, "assembler", text
    message.status = [status]
    return message


def write_run(path, namespace="/", run_id=RUN_ID, plan=PLAN):
    with BagWriter(path, header(run_id=run_id, plan=plan)) as bag:

        def add(topic, message, time=START):
            put(bag, topic, message, time, namespace)

        add(topics.RUN_DESCRIPTION, description(run_id, plan))
        add(topics.RUN_DESCRIPTION, description(run_id, plan))
        for n in range(3):
            add(topics.RUN_STATE, state(1, "running", START + n, run_id))
        add(topics.RUN_STATE, state(1, "a late heartbeat", START, "an earlier run"))
        for n in range(3):
            for purpose in (conversion.PURPOSE_POSITION, conversion.PURPOSE_STOP):
                add(
                    topics.MACHINE_COMMAND,
                    conversion.from_stop_command(
                        command(n), run_id, START + n, 0.05, purpose, new=NEW
                    ),
                )
            for status in (0, 1, 2):
                add(
                    topics.COMMAND_STATUS,
                    conversion.from_command_status(
                        n, run_id, START + n, status, (n, 0, 0), (n + 0.5, 0, 0), new=NEW
                    ),
                )
            name = topics.absolute(topics.READING, namespace)
            bag.write(name, topics.READING.type_name, reading_cdr(n), START + n)
            add(topics.STOP, conversion.from_settled_stop(stop(n), run_id, NEW))
        block = BlockDisplacement(0, 1, X, START, 1, "X", 0, 1, 0.01, 0.0100001, 1e-8)
        add(topics.BLOCK, conversion.from_block(block, run_id, NEW))
        for attempt in (1, 2):
            measured = line(0, attempt)
            add(topics.LINE, conversion.from_measured_line(measured, run_id, NEW))
        for n, (level, text) in enumerate([(0, "ok"), (0, "ok"), (2, "no readings"), (0, "ok")]):
            add(topics.DIAGNOSTICS, diagnostics(bytes([level])[0], text, START + n))
        add(topics.RUN_STATE, state(4, "finished", START + 9, run_id))
    return path


def test_everything_that_the_bag_says_is_there(tmp_path):
    run = load_run(write_run(tmp_path / "a.mcap"))
    assert (run.run_id, run.namespace, run.schema_version) == (RUN_ID, "/", 1)
    assert (run.plan_text, run.machine_text, run.cell_text) == (PLAN, MACHINE, "")
    assert run.start_time == START
    assert run.plan.feed == 0.05
    assert run.volume.step == (0.01, 0.02, 0.03)
    assert run.chain == "YXZ"
    assert run.commands == tuple(command(n) for n in range(3))
    assert [arrival.command_id for arrival in run.arrivals] == [0, 1, 2]
    assert [arrival.position for arrival in run.arrivals] == [(n + 0.5, 0, 0) for n in range(3)]
    assert run.stops == tuple(stop(n) for n in range(3))
    assert [block.displacement for block in run.blocks] == [0.0100001]
    assert [measured.attempt for measured in run.lines] == [1, 2]
    assert [measured.attempt for measured in run.measurement.lines] == [2]
    assert [(s.state, s.text) for s in run.states] == [(1, "running"), (4, "finished")]
    assert [(d.level, d.message) for d in run.diagnostics] == [
        (0, "ok"),
        (2, "no readings"),
        (0, "ok"),
    ]
    assert list(run.readings()) == [reading(n) for n in range(3)]


def test_events_come_in_the_order_of_recording(tmp_path):
    run = load_run(write_run(tmp_path / "a.mcap"))
    expected = []
    for n in range(3):
        expected += [command(n), run.arrivals[n], reading(n)]
    assert list(run.events()) == expected


def test_a_run_in_a_namespace_is_found(tmp_path):
    run = load_run(write_run(tmp_path / "a.mcap", "/hall/cell"))
    assert run.namespace == "/hall/cell"
    assert len(run.lines) == 2
    assert len(list(run.events())) == 9
    assert len(run.diagnostics) == 3


def test_a_bag_of_several_runs_asks_which(tmp_path):
    path = tmp_path / "a.mcap"
    with BagWriter(path, header()) as bag:
        for run_id in ("first", "second"):
            put(bag, topics.RUN_DESCRIPTION, description(run_id), START)
            put(bag, topics.LINE, conversion.from_measured_line(line(0, 1), run_id, NEW), START)
    with refused(BagError, "ambiguous", "--run", aspect="run"):
        load_run(path)
    assert load_run(path, "second").run_id == "second"
    assert len(load_run(path, "second").lines) == 1
    with refused(BagError, "not_found", "third"):
        load_run(path, "third")


def test_a_bag_without_a_run_is_refused(tmp_path):
    path = tmp_path / "a.mcap"
    with BagWriter(path, header()) as bag:
        put(bag, topics.RUN_STATE, state(1, "", START), START)
    with refused(BagError, "missing", "a.mcap"):
        load_run(path)


def test_a_wrong_plan_in_a_bag_is_named(tmp_path):
    path = write_run(tmp_path / "a.mcap", plan=PLAN.replace("blocks: 2", "blocks: many"))
    with refused(BagError, "out_of_range", "many", about="blocks"):
        load_run(path)


def test_a_cut_bag_is_refused_with_advice(tmp_path):
    path = write_run(tmp_path / "a.mcap")
    path.write_bytes(path.read_bytes()[:-100])
    with refused(BagCutError, "cut", "a.mcap"):
        load_run(path)
