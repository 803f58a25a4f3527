"""A plan's table that a person fills in comes back as a run of this plan."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import yaml
from refused import refused

from stepdiag_ros import cli
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.metrology.plausible import ROTATIONS_KEY
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.planning.reading_table import READING, reading_table


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def filled(folder, name, readings, **text):
    """Fill in the readings, in mm; write the table as a spreadsheet with other signs would."""
    path, mapping = folder / f"{name}_readings.csv", folder / f"{name}_readings.yaml"
    rows = list(csv.DictReader(path.read_text("utf-8").splitlines()))
    for row, reading in zip(rows, readings, strict=True):
        row[READING] = reading if isinstance(reading, str) else f"{reading:.9f}"
        if text:
            row[READING] = row[READING].replace(".", ",")
    with path.open("w", encoding="utf-8", newline="") as file:
        delimiter = ";" if text else ","
        writer = csv.DictWriter(file, rows[0], delimiter=delimiter)
        writer.writeheader()
        writer.writerows(rows)
    told = yaml.safe_load(mapping.read_text("utf-8"))
    told["text"].update(text)
    mapping.write_text(yaml.safe_dump(told), "utf-8")
    return ["import", path.name, "run.mcap", "--mapping", mapping.name]


def expected(path):
    """Return the readings of a perfect machine that stand in a table, mm."""
    return [float(row["expected_mm"]) for row in csv.DictReader(path.read_text().splitlines())]


@pytest.mark.parametrize("name", ["demo", "move_orders", "iso230_6_face", "kimm", "iso230_2"])
@pytest.mark.parametrize("text", [{}, {"delimiter": "semicolon", "decimal": "comma"}])
def test_a_table_that_is_filled_in_is_a_run_of_the_plan(folder, name, text):
    assert cli.main(["plan", "--check", name, "--machine", "demo", "--table"]) == 0
    plan = load_plan(name)[0]
    measured = simulate(plan, load_cell("demo")[0], np.random.default_rng(1)).lines
    readings = np.concatenate([line.displacement for line in measured]) * IN_MILLI
    assert cli.main(filled(folder, name, readings, **text)) == 0
    run = load_run("run.mcap")
    # How a person reads a stop is not known.
    assert run.plan == replace(plan, sampling=run.plan.sampling)
    assert "sampling" not in run.plan_text
    assert [line.line for line in run.lines] == list(plan.lines)
    for line, simulated in zip(run.lines, measured, strict=True):
        assert line.displacement == pytest.approx(simulated.displacement, abs=2e-12)
        assert line.target == pytest.approx(simulated.target, abs=1e-15)
    assert (run.machine["name"], run.chain) == ("demo machine", "YXZ")
    # The plan states a feed and the run no drives, which is no fault of a table.
    assert cli.main(["diagnose", "run.mcap", "--pictures", "none", "--output", "d"]) == 0


def test_lines_away_from_the_corner_come_back_at_their_places(folder, capsys):
    arguments = ["--for", "volumetric", "--machine", "demo", "--until", "20um", "--no-picture"]
    assert cli.main(["plan", *arguments, "--table"]) == 0
    plan = load_plan(folder / "volumetric_plan.yaml")[0]
    assert any(any(line.offset) for line in plan.lines)
    nominal = expected(folder / "volumetric_plan_readings.csv")
    capsys.readouterr()
    assert cli.main(filled(folder, "volumetric_plan", nominal)) == 0
    run = load_run("run.mcap")
    assert run.plan == replace(plan, sampling=run.plan.sampling)
    assert [line.line for line in run.lines] == list(plan.lines)
    # Nothing was left to the import to assume.
    assert "corner" not in capsys.readouterr().err
    # Expected is what a perfect machine shows.
    for line in run.lines:
        beam = line.line.beam(plan.volume)
        change = beam.between(line.target[0], line.target)
        assert line.displacement - line.displacement[0] == pytest.approx(change, abs=2e-7)


def test_a_stop_that_was_not_read_is_marked_and_one_that_was_forgotten_is_named(folder, capsys):
    assert cli.main(["plan", "--check", "quick", "--machine", "demo", "--table"]) == 0
    nominal = expected(folder / "quick_readings.csv")
    capsys.readouterr()
    assert cli.main(filled(folder, "quick", [*nominal[:2], "", *nominal[3:]])) == 1
    said = capsys.readouterr().err
    assert "row 4" in said and READING in said and "'-'" in said
    assert not (folder / "run.mcap").exists()
    assert cli.main(filled(folder, "quick", [*nominal[:2], "-", *nominal[3:]])) == 0
    (first, *_) = load_run("run.mcap").lines
    assert np.flatnonzero(np.isnan(first.displacement)).tolist() == [2]


@pytest.mark.parametrize(
    ("stated", "size"), [("precision", 3e-6), ("machining_centre", 10e-6), ("", 10e-6)]
)
def test_what_the_machine_file_states_of_rotations_is_in_the_run(folder, stated, size):
    text = "chain: XYZ\ntravel_low_m: [0, 0, 0]\ntravel_high_m: [1, 1, 1]\n"
    text += f"rotations: {stated}\n" if stated else ""
    (folder / "m.yaml").write_text(f"{text}feed_limit_m_per_s: 0.5\nacceleration_m_per_s2: 2.0\n")
    assert cli.main(["plan", "--check", "quick", "--machine", "m.yaml", "--table"]) == 0
    assert cli.main(filled(folder, "quick", expected(folder / "quick_readings.csv"))) == 0
    run = load_run("run.mcap")
    assert run.measurement.plausible.rotation == size
    # Also the usual size: the report says who states it.
    assert (ROTATIONS_KEY in run.machine) == bool(stated)


def test_the_sheet_for_noted_readings_speaks_of_the_table_and_of_no_recording(folder):
    arguments = ["plan", "--check", "quick", "--machine", "demo", "--nc"]
    assert cli.main([*arguments, "--table"]) == 0
    sheet = (folder / "quick_sheet.txt").read_text("utf-8")
    assert "stepdiag import quick_readings.csv --mapping quick_readings.yaml" in sheet
    assert "by-hand" not in sheet and ".csv" not in sheet.replace("quick_readings.csv", "")
    assert max(map(len, sheet.splitlines())) <= 80


def test_nothing_is_written_over_without_being_asked(folder, capsys):
    (folder / "quick_readings.yaml").write_text("mine")
    assert cli.main(["plan", "--check", "quick", "--machine", "demo", "--table"]) == 1
    assert "quick_readings.yaml" in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["quick_readings.yaml"]


def test_lines_on_the_fly_have_no_table():
    plan = load_plan("on_the_fly")[0]
    assert plan.on_the_fly
    with refused(Refusal, "unsupported", "--table"):
        reading_table(plan)
