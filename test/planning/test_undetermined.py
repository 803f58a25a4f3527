"""What lines do not tell is said before they are measured, with the lines that would tell it.

Checked against the solver: what is said to be unknown has no number in the result, and the lines
that are named give it one.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
import standard_runs
from refused import refused

from stepdiag_ros.cli import main
from stepdiag_ros.configuration import find, load_cell, load_plan, plan_from_text, target_from_text
from stepdiag_ros.metrology.geometry import SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.plan import FORWARD, LINEAR, STEP_DIAGONAL
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve_all
from stepdiag_ros.planning.undetermined import refuse_undetermined, undetermined

POSITIONING = {"E_XX", "E_YY", "E_ZZ"}
HEAD = """\
name: four diagonals
step_m: [0.03, 0.02, 0.025]
blocks: 4
repeats: 2
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
"""
DIAGONALS = "  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}\n"
AXES = "  - {kind: linear, names: [x, y, z]}\n"


def plan_with(*names):
    """Return the demonstration's plan with these of its lines only."""
    plan = load_plan(str(find("demo", "plans")))[0]
    return replace(plan, lines=tuple(line for line in plan.lines if line.name in names))


def solved(plan, cell="demo"):
    return solve_all(simulate(plan, load_cell(str(find(cell, "cells")))[0], seed=4))[0]


def unknown_of(result):
    curves = {name for name in TRANSLATIONS if not np.all(np.isfinite(result.curves[name]))}
    return curves | {name for name in SQUARENESS if not np.isfinite(result.figure(name).value)}


FOUR = ("ppp", "npp", "pnp", "ppn")
SUBSETS = {
    "four diagonals": FOUR,
    "three diagonals": FOUR[:3],
    "two diagonals and all axes": (*FOUR[:2], "x", "y", "z"),
    "four diagonals and one axis": (*FOUR, "y"),
    "axes alone": ("x", "y", "z"),
}


@pytest.mark.parametrize("names", SUBSETS.values(), ids=SUBSETS)
def test_what_is_said_to_be_unknown_is_what_the_solver_does_not_tell(names):
    plan = plan_with(*names)
    told = undetermined(plan)
    result = solved(plan).get("least_squares")
    assert result is not None
    assert set(told.names) == unknown_of(result)


@pytest.mark.parametrize("names", SUBSETS.values(), ids=SUBSETS)
def test_the_lines_that_are_named_tell_all_of_it(names):
    plan = plan_with(*names)
    remedy = undetermined(plan).remedy
    assert remedy
    added = {line.name for line in remedy}
    assert not added & set(names), "what is there already is no remedy"
    more = plan_with(*names, *added)
    assert undetermined(more).names == ()
    assert unknown_of(solved(more)["least_squares"]) == set()
    # None of them is too much.
    for one in added:
        assert undetermined(plan_with(*names, *(added - {one}))).names


def test_four_step_diagonals_alone_do_not_tell_positioning():
    told = undetermined(plan_with(*FOUR))
    assert set(told.curves) == POSITIONING and told.squareness == ()
    assert {line.kind for line in told.remedy} == {LINEAR}
    assert told.shape_told
    for name in POSITIONING:
        assert name in told.sentence
    assert told.remedy_words in told.sentence


def test_axes_alone_tell_neither_straightness_nor_squareness():
    told = undetermined(plan_with("x", "y", "z"))
    assert set(told.curves) == set(TRANSLATIONS) - POSITIONING
    assert set(told.squareness) == set(SQUARENESS) and not told.shape_told
    assert {line.kind for line in told.remedy} == {STEP_DIAGONAL}


@pytest.mark.parametrize(
    "name", ["check", "demo", "quick", "kimm", "ibaraki_hata_2010", "move_orders"]
)
def test_a_plan_that_tells_all_nine_curves_is_not_warned_of(name):
    told = undetermined(load_plan(str(find(name, "plans")))[0])
    assert (told.names, told.remedy, told.sentence) == ((), (), "")


@pytest.mark.parametrize("blocks", [3, 12, 40])
def test_it_does_not_depend_on_the_number_of_stops(blocks):
    text = (HEAD + DIAGONALS).replace("blocks: 4", f"blocks: {blocks}")
    told = undetermined(plan_from_text(text, "plan"))
    assert set(told.names) == POSITIONING and told.shape_told


@pytest.fixture
def diagonals(tmp_path):
    path = tmp_path / "four.yaml"
    path.write_text(HEAD + DIAGONALS)
    return path


