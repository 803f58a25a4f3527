"""``--direct``: what was measured directly, in the commands that solve a bag."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from stepdiag_ros import cli, notebook
from stepdiag_ros.metrology.geometry import ROTATIONS

CASE = Path(__file__).parents[1] / "data" / "cases" / "null_rich"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    target = tmp_path_factory.mktemp("direct") / "run.mcap"
    assert cli.main(["import", str(CASE / "run.csv"), str(target)]) == 0
    return target


@pytest.fixture(scope="module")
def measured_angles(tmp_path_factory):
    """A file of angles that no test changes."""
    return written_angles(tmp_path_factory.mktemp("angles"))


@pytest.fixture
def angles(tmp_path):
    return written_angles(tmp_path)


def written_angles(folder):
    rng = np.random.default_rng(1)
    rows = ["# autocollimator", "name,position_m,value,standard_uncertainty"]
    for name in ROTATIONS:
        rows += [f"{name},{0.01 * k!r},{3e-7 * rng.standard_normal()},3e-7" for k in range(13)]
    path = folder / "angles.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def solved(bag, folder, *options):
    arguments = ["solve", str(bag), "--pictures", "none", "--output", str(folder)]
    assert cli.main([*arguments, *options]) == 0
    return json.loads((folder / "results.json").read_text())


@pytest.fixture(scope="module")
def told(bag, measured_angles, tmp_path_factory):
    """Return the document of a solve with the angles."""
    return solved(bag, tmp_path_factory.mktemp("told"), "--direct", str(measured_angles))


def test_the_document_says_by_which_file_it_can_be_had_again(bag, measured_angles, told, tmp_path):
    plain = solved(bag, tmp_path / "plain")
    assert plain["direct"] == []
    assert told["direct"] == [
        {
            "file": str(measured_angles),
            "sha256": hashlib.sha256(measured_angles.read_bytes()).hexdigest(),
            "errors": list(ROTATIONS),
        }
    ]
    assert solved(bag, tmp_path / "again", "--direct", str(measured_angles)) == told
    here, there = (one["methods"]["least_squares"] for one in (told, plain))
    assert here["degrees_of_freedom"] == there["degrees_of_freedom"]
    assert set(here["curves"]) - set(there["curves"]) == set(ROTATIONS)
    assert None not in told["methods"]["rigid_body"]["curves"]["E_BY"]
    for method in ("setup_robust", "conventional"):
        assert told["methods"][method]["curves"] == plain["methods"][method]["curves"]
        assert len(told["methods"][method]["remarks"]) > len(plain["methods"][method]["remarks"])


def test_a_notebook_says_the_same(bag, measured_angles, told):
    report = notebook.solve(notebook.open_run(bag), direct=[measured_angles])
    expected = told["methods"]["least_squares"]["curves"]["E_BY"]
    assert list(report.preferred().curves["E_BY"]) == expected


def test_budget_and_report_weigh_it_in_too(bag, angles, tmp_path, capsys):
    options = ["--direct", str(angles), "--output", str(tmp_path / "out"), "--json"]
    assert cli.main(["budget", str(bag), "--pictures", "none", *options]) == 0
    budget = json.loads(capsys.readouterr().out)
    assert any(source["group"] == "measured directly" for source in budget["sources"])
    assert cli.main(["report", str(bag), *options]) == 0
    report = (tmp_path / "out" / "report.json").read_text()
    assert hashlib.sha256(angles.read_bytes()).hexdigest() in report


@pytest.mark.parametrize(
    ("old", "new"), [("0.01,", "0.01x,"), (",3e-7", ","), ("E_BX,0.01", "E_QX,0.01")]
)
def test_a_wrong_file_ends_the_solve_and_is_named(bag, angles, tmp_path, capsys, old, new):
    angles.write_text(angles.read_text().replace(old, new))
    arguments = ["solve", str(bag), "--direct", str(angles), "--output", str(tmp_path / "r")]
    assert cli.main(arguments) == 1
    said = capsys.readouterr()
    assert said.out == "" and "Traceback" not in said.err
    assert str(angles) in said.err
    assert not (tmp_path / "r").exists()


def test_angles_need_the_order_of_the_axes(angles, tmp_path, capsys):
    bag = tmp_path / "nameless.mcap"
    table = tmp_path / "run.csv"
    table.write_bytes((CASE / "run.csv").read_bytes())
    assert cli.main(["import", str(table), str(bag)]) == 0
    capsys.readouterr()
    assert cli.main(["solve", str(bag), "--direct", str(angles)]) == 1
    assert "chain" in capsys.readouterr().err
