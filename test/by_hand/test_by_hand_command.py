"""``stepdiag by-hand``: from a file of readings to a bag that every command takes."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from program_run import Instrument, run_program

from stepdiag_ros import cli
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.recording import read_recording
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import find, load_cell, load_plan
from stepdiag_ros.metrology.air import index_of
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.measurement import Environment, MeasuredLine
from stepdiag_ros.planning.moves import moves_of
from stepdiag_ros.planning.plan_text import plan_text

MAPPING = """\
table: readings
text: {delimiter: tab}
columns: {time: "Time (ms)", reading: "Distance (mm)"}
units: {time: ms, reading: mm}
compensated: true
"""


def write(path, readings):
    """Write times (ns) and displacements (m) as a laser's own program does."""
    rows = [f"{time * 1e-6:.3f}\t{value * 1e3:.7f}\n" for time, value in readings]
    path.write_text("Time (ms)\tDistance (mm)\n" + "".join(rows))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A plan, a mapping, and recordings: of all lines, and of each setup alone."""
    folder = tmp_path_factory.mktemp("by_hand")
    plan = load_plan("quick")[0]
    plan = replace(plan, sampling=replace(plan.sampling, dwell=1.0))
    (folder / "plan.yaml").write_text(plan_text(plan))
    (folder / "laser.yaml").write_text(MAPPING)
    moves = moves_of(plan)
    seen = run_program(
        plan, moves, load_cell("demo")[0], 2.0, Instrument(rate=50.0, seed=2, work=5.0)
    )
    readings = [(one.time, one.compensated_displacement) for one in seen.readings]
    write(folder / "all.txt", readings)
    begins = [time for time, move in zip(seen.arrivals, moves, strict=True) if "Align" in
              move.program_stop]  # fmt: skip
    for number, (begin, end) in enumerate(zip(begins, [*begins[1:], 2**62], strict=True)):
        # Each file has a clock of its own.
        part = [(time - begin, value) for time, value in readings if begin <= time < end]
        write(folder / f"{number}.txt", part)
    write(folder / "cut.txt", [one for one in readings if one[0] < begins[-1] + 20e9])
    return folder


def load_recorded(path):
    """Return times (ns) and displacements (m) of such a file."""
    rows = [row.split("\t") for row in path.read_text().splitlines()[1:]]
    return [(round(float(time) * 1e6), float(value) * 1e-3) for time, value in rows]


def run(*arguments):
    return cli.main([str(argument) for argument in arguments])


def by_hand(folder, *arguments):
    return run("by-hand", *arguments, "--mapping", folder / "laser.yaml", "--plan",
               folder / "plan.yaml")  # fmt: skip


def test_the_bag_is_a_run_like_any_other(folder, capsys):
    bag = folder / "all.mcap"
    assert by_hand(folder, folder / "all.txt", "--machine", "demo", "--output", bag, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert [line["complete"] for line in document["lines"]] == [True] * 6
    recorded = load_run(bag)
    assert recorded.chain == "YXZ" and recorded.run_id == document["run_id"]
    assert len(recorded.commands) == len(recorded.arrivals) == 42 and len(recorded.lines) == 6
    again = [
        event
        for event in assemble(
            recorded.plan,
            recorded.start_time,
            recorded.commands,
            recorded.arrivals,
            recorded.readings(),
        )
        if isinstance(event, MeasuredLine)
    ]
    for line, other in zip(recorded.lines, again, strict=True):
        assert np.array_equal(line.displacement, other.displacement)
        assert np.array_equal(line.standard_uncertainty, other.standard_uncertainty)
    # The source is in it, byte for byte; what nobody knows is said to be unknown.
    with BagReader(bag) as opened:
        kept = {one.name: one.data for one in opened.attachments}
    assert kept["source/all.txt"] == (folder / "all.txt").read_bytes()
    assert all(np.isnan(arrival.position).all() for arrival in recorded.arrivals)
    assert recorded.states[-1].text == "measured by hand: 6 of 6 lines"
    assert run("solve", bag, "--json", "--pictures", "none", "--output", folder / "results") == 0
    solved = json.loads(capsys.readouterr().out)
    assert "bit-identical to the recorded" in json.dumps(solved)
    assert {"setup_robust", "least_squares"} <= set(solved["methods"])


@pytest.mark.parametrize("machine", [(), ("--machine", "demo")])
def test_without_a_machine_it_is_said_that_the_chain_is_unknown(folder, tmp_path, capsys, machine):
    bag = tmp_path / "run.mcap"
    assert by_hand(folder, folder / "all.txt", "--output", bag, *machine) == 0
    assert ("--machine" in capsys.readouterr().err) == (not machine)
    assert load_run(bag).chain == ("YXZ" if machine else "")


def test_a_bag_with_readings_is_a_recording_too(folder, capsys):
    bag, again = folder / "once.mcap", folder / "again.mcap"
    assert by_hand(folder, folder / "all.txt", "--output", bag) == 0
    assert run("by-hand", bag, "--plan", folder / "plan.yaml", "--output", again) == 0
    capsys.readouterr()
    for line, other in zip(load_run(bag).lines, load_run(again).lines, strict=True):
        assert np.array_equal(line.displacement, other.displacement)


def test_each_setup_may_have_a_file_of_its_own(folder, capsys):
    bag = folder / "six.mcap"
    files = [folder / f"{number}.txt" for number in range(6)]
    assert by_hand(folder, *files, "--output", bag) == 0
    assert "6 of 6 lines found, 6 of them complete" in capsys.readouterr().out
    recorded = load_run(bag)
    whole = {line.line_index: line for line in recorded.lines}
    assert sorted(whole) == list(range(6))
    assert len({line.setup for line in recorded.lines}) == 6


def test_some_lines_may_be_looked_for(folder, capsys):
    bag = folder / "one.mcap"
    assert by_hand(folder, folder / "3.txt", "--lines", "4", "--output", bag) == 0
    assert "1 of 1 lines found" in capsys.readouterr().out
    assert [line.line_index for line in load_run(bag).lines] == [3]


def test_what_is_not_found_is_said_and_the_rest_is_kept(folder, capsys):
    bag = folder / "cut.mcap"
    assert by_hand(folder, folder / "cut.txt", "--output", bag) == 0
    output = capsys.readouterr()
    assert "5 of 6 lines found" in output.out
    assert "pnp XYZ forward, repeat 0: no result: " in output.err
    assert "pnp XYZ forward, repeat 0: no result: " in load_run(bag).states[-1].text
    # What was seen, and the options that add the line.
    assert re.search(r"cut.txt: .* \d+ rests .*[+-]\d+\.\d mm", output.err)
    assert "cut.txt again_1.csv --lines 1-6 --lines 6-6" in output.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["all.txt", "--lines", "1-7"], "the plan has the lines 1 to 6"),
        (["all.txt", "--lines", "1", "--lines", "2"], "2 times --lines for 1 recordings"),
        (["0.txt", "1.txt"], "2 recordings for a plan of 6 setups and 6 lines"),
        (["none.txt"], "none.txt"),
        (["0.txt", "--lines", "4"], "no line of the plan was found"),
    ],
)
def test_refusals_are_one_sentence_and_leave_nothing(folder, capsys, arguments, words):
    bag = folder / "refused.mcap"
    given = [folder / one if one.endswith(".txt") else one for one in arguments]
    assert by_hand(folder, *given, "--output", bag) == 1
    errors = capsys.readouterr().err.strip().splitlines()
    assert words in errors[-1]
    assert not bag.exists() and not list(folder.glob(".*partial"))


@pytest.mark.parametrize(
    ("signs", "advised"),
    [(";.", "delimiter: semicolon"), ("\t,", "decimal: comma"), (";,", "delimiter: semicolon")],
)
def test_the_advice_on_foreign_signs_names_the_key_of_the_mapping(folder, capsys, signs, advised):
    path = folder / "german.txt"
    delimiter, decimal = signs
    lines = (folder / "0.txt").read_text().replace(".", decimal).replace("\t", delimiter)
    path.write_text(lines)
    assert by_hand(folder, path, "--lines", "1") == 1
    told = capsys.readouterr().err
    assert advised in told and "--decimal" not in told


def test_the_files_on_the_page_are_read_by_the_mappings_beside_them(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "by_hand.md").read_text(encoding="utf-8")
    section = page.partition("## A file of the laser")[2].partition("\n## ")[0]
    plain, german, mapping = (part.partition("\n")[2] for part in section.split("```")[1::2])
    (tmp_path / "german.yaml").write_text(mapping)
    read = []
    for text, given in ((plain, "readings_in_time"), (german, str(tmp_path / "german.yaml"))):
        (tmp_path / "laser.txt").write_text(text)
        read.append(
            read_recording(
                tmp_path / "laser.txt", given, find("quick", "plans").read_text()
            ).readings
        )
    assert [one.compensated_displacement for one in read[0]] == pytest.approx(
        [one.compensated_displacement for one in read[1]]
    )
    assert len(read[0]) == 4


def test_a_silence_of_the_recording_is_noted(folder, capsys):
    rows = (folder / "3.txt").read_text().splitlines(keepends=True)
    (folder / "gap.txt").write_text("".join(rows[:101] + rows[171:]))
    given = (folder / "gap.txt", "--lines", "4", "--output", folder / "gap.mcap")
    assert by_hand(folder, *given) == 0
    start, before, after = (float(rows[n].split()[0]) * 1e-3 for n in (1, 100, 171))
    said = capsys.readouterr().err
    assert f"{before - start:.1f} s" in said and f"{after - start:.1f} s" in said
    assert "gap.txt: no readings" in said


def test_a_table_without_a_mapping_names_those_of_the_package(folder, capsys):
    assert run("by-hand", folder / "0.txt", "--plan", folder / "plan.yaml") == 1
    assert "readings_in_time" in capsys.readouterr().err


def test_readings_that_were_not_compensated_need_the_air(folder, capsys):
    path, air = folder / "raw.txt", Environment(24.0, 98000.0, 0.4)
    index = index_of(air)
    readings = load_recorded(folder / "3.txt")
    write(path, [(time, value * index) for time, value in readings])
    raw = MAPPING.replace("compensated: true", "compensated: false")
    arguments = ("--mapping", folder / "raw.yaml", "--plan", folder / "plan.yaml", "--lines", "4")
    (folder / "raw.yaml").write_text(raw)
    assert run("by-hand", path, *arguments) == 1
    assert "the air is unknown. State in the mapping file" in capsys.readouterr().err
    (folder / "raw.yaml").write_text(
        raw + "environment: {air_temperature_degC: 24.0, air_pressure_Pa: 98000.0,"
        " relative_humidity: 0.4}\n"
    )
    assert run("by-hand", path, *arguments, "--output", folder / "raw.mcap") == 0
    known = folder / "known.mcap"
    assert by_hand(folder, folder / "3.txt", "--lines", "4", "--output", known) == 0
    (line,), (other,) = load_run(folder / "raw.mcap").lines, load_run(known).lines
    # Both files are written to 0.1 nm.
    assert line.displacement == pytest.approx(other.displacement, abs=2e-10)
