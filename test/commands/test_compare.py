"""``stepdiag compare``: a bag beside a table of direct measurements."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from stepdiag_ros import cli
from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.plots.files import experiment as experiment_figures

CASE = Path(__file__).parents[1] / "data" / "cases" / "null_rich"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    target = tmp_path_factory.mktemp("compare") / "run.mcap"
    assert cli.main(["import", str(CASE / "run.csv"), str(target)]) == 0
    return target


@pytest.fixture
def table(tmp_path):
    truth = yaml.safe_load((CASE / "truth.yaml").read_text())
    rows = ["name,position_m,value,standard_uncertainty,definition"]
    for name in TRANSLATIONS:
        rows += [
            f"{name},{position},{float(value)!r},1e-7,"
            for position, value in zip(0.01 * np.arange(13), truth[name], strict=True)
        ]
    rows.append("C0Y,,-2.0e-5,1e-6,rotation")
    path = tmp_path / "artefact.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_tables_and_pictures(bag, table, tmp_path, capsys, monkeypatch):
    folder = tmp_path / "out"
    monkeypatch.setattr(
        experiment_figures,
        "draw_experiment",
        lambda found: {
            "direct_comparison": experiment_figures.direct_comparison(found.comparison_to_draw())
        },
    )
    code = cli.main(["compare", str(bag), "--measured", str(table), "--output", str(folder)])
    said = capsys.readouterr()
    assert code == 0
    assert "Table 1" in said.out and "E_n" in said.out and "Measured" in said.out
    names = {path.name for path in folder.iterdir()}
    assert names == {"table_1.txt", "table_1.json", "direct_comparison.png"}
    assert (folder / "direct_comparison.png").read_bytes().startswith(b"\x89PNG")
    assert str(folder) in said.err


def test_json(bag, table, tmp_path, capsys):
    arguments = ["compare", str(bag), "--measured", str(table), "--json", "--pictures", "none"]
    assert cli.main([*arguments, "--output", str(tmp_path / "out")]) == 0
    document = json.loads(capsys.readouterr().out)
    compared = {one["method"]: one for one in document["comparisons"]}
    errors = np.array(
        [
            error
            for curve in compared["least_squares"]["curves"].values()
            for error in curve["normalised_error"]
            if error is not None
        ]
    )
    assert np.mean(np.abs(errors) <= 1.0) > 0.95
    assert compared["least_squares"]["squareness"]["C0Y"]["direct"] == pytest.approx(-2.0e-5)


def test_what_cannot_be_compared_is_refused_and_nothing_is_written(bag, table, tmp_path, capsys):
    wrong = tmp_path / "wrong.csv"
    wrong.write_text(table.read_text().replace("E_XX,0.0,", "E_XW,0.0,", 1))
    beyond = tmp_path / "beyond.csv"
    beyond.write_text(table.read_text() + "E_YX,0.3,0,1e-7,\n")
    folder = tmp_path / "out"
    for path, message in (
        (wrong, "wrong.csv, row 2: 'E_XW' is not an error"),
        (beyond, "beyond.csv: E_YX was measured directly at X = 0.3 m, outside"),
        (tmp_path / "nothing.csv", "nothing.csv: cannot be read"),
    ):
        arguments = ["compare", str(bag), "--measured", str(path), "--output", str(folder)]
        assert cli.main(arguments) == 1
        said = capsys.readouterr().err
        assert message in said and said.count("\n") == 1
    assert not folder.exists()
