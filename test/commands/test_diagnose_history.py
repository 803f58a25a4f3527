"""``stepdiag diagnose`` of bags that were recorded months apart."""

import json
from dataclasses import replace
from datetime import datetime, timedelta, timezone

import pytest
import standard_runs
from cells_for_tests import make_cell
from standard_runs import message_of, write_messages

from stepdiag_ros import schemas
from stepdiag_ros.cli import main
from stepdiag_ros.configuration import load_machine, plan_from_text
from stepdiag_ros.metrology import effects
from stepdiag_ros.metrology.effects.backlash import EFFECT
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.simulation import simulate

PLAN = """\
name: monthly
step_m: [0.03, 0.02, 0.025]
blocks: 4
repeats: 2
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x, y, z]}
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}
"""
MACHINE = load_machine("demo")[1]
BEGIN = datetime(2026, 1, 10, 8, tzinfo=timezone.utc)


@pytest.fixture(autouse=True)
def small_catalogue(monkeypatch):
    monkeypatch.setattr(effects, "catalogue", lambda: {EFFECT.name: EFFECT})


@pytest.fixture
def bag(tmp_path, monkeypatch):
    """Write the bag of a day; every run has other curves, alignments and noise."""

    def write(name, day, lost_motion=0.0, run_id=None, machine=MACHINE):
        begin = BEGIN + timedelta(days=day)
        monkeypatch.setattr(standard_runs, "START", int(begin.timestamp()) * 10**9)
        monkeypatch.setattr(standard_runs, "RUN_ID", run_id or f"run-{name}")
        number = 1 + sum(map(ord, name))
        backlash = ActiveEffect(EFFECT, {"axis": "Y"}, {"lost_motion": lost_motion})
        cell = make_cell(seed=number, high=(0.12, 0.08, 0.1), noise=0.05e-6)
        acting = replace(cell, effects=(backlash,))
        run = simulate(plan_from_text(PLAN, "plan"), acting, seed=number)
        return write_messages(
            tmp_path / f"{name}.mcap", [message_of(line) for line in run.lines], PLAN, machine
        )

    return write


def diagnosed(capsys, *arguments):
    given = ["diagnose", *map(str, arguments), "--json"]
    assert main(given) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys, *arguments):
    assert main(["diagnose", *map(str, arguments)]) == 1
    return capsys.readouterr().err


def test_a_backlash_that_grows_is_followed_with_its_rate_whatever_the_order(bag, tmp_path, capsys):
    bags = [bag(name, 61 * place, 0.3e-6 * place) for place, name in enumerate("abcd")]
    given = [bags[2], bags[0], bags[3], bags[1], "--output", tmp_path / "out"]
    document = diagnosed(capsys, *given)
    assert document["schema"] == schemas.identifier("history")
    assert [run["files"][0]["run_id"] for run in document["runs"]] == [f"run-{n}" for n in "abcd"]
    assert document["runs"][1]["start"] == "2026-03-12T08:00:00+00:00"
    (effect,) = document["effects"]
    assert effect["label"] == "backlash of Y"
    assert effect["kind"] == "grows"
    assert effect["size"]["unit"] == "m"
    low, high = effect["rate"]["band_95"]
    assert low < 0.3e-6 / (61 * 12 / 365.2425) < high < 2 * low
    for place, size in enumerate(effect["sizes"]):
        assert abs(size["value"] - 0.3e-6 * place) < 4.0 * size["standard_uncertainty"] < 0.2e-6
    assert effect["common"]["value"] is None
    text = (tmp_path / "out" / "history.txt").read_text()
    assert max(len(line) for line in text.splitlines() if line.startswith(" ")) <= 80
    assert (tmp_path / "out" / "history.png").stat().st_size > 5000
    assert "stepdiag changes" in text


def test_an_effect_in_all_runs_has_one_size(bag, tmp_path, capsys):
    bags = [bag(name, 61 * place, 0.6e-6) for place, name in enumerate("abc")]
    document = diagnosed(capsys, *bags, "--output", tmp_path / "out", "--pictures", "none")
    (effect,) = document["effects"]
    assert effect["kind"] == "in all runs"
    assert effect["having"] == [1, 2, 3]
    low, high = effect["common"]["band_95"]
    assert low < 0.6e-6 < high
    each = [one["standard_uncertainty"] for one in effect["sizes"]]
    assert effect["common"]["standard_uncertainty"] < 0.75 * min(each)


def test_runs_of_one_week_are_one_measurement_unless_told_otherwise(bag, tmp_path, capsys):
    bags = [bag("a", 0, 0.6e-6), bag("b", 3, 0.6e-6), bag("c", 40, 0.6e-6)]
    out = ("--output", tmp_path / "out", "--pictures", "none")
    assert diagnosed(capsys, *bags[:2], *out)["schema"] == schemas.identifier("diagnosis")
    document = diagnosed(capsys, *bags, *out)
    assert [len(run["files"]) for run in document["runs"]] == [2, 1]
    assert len(diagnosed(capsys, *bags, *out, "--together", "0")["runs"]) == 3


def test_runs_that_are_not_of_one_machine_are_refused_by_name(bag, capsys):
    first = bag("a", 0)
    other = bag("b", 40, machine=MACHINE.replace("name: ", "name: other "))
    error = refused(capsys, first, other)
    assert "another machine" in error and "b.mcap" in error
    turned = bag("c", 40, machine=MACHINE.replace("chain: YXZ", "chain: XYZ"))
    assert "chain" in refused(capsys, first, turned)


def test_the_same_run_twice_is_refused(bag, tmp_path, capsys):
    first = bag("a", 0)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(first.read_bytes())
    error = refused(capsys, first, bag("b", 40), copy)
    assert "the same run" in error and "copy.mcap" in error
    again = bag("d", 0, run_id="run-a")
    assert "the same run" in refused(capsys, first, again)


def test_a_run_without_a_date_among_those_of_months_is_refused(bag, capsys):
    undated = bag("c", -(BEGIN - datetime(1970, 1, 2, tzinfo=timezone.utc)).days)
    error = refused(capsys, bag("a", 0), bag("b", 40), undated)
    assert "states no date" in error and "c.mcap" in error


def test_what_belongs_to_one_time_is_refused_for_several(bag, tmp_path, capsys):
    bags = [bag("a", 0), bag("b", 40)]
    model = tmp_path / "model.yaml"
    assert "--extend" in refused(capsys, *bags, "--extend", model)
    assert not model.exists()
    with pytest.raises(SystemExit):
        main(["diagnose", *map(str, bags), "--together", "-1"])
