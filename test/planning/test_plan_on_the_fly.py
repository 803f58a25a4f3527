"""Plans whose lines may be measured on the fly: expected nodes, search, command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from refused import refused

from stepdiag_ros import cli
from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.metrology.on_the_fly.expected import Streams
from stepdiag_ros.metrology.plan import FORWARD, LINEAR, STEP_DIAGONAL, STOPS, Line, Plan, Volume
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.planning.duration import Assumptions
from stepdiag_ros.planning.expectation import expect_with_rotations
from stepdiag_ros.planning.information import Information
from stepdiag_ros.planning.offers import StopNoise, noise_of_stops, offers_of
from stepdiag_ros.planning.proposal import propose
from stepdiag_ros.planning.request import Request

MACHINE = load_machine("demo")[0]
NO_ALIGNMENT = Assumptions(linear_alignment_s=0.0, diagonal_alignment_s=0.0)
STREAMS = Streams(reading_noise=0.01e-6)
CUBE = {"low": (0.0, 0.0, 0.0), "high": (0.12, 0.12, 0.12), "blocks": 12}


def asked(**wishes):
    given = {
        "stop_uncertainty": 0.01e-6,
        "reading_noise": 0.01e-6,
        "assumptions": NO_ALIGNMENT,
        "streams": STREAMS,
        **CUBE,
        **wishes,
    }
    return Request("volumetric", MACHINE, **given)


def test_the_search_expects_of_nodes_what_the_plan_is_promised():
    volume = Volume((0.0, 0.0, 0.0), (0.02, 0.015, 0.01), 5)
    lines = [Line(LINEAR, name, "", 0, FORWARD) for name in ("x", "y", "z")]
    lines += [Line(STEP_DIAGONAL, name, "XYZ", 0, FORWARD) for name in ("ppp", "npp", "pnp", "ppn")]
    conditions = Plan("test", volume, (), 0.05, pause_for_setup=False, measurement="on_the_fly")
    both = (FORWARD, "backward")
    nodes = noise_of_stops(conditions, MACHINE, StopNoise(1e-8), STREAMS, NO_ALIGNMENT)
    offers = offers_of(lines, conditions, MACHINE, nodes, both, NO_ALIGNMENT)
    names = ("E_XX", "E_ZZ", "C0Y")
    information = Information(offers, volume, "YXZ", Plausible(MACHINE.rotations), names)
    found = information.standing(np.ones(len(offers))).largest()
    passes = tuple(one for offer in offers for one in offer.passes(1))
    plan = replace(conditions, lines=passes)
    told = expect_with_rotations(plan, nodes, "YXZ", MACHINE.rotations)
    assert found["E_XX"] == pytest.approx(told.positioning["E_XX"], rel=1e-5)
    assert found["E_ZZ"] == pytest.approx(told.positioning["E_ZZ"], rel=1e-5)
    assert found["C0Y"] == pytest.approx(told.squareness["C0Y"], rel=1e-5)


def test_lines_on_the_fly_are_chosen_where_they_take_less_time():
    wish = {"until": {"E_XX": 0.1e-6, "E_YY": 0.1e-6, "E_ZZ": 0.1e-6}}
    stops = propose(asked(streams=None, **wish)).chosen
    moving = propose(asked(**wish)).chosen
    assert stops.plan.measurement == STOPS and moving.plan.on_the_fly
    assert moving.ratio <= 1.001
    assert moving.duration.total < 0.5 * stops.duration.total


def test_rough_time_stamps_bring_the_stops_back():
    rough = Streams(reading_noise=0.3e-6, stamp_jitter=0.4e-3)
    assert propose(asked(streams=rough, until={"E_XX": 0.06e-6})).chosen.plan.measurement == STOPS


def test_positions_that_come_too_seldom_are_refused():
    with refused(ValueError, "out_of_range"):
        propose(asked(streams=replace(STREAMS, position_rate=20.0)))


def test_a_purpose_with_prescribed_lines_refuses_to_seek_them_on_the_fly():
    with refused(ValueError, "unsupported", "iso230-2", about="on_the_fly"):
        propose(replace(asked(), purpose="iso230-2", until={}))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_command_writes_and_checks_a_plan_on_the_fly(folder, capsys):
    laser = ["--machine", "demo", "--json", "--noise", "0.01", "--reading-noise", "0.01"]
    wish = ["--for", "quick", "--blocks", "6", "--on-the-fly", "--no-picture"]
    times = ["--align-linear", "0", "--align-diagonal", "0"]
    assert cli.main(["plan", *wish, *laser, *times]) == 0
    proposed = json.loads(capsys.readouterr().out)
    assert load_plan(folder / "quick_plan.yaml")[0].on_the_fly
    assert proposed["plan"]["measurement"] == "on_the_fly"
    assert cli.main(["plan", "--check", "quick_plan.yaml", *laser, *times]) == 0
    checked = json.loads(capsys.readouterr().out)
    proposed.pop("proposal"), checked.pop("proposal")
    assert checked == proposed
    worse = ["--reading-rate", "200", "--position-rate", "250", "--jitter", "100"]
    assert cli.main(["plan", "--check", "quick_plan.yaml", *laser, *times, *worse]) == 0
    other = json.loads(capsys.readouterr().out)
    assert other["stop_uncertainty"] > 1.1 * checked["stop_uncertainty"]
    assert cli.main(["plan", "--check", "quick_plan.yaml", *laser, "--on-the-fly"]) == 1
