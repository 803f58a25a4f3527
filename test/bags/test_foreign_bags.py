"""Bags of ``ros2 bag record``: folders, split and compressed, of several runs, begun late."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from bags_for_tests import MACHINE, PLAN, RUN_ID, START, reading_cdr
from mcap.writer import CompressionType, Writer
from refused import a_fault, refused

from stepdiag_ros import topics
from stepdiag_ros.bags.bag import RecordedMessage
from stepdiag_ros.bags.errors import BagCorruptError, BagCutError, BagError
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.info import bag_info
from stepdiag_ros.bags.repetitions import without_repetitions
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.runs import choose_run, records_of, runs_in
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.cli import main
from stepdiag_ros.evaluation.recorded_run import measurement_of
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import Line

NEW, TYPES = own_types().new, own_types()
SECOND = 1_000_000_000
CELL = "/cell"


def encoded(topic, message):
    return topic, TYPES.encode(topic.type_name, message)


def description(run_id=RUN_ID, start=START):
    message = NEW(topics.RUN_DESCRIPTION.type_name)
    set_header(message, start)
    message.schema_version, message.software_version = 1, "0.1.0"
    message.run_id, message.plan, message.machine = run_id, PLAN, MACHINE
    return encoded(topics.RUN_DESCRIPTION, message)


def line(index, run_id=RUN_ID, time=START):
    ramp = np.arange(3) * 0.01
    made = MeasuredLine(
        Line("linear", "x", "", index, "forward"),
        index,
        1,
        "x",
        np.arange(3.0),
        time,
        np.column_stack([ramp, 0 * ramp, 0 * ramp]),
        ramp * (1.0 + 1e-6 * index),
        np.full(3, 1e-8),
        np.full((3, 4), np.nan),
    )
    return encoded(topics.LINE, conversion.from_measured_line(made, run_id, NEW))


def command(number, run_id=RUN_ID):
    message = NEW(topics.MACHINE_COMMAND.type_name)
    set_header(message, START + number)
    message.run_id, message.command_id = run_id, number
    return encoded(topics.MACHINE_COMMAND, message)


def reading(number):
    return topics.READING, reading_cdr(number)


def idle(time):
    message = NEW(topics.RUN_STATE.type_name)
    set_header(message, time)
    return encoded(topics.RUN_STATE, message)


def record(path, messages, namespace="/"):
    """Write a file as rosbag2 does: no identity in front of it, its own idea of chunks."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD, enable_data_crcs=False)
        writer.start(profile="ros2", library="libmcap 1.1.0")
        channels = {}
        for time, (topic, data) in messages:
            name = topics.absolute(topic, namespace)
            if name not in channels:
                text = TYPES.schema(topic.type_name).encode()
                schema = writer.register_schema(topic.type_name, "ros2msg", text)
                channels[name] = writer.register_channel(name, "cdr", schema)
            writer.add_message(channels[name], time, data, time)
        writer.finish()
    return path


def folder_of(path, parts, namespace="/", compress=False, **told):
    path.mkdir()
    names = []
    for number, messages in enumerate(parts):
        file = record(path / f"{path.name}_{number}.mcap", messages, namespace)
        if compress:
            packed = file.with_name(f"{file.name}.zstd")
            packed.write_bytes(zstandard.ZstdCompressor().compress(file.read_bytes()))
            file.unlink()
            file = packed
        names.append(file.name)
    information = {"version": 9, "storage_identifier": "mcap", "relative_file_paths": names, **told}
    (path / "metadata.yaml").write_text(
        yaml.safe_dump({"rosbag2_bagfile_information": information})
    )
    return path


