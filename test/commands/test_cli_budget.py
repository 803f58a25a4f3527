"""``stepdiag budget``, and ``solve --expansion-per-K``, on a bag made from a run table."""

import csv
import json
from pathlib import Path

import pytest

from stepdiag_ros.cli import main

CASE = Path(__file__).parents[1] / "data" / "cases" / "four_diagonals"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """The first two repeats of one direction of a case: enough for every source, and quick."""
    folder = tmp_path_factory.mktemp("budget")
    with (CASE / "run.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    kept = [row for row in rows if int(row["repeat"]) < 2 and row["direction"] == "forward"]
    with (folder / "run.csv").open("w", newline="") as table:
        writer = csv.DictWriter(table, rows[0].keys())
        writer.writeheader()
        writer.writerows(kept)
    (folder / "case.yaml").write_text((CASE / "case.yaml").read_text())
    assert main(["import", str(folder / "run.csv"), str(folder / "run.mcap")]) == 0
    return folder / "run.mcap"


def test_a_budget_is_printed_and_written(bag, tmp_path, capsys):
    arguments = ["budget", str(bag), "--instrument", "demo", "--output", str(tmp_path / "out")]
    assert main([*arguments, "--json", "--pictures", "svg"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["method"] == "least_squares"
    assert json.loads((tmp_path / "out" / "budget.json").read_text()) == document
    assert "Positioning error" in (tmp_path / "out" / "budget.txt").read_text()
    assert (tmp_path / "out" / "budget.svg").exists()
    assert (tmp_path / "out" / "budget_curves.svg").exists()
    assert document["monte_carlo"] is None


def test_without_an_instrument_everything_but_the_readings_is_unknown(bag, tmp_path, capsys):
    arguments = ["--pictures", "none", "--output", str(tmp_path)]
    assert main(["budget", str(bag), *arguments, "--method", "setup_robust"]) == 0
    text = capsys.readouterr().out
    assert "lower bounds: laser wavelength" in text
    assert "Setup-robust" in text
    assert "≥" in text


def test_monte_carlo_on_request(bag, tmp_path, capsys):
    options = ["--pictures", "none", "--output", str(tmp_path), "--trials", "50000"]
    options += ["--instrument", "simulated", "--monte-carlo", "--method", "conventional"]
    assert main(["budget", str(bag), *options]) == 0
    text = capsys.readouterr().out
    assert "50,000 trials" in text
    assert "pass" in text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--instrument", "nothing"], "there is no instrument 'nothing'"),
        (["--method", "wang"], "'wang' is not a method"),
        (["--material-temperature", "22"], "give --expansion-per-K too"),
        (["--coverage", "95"], "not between 0.5 and 0.9999"),
    ],
)
def test_what_cannot_be_is_said_in_one_sentence(bag, tmp_path, capsys, options, words):
    try:
        code = main(["budget", str(bag), "--output", str(tmp_path / "none"), *options])
    except SystemExit as stopped:
        code = stopped.code
    assert code in (1, 2)
    assert words in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def positioning(document, method="least_squares"):
    return document["methods"][method]["figures"]["positioning E_XX"]["value"]


def test_solve_corrects_to_20_degrees_and_says_so(bag, tmp_path, capsys):
    options = ["--pictures", "none", "--json", "--output", str(tmp_path)]
    assert main(["solve", str(bag), *options]) == 0
    raw = json.loads(capsys.readouterr().out)
    correction = ["--expansion-per-K", "11.5e-6", "--material-temperature", "24"]
    assert main(["solve", str(bag), *options, *correction]) == 0
    corrected = json.loads(capsys.readouterr().out)
    # 120 mm · 4 K · 11.5 µm/(m K)
    assert positioning(raw) - positioning(corrected) == pytest.approx(5.52e-6, abs=2e-9)
    remarks = " ".join(corrected["run"]["remarks"])
    assert "corrected to 20 degC (ISO 1) with 11.5 µm/(m K)" in remarks
    assert "the bag keeps the uncorrected readings" in remarks
    assert "20 degC" not in " ".join(raw["run"]["remarks"])
