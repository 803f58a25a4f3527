"""The commands of tests by standards: iso230, squareness, volumetric, on bags and tables."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import standard_runs

from stepdiag_ros import cli
from stepdiag_ros.bags import run as bags_run
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.metrology.plausible import NOTHING
from stepdiag_ros.metrology.standards.diagonal_squareness import squareness_of

CASE = Path(__file__).parents[1] / "data" / "cases" / "iso230_2_measured"
STEPS = """\
name: step diagonals
step_m: [0.03, 0.02, 0.025]
blocks: 5
repeats: 2
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}
  - {kind: linear, names: [x, y, z]}
"""
CONDITIONS = """\
device_U_m_per_m: 0.5e-6
misalignment_m: 0.5e-3
temperature_range_K: 0.4
expansion_coefficient_per_K: 11.5e-6
expansion_range_per_K: 2.0e-6
temperature_difference_K: 1.0
environmental_variation_m: 0.2e-6
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return standard_runs.write_bag(tmp_path_factory.mktemp("bag") / "run.mcap")


def stepdiag(capsys, *arguments):
    code = cli.main([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_the_real_axis_shows_the_two_figures_that_depart_from_the_standard(capsys, tmp_path):
    code, out, err = stepdiag(
        capsys,
        "iso230",
        CASE / "data.csv",
        "--axis",
        "X",
        "--published",
        CASE / "published.yaml",
        "--output",
        tmp_path,
    )
    assert code == 0
    rows = [line.split() for line in out.splitlines()]
    verdicts = {row[0]: row[-1] for row in rows if row[-1:] in (["agrees"], ["DIFFERS"])}
    assert {name for name, verdict in verdicts.items() if verdict == "DIFFERS"} == {"R", "E"}
    assert list(verdicts.values()).count("agrees") == 10
    assert (
        "Published figures that depart from ISO 230-2: R (published 0.06290 µm, by the standard"
        " 0.06882 µm); E (published 0.02460 µm, by the standard 0.03680 µm)."
    ) in out
    assert "value / µm, U unknown" in out and " ± " not in out
    assert "iso230_2_X.png" in err
    assert (tmp_path / "iso230_2_X.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "iso230.txt").read_text(encoding="utf-8")
    assert text.splitlines() == [line.rstrip() for line in out.splitlines()]


@pytest.mark.parametrize("pictures", ["none", "svg"])
def test_no_picture_of_an_earlier_evaluation_stays(capsys, tmp_path, pictures):
    (tmp_path / "iso230_2_other.png").write_bytes(b"of somebody who has no results here")
    told = ("--output", tmp_path, "--pictures")
    assert stepdiag(capsys, "iso230", CASE / "data.csv", "--axis", "X", *told, "png")[0] == 0
    assert (tmp_path / "iso230_2_X.png").exists() and (tmp_path / "iso230_2_other.png").exists()
    (tmp_path / "mine.png").write_bytes(b"of the user")
    assert stepdiag(capsys, "iso230", CASE / "data.csv", "--axis", "Y", *told, pictures)[0] == 0
    kept = {"iso230.json", "iso230.txt", "mine.png"}
    kept |= {"iso230_2_Y.svg"} if pictures == "svg" else set()
    assert {path.name for path in tmp_path.iterdir()} == kept


def test_published_figures_that_are_no_parameters_are_refused(capsys, tmp_path):
    published = tmp_path / "p.yaml"
    published.write_text("unit: mm\nparameters: {Q: 1.0}\n")
    code, out, err = stepdiag(capsys, "iso230", CASE / "data.csv", "--published", published)
    assert (code, out) == (1, "")
    assert "'Q' is not a parameter of ISO 230-2" in err
    assert err.count("\n") == 1


def test_a_bag_tells_every_axis_and_diagonal(bag, capsys, tmp_path):
    conditions = tmp_path / "conditions.yaml"
    conditions.write_text(CONDITIONS)
    code, out, _ = stepdiag(
        capsys, "iso230", bag, "--json", "--uncertainty", conditions, "--output", tmp_path / "r"
    )
    assert code == 0
    document = json.loads(out)
    names = [(test["standard"], test["name"]) for test in document["tests"]]
    assert names == [
        *(("ISO 230-6", name) for name in ("ppp", "npp", "pnp", "ppn", "pp0", "np0")),
        *(("ISO 230-2", name) for name in "XYZ"),
    ]
    assert all(test["runs"] == {"forward": 5, "backward": 5} for test in document["tests"])
    body, face = document["diagonals"]
    errors = [test["parameters"]["E"]["value"] for test in document["tests"]]
    assert body["E_d"] == max(errors[:4])
    assert face["E_d"] == max(errors[4:6])
    assert body["expanded_uncertainty_E_d"] > 0
    assert "do not give the volumetric accuracy" in document["warnings"][0]
    names = sorted(path.name for path in (tmp_path / "r").iterdir())
    assert names == [
        "iso230.json",
        "iso230.txt",
        *(f"iso230_2_{axis}.png" for axis in "xyz"),
        "iso230_6_body_diagonals.png",
        "iso230_6_face_diagonals_XY.png",
    ]


def test_without_conditions_the_result_equals_the_recorded_one(bag, capsys, tmp_path):
    code, out, _ = stepdiag(
        capsys, "iso230", bag, "--json", "--pictures", "none", "--output", tmp_path
    )
    document = json.loads(out)
    assert code == 0
    assert all(test["equals_recorded"] is True for test in document["tests"])
    assert all(
        entry["expanded_uncertainty"] is None
        for test in document["tests"]
        for entry in test["parameters"].values()
    )
    assert len(load_run(bag).tests) == 9


def test_a_recorded_test_that_differs_in_one_bit_is_told(bag, capsys, tmp_path, monkeypatch):
    recorded = load_run(bag)
    mean = recorded.tests[0].mean_forward.copy()
    mean[1] = np.nextafter(mean[1], 1.0)
    changed = (replace(recorded.tests[0], mean_forward=mean), *recorded.tests[1:])
    monkeypatch.setattr(bags_run, "load_run", lambda *_: replace(recorded, tests=changed))
    code, out, _ = stepdiag(capsys, "iso230", bag, "--pictures", "none", "--output", tmp_path)
    assert code == 0
    assert "ppp diagonal: NOT the same numbers as the result recorded in the bag." in out
    assert out.count("NOT the same numbers") == 1


def test_squareness_of_a_bag_in_both_signs(bag, capsys, tmp_path):
    code, out, _ = stepdiag(capsys, "squareness", bag, "--json", "--output", tmp_path)
    assert code == 0
    document = json.loads(out)
    true = {"C0Y": 30e-6, "B0Z": -20e-6, "A0Z": 25e-6}
    assert len(document["squareness"]) == 4
    for one in document["squareness"]:
        # The cell's straightness ends where it begins; noise is five times smaller than this.
        assert one["rotation"] == pytest.approx(true[one["name"]], abs=1e-6)
        assert one["angle"] == one["rotation"] * (-1 if one["name"] == "B0Z" else 1)
    assert abs(document["closure"]) < 4 * document["closure_standard_uncertainty"]
    measurement = load_run(bag).measurement
    # How large the rotations are taken that are in these uncertainties, and nothing else.
    [remark] = document["remarks"]
    assert f"{measurement.plausible.rotation * 1e6:g} µrad" in remark
    assert (tmp_path / "squareness_sensitivity.png").is_file()
    told = [one["standard_uncertainty"] for one in document["squareness"]]

    def uncertainties(plausible):
        told = squareness_of(replace(measurement, plausible=plausible)).values
        return [one.standard_uncertainty for one in told]

    assert told == uncertainties(measurement.plausible)
    by_noise = uncertainties(NOTHING)
    assert min(by_noise) > 0.0 and max(by_noise) < 0.5e-6
    # Rotations lengthen diagonals as a squareness does: as large as they are, far beyond noise.
    twice = replace(measurement.plausible, rotation=2.0 * measurement.plausible.rotation)
    assert uncertainties(twice) == pytest.approx([2.0 * u for u in told], rel=0.01)


def test_squareness_from_step_diagonals_warns_of_what_is_not_known(capsys, tmp_path):
    bag = standard_runs.write_bag(tmp_path / "steps.mcap", STEPS)
    code, out, _ = stepdiag(capsys, "squareness", bag, "--pictures", "none")
    assert code == 0
    assert "C0Y  Y to X  ppp, npp, pnp, ppn" in out
    assert "right-handed rotation" in out
    assert "larger than 90°" in out
    assert "it is not known that both ends were approached in the same direction" in out
    assert "Warning: diagonal tests alone" in out


def test_squareness_of_a_table_by_hand(capsys, tmp_path):
    table = tmp_path / "d.csv"
    header = (
        "diagonal,start_x_mm,start_y_mm,start_z_mm,finish_x_mm,finish_y_mm,finish_z_mm,length_mm"
    )
    table.write_text(f"{header}\npp0,0,0,0,400,300,0,500.005\nnp0,400,0,0,0,300,0,499.999\n")
    assert stepdiag(capsys, "squareness", table)[0] == 0
    assert (tmp_path / "d_squareness" / "squareness_sensitivity.png").exists()
    code, out, _ = stepdiag(capsys, "squareness", table, "--pictures", "none", "--json")
    assert code == 0
    (one,) = json.loads(out)["squareness"]
    assert not (tmp_path / "d_squareness" / "squareness_sensitivity.png").exists()
    assert one["theta"] == pytest.approx(0.5 * 6e-6 / 0.24)
    assert one["standard_uncertainty"] is None
    table.write_text(f"{header}\npp0,0,0,0,400,300,0,500.005\nnp0,390,0,0,0,300,0,492.036\n")
    code, out, err = stepdiag(capsys, "squareness", table)
    assert (code, out) == (1, "")
    assert "diagonals must start and finish at identical coordinates" in err


@pytest.mark.parametrize(
    ("command", "option"),
    [
        ("iso230", ("--run", "foo")),
        ("iso230", ("--material-temperature", "22")),
        ("iso230", ("--expansion-per-K", "11.5e-6")),
        ("squareness", ("--run", "foo")),
        ("diagnose", ("--run", "foo")),
    ],
)
def test_an_option_that_a_table_has_no_use_for_is_refused(capsys, tmp_path, command, option):
    code, out, err = stepdiag(
        capsys, command, CASE / "data.csv", *option, "--output", tmp_path / "made"
    )
    assert (code, out) == (1, "") and f"data.csv: {option[0]} " in err
    assert not (tmp_path / "made").exists()


def test_a_bag_names_its_axes_itself(capsys, tmp_path):
    given = ("iso230", tmp_path / "run.mcap", "--axis", "X", "--output", tmp_path / "made")
    code, out, err = stepdiag(capsys, *given)
    assert (code, out) == (1, "") and "run.mcap: --axis " in err


def test_the_examples_of_volumetric_accuracy(capsys, tmp_path):
    code, out, _ = stepdiag(capsys, "volumetric", "--output", tmp_path)
    assert code == 0
    lines = [line.strip() for line in out.splitlines() if "," in line]
    rows = {line.rsplit(",", 1)[0]: line.split() for line in lines}
    assert rows["diagonal test result E_d"][-3:] == ["0.0", "28.9", "14.4"]
    assert rows["volumetric accuracy"][-3:] == ["122.5", "50.0", "114.6"]
    assert "worst position error, µm                35.36" in out
    assert (tmp_path / "diagonals_and_volume.png").is_file()
    assert stepdiag(capsys, "volumetric", "--output", tmp_path, "--pictures", "none")[0] == 0
    assert not (tmp_path / "diagonals_and_volume.png").exists()


def test_volumetric_accuracy_of_a_bag(capsys, tmp_path):
    bag = standard_runs.write_bag(tmp_path / "steps.mcap", STEPS)
    code, out, _ = stepdiag(capsys, "volumetric", bag, "--json", "--pictures", "none")
    assert code == 0
    methods = json.loads(out)["methods"]
    found = methods["least_squares"]
    assert 1e-6 < found["value"] < 20e-6
    # Angles of 10 µrad over this box, of which the lines determine few.
    assert 0 < found["standard_uncertainty"] < 2e-6
    assert "E_YX" in found["frame"]


def test_a_bag_without_diagonals_is_refused(capsys, tmp_path):
    plan = STEPS.replace(
        "  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}\n", ""
    )
    bag = standard_runs.write_bag(tmp_path / "linear.mcap", plan)
    code, out, err = stepdiag(capsys, "squareness", bag)
    assert (code, out) == (1, "")
    assert "there is no face or body diagonal" in err


def test_a_table_and_its_bag_call_the_axis_and_themselves_by_the_same_form(capsys, tmp_path):
    rows = [
        f"{cycle},{direction},{target},{target + 1e-4 * (target + cycle):.5f}"
        for cycle in (1, 2)
        for direction, targets in (("forward", (0, 10, 25)), ("backward", (25, 10, 0)))
        for target in targets
    ]
    table, run = tmp_path / "x.csv", tmp_path / "x.mcap"
    table.write_text("\n".join(["cycle,direction,target_mm,position_mm", *rows]) + "\n")
    assert stepdiag(capsys, "import", table, "--axis", "X")[0] == 0
    first = stepdiag(capsys, "iso230", table, "--pictures", "none")
    second = stepdiag(capsys, "iso230", run, "--pictures", "none")
    for _, out, _ in (first, second):
        assert "axis X" in out and "axis x" not in out
        assert "\nX: " in out and "\nx: " not in out
    # What replaces another result is named, and a table has no identity to name.
    assert "x_iso230" in second[2] and "''" not in second[2]
    assert load_run(run).run_id in second[2]
    third = stepdiag(capsys, "iso230", table, "--pictures", "none")
    assert load_run(run).run_id in third[2] and "''" not in third[2]
