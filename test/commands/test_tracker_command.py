"""``stepdiag tracker`` from plan to result, and what it refuses."""

import json

import numpy as np
import pytest
from refused import a_fault, refused

from stepdiag_ros import cli
from stepdiag_ros.configuration import available, find, load_tracker
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.schemas import identifier

PLACE = ["--station", "-0.2", "0.1", "0.05"]
BOX = ["--box", 0, 0, 0, 0.12, 0.12, 0.12]
FOUR = [
    *("--station", "-0.2", "-0.2", "-0.1", "--station", "0.3", "-0.2", "-0.15"),
    *("--station", "0.05", "0.35", "-0.1", "--station", "0.05", "-0.3", "0.35"),
]


def run(capsys, *arguments):
    code = cli.main(["tracker", *map(str, arguments)])
    return code, *capsys.readouterr()


@pytest.fixture
def cell(tmp_path):
    """The demo cell's errors over the whole travel of the demo machine."""
    text = find("demo", "cells").read_text()
    text = text.replace("[0.0, 0.0, 0.0]", "[-0.05, -0.05, -0.05]", 1)
    path = tmp_path / "large.yaml"
    path.write_text(text.replace("[0.12, 0.12, 0.12]", "[0.9, 0.5, 0.35]"))
    return path


@pytest.fixture
def readings(tmp_path, cell, capsys):
    plan = tmp_path / "plan"
    few = ["--targets", 5, "--runs", 2, "--pictures", "none"]
    assert run(capsys, "plan", "--machine", "demo", *PLACE, *few, "--output", plan)[0] == 0
    code, out, _ = run(capsys, "simulate", plan / "places.csv", *PLACE, "--cell", cell)
    assert code == 0
    assert "readings" in out
    return plan / "readings.csv"


def test_plan_shows_the_lines_and_writes_places_program_and_picture(tmp_path, capsys):
    code, out, _ = run(
        capsys,
        "plan",
        "--machine",
        "demo",
        *PLACE,
        "--targets",
        5,
        "--runs",
        1,
        "--nc",
        "--output",
        tmp_path / "p",
    )
    assert code == 0
    assert {path.name for path in (tmp_path / "p").iterdir()} == {
        "places.csv",
        "plan.yaml",
        "station_1.nc",
        "places.png",
    }
    for name in ("x", "y", "z", "xy", "xz", "yz", "xyz"):
        assert f"\n {name} " in out
    assert "conventional laser" in out
    assert (tmp_path / "p" / "station_1.nc").read_text().count("G4 P3000") == 10 + 7 * 2 * 5


def test_a_gantry_of_the_documents_size_from_plan_to_squareness(tmp_path, capsys):
    """ATLI section 3: 1400 x 700 x 600 mm. All of its errors act, and the truth is in the band."""
    plan = tmp_path / "gantry"
    place = ["--station", -0.12, -0.1, 0.05]
    few = ["--targets", 8, "--runs", 2, "--pictures", "none", "--json"]
    code, out, _ = run(
        capsys, "plan", "--machine", "gantry", *place, *few, "--tracker", "ideal", "--output", plan
    )
    assert code == 0
    document = json.loads(out)
    assert document["schema"] == identifier("tracker_plan")
    (duration,) = document["durations"]
    assert 1.8 < duration["laser"] / duration["tracker"] < 3.2
    assert run(capsys, "simulate", plan / "places.csv", *place, "--cell", "gantry")[0] == 0
    how = ["--chain", "XYZ", "--cell", "gantry", "--json", "--pictures", "none"]
    code, out, _ = run(capsys, "evaluate", plan / "readings.csv", *how)
    assert code == 0
    joint = json.loads(out)["joint"]
    spread = np.sqrt(np.diag(joint["covariance"]))
    assert np.all(np.abs(np.array(joint["values"]) - joint["truth"]) < 3.0 * spread)
    assert np.all(spread[3:] < 15e-6)


def test_evaluate_writes_text_json_and_pictures(readings, cell, capsys):
    code, out, _ = run(capsys, "evaluate", readings, "--cell", cell, "--chain", "YXZ")
    assert code == 0
    folder = readings.parent / "readings_evaluate"
    assert {path.name for path in folder.iterdir()} == {
        "tracker_evaluate.json",
        "tracker_evaluate.txt",
        "tracker_location.png",
        "seven_lines.png",
    }
    document = json.loads((folder / "tracker_evaluate.json").read_text())
    assert len(document["lines_with_tracker_from_places"]["tests"]) == 7
    assert "right-handed" in document["squareness_sign"]
    np.testing.assert_allclose(document["location"]["position"], [-0.2, 0.1, 0.05], atol=50e-6)
    assert "C0Y" in out
    joint = document["joint"]
    assert document["schema"] == identifier("tracker_result")
    spread = np.sqrt(np.diag(joint["covariance"]))
    assert np.max(np.abs(np.array(joint["values"]) - joint["truth"]) / spread) < 3.5
    assert joint["chain"] == "YXZ"