def one_run(run_id=RUN_ID, start=START):
    """Return the messages of a run with two lines, each said again and again."""
    said = [
        (start, description(run_id, start)),
        *((start + n, reading((start - START) // 1_000_000 + n)) for n in range(20)),
        (start + 30, command(1, run_id)),
        (start + 40, line(0, run_id, start + 40)),
        (start + 5 * SECOND, description(run_id, start)),
        (start + 5 * SECOND + 40, line(0, run_id, start + 40)),
        (start + 6 * SECOND, line(1, run_id, start + 6 * SECOND)),
        (start + 10 * SECOND, description(run_id, start)),
        (start + 10 * SECOND + 40, line(0, run_id, start + 40)),
    ]
    return sorted(said, key=lambda one: one[0])


@pytest.mark.parametrize("compress", [False, True], ids=["plain", "zstd"])
def test_a_folder_of_several_files_is_one_bag_and_a_repetition_counts_once(tmp_path, compress):
    messages = one_run()
    whole = record(tmp_path / "whole.mcap", messages)
    split = folder_of(
        tmp_path / "split", [messages[:9], messages[9:25], messages[25:]], "/", compress
    )
    run, same = load_run(split), load_run(whole)
    assert [one.line_index for one in run.lines] == [0, 1]
    assert list(run.readings()) == list(same.readings())
    assert len(list(run.readings())) == 20
    assert not run.begun_late
    with open_bag(split) as bag, open_bag(whole) as other:
        assert list(bag.records()) == list(other.records())
        assert list(bag.records("time")) == list(other.records("time"))
        assert (bag.start_time, bag.end_time) == (other.start_time, other.end_time)
        assert bag.topics == other.topics
    info = bag_info(split)
    assert (info.complete, info.intact, info.problem, info.header) == (True, True, "", None)
    assert (info.messages, info.repetitions, len(info.lines)) == (len(messages), 4, 2)
    (found,) = info.runs
    assert (found.run_id, found.plan, found.start_time) == (RUN_ID, "three lines", START)


def test_what_a_compressed_file_lacks_is_said(tmp_path):
    packed = zstandard.ZstdCompressor().compress(
        record(tmp_path / "a.mcap", one_run()).read_bytes()
    )
    for name, content, error, words in (
        ("half", packed[: len(packed) // 2], BagCutError, a_fault("cut")),
        ("none", packed[:6], BagCutError, a_fault("cut")),
        (
            "wrong",
            packed[:200] + packed[100:],
            BagCorruptError,
            a_fault("damaged", "wrong.mcap.zstd"),
        ),
        (
            "text",
            zstandard.ZstdCompressor().compress(b"some text"),
            BagError,
            a_fault("wrong_kind", "text.mcap.zstd"),
        ),
    ):
        path = tmp_path / f"{name}.mcap.zstd"
        path.write_bytes(content)
        with refused(error, words):
            open_bag(path)


def test_a_folder_that_is_no_bag_says_why(tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    with refused(BagError, "wrong_kind", "metadata.yaml"):
        open_bag(empty)
    database = folder_of(tmp_path / "database", [one_run()], storage_identifier="sqlite3")
    with refused(BagError, "wrong_kind", "sqlite3"):
        open_bag(database)
    lost = folder_of(tmp_path / "lost", [one_run(), one_run()])
    (lost / "lost_1.mcap").unlink()
    with refused(BagError, "not_found", "lost_1.mcap"):
        open_bag(lost)
    (lost / "metadata.yaml").write_text("nothing: here")
    with refused(BagError, "malformed", "metadata.yaml"):
        open_bag(lost)
    (lost / "metadata.yaml").write_text("{")
    with refused(BagError, "unreadable", "metadata.yaml"):
        open_bag(lost)


def test_a_recording_that_was_killed_has_no_metadata_and_is_read_in_the_order_of_names(tmp_path):
    messages = [(START + n, reading(n)) for n in range(11)]
    path = folder_of(tmp_path / "killed", [[one] for one in messages])
    (path / "metadata.yaml").unlink()
    with open_bag(path) as bag:
        assert [one.log_time for one in bag.records()] == [time for time, _ in messages]
    record(path / "other_0.mcap", messages)
    with refused(BagError, "ambiguous", "killed_6.mcap", aspect="bag"):
        open_bag(path)


def test_a_bag_of_several_runs_lists_them_and_gives_each_what_is_its_own(tmp_path, capsys):
    later = START + 3600 * SECOND
    messages = [
        *((START - n * SECOND, idle(START - n * SECOND)) for n in (3, 2, 1)),
        *one_run("first"),
        *one_run("second", later),
    ]
    path = folder_of(tmp_path / "both", [messages], CELL)
    with open_bag(path) as bag:
        assert list(runs_in(bag)) == ["first", "second"]
        with refused(BagError, "ambiguous", "--run", aspect="run"):
            choose_run(bag)
        with refused(BagError, "not_found", "third"):
            choose_run(bag, "third")
        first, second = (choose_run(bag, run_id) for run_id in ("first", "second"))
        own = [len(list(records_of(bag, run))) for run in (first, second)]
        times = [record.log_time for record, _ in records_of(bag, second)]
    # Of the states before the first run none is the second's.
    assert own == [3 + 24, 24]
    assert min(times) == later
    for run_id, start in (("first", START), ("second", later)):
        run = load_run(path, run_id)
        assert (run.run_id, run.namespace, run.start_time) == (run_id, CELL, start)
        assert len(run.lines) == 2
        readings = list(run.readings())
        assert len(readings) == 20
        assert readings[0].time == start

    assert main(["info", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [run["run_id"] for run in told["runs"]] == ["first", "second"]
    assert len(told["lines"]) == 4
    assert main(["info", str(path), "--run", "second", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["lines"]) == 2
    for name in ("export", "iso230"):
        assert main([name, str(path)]) == 1, name
        assert "say which by --run: first, second" in capsys.readouterr().err, name
    commands = [
        "solve",
        "export",
        "replay",
        "diagnose",
        "budget",
        "iso230",
        "squareness",
        "volumetric",
        "info",
    ]
    for name in commands:
        assert main([name, str(path), "--run", "third"]) == 1, name
        assert "holds no run 'third', but first, second" in capsys.readouterr().err, name
    assert main(["export", str(path), "--run", "second", "--readings"]) == 0
    rows = (tmp_path / "both_tables" / "readings.csv").read_text().splitlines()
    assert len(rows) == 1 + 20


def test_a_recording_that_began_late_is_taken_as_recorded_and_says_so(tmp_path):
    messages = [(time, said) for time, said in one_run() if said[0] is not topics.MACHINE_COMMAND]
    run = load_run(record(tmp_path / "late.mcap", [*messages, (START + 7, command(312))]))
    assert (run.begun_late, run.first_command) == (True, 312)
    measurement, words = measurement_of(run, False, lambda _done, _text="": None)
    assert len(measurement.lines) == 2
    assert words == (
        "the recording began after the run: solved from its 2 lines as recorded; 0 of them were"
        " assembled again from 20 readings and are bit-identical"
    )
    assert not load_run(record(tmp_path / "whole.mcap", one_run())).begun_late


def test_a_foreign_topic_without_a_definition_that_can_be_read_is_no_hindrance(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="libmcap 1.1.0")
        idl = writer.register_schema("foreign_msgs/msg/Odd", "ros2idl", b"module foreign_msgs {};")
        text = TYPES.schema(topics.RUN_DESCRIPTION.type_name).encode()
        own = writer.register_schema(topics.RUN_DESCRIPTION.type_name, "ros2msg", text)
        odd = writer.register_channel("/odd", "cdr", idl)
        writer.add_message(odd, START, b"\0\1\0\0odd", START)
        told = writer.register_channel("/run/description", "cdr", own)
        writer.add_message(told, START, description()[1], START)
        writer.finish()
    assert load_run(tmp_path / "a.mcap").run_id == RUN_ID
    with open_bag(tmp_path / "a.mcap") as bag:
        first = next(bag.records())
        with refused(BagError, "undetermined", "/odd", "foreign_msgs/msg/Odd"):
            bag.decode(first)


def test_a_message_that_is_no_state_may_say_the_same_twice():
    once = RecordedMessage("/run/state", "stepdiag_ros/msg/RunState", 1, 1, 0, b"same")
    stream = once._replace(topic="/joint_states")
    foreign = once._replace(topic="/chatter")
    other = once._replace(topic="/cell/run/state")
    kept = list(without_repetitions([once, stream, once, stream, foreign, foreign, other, once]))
    assert kept == [once, stream, stream, foreign, foreign, other]


def test_the_shipped_qos_of_ros2_bag_record_keeps_all_that_the_topics_mean():
    path = Path(__file__).parents[2] / "config" / "rosbag2_qos.yaml"
    told = yaml.safe_load(path.read_text())
    assert set(told) == {topics.absolute(topic) for topic in topics.RECORDED}
    for topic in topics.RECORDED:
        assert told[topics.absolute(topic)] == {
            "history": "keep_all",
            "reliability": "reliable",
            # As our recorder: no events from before it began, whose readings it lacks.
            "durability": "transient_local" if topic.qos.repeated else "volatile",
        }
