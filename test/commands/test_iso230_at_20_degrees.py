"""``--expansion-per-K`` of iso230 and report: results of readings that are corrected to 20 °C."""

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


def made(folder, *command):
    """Return the document that a command writes into a folder."""
    assert main([*command, "--output", str(folder)]) == 0
    (path,) = folder.glob("*.json")
    return json.loads(path.read_text())


@pytest.mark.parametrize("told", [(), ("--expansion-per-K", str(ALPHA))])
def test_a_report_states_what_solve_and_iso230_state(tmp_path, told):
    bag = str(standard_runs.write_bag(tmp_path / "run.mcap"))
    told = told and (*told, "--material-temperature", str(20.0 + ABOVE))
    report = made(tmp_path / "report", "report", bag, "--json", *told)
    sections = report["sections"]
    tests = made(tmp_path / "iso", "iso230", bag, "--pictures", "none", *told)["tests"]
    for one, same in zip(sections["axes"]["tests"], tests, strict=True):
        assert one["parameters"] == same["parameters"]
    solved = made(tmp_path / "solve", "solve", bag, "--pictures", "none", *told)
    assert sections["curves"]["methods"] == solved["methods"]
    sources = {one["name"] for one in sections["uncertainty"]["sources"]}
    assert ("expansion coefficient" in sources) == bool(told)
    remarks = sections["curves"]["run"]["remarks"]
    assert any("(ISO 1)" in one for one in remarks) == bool(told)


def test_a_table_has_no_temperature_of_the_material(tmp_path, capsys):
    table = tmp_path / "axis.csv"
    table.write_text("cycle,direction,target_mm,position_mm\n1,forward,0,0\n")
    assert main(["iso230", str(table), "--expansion-per-K", str(ALPHA)]) == 1
    assert "axis.csv" in capsys.readouterr().err
