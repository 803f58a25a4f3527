"""A plan on the fly: as text, in its duration, and by hand."""

import json
from dataclasses import replace

import pytest
import yaml

from stepdiag_ros.cli import main
from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.metrology.by_hand import plan_by_hand
from stepdiag_ros.metrology.plan import ON_THE_FLY, STOPS, Plan
from stepdiag_ros.planning.duration import duration
from stepdiag_ros.planning.plan_text import plan_text


@pytest.fixture(scope="module")
def plan():
    return load_plan("on_the_fly")[0]


def test_its_text_gives_the_same_plan(plan):
    assert plan.measurement == ON_THE_FLY
    assert Plan.from_mapping(yaml.safe_load(plan_text(plan)), "test") == plan


@pytest.mark.parametrize("measurement", [STOPS, ON_THE_FLY])
def test_its_document_says_how_it_is_measured(tmp_path, plan, capsys, measurement):
    file = tmp_path / "plan.yaml"
    file.write_text(plan_text(replace(plan, measurement=measurement)))
    assert main(["plan", "--check", str(file), "--machine", "demo", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["plan"]["measurement"] == measurement


def test_only_the_ends_of_a_line_take_a_stay(plan):
    machine = load_machine("demo")[0]
    moving, standing = (duration(one, machine) for one in (plan, replace(plan, measurement=STOPS)))
    for fast, slow in zip(moving.lines, standing.lines, strict=True):
        assert fast.dwells == pytest.approx(slow.dwells * 2 / slow.stops)
        assert fast.moves == slow.moves


def test_by_hand_every_stop_is_one(plan):
    assert not plan_by_hand(plan).on_the_fly