def test_plan_warns_of_them_and_a_document_names_them(diagonals, capsys):
    arguments = ["plan", "--check", str(diagonals), "--machine", "demo"]
    assert main([*arguments, "--json"]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert set(document["undetermined"]) == POSITIONING
    assert "linear lines" in document["lines_that_would_tell"]
    assert "warning" in said.err and all(name in said.err for name in POSITIONING)
    diagonals.write_text(HEAD + DIAGONALS + AXES)
    assert main([*arguments, "--json"]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert document["undetermined"] == [] and document["lines_that_would_tell"] is None
    assert "warning" not in said.err


def test_import_says_so_of_a_measurement_made_elsewhere(tmp_path, capsys):
    for name, lines, unknown in (("part", DIAGONALS, POSITIONING), ("all", DIAGONALS + AXES, ())):
        standard_runs.write_bag(tmp_path / f"{name}.mcap", HEAD + lines)
        folder = tmp_path / name
        assert main(["export", str(tmp_path / f"{name}.mcap"), "--output", str(folder)]) == 0
        capsys.readouterr()
        assert main(["import", str(folder / "run.csv"), "--json"]) == 0
        remarks = " ".join(json.loads(capsys.readouterr().out)["remarks"])
        assert all(one in remarks for one in unknown)
        assert ("do not determine" in remarks) == bool(unknown)


def test_a_run_warns_before_any_node_is_started(diagonals, tmp_path, capsys, monkeypatch):
    from stepdiag_ros.processes import measure

    def none_started(*_, **__):
        raise ValueError("no node is started here")

    monkeypatch.setattr(measure, "MeasuringSession", none_started)
    given = ["run", "--plan", str(diagonals), "--output", str(tmp_path / "o")]
    assert main(given) == 1
    said = capsys.readouterr().err
    assert all(name in said for name in POSITIONING)
    assert said.index("warning") < said.index("no node is started here")
    assert main(["run", "--plan", "quick", "--output", str(tmp_path / "o")]) == 1
    assert "warning" not in capsys.readouterr().err


def test_measure_warns_before_it_asks_for_the_run(diagonals, capsys, monkeypatch):
    from stepdiag_ros.processes import joining

    class Joined:
        measured = None

        def __init__(self, *_):
            pass

        def measure(self, *_):
            raise ValueError("nothing is measured here")

    monkeypatch.setattr(joining, "JoinedRun", Joined)
    assert main(["measure", "--plan", str(diagonals)]) == 1
    said = capsys.readouterr().err
    assert all(name in said for name in POSITIONING)
    assert said.index("warning") < said.index("nothing is measured here")


TESTED = "until: {until}\nconditions:\n" + "".join(
    f"  {key}: 1.0e-7\n"
    for key in (
        "device_U_m_per_m",
        "misalignment_m",
        "temperature_range_K",
        "expansion_coefficient_per_K",
        "expansion_range_per_K",
        "temperature_difference_K",
        "environmental_variation_m",
    )
)


@pytest.mark.parametrize(
    ("names", "until", "about"),
    [
        (FOUR, "1um", ("E_XX", "x")),
        (FOUR, "E_XX=1um", ("E_XX",)),
        (("x", "y", "z"), "C0Y=1urad", ("C0Y", "ppp")),
        ((*FOUR, "x", "y", "z"), "E_BY=1urad", ("E_BY",)),
        ((*FOUR, "x"), "Y:A=1um", ("X", "ppp")),
        ((*FOUR, "x"), "X:A=1um", ("conditions",)),
        ((*FOUR, "x"), "X:B=1um", ("conditions",)),
    ],
)
def test_a_target_that_the_plan_does_not_determine_is_refused(names, until, about):
    with refused(Refusal, "undetermined", *about):
        refuse_undetermined(target_from_text(until), plan_with(*names), "YXZ")


@pytest.mark.parametrize(
    ("names", "until"),
    [
        ((*FOUR, "x", "y", "z"), "1um"),
        (("x",), "E_XX=1um"),
        ((*FOUR, "x", "y", "z"), "C0Y=1urad"),
        (("x",), TESTED.format(until="X:A=1um")),
        (FOUR, TESTED.format(until="ppp:E↑=1um")),
    ],
)
def test_a_target_that_the_plan_determines_is_taken(names, until):
    refuse_undetermined(target_from_text(until), plan_with(*names), "YXZ")


def test_a_test_in_one_direction_alone_is_no_target_in_both():
    plan = plan_with("x")
    forward = replace(plan, lines=tuple(one for one in plan.lines if one.direction == FORWARD))
    refuse_undetermined(target_from_text(TESTED.format(until="X:E↑=1um")), forward, "")
    for name in ("E", "E↓", "B"):
        with refused(Refusal, "undetermined", name):
            refuse_undetermined(target_from_text(TESTED.format(until=f"X:{name}=1um")), forward, "")
