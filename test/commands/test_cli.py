"""The command line: every command on a small recorded run, wrong inputs, and the exit codes."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from patience import PATIENCE
from refused import refused

from stepdiag_ros import __version__, cli, topics
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.commands import info
from stepdiag_ros.commands.arguments import Group
from stepdiag_ros.configuration import load_cell, load_machine, load_plan
from stepdiag_ros.evaluation.solving import solve_reproducibly
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.messages.volumetric import from_volumetric_errors
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.measurement import (
    Arrival,
    Environment,
    MeasuredLine,
    Measurement,
    Reading,
    StopCommand,
)
from stepdiag_ros.metrology.plan import moved_axes
from stepdiag_ros.schemas import identifier

START = 1_000_000_000
RUN_ID = "20260102T030405-abcd"
CASE = Path(__file__).parents[1] / "data" / "cases" / "paper_like"


def events_of_a_run(plan, cell):
    """Return commands, arrivals and readings of a plan on a cell: 50 readings at each stop."""
    rng = np.random.default_rng(1)
    commands, arrivals, readings = [], [], []
    now = START
    for index, line in enumerate(plan.lines):
        stops = line.stops(plan.volume)
        alignment = cell.alignment(line.setup, line.name, plan.volume.step, tuple(stops[0]))
        path = cell.displacement(stops, alignment)
        for stop, target in enumerate(stops):
            axis = moved_axes(stops[stop - 1], target) if stop else ""
            identity = len(commands) + 1
            place = tuple(float(value) for value in target)
            commands.append(StopCommand(identity, index, 1, line.setup, stop, axis, place, now))
            arrivals.append(Arrival(identity, now + 20_000_000, place))
            for _ in range(50):
                now += 10_000_000
                value = float(path[stop] + 1e-8 * rng.standard_normal())
                air = Environment(20.0, 101325.0, 0.5, 20.0)
                readings.append(Reading(now, len(readings), value, value, 0.9, 0, air))
            now += 10_000_000
    return commands, arrivals, readings


def write_bag(path, damage=None):
    """Record a small run with its lines and results; ``damage`` may change the results."""
    (plan, plan_text), (cell, cell_text) = load_plan("quick"), load_cell("demo")
    machine_text = load_machine("demo")[1]
    commands, arrivals, readings = events_of_a_run(plan, cell)
    events = assemble(plan, START, commands, arrivals, readings)
    lines = tuple(event for event in events if isinstance(event, MeasuredLine))
    assert len(lines) == len(plan.lines)
    assert all(line.complete for line in lines)
    chain = load_machine("demo")[0].chain
    results = solve_reproducibly(Measurement(plan.volume, lines, chain))[0]
    types = own_types()
    new = types.new
    description = new(topics.RUN_DESCRIPTION.type_name)
    set_header(description, START)
    description.schema_version = 1
    description.run_id, description.software_version = RUN_ID, __version__
    description.plan, description.machine = plan_text, machine_text
    description.simulated_cell = cell_text
    messages = [(START, topics.RUN_DESCRIPTION, description)]
    for command, arrival in zip(commands, arrivals, strict=True):
        messages.append(
            (
                command.time,
                topics.MACHINE_COMMAND,
                conversion.from_stop_command(command, RUN_ID, command.time, plan.feed, new=new),
            )
        )
        messages.append(
            (
                arrival.time,
                topics.COMMAND_STATUS,
                conversion.from_command_status(
                    arrival.command_id,
                    RUN_ID,
                    arrival.time,
                    conversion.STATUS_IN_POSITION,
                    arrival.position,
                    arrival.position,
                    new=new,
                ),
            )
        )
    for reading in readings:
        message = conversion.from_reading(reading, "laser", new=new)
        messages.append((reading.time, topics.READING, message))
    for line in lines:
        message = conversion.from_measured_line(line, RUN_ID, new=new)
        messages.append((line.end_time, topics.LINE, message))
    for result in results.values():
        recorded = result if damage is None else damage(result)
        end = readings[-1].time
        message = from_volumetric_errors(recorded, RUN_ID, end, new=new)
        messages.append((end, topics.VOLUMETRIC_ERRORS, message))
    header = RunHeader(
        RUN_ID, plan.name, __version__, 1, "none", START, plan_text, machine_text, cell_text
    )
    with BagWriter(path, header) as bag:
        for stamp, topic, message in sorted(messages, key=lambda entry: entry[0]):
            data = types.encode(topic.type_name, message)
            bag.write(topics.absolute(topic), topic.type_name, data, stamp)
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bag") / "run.mcap")


def stepdiag(capsys, *arguments):
    """Run the command line in this process; return exit code, standard output, standard error."""
    try:
        code = cli.main([str(argument) for argument in arguments])
    except SystemExit as end:
        code = end.code
    said = capsys.readouterr()
    return code, said.out, said.err


def refusal_of(capsys, *arguments):
    """Run a command that must be refused with exit code 1 and one sentence; return the sentence."""
    code, out, err = stepdiag(capsys, *arguments)
    assert code == 1
    assert out == ""
    assert err.startswith("stepdiag: error: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    return err


# -- solve ---------------------------------------------------------------------------------------


def test_solve_from_the_readings_equals_the_recorded_result_to_the_last_bit(bag, capsys, tmp_path):
    code, out, err = stepdiag(capsys, "solve", bag, "--details", "--output", tmp_path / "results")
    assert code == 0
    same = next(line for line in out.splitlines() if "same bits as recorded" in line)
    words = same.split()
    assert words[:4] == ["same", "bits", "as", "recorded"]
    assert len(words) > 6 and set(words[4:]) == {"yes"}
    assert "assembled again from 2100 readings: the lines are bit-identical" in out
    assert RUN_ID in out
    assert "error_curves.png" in err
    assert (tmp_path / "results" / "error_curves.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "results" / "report.txt").read_text(encoding="utf-8")
    assert text.splitlines() == [line.rstrip() for line in out.splitlines()]


def test_solve_prints_json_and_nothing_else(bag, capsys, tmp_path):
    folder = tmp_path / "results"
    code, out, err = stepdiag(
        capsys, "solve", bag, "--json", "--pictures", "none", "--output", folder
    )
    assert code == 0
    document = json.loads(out)
    assert document["schema"] == identifier("result")
    assert document == json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert document["run"]["run_id"] == RUN_ID
    assert document["run"]["chain"] == "YXZ"
    assert document["run"]["simulated"] is True
    method = document["methods"]["least_squares"]
    assert method["equals_recorded"] is True
    assert method["comparison_with_truth"]["rms"] < 1e-7
    assert "results in" in err


def test_solve_writes_beside_the_bag_unless_told(bag, capsys):
    code, _, _ = stepdiag(capsys, "solve", bag, "--pictures", "none")
    assert code == 0
    assert sorted(path.name for path in bag.with_name("run_results").iterdir()) == [
        "report.txt",
        "results.json",
        "table_1.json",
        "table_1.txt",
    ]


def test_results_of_another_run_are_not_replaced_without_a_word(bag, capsys, tmp_path):
    file, said = tmp_path / "results.json", []
    for change in ("", "another", ""):
        if change == "another":
            file.write_text(re.sub(r'"run_id": "[^"]*"', '"run_id": "X1"', file.read_text()))
        arguments = ("solve", bag, "--pictures", "none", "--output", tmp_path)
        said.append(stepdiag(capsys, *arguments)[2])
    assert [one.count(str(tmp_path)) for one in said] == [1, 2, 2]
    assert ["'X1'" in one and "--output" in one for one in said] == [False, True, False]


@pytest.mark.parametrize(
    ("change", "differs"),
    [(lambda value: np.nextafter(value, 1.0), False), (lambda value: value + 1e-9, True)],
)
def test_solve_says_that_the_recorded_result_differs(change, differs, tmp_path, capsys):
    """The last bit may differ from processor to processor; a nanometre may not."""

    def damage(result):
        curve = result.curves["E_XX"].copy()
        curve[-1] = change(curve[-1])
        changed = {**result.curves, "E_XX": curve}
        return replace(result, curves=changed) if result.method == "least_squares" else result

    bag = write_bag(tmp_path / "run.mcap", damage)
    code, out, err = stepdiag(capsys, "solve", bag, "--json", "--pictures", "none")
    methods = json.loads(out)["methods"]
    assert code == 0
    assert methods["least_squares"]["equals_recorded"] is False
    assert methods["setup_robust"]["equals_recorded"] is True
    assert ("warning: least_squares: the numbers differ" in err) is differs


def test_what_is_printed_without_details_fits_a_screen(bag, capsys):
    code, out, err = stepdiag(capsys, "solve", bag, "--pictures", "none")
    lines = out.splitlines()
    assert code == 0 and len(lines) <= 24
    assert "Least squares" in out and "C0Y" in out and "report" in out
    assert "Methods" not in out and "--details" in err
    report = (bag.with_name("run_results") / "report.txt").read_text(encoding="utf-8")
    assert "Methods" in report
    lead = report.partition("In short:\n")[2].splitlines()
    assert [line for line in lead if line not in lines] == []


def test_squareness_sign_is_printed_as_asked(bag, capsys):
    rows = {}
    for definition in ("rotation", "angle"):
        arguments = ("solve", bag, "--details", "--pictures=none", "--squareness-sign", definition)
        _, out, _ = stepdiag(capsys, *arguments)
        for line in out.splitlines():
            if line.strip().startswith(("B0Z  Z", "C0Y  Y")):
                rows[definition, line.split()[0]] = float(line.split()[-1])
    assert rows["angle", "B0Z"] == -rows["rotation", "B0Z"] != 0.0
    assert rows["angle", "C0Y"] == rows["rotation", "C0Y"] != 0.0


def write_description(path, version):
    """Write a bag with nothing but the description of a run, of a schema version."""
    types, text = own_types(), load_plan("quick")[1]
    description = types.new(topics.RUN_DESCRIPTION.type_name)
    description.run_id, description.plan = RUN_ID, text
    description.software_version, description.schema_version = "9.9", version
    header = RunHeader(RUN_ID, "quick", "9.9", version, "none", START, text)
    with BagWriter(path, header) as bag:
        data = types.encode(topics.RUN_DESCRIPTION.type_name, description)
        bag.write("/run/description", topics.RUN_DESCRIPTION.type_name, data, START)
    return path


def test_a_bag_without_finished_lines_is_refused(tmp_path, capsys):
    path = write_description(tmp_path / "empty.mcap", 1)
    assert "empty.mcap: no line was finished" in refusal_of(capsys, "solve", path)
    assert "--output" in refusal_of(capsys, "diagnose", path)


@pytest.mark.parametrize("command", ["solve", "export", "replay"])
def test_a_bag_of_a_newer_schema_version_is_refused(command, tmp_path, capsys):
    sentence = refusal_of(capsys, command, write_description(tmp_path / "newer.mcap", 2))
    assert "newer.mcap was made by stepdiag_ros 9.9" in sentence
    assert "schema version 2, but this program reads up to 1" in sentence


def test_a_bag_without_a_run_is_not_replayed(tmp_path, capsys):
    path = tmp_path / "other.mcap"
    header = RunHeader(RUN_ID, "quick", __version__, 1, "none", START, "")
    with BagWriter(path, header) as bag:
        bag.write("/chatter", "std_msgs/msg/String", b"\0\1\0\0\2\0\0\0a\0", START)
    assert "other.mcap holds no run" in refusal_of(capsys, "replay", path)


def test_a_replay_with_nothing_to_compare_says_so(tmp_path, capsys):
    path = write_description(tmp_path / "bare.mcap", 1)
    assert "nothing to compare" in refusal_of(capsys, "replay", path, "--check")


# -- import, export, info, recover ---------------------------------------------------------------


def test_a_table_is_imported_solved_and_exported_again(capsys, tmp_path):
    bag = tmp_path / "case.mcap"
    code, out, _ = stepdiag(capsys, "import", CASE / "run.csv", bag, "--json")
    assert code == 0
    assert json.loads(out)["lines"] == 60
    code, out, _ = stepdiag(
        capsys, "solve", bag, "--json", "--pictures", "none", "--truth", CASE / "truth.yaml"
    )
    methods = json.loads(out)["methods"]
    assert code == 0
    assert round(methods["conventional"]["comparison_with_truth"]["rms"] * 1e6, 1) == 13.8
    assert methods["setup_robust"]["comparison_with_truth"]["rms"] < 0.0655e-6
    assert methods["least_squares"]["comparison_with_truth"]["rms"] < 0.0455e-6
    assert methods["least_squares"]["equals_recorded"] is None
    code, out, _ = stepdiag(capsys, "export", bag, "--json")
    assert code == 0
    files = [Path(name) for name in json.loads(out)["files"]]
    assert tmp_path / "case_tables" / "run.csv" in files
    assert all(path.is_file() for path in files)
    assert "exists" in refusal_of(capsys, "export", bag)
    assert stepdiag(capsys, "export", bag, "--overwrite")[0] == 0


def test_info_says_what_is_there(bag, capsys):
    code, out, _ = stepdiag(capsys, "info", bag)
    assert code == 0
    assert RUN_ID in out
    assert "complete, every checksum is right" in out
    assert "2100, none missing" in out
    document = json.loads(stepdiag(capsys, "info", bag, "--json")[1])
    assert document["intact"] is True
    assert document["missing_readings"] == 0


def test_a_cut_bag_is_refused_recovered_and_solved(bag, capsys, tmp_path):
    cut = tmp_path / "cut.mcap"
    whole = bag.read_bytes()
    cut.write_bytes(whole[: len(whole) * 9 // 10])
    assert f"stepdiag recover {cut}" in refusal_of(capsys, "solve", cut)
    code, out, err = stepdiag(capsys, "info", cut)
    assert code == 1
    assert "stepdiag recover" in out
    assert "Messages" not in out, "nobody has counted them"
    assert "stepdiag recover" in err
    code, out, _ = stepdiag(capsys, "recover", cut, "--json")
    assert code == 0
    document = json.loads(out)
    assert document["target"] == str(tmp_path / "cut_recovered.mcap")
    assert document["source_was_closed"] is False
    assert document["messages"] > 1000
    code, out, _ = stepdiag(capsys, "solve", document["target"], "--json", "--pictures", "none")
    assert code == 0
    assert json.loads(out)["schema"] == identifier("result")
    assert "exists already" in refusal_of(capsys, "recover", cut)


def test_a_flipped_bit_is_refused(bag, capsys, tmp_path):
    flipped = tmp_path / "flipped.mcap"
    content = bytearray(bag.read_bytes())
    content[len(content) // 2] ^= 0x10
    flipped.write_bytes(content)
    assert "flipped.mcap" in refusal_of(capsys, "solve", flipped)


# -- wrong input ---------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["solve", "info", "export", "recover"])
def test_a_file_that_is_missing_or_no_bag(command, capsys, tmp_path):
    missing = tmp_path / "missing.mcap"
    assert str(missing) in refusal_of(capsys, command, missing)
    other = tmp_path / "other.mcap"
    other.write_text("not a bag")
    assert str(other) in refusal_of(capsys, command, other)
    assert str(tmp_path) in refusal_of(capsys, command, tmp_path)


def test_a_wrong_table_is_refused_with_the_row(capsys, tmp_path):
    table = tmp_path / "run.csv"
    rows = (CASE / "run.csv").read_text().splitlines()
    rows[6] = rows[6].replace("forward", "sideways")
    table.write_text("\n".join(rows))
    sentence = refusal_of(capsys, "import", table)
    assert "run.csv, row 7" in sentence
    assert "sideways" in sentence
    assert list(tmp_path.iterdir()) == [table]
    assert "nothing.csv" in refusal_of(capsys, "import", tmp_path / "nothing.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("E_XX: [0.0", "truth.yaml, line 1"),
        ("- 1.0", "expected error curves"),
        ("E_XX: [0.0, 0.0]", "E_XX must be 4 numbers"),
        ("E_XX: [0.0, 0.0, 0.0, nonsense]", "truth.yaml"),
        ("E_XX: [0.0, 0.0, 0.0, .nan]", "E_XX must be 4 numbers"),
        ("E_XX: [0.0, 0.0, 0.0, 0.0]", "lack the curve E_YX"),
    ],
)
def test_a_wrong_truth_is_refused(text, message, bag, capsys, tmp_path):
    truth = tmp_path / "truth.yaml"
    truth.write_text(text)
    assert message in refusal_of(capsys, "solve", bag, "--truth", truth)


@pytest.mark.parametrize(
    "arguments",
    [("sovle", "x"), ("solve", "x", "--picture-format", "bmp"), ("node", "nobody")],
)
def test_wrong_usage_ends_with_2(arguments, capsys):
    code, out, err = stepdiag(capsys, *arguments)
    assert code == 2
    assert out == ""
    # The usage of a command with many options would push the sentence out of sight.
    assert err.startswith("stepdiag") and ": error: " in err and "usage" not in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "--corection", "m"), "stepdiag run: error: there is no option --corection; did"),
        (("schema", "--nothing"), "error: there is no option --nothing; 'stepdiag schema --help'"),
        (
            ("compensate", "a.mcap", "--fro", "x"),
            "error: there is no option --fro; did you mean '--f",
        ),
        (("info", "a.mcap", "b.mcap"), "stepdiag info: error: one argument too many: b.mcap"),
        (("tracker", "figures", "x", "--sed=1"), "figures: error: there is no option --sed;"),
    ],
)
def test_what_a_command_does_not_know_it_says_itself(arguments, said, capsys):
    code, out, err = stepdiag(capsys, *arguments)
    assert (code, out) == (2, "")
    assert said in err.splitlines()[0]


def test_without_a_command_all_are_listed_by_what_they_are_for(capsys):
    code, out, err = stepdiag(capsys)
    assert (code, err) == (0, "")
    places = [out.index(f"\n{group.value}:\n") for group in Group]
    assert places == sorted(places)
    assert [word for word in cli.commands() if f"\n  {word.name} " not in out] == []
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("sovle", "x"), "solve"),
        (("node", "sovler"), "solver"),
        (("compensate", "x.mcap", "--for", "linuxnc"), "linuxcnc"),
        (("tracker", "locte", "x"), "locate"),
        (("plan", "--check", "qick", "--machine", "demo"), "quick"),
    ],
)
def test_a_word_that_is_nearly_right_is_answered_with_the_right_one(arguments, meant, capsys):
    code, out, err = stepdiag(capsys, *arguments)
    assert (code != 0, out) == (True, "")
    assert f"did you mean '{meant}'?" in err


def test_without_a_bag_the_newest_here_is_taken(bag, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code, out, err = stepdiag(capsys, "info")
    assert (code, out) == (2, "")
    assert "name a bag" in err
    (tmp_path / "stepdiag_results").mkdir()
    for age, name in enumerate(("old.mcap", "stepdiag_results/new.mcap", "older.mcap")):
        (tmp_path / name).write_bytes(bag.read_bytes())
        os.utime(tmp_path / name, ns=(10**18 - abs(age - 1),) * 2)
    code, out, err = stepdiag(capsys, "info")
    assert code == 0
    assert str(Path("stepdiag_results/new.mcap")) in err and re.search(r"\d{4}-\d\d-\d\d", err)
    assert "new.mcap" in out
    code, _, err = stepdiag(capsys, "info", "")
    assert (code, "newest" in err) == (1, False)


def test_files_and_options_come_in_any_order(tmp_path):
    mapping, bag = tmp_path / "mapping.yaml", tmp_path / "b.mcap"
    orders = [
        ("a.csv", bag, "--mapping", mapping),
        ("a.csv", "--mapping", mapping, bag),
        ("--mapping", mapping, "a.csv", bag),
    ]
    read = [cli.make_parser().parse_args(["import", *map(str, one)]) for one in orders]
    assert [one.paths for one in read] == [[Path("a.csv"), bag]] * 3
    assert vars(read[0]) == vars(read[1]) == vars(read[2])
    # What follows --ros-args is the node's.
    node = cli.make_parser().parse_args(["node", "solver", "--ros-args", "-p", "a:=1"])
    assert node.ros_arguments == ["--ros-args", "-p", "a:=1"]


def test_a_folder_that_cannot_be_written(bag, capsys, tmp_path):
    (tmp_path / "file").write_text("")
    sentence = refusal_of(capsys, "solve", bag, "--output", tmp_path / "file" / "results")
    assert str(tmp_path / "file") in sentence
    for arguments in (("solve", bag), ("run", "--plan", "quick")):
        sentence = refusal_of(capsys, *arguments, "--output", tmp_path / "file")
        assert f"{tmp_path / 'file'} is a file" in sentence


def test_a_full_disk_is_said_with_the_file_and_leaves_no_part_of_it(
    bag, capsys, tmp_path, monkeypatch
):
    def full(self, *_, **__):
        self.touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text", full)
    sentence = refusal_of(capsys, "solve", bag, "--pictures", "none", "--output", tmp_path / "new")
    assert f"{tmp_path / 'new' / 'results.json'}: no space left" in sentence
    assert list((tmp_path / "new").iterdir()) == []


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("step_m: [0.010,", "step_m: [0.5,", "outside the soft limits"),
        ("feed_m_per_s: 0.033", "feed_m_per_s: 0.9", "above the machine's feed limit 0.5 m/s"),
        ("feed_m_per_s: 0.033", "feed_m_per_s: unknown", "solved, but not executed"),
    ],
)
def test_a_plan_beyond_the_machine_is_refused_before_anything_starts(
    right, wrong, message, capsys, tmp_path
):
    text = load_plan("quick")[1]
    assert right in text
    plan = tmp_path / "plan.yaml"
    plan.write_text(text.replace(right, wrong))
    sentence = refusal_of(capsys, "run", "--plan", plan, "--output", tmp_path / "out")
    assert f"{plan} cannot be executed on" in sentence
    assert message in sentence
    assert not (tmp_path / "out").exists()


def test_a_plan_beyond_the_cell_is_refused_before_anything_starts(capsys, tmp_path):
    plan = tmp_path / "plan.yaml"
    plan.write_text(load_plan("quick")[1].replace("step_m: [0.010,", "step_m: [0.050,"))
    sentence = refusal_of(capsys, "run", "--plan", plan, "--output", tmp_path / "out")
    assert "X = 150 mm" in sentence
    assert "0 to 120 mm" in sentence
    assert not (tmp_path / "out").exists()


def test_a_correction_that_is_no_map_is_refused_before_anything_starts(capsys, tmp_path):
    no_map = tmp_path / "no_map.json"
    no_map.write_text('{"schema": "urn:stepdiag:plan:1"}')
    out = tmp_path / "out"
    for wrong in (no_map, tmp_path / "missing.json"):
        sentence = refusal_of(capsys, "run", "--correction", wrong, "--output", out)
        assert str(wrong) in sentence
        assert not out.exists()


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--factor", "0", "0 is not between 0.001 and 1000"),
        ("--rate", "nan", "nan is not between 0.1 and 10000"),
        ("--seed", "-1", "'-1' is not a whole number from 0 to 2147483648"),
    ],
)
def test_a_number_out_of_range_is_wrong_usage(option, value, message, capsys):
    code, out, err = stepdiag(capsys, "run", f"{option}={value}")
    assert (code, out) == (2, "")
    assert message in err


# -- the process ---------------------------------------------------------------------------------


def test_version_and_help(capsys):
    assert stepdiag(capsys, "--version") == (0, f"stepdiag {__version__}\n", "")
    code, out, _ = stepdiag(capsys, "--help")
    assert code == 0
    for name in ("demo", "run", "replay", "solve", "import", "export", "recover", "info", "node"):
        assert f"\n  {name} " in out
        code, page, _ = stepdiag(capsys, name, "--help")
        assert code == 0
        assert "example" in page


def test_help_needs_no_slow_import():
    script = (
        "import sys; from stepdiag_ros.cli import make_parser; make_parser().format_help();"
        "slow = ('numpy', 'scipy', 'matplotlib', 'rich', 'rosbags');"
        "print([name for name in slow if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=PATIENCE
    )
    assert done.stdout == "[]\n"


def test_an_error_shows_its_place_only_when_asked(tmp_path, capsys):
    missing = tmp_path / "missing.mcap"
    refusal_of(capsys, "solve", missing)
    with refused(BagError, "not_found", "missing.mcap"):
        cli.main(["--traceback", "solve", str(missing)])


def test_ctrl_c_ends_with_130(monkeypatch, capsys):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "commands", lambda: [replace(info.COMMAND, run=interrupted)])
    code, out, err = stepdiag(capsys, "info", "x.mcap")
    assert (code, out, err) == (128 + signal.SIGINT, "", "stepdiag: stopped\n")


def test_ctrl_c_while_commands_are_imported(monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "of_modules", interrupted)
    code, out, err = stepdiag(capsys, "info", "a.mcap")
    assert (code, out, err) == (128 + signal.SIGINT, "", "stepdiag: stopped\n")


def test_a_reader_that_goes_away_is_no_error(bag):
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "stepdiag_ros.cli", "solve", str(bag), "--pictures", "none"],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    os.close(write)
    assert done.returncode == 141
    assert "Traceback" not in done.stderr
    assert "error" not in done.stderr


def test_closed_outputs_are_no_error(bag):
    done = subprocess.run(
        f"{sys.executable} -m stepdiag_ros.cli solve {bag} --pictures none >&- 2>&-",
        shell=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0


def test_a_terminal_without_greek_letters_gets_question_marks(bag):
    done = subprocess.run(
        [sys.executable, "-m", "stepdiag_ros.cli", "solve", str(bag), "--pictures", "none"],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0
    assert b" ?m " in done.stdout


def test_an_interrupt_inside_generated_code_ends_with_130_too(tmp_path):
    """It hit dataclasses by chance as they were made, and ended the interpreter by the signal."""
    (tmp_path / "interrupted.py").write_text(
        "import sys\n"
        "from stepdiag_ros import cli\n"
        "cli._run = lambda argv: exec('raise KeyboardInterrupt')\n"
        "sys.exit(cli.main([]))\n",
        encoding="utf-8",
    )
    done = subprocess.run(
        [sys.executable, "-m", "interrupted"], cwd=tmp_path, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (130, "stepdiag: stopped\n")
