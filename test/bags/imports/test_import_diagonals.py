"""Four .rtl files of four diagonals are one test of ISO 230-6: E_d, B_d, squareness, curves."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from import_files import RTL

from stepdiag_ros.bags.imports.source import PREFIX
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.configuration import cell_from_text, find, read_text
from stepdiag_ros.evaluation.solving import solve_reproducibly
from stepdiag_ros.metrology.geometry import AXES, BODY_DIAGONALS, FACE_DIAGONALS, beam_direction
from stepdiag_ros.metrology.plan import FORWARD, Plan
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.standards.axis_test import all_runs
from stepdiag_ros.metrology.standards.diagonal_squareness import squareness_of
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.metrology.standards.iso230_6 import diagonal_groups

LOW, HIGH = (-0.25, -0.15, 0.05), (0.05, 0.05, 0.15)
BOX = [str(value) for value in (*LOW, *HIGH)]
PRINTED = 1e-9 / 2
"""m: deviations stand in the files with three decimals of a micrometre."""


def measured(kind, names, blocks=5, seed=3):
    """Simulate a machine with every kind of error, five runs each way along each line."""
    plan = Plan.from_mapping(
        {
            "origin_m": list(LOW),
            "step_m": [round((b - a) / blocks, 9) for a, b in zip(LOW, HIGH, strict=True)],
            "blocks": blocks,
            "repeats": 5,
            "directions": ["forward", "backward"],
            "feed_m_per_s": 0.03,
            "overrun_m": 0.002,
            "lines": [{"kind": kind, "names": list(names)}],
        },
        "plan",
    )
    return simulate(plan, cell_over_box(), seed=seed)


def cell_over_box():
    """Return the cell of the demonstration with its error curves over the measured box."""
    given = yaml.safe_load(read_text(find("demo", "cells")))
    given["errors"] |= {"travel_low_m": list(LOW), "travel_high_m": list(HIGH)}
    return cell_from_text(yaml.safe_dump(given), "demo over the box")


def write_rtl(path, lines, step, axis=""):
    """Write a file as laser software does: run, target, deviation in µm, in measured order."""
    first = lines[0]
    assert first.line.direction == FORWARD
    beam = beam_direction(first.line.name, np.asarray(step))
    along = (first.target - first.target[0]) @ beam
    origin = first.target[0] @ beam if first.line.name in "xyz" else 0.0
    rows = []
    for run, line in enumerate(lines, start=1):
        places = (line.target - first.target[0]) @ beam
        for place, reading in zip(places, line.displacement, strict=True):
            number = int(np.argmin(np.abs(along - place))) + 1
            rows.append(f"{run} {number} {1e6 * (reading - place):.3f}")
    path.write_text(
        "HEADER::\nFile type : rtl\n\nTARGET DATA::\n"
        f"Target-count: {len(along)}\nTargets :\n"
        + " ".join(f"{1e3 * (origin + one):.6f}" for one in along)
        + f"\n\nUSER-TEXT::\nMachine: Portal 4\nSerial No: 17\nBy: A. Beispiel\nAxis: {axis}\n"
        f"\nRUNS::\nRun-count:{len(lines)}\n\nDEVIATIONS::\nRun Target Data:\n"
        + "\n".join(rows)
        + "\n\nEOF::\n"
    )
    return path


def files(folder, measurement, says=False):
    made = []
    names = list(dict.fromkeys(line.line.name for line in measurement.lines))
    for number, name in enumerate(names, start=1):
        lines = [line for line in measurement.lines if line.line.name == name]
        told = name if says else f"Diagonal {number}"
        path = folder / f"Diagonal {number}.RTL"
        if name in "xyz":
            path = folder / f"{name}.RTL"
        made.append(write_rtl(path, lines, measurement.volume.step, told))
    return [str(path) for path in made], names


def imported(folder, measurement, *more):
    paths, names = files(folder, measurement)
    bag = folder / "RUN.mcap"
    box = ["--box", *BOX, "--overrun", "0.002", *more]
    assert main(["import", *paths, str(bag), "--axis", *names, *box]) == 0
    return bag


@pytest.mark.parametrize("names", [BODY_DIAGONALS, FACE_DIAGONALS], ids=["body", "faces"])
def test_the_files_of_diagonals_are_one_measurement(tmp_path, names):
    truth = measured("diagonal", names)
    run = load_run(imported(tmp_path, truth))
    assert run.volume == truth.volume
    assert [line.line for line in run.measurement.lines] == [line.line for line in truth.lines]
    assert [line.line for line in run.measurement.lines] == list(run.plan.lines)
    for one, other in zip(run.measurement.lines, truth.lines, strict=True):
        np.testing.assert_array_equal(one.target, other.target)
        assert np.max(np.abs(one.displacement - other.displacement)) < 2 * PRINTED
        assert (one.setup, one.overrun) == (other.setup, 0.002)
    found, expected = (
        diagonal_groups([evaluate(runs) for runs in all_runs(one)])
        for one in (run.measurement, truth)
    )
    assert [group.labels for group in found] == [group.labels for group in expected]
    for group, true in zip(found, expected, strict=True):
        assert abs(group.systematic_deviation - true.systematic_deviation) < 4 * PRINTED
        assert abs(group.reversal_value - true.reversal_value) < 4 * PRINTED
    angles, true_angles = squareness_of(run.measurement), squareness_of(truth)
    assert [one.name for one in angles.values] == [one.name for one in true_angles.values]
    for angle, true in zip(angles.values, true_angles.values, strict=True):
        # At worst D0 / (2 Y Z) = 5.6 per metre, times what rounding does to both lengths.
        assert abs(angle.value - true.value) < 5.6 * 4 * PRINTED


def test_the_bag_keeps_every_file_and_what_they_tell(tmp_path, capsys):
    paths, names = files(tmp_path, measured("diagonal", BODY_DIAGONALS))
    bag = tmp_path / "RUN.mcap"
    assert main(["import", *paths, str(bag), "--json", "--axis", *names, "--box", *BOX]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [one["file"] for one in document["files"]] == paths
    assert document["facts"]["machine"] == "Portal 4"
    with BagReader(bag) as opened:
        kept = {one.name: one.data for one in opened.attachments}
        facts = opened.header.facts
    for number in range(1, 5):
        path = tmp_path / f"Diagonal {number}.RTL"
        assert kept[f"{PREFIX}{path.name}"] == path.read_bytes()
    assert facts["source: ppp: axis_as_told"] == "Diagonal 1"
    assert load_run(bag).machine["name"] == "Portal 4"


@pytest.mark.parametrize("command", ["iso230", "squareness", "solve", "diagnose"])
def test_every_command_takes_the_bag(tmp_path, command):
    bag = imported(tmp_path, measured("diagonal", BODY_DIAGONALS))
    output = ["--output", str(tmp_path / "out")]
    assert main([command, str(bag), *output, "--json", "--pictures", "none"]) == 0


@pytest.mark.parametrize("road", ["as imported", "through tables"])
def test_the_report_says_what_the_files_tell(tmp_path, road):
    bag = imported(tmp_path, measured("diagonal", BODY_DIAGONALS))
    if road == "through tables":
        assert main(["export", str(bag), "--output", str(tmp_path / "tables")]) == 0
        bag = tmp_path / "again.mcap"
        assert main(["import", str(tmp_path / "tables" / "run.csv"), str(bag)]) == 0
    out = tmp_path / "report"
    assert main(["report", str(bag), "--json", "--output", str(out)]) == 0
    (path,) = out.glob("*.json")
    said = json.loads(path.read_text())["sections"]["measurement"]
    assert (said["machine_number"], said["operator"]) == ("17", "A. Beispiel")
    assert said["told_by_source"]["machine"] == "Portal 4"


def test_what_the_user_tells_goes_before_what_the_files_tell(tmp_path):
    bag = imported(tmp_path, measured("diagonal", BODY_DIAGONALS))
    words = ["report", str(bag), "--json", "--operator", "B. Muster"]
    assert main([*words, "--output", str(tmp_path / "other")]) == 0
    (path,) = (tmp_path / "other").glob("*.json")
    assert json.loads(path.read_text())["sections"]["measurement"]["operator"] == "B. Muster"


def test_diagonals_and_axes_together_tell_the_curves(tmp_path):
    diagonals, axes = measured("diagonal", BODY_DIAGONALS), measured("linear", "xyz")
    first, diagonal_names = files(tmp_path, diagonals)
    second, axis_names = files(tmp_path, axes)
    bag = tmp_path / "RUN.mcap"
    names = [*diagonal_names, *(name.upper() for name in axis_names)]
    command = ["import", *first, *second, str(bag), "--axis", *names, "--box", *BOX]
    assert main(command) == 0
    found, _ = solve_reproducibly(load_run(bag).measurement)
    begin = len(diagonals.lines)
    after = tuple(replace(line, line_index=begin + line.line_index) for line in axes.lines)
    true, _ = solve_reproducibly(replace(diagonals, lines=diagonals.lines + after))
    for axis in AXES:
        curve = f"E_{axis}{axis}"
        np.testing.assert_allclose(
            found["least_squares"].curves[curve], true["least_squares"].curves[curve], atol=5e-9
        )


def test_a_file_that_names_its_diagonal_needs_no_option(tmp_path):
    paths, names = files(tmp_path, measured("diagonal", BODY_DIAGONALS), says=True)
    bag = tmp_path / "RUN.mcap"
    assert main(["import", *paths, str(bag), "--box", *BOX]) == 0
    assert list(dict.fromkeys(line.line.name for line in load_run(bag).lines)) == names


@pytest.mark.parametrize("order", ["before", "behind"])
def test_one_file_and_its_axis_in_any_order(tmp_path, order):
    paths, _ = files(tmp_path, measured("diagonal", ["npp"]))
    bag = str(tmp_path / "RUN.mcap")
    said = ["--axis", "npp"]
    command = [*said, paths[0], bag] if order == "before" else [paths[0], bag, *said]
    assert main(["import", "--box", *BOX, *command]) == 0
    assert {line.line.name for line in load_run(bag).lines} == {"npp"}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"--axis": []}, "does not name|calls the axis 'Diagonal 1'"),
        ({"--axis": ["ppp", "npp", "pnp"]}, "3 names"),
        ({"--axis": ["ppp", "npp", "pnp", "pnp"]}, "both given as pnp"),
        ({"--axis": ["ppp", "npp", "pnp", "xyz"]}, "'xyz'.* X, Y, Z, ppp"),
        ({"--axis": ["ppp", "npp", "pnp", "pp0"]}, "pp0 of the box"),
        ({"--box": []}, "--box"),
        ({"--box": [*BOX[:3], "0.1", "0.05", "0.15"]}, "of the box is"),
        ({"--box": [*BOX[3:], *BOX[:3]]}, "must be larger"),
    ],
)
def test_nothing_is_guessed(tmp_path, capsys, change, reason):
    paths, names = files(tmp_path, measured("diagonal", BODY_DIAGONALS))
    options = {"--axis": names, "--box": BOX, **change}
    said = [word for name, value in options.items() if value for word in (name, *value)]
    bag = tmp_path / "RUN.mcap"
    assert main(["import", *paths, str(bag), *said]) == 1
    told = capsys.readouterr().err
    assert re.search(reason, told), told
    assert not bag.exists()


def test_the_same_file_twice_and_boxes_of_another_kind_are_refused(tmp_path, capsys):
    paths, _ = files(tmp_path, measured("diagonal", ["ppp"]))
    copy = tmp_path / "copy.RTL"
    copy.write_bytes((tmp_path / "Diagonal 1.RTL").read_bytes())
    command = ["import", "--box", *BOX, paths[0], str(copy), str(tmp_path / "a.mcap")]
    assert main([*command, "--axis", "ppp", "npp"]) == 1
    assert "the same file" in capsys.readouterr().err
    files(tmp_path, measured("diagonal", ["npp"], blocks=4))
    (tmp_path / "Diagonal 1.RTL").rename(tmp_path / "second.RTL")
    command = ["import", "--box", *BOX, str(copy), str(tmp_path / "second.RTL")]
    assert main([*command, str(tmp_path / "a.mcap"), "--axis", "ppp", "npp"]) == 1
    assert "5 targets" in capsys.readouterr().err
    assert main(["import", str(RTL), str(copy), str(tmp_path / "a.mcap"), "--axis", "X", "Y"]) == 1
    assert not (tmp_path / "a.mcap").exists()
