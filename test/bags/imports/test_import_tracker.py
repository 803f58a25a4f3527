"""The table of a tracker becomes a bag, and comes back byte for byte."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refused import refused

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.export import TRACKER_FILE, export_bag
from stepdiag_ros.bags.imports.imported import ImportOptions
from stepdiag_ros.bags.imports.registry import import_file
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.tracker_table import table_text
from stepdiag_ros.cli import main
from stepdiag_ros.configuration import load_cell, load_tracker
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.campaign import simulate_readings
from stepdiag_ros.metrology.tracker.measured_lines import readings_of
from stepdiag_ros.metrology.tracker.seven_lines import make_test

STATION = np.array([-0.15, 0.15, -0.15])
TRACKER = load_tracker("demo")[0]


def readings(targets=5, runs=1, seed=0):
    box = Box(np.zeros(3), np.full(3, 0.12))
    planned = make_test(box, STATION, TRACKER, targets=targets, runs=runs, locating=7).readings()
    return simulate_readings(planned, [STATION], TRACKER, load_cell("demo")[0], seed)


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "readings.csv"
    path.write_text(table_text(readings()), encoding="utf-8")
    return path


@settings(max_examples=12)
@given(st.integers(5, 8), st.integers(1, 3), st.integers(0, 2**32))
def test_a_table_comes_back_byte_for_byte(tmp_path_factory, targets, runs, seed):
    folder = tmp_path_factory.mktemp("table")
    text = table_text(readings(targets, runs, seed))
    (folder / "t.csv").write_text(text, encoding="utf-8")
    import_file(folder / "t.csv", folder / "t.mcap", ImportOptions(chain="YXZ"))
    run = load_run(folder / "t.mcap")
    assert table_text(readings_of(run.plan, run.lines)) == text
    export_bag(folder / "t.mcap", folder / "again")
    assert (folder / "again" / TRACKER_FILE).read_text(encoding="utf-8") == text


def test_bag_and_table_are_evaluated_alike(table, tmp_path, capsys):
    bag = tmp_path / "run.mcap"
    assert main(["import", str(table), str(bag), "--chain", "YXZ"]) == 0
    capsys.readouterr()
    documents = []
    for source in ([str(bag)], [str(table), "--chain", "YXZ"]):
        command = ["tracker", "evaluate", *source, "--json", "--pictures", "none"]
        assert main([*command, "--output", str(tmp_path / "results")]) == 0
        documents.append(json.loads(capsys.readouterr().out))
    for document in documents:
        document["sentences"] = [one for one in document["sentences"] if "Lines:" not in one]
        del document["source"]
    assert documents[0] == documents[1]
    assert documents[0]["verdict"]["name"] == "CONSISTENT"


def test_without_a_chain_no_uncertainty_is_given(table, tmp_path, capsys):
    bag = tmp_path / "run.mcap"
    assert main(["import", str(table), str(bag)]) == 0
    assert "--chain" in capsys.readouterr().err
    arguments = ["tracker", "evaluate", str(bag), "--json", "--pictures", "none"]
    assert main([*arguments, "--output", str(tmp_path / "results")]) == 0
    joint = json.loads(capsys.readouterr().out)["joint"]
    assert joint["chain"] is None
    assert all(value is None for row in joint["covariance"] for value in row)


def refusal_of(path, tmp_path, text):
    path.write_text(text, encoding="utf-8")
    with refused(TableError, None, path.name) as error:
        import_file(path, tmp_path / "no.mcap", ImportOptions())
    assert not (tmp_path / "no.mcap").exists()
    return str(error.value)


def test_a_table_that_does_not_fit_together_leaves_no_bag(table, tmp_path):
    rows = table.read_text(encoding="utf-8").splitlines(keepends=True)
    first_of_x = next(number for number, row in enumerate(rows) if ",x,1,forward,0" in row)
    assert "line x" in refusal_of(
        table, tmp_path, "".join(rows[:first_of_x] + rows[first_of_x + 1 :])
    )
    assert "station 1" in refusal_of(table, tmp_path, "".join(rows[:4]))


def test_a_chain_is_for_a_tracker_alone(tmp_path, capsys):
    path = tmp_path / "x.csv"
    path.write_text("target_mm,cycle,direction,position_mm\n0,1,forward,0\n", encoding="utf-8")
    assert main(["import", str(path), "--chain", "YXZ", "--axis", "X"]) == 1
    assert "--chain" in capsys.readouterr().err