def test_a_machine_is_not_simulated_beyond_its_errors(tmp_path, capsys):
    plan = tmp_path / "plan"
    few = ["--targets", 5, "--runs", 1, "--pictures", "none"]
    assert run(capsys, "plan", "--machine", "demo", *PLACE, *few, "--output", plan)[0] == 0
    code, out, err = run(capsys, "simulate", plan / "places.csv", *PLACE, "--cell", "demo")
    assert (code, out) == (1, "")
    assert "900 mm" in err
    assert "0 to 120 mm" in err
    assert not (plan / "readings.csv").exists()


def test_locate_prints_the_place_as_json(readings, capsys):
    code, out, _ = run(capsys, "locate", readings, "--json", "--pictures", "none")
    assert code == 0
    document = json.loads(out)
    assert len(document["location"]["residuals"]) == 10
    assert "joint" not in document


def test_multilateration_from_plan_to_curves(tmp_path, capsys):
    plan = tmp_path / "grid"
    more = ["--grid", 3, "--tracker", "ideal", "--pictures", "none", "--output", plan]
    assert run(capsys, "plan", *BOX, *FOUR, *more)[0] == 0
    measured = ["--cell", "angular", "--tracker", "ideal"]
    assert run(capsys, "simulate", plan / "places.csv", *FOUR, *measured)[0] == 0
    code, out, _ = run(
        capsys,
        "multilaterate",
        plan / "readings.csv",
        "--chain",
        "YXZ",
        "--cell",
        "angular",
        "--json",
        "--pictures",
        "none",
    )
    assert code == 0
    document = json.loads(out)
    assert document["schema"] == identifier("result")
    found = document["methods"]["multilateration"]
    assert found["comparison_with_truth"]["rms"] < 5e-9
    assert found["curves"]["E_CZ"][1] is None
    assert found["figures"]["C0Y"]["standard_uncertainty"] < 1e-7


def test_figures_say_the_printed_range(tmp_path, capsys):
    code, out, _ = run(capsys, "figures", "--output", tmp_path)
    assert code == 0
    assert "-20.4 µm, falls to -33.6 µm" in " ".join(out.split())
    assert (tmp_path / "atli_figure_4.png").stat().st_size > 10_000
    assert (tmp_path / "atli_figure_5.png").stat().st_size > 10_000
    document = json.loads((tmp_path / "tracker_figures.json").read_text())
    assert [one["label"] for one in document["figure_4"]] == [
        "line runs towards the tracker",
        "line runs away from the tracker",
    ]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["evaluate", "none.csv"], "there is no table none.csv"),
        (["plan", "--machine", "demo", "--station", 0.4, 0.2, 0.1, "--runs", 0], "0 runs"),
        (["plan", "--machine", "nothing", *PLACE], "there is no machine 'nothing'"),
        (["plan", "--box", 0, 0, 0, 1, 1, -1, *PLACE], "below its upper"),
        (["plan", "--machine", "demo", *PLACE, "--tracker", "x"], "there is no tracker 'x'"),
        (["plan", "--machine", "demo", *PLACE, "--grid", 1], "1 places along an axis"),
    ],
)
def test_one_sentence_for_what_cannot_be_done(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *arguments)
    assert code == 1
    assert out == ""
    assert err.startswith("stepdiag: error: ")
    assert words in err
    assert list(tmp_path.iterdir()) == []


def test_several_stations_must_be_chosen_from(readings, capsys):
    text = readings.read_text()
    rows = text.splitlines()
    more = [row.replace("1,", "2,", 1) for row in rows[1:]]
    readings.write_text("\n".join([*rows, *more]) + "\n")
    code, _, err = run(capsys, "locate", readings, "--pictures", "none")
    assert code == 1
    assert "choose one with --station" in err
    code, _, err = run(capsys, "locate", readings, "--station", "7")
    assert "there is no station '7'" in err
    assert run(capsys, "locate", readings, "--station", "2", "--pictures", "none")[0] == 0


def test_nothing_is_overwritten_without_force(readings, cell, capsys):
    measured = readings.read_text()
    again = ["simulate", readings.parent / "places.csv", *PLACE, "--cell", cell, "--seed", 1]
    code, _, err = run(capsys, *again)
    assert code == 1
    assert "is there already; --force" in err
    assert readings.read_text() == measured
    assert run(capsys, *again, "--force")[0] == 0
    assert readings.read_text() != measured


@pytest.mark.parametrize("name", available("trackers"))
def test_trackers_of_the_package(name):
    assert load_tracker(name)[0].minimum_range > 0


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("minimum_range_m: -1", a_fault("out_of_range", "-1", about="minimum_range_m")),
        ("maximum_range_m: 0.01", a_fault("mismatch", "maximum_range_m")),
        ("lowest_elevation_deg: 90", a_fault("mismatch", "highest_elevation_deg")),
        ("upright: [0, 0, 0]", a_fault("malformed", "tracker.yaml")),
        ("held_by: roof", a_fault("unknown", "roof", about="held_by")),
        ("hight: 1", a_fault("unknown", about="hight")),
    ],
)
def test_a_wrong_tracker_file_is_refused_with_its_key(line, words, tmp_path):
    path = tmp_path / "tracker.yaml"
    path.write_text(line + "\n")
    with refused(Refusal, words):
        load_tracker(path)
