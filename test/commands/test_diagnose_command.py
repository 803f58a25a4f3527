"""``stepdiag diagnose`` on a run table in which a backlash was hidden by plain arithmetic."""

import csv
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from standard_runs import measured, message_of, write_bag, write_messages

from stepdiag_ros.cli import main
from stepdiag_ros.configuration import load_machine
from stepdiag_ros.metrology import effects
from stepdiag_ros.metrology.effects.backlash import EFFECT
from stepdiag_ros.metrology.solvers import limits

CASE = Path(__file__).parents[1] / "data" / "cases" / "four_diagonals"
LOST_MOTION = 6e-7
PLAN = Path(__file__).parents[2] / "config" / "plans" / "demo.yaml"
FILES = ("diagnosis.json", "diagnosis.txt", "diagnosis.html", "gap_map.png", "candidates.png")


@pytest.fixture(autouse=True)
def small_catalogue(monkeypatch):
    """Try backlash alone: what the whole catalogue finds is the engine's own test."""
    monkeypatch.setattr(effects, "catalogue", lambda: {EFFECT.name: EFFECT})


def _run(folder, lost_motion, repeats=2):
    """Write a run table with a backlash of Y."""
    folder.mkdir(exist_ok=True)
    with (CASE / "run.csv").open(newline="") as table:
        rows = [row for row in csv.DictReader(table) if int(row["repeat"]) < repeats]
    sense, before, zeros = 0.0, None, {}
    for row in rows:
        y = float(row["y_m"])
        if before is not None and y != before:
            sense = np.sign(y - before)
        before = y
        line = row["line"]
        along = {"x": 0.0, "y": 1.0, "z": 0.0}.get(line)
        if along is None:
            along = (-1.0 if line[1] == "n" else 1.0) / np.sqrt(3.0)
        change = -0.5 * lost_motion * sense * along
        zero = zeros.setdefault(line + row["order"], change)
        row["reading_m"] = f"{float(row['reading_m']) + change - zero:.10f}"
    path = folder / "run.csv"
    with path.open("w", newline="") as table:
        writer = csv.DictWriter(table, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    (folder / "case.yaml").write_text((CASE / "case.yaml").read_text())
    return path


@pytest.fixture
def hidden(tmp_path):
    return _run(tmp_path / "hidden", LOST_MOTION)


def test_a_run_of_too_many_stops_is_refused_with_the_file_and_the_limit(
    hidden, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(limits, "MOST_STOPS", 50)
    out = tmp_path / "out"
    assert main(["diagnose", str(hidden), "--output", str(out)]) != 0
    (said,) = capsys.readouterr().err.strip().splitlines()
    assert hidden.name in said and "50" in said
    assert not out.exists()


def test_the_hidden_effect_is_named_proven_and_added(hidden, tmp_path, capsys):
    out, model = tmp_path / "out", tmp_path / "grown.yaml"
    assert main(["diagnose", str(hidden), "--output", str(out), "--extend", str(model)]) == 0
    text = capsys.readouterr().out
    assert text.startswith("NAMED: ")
    assert all((out / name).stat().st_size > 1000 for name in FILES)
    document = json.loads((out / "diagnosis.json").read_text())
    (finding,) = document["findings"]
    assert finding["label"] == "backlash of Y"
    low, high = finding["sizes"][0]["band_95"]
    assert low - 1e-8 < LOST_MOTION < high + 1e-8
    proof = document["held_out"]
    assert proof["named_by_the_other_readings_alone"]
    before, after = (
        proof[when]["chi_squared"] / proof[when]["degrees_of_freedom"]
        for when in ("before", "after")
    )
    assert before > 2.0 and 0.8 < after < 1.25
    assert proof["after"]["rms_m"] < 0.7 * proof["before"]["rms_m"]
    assert [one["verdict"] for one in document["rounds"]] == ["CONSISTENT"]

    grown = yaml.safe_load(model.read_text())
    assert grown["name"] == "grown"
    assert grown == document["extended_model"]
    (effect,) = grown["effects"]
    assert effect["sizes"]["lost_motion"] == finding["sizes"][0]["value"]
    assert effect["standard_uncertainty"]["lost_motion"] > 0.0
    digest = hashlib.sha256(hidden.read_bytes()).hexdigest()
    assert effect["provenance"]["sha256"] == digest
    assert effect["provenance"]["bag"] == "run.csv"
    assert "chi-squared" in effect["provenance"]["evidence"]
    assert grown["chain"] == "YXZ"

    # The grown model explains the run, and a table is told from what is already known.
    (out / "mine.png").write_bytes(b"a picture of the user")
    arguments = ["--model", str(model), "--output", str(out), "--pictures", "none", "--json"]
    assert main(["diagnose", str(hidden), *arguments]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["verdict"] == "CONSISTENT" and again["findings"] == []
    # What the earlier diagnosis has drawn would belong to no result.
    assert {path.name for path in out.iterdir()} == {"diagnosis.json", "diagnosis.txt", "mine.png"}
    assert again["model"]["effects"][0]["setting"] == {"axis": "Y"}


def test_a_model_with_the_wrong_size_fixed_leaves_the_rest_to_be_found(hidden, tmp_path, capsys):
    model = tmp_path / "wrong.yaml"
    entry = {"effect": "backlash", "setting": {"axis": "Y"}, "sizes": {"lost_motion": 2e-7}}
    model.write_text(yaml.safe_dump({"effects": [{**entry, "status": "fixed"}]}))
    arguments = ["--model", str(model), "--output", str(tmp_path), "--pictures", "none", "--json"]
    assert main(["diagnose", str(hidden), *arguments]) == 0
    (finding,) = json.loads(capsys.readouterr().out)["findings"]
    assert finding["sizes"][0]["value"] == pytest.approx(LOST_MOTION - 2e-7, abs=3e-8)


def test_a_bag_says_the_same_as_its_table(hidden, tmp_path, capsys):
    bag = tmp_path / "run.mcap"
    assert main(["import", str(hidden), str(bag)]) == 0
    capsys.readouterr()
    found = []
    for run in (hidden, bag):
        out = ["--output", str(tmp_path / "out"), "--pictures", "none", "--json"]
        assert main(["diagnose", str(run), *out]) == 0
        document = json.loads(capsys.readouterr().out)
        found.append((document["verdict"], document["findings"][0]["sizes"][0]["value"]))
    assert found[0][0] == found[1][0] == "NAMED"
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-9)


def test_where_nothing_is_hidden_nothing_is_named_or_written(tmp_path, capsys):
    run, model = _run(tmp_path / "null", 0.0), tmp_path / "none.yaml"
    arguments = ["--output", str(tmp_path / "out"), "--pictures", "none"]
    assert main(["diagnose", str(run), *arguments, "--extend", str(model)]) == 0
    told = capsys.readouterr()
    assert told.out.startswith("CONSISTENT: ")
    assert "Smallest size that would have been seen" in told.out
    assert "was not written: the verdict is CONSISTENT" in told.err
    assert not model.exists()


def _refused(arguments, capsys):
    assert main(["diagnose", *map(str, arguments)]) == 1
    error = capsys.readouterr().err
    assert error.startswith("stepdiag: error: ") and error.count("\n") == 1
    return error


def test_what_cannot_be_done_is_refused_in_a_sentence(hidden, tmp_path, capsys):
    there = tmp_path / "there.yaml"
    there.write_text("chain: XYZ\n")
    assert "is there already" in _refused([hidden, "--extend", there], capsys)
    assert "the chain YXZ, the model of one with XYZ" in _refused(
        [hidden, "--model", there], capsys
    )
    there.write_text("effects: [{effect: backslash}]\n")
    assert "effects[0]: 'effect' is 'backslash'" in _refused([hidden, "--model", there], capsys)
    text = _refused([hidden, "--model", there], capsys)
    assert "backlash" in text and "pip install" in text
    assert "'model'" in _refused([hidden, "--model", PLAN], capsys)
    for ending in ("yaml", "yml"):
        no_run = tmp_path / f"cell.{ending}"
        no_run.write_text("seed: 1\n")
        text = _refused([no_run], capsys)
        assert no_run.name in text and ".mcap" in text and ".csv" in text
    bag = tmp_path / "runs" / "monday" / "run.mcap"
    bag.parent.mkdir(parents=True)
    bag.touch()
    assert str(bag.parent) in _refused([tmp_path / "runs"], capsys)
    assert "no model 'nothing'" in _refused([hidden, "--model", "nothing"], capsys)
    assert "nowhere.csv" in _refused([tmp_path / "nowhere.csv"], capsys)
    unfinished = CASE.parents[1] / "bags" / "schema_1.mcap"
    assert main(["diagnose", str(unfinished)]) == 1
    assert "no line of this run was finished" in capsys.readouterr().err
    nowhere = tmp_path / "no" / "new.yaml"
    assert "there is no folder" in _refused([hidden, "--extend", nowhere], capsys)
    one = tmp_path / "one.yaml"
    assert str(one) in _refused([hidden, "--extend", one, "--propose", one], capsys)
    assert not one.exists()
    assert not (hidden.parent / "run_diagnosis").exists()


def test_the_help_has_the_verdicts_and_examples(capsys):
    with pytest.raises(SystemExit):
        main(["diagnose", "--help"])
    text = capsys.readouterr().out
    for word in ("CONSISTENT", "UNEXPLAINED", "--extend", "stepdiag diagnose run.mcap"):
        assert word in text


def test_several_runs_are_diagnosed_together(hidden, tmp_path, capsys):
    again = _run(tmp_path / "again", LOST_MOTION, repeats=1)
    out, model = tmp_path / "both", tmp_path / "both.yaml"
    arguments = [str(hidden), str(again), "--output", str(out), "--pictures", "none", "--json"]
    assert main(["diagnose", *arguments, "--extend", str(model)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["verdict"] == "NAMED"
    (further,) = document["further_runs"]
    assert further["sha256"] == hashlib.sha256(again.read_bytes()).hexdigest()
    assert {stop["run"] for stop in document["gap"]["stops"]} == {1, 2}
    assert document["held_out"]["split"] == "run 2, the last"
    assert document["held_out"]["named_by_the_other_readings_alone"]
    (effect,) = yaml.safe_load(model.read_text())["effects"]
    assert effect["provenance"]["sha256"] == f"{document['sha256']} + {further['sha256']}"
    assert "Run 2:" in (out / "diagnosis.txt").read_text()


def test_runs_over_different_boxes_are_refused_by_name(hidden, tmp_path, capsys):
    other = _run(tmp_path / "other", LOST_MOTION)
    case = yaml.safe_load((other.parent / "case.yaml").read_text())
    case["chain"] = ["X", "Y", "Z"]
    (other.parent / "case.yaml").write_text(yaml.safe_dump(case))
    assert main(["diagnose", str(hidden), str(other)]) == 1
    error = capsys.readouterr().err
    assert str(other) in error
    assert "the chain XYZ" in error


def test_an_extra_plan_is_not_written_where_nothing_is_open(hidden, tmp_path, capsys):
    plan = tmp_path / "more.yaml"
    out = str(tmp_path / "out")
    asked = ["diagnose", str(hidden), "--propose", str(plan), "--output", out, "--pictures", "none"]
    assert main(asked) == 0
    assert not plan.exists()
    assert "Nothing is open" in capsys.readouterr().err
    plan.write_text("mine")
    assert main(asked) == 1
    assert "is there already" in capsys.readouterr().err
    assert plan.read_text() == "mine"


def test_an_extra_plan_is_written_and_can_be_checked(tmp_path, capsys, monkeypatch):
    from stepdiag_ros.metrology.effects import servo_lag, trigger_delay

    both = (servo_lag.EFFECT, trigger_delay.EFFECT)
    monkeypatch.setattr(effects, "catalogue", lambda: {one.name: one for one in both})
    table, plan = _late(tmp_path / "late"), tmp_path / "more.yaml"
    out = tmp_path / "out"
    asked = ["diagnose", str(table), "--propose", str(plan), "--output", str(out)]
    assert main(asked) == 0
    text = capsys.readouterr().out
    assert text.startswith("AMBIGUOUS: ")
    assert "What to measure next" in text
    document = json.loads((out / "diagnosis.json").read_text())["proposal"]
    assert document["plan_file"] == str(plan)
    assert document["certainty"] >= 0.95
    assert {label for pair in document["pairs"] for label in pair["labels"]} == {
        "servo lag",
        "position-trigger delay",
    }
    assert "What to measure next" in (out / "diagnosis.html").read_text()
    assert main(["plan", "--check", str(plan), "--machine", "demo"]) == 0
    assert f"{len(document['passes'])} passes" in capsys.readouterr().out


def _late(folder):
    """Write a run table in which every stop is read 0.4 µm short of its move."""
    path = _run(folder, 0.0, repeats=2)
    with path.open(newline="") as table:
        rows = list(csv.DictReader(table))
    before = None
    for row in rows:
        place = np.array([float(row[f"{axis}_m"]) for axis in "xyz"])
        if before is not None and int(row["stop"]):
            way = place - before
            beam = _beam(row["line"])
            short = -4e-7 * float(beam @ way) / np.linalg.norm(way)
            row["reading_m"] = f"{float(row['reading_m']) + short:.10f}"
        before = place
    with path.open("w", newline="") as table:
        writer = csv.DictWriter(table, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    return path


def _beam(line):
    if len(line) == 1:
        return np.array([float(line == axis) for axis in "xyz"])
    return np.array([-1.0 if sign == "n" else 1.0 for sign in line]) / np.sqrt(3.0)


STOPPED = """\
name: stopped
step_m: [0.03, 0.02, 0.025]
blocks: 3
repeats: 2
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x, y, z]}
"""


def test_a_stopped_run_beside_another_is_named(tmp_path, capsys):
    whole, stopped = tmp_path / "whole.mcap", tmp_path / "stopped.mcap"
    write_bag(whole, STOPPED, with_tests=False)
    plan, measurement = measured(STOPPED)
    messages = [message_of(line) for line in measurement.lines[:-1]]
    write_messages(stopped, messages, STOPPED, load_machine("demo")[1], plan.name)
    given = ["diagnose", str(whole), str(stopped), "--pictures", "none"]
    assert main([*given, "--output", str(tmp_path / "out")]) == 0
    (said,) = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
    assert str(stopped) in said and "5 of 6" in said
