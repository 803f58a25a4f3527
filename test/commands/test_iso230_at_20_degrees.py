"""``stepdiag iso230 --expansion-per-K``: the parameters of readings that are corrected to 20 °C."""

import json

import pytest
import standard_runs

from stepdiag_ros.cli import main

ALPHA, ABOVE = 11.5e-6, 4.0


def evaluated(capsys, source, folder, *options):
    given = ("iso230", str(source), "--json", "--pictures", "none", "--output", str(folder))
    assert main([*given, *options]) == 0
    return json.loads(capsys.readouterr().out)


def test_every_deviation_is_corrected_and_said_to_be(tmp_path, capsys):
    bag = standard_runs.write_bag(tmp_path / "run.mcap")
    as_read = evaluated(capsys, bag, tmp_path / "a")
    told = ("--expansion-per-K", str(ALPHA), "--material-temperature", str(20.0 + ABOVE))
    at_20 = evaluated(capsys, bag, tmp_path / "b", *told)
    for before, after in zip(as_read["tests"], at_20["tests"], strict=True):
        target = after["target"]
        length = target[-1] - target[0]
        moved = [(one["mean_forward"][-1] - one["mean_forward"][0]) for one in (before, after)]
        assert moved[0] - moved[1] == pytest.approx(ALPHA * ABOVE * length, rel=1e-3)
        assert before["equals_recorded"] is not False and not after["equals_recorded"]
    assert any("20 degC" in text for text in at_20["warnings"])
    assert not any("20 degC" in text for text in as_read["warnings"])


def test_a_table_has_no_temperature_of_the_material(tmp_path, capsys):
    table = tmp_path / "axis.csv"
    table.write_text("cycle,direction,target_mm,position_mm\n1,forward,0,0\n")
    assert main(["iso230", str(table), "--expansion-per-K", str(ALPHA)]) == 1
    assert "axis.csv" in capsys.readouterr().err
