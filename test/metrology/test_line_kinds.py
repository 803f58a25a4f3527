"""Lines of kind ``diagonal`` and the overrun: plan, simulation, assembler, least squares."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell
from refused import a_fault, refused
from runs_for_tests import SAMPLING, Run, blocks_of, lines_of, stops_of

from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import (
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    TRANSLATIONS,
    beam_direction,
    moving_axis,
)
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    DIAGONAL,
    FORWARD,
    LINE_NAMES,
    LINEAR,
    STEP_DIAGONAL,
    Line,
    Plan,
    Volume,
    kind_of,
    moved_axes,
)
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve

VOLUME = Volume((0.1, 0.0, 0.02), (0.01, 0.02, 0.03), 2)
STEP = np.array(VOLUME.step)


X = {"kind": "linear", "names": ["x"]}


def plan_of(*groups, **keys):
    return Plan.from_mapping(
        {"step_m": list(VOLUME.step), "blocks": 2, "feed_m_per_s": 0.1, "lines": list(groups)}
        | keys,
        "my.yaml",
    )


def test_all_axes_of_a_diagonal_reach_the_nodes_together():
    body = Line(DIAGONAL, "npp", "", 0, FORWARD).stops(VOLUME)
    assert body == pytest.approx(
        np.array([[0.12, 0.0, 0.02], [0.11, 0.02, 0.05], [0.10, 0.04, 0.08]]), abs=1e-15
    )
    face = Line(DIAGONAL, "p0n", "", 0, BACKWARD, (0.0, 0.04, 0.0)).stops(VOLUME)
    assert face == pytest.approx(
        np.array([[0.12, 0.04, 0.02], [0.11, 0.04, 0.05], [0.10, 0.04, 0.08]]), abs=1e-15
    )


@pytest.mark.parametrize("name", LINE_NAMES[DIAGONAL])
def test_the_stops_of_a_diagonal_are_stops_of_its_step_diagonal_to_the_last_bit(name):
    """Each stop of the way at once is one at which a block of the way by steps has ended."""
    direct = Line(DIAGONAL, name, "", 0, FORWARD).stops(VOLUME)
    order = "".join(axis for axis, sign in zip("XYZ", name, strict=True) if sign != "0")
    steps = Line(STEP_DIAGONAL, name, order, 0, FORWARD).stops(VOLUME)
    assert np.array_equal(direct, steps[:: len(order)])
    assert np.diff(direct, axis=0) @ beam_direction(name, STEP) == pytest.approx(
        np.linalg.norm(STEP[[sign != "0" for sign in name]])
    )
    assert moved_axes(direct[0], direct[1]) == order


def test_every_kind_place_and_order_is_a_setup_of_its_own():
    lines = [
        Line(STEP_DIAGONAL, "ppp", "XYZ", 0, FORWARD),
        Line(DIAGONAL, "ppp", "", 0, FORWARD),
        Line(DIAGONAL, "pp0", "", 0, FORWARD),
        Line(DIAGONAL, "pp0", "", 0, FORWARD, (0.0, 0.0, 0.06)),
        Line(LINEAR, "x", "", 0, FORWARD),
    ]
    assert len({line.setup for line in lines}) == len(lines)
    shared = replace(plan_of(X), lines=tuple(lines), one_alignment_per_diagonal=True)
    assert len({shared.setup_of(line) for line in lines}) == len(lines)
    assert str(lines[1]) == "ppp diagonal forward, repeat 0"
    assert [kind_of(line.name, line.order) for line in lines] == [line.kind for line in lines]


def test_a_plan_file_names_diagonals():
    plan = plan_of(
        {"kind": "diagonal", "names": [*BODY_DIAGONALS, *FACE_DIAGONALS], "repeats": 2},
        {"kind": "diagonal", "names": ["0pp", "0np"], "offset_m": [0.02, 0.0, 0.0]},
        overrun_m=0.003,
    )
    assert [line.name for line in plan.lines[:4]] == ["ppp", "ppp", "npp", "npp"]
    assert len(plan.lines) == 22 and plan.stop_count == 66
    assert plan.lines[-1].offset == (0.02, 0.0, 0.0)
    assert plan.overrun == 0.003


@pytest.mark.parametrize(
    ("group", "words"),
    [
        ({"kind": "diagonal", "names": ["x"]}, a_fault("unknown", "x", "ppp", about="names")),
        ({"kind": "step_diagonal", "names": ["x"]}, a_fault("unknown", "x", "ppp", about="names")),
        (
            {"kind": "step_diagonal", "names": ["p00"]},
            a_fault("unknown", "p00", "pp0", about="names"),
        ),
        (
            {"kind": "step_diagonal", "names": ["pp0"], "orders": ["XZ"]},
            a_fault("mismatch", "pp0"),
        ),
        (
            {
                "kind": "step_diagonal",
                "names": ["pp0"],
                "orders": ["XYZ"],
            },
            a_fault("mismatch", "pp0"),
        ),
        (
            {"kind": "diagonal", "names": ["ppp"], "orders": ["XYZ"]},
            a_fault("unknown", about="orders"),
        ),
        (
            {"kind": "diagonal", "names": ["ppp"], "offset_m": [0, 0, 0.1]},
            a_fault("mismatch", "offset_m", "Z", "ppp"),
        ),
        (
            {"kind": "diagonal", "names": ["pp0", "p0p"], "offset_m": [0, 0, 0.1]},
            a_fault("mismatch", "offset_m", "Z", "p0p"),
        ),
    ],
)
def test_a_diagonal_that_cannot_be_is_refused(group, words):
    with refused(Refusal, words):
        plan_of(group)


@pytest.mark.parametrize("direction", [FORWARD, BACKWARD])
@pytest.mark.parametrize("name", ["y", "npp", "0np"])
def test_the_run_up_lies_behind_the_first_stop_in_the_sense_of_the_pass(name, direction):
    line = Line(kind_of(name, ""), name, "", 0, direction)
    plan = replace(plan_of(X), volume=VOLUME, lines=(line,), overrun=0.004)
    first, second = line.stops(VOLUME)[:2]
    towards = (second - first) / np.linalg.norm(second - first)
    beyond = plan.run_up(line)
    assert beyond is not None
    assert first - beyond == pytest.approx(0.004 * towards, abs=1e-15)
    assert plan_of(X).run_up(line) is None


def test_step_diagonals_have_no_overrun():
    plan = plan_of({"kind": "step_diagonal", "names": ["ppp"]}, overrun_m=0.01)
    assert plan.run_up(plan.lines[0]) is None


def test_an_overrun_takes_its_time_in_the_simulation_and_changes_no_reading():
    without = plan_of({"kind": "diagonal", "names": ["ppp"]}, {"kind": "linear", "names": ["x"]})
    with_it = replace(without, overrun=0.01)
    cell = make_cell(noise=0.0)
    one, other = simulate(without, cell), simulate(with_it, cell)
    assert other.lines[0].time - one.lines[0].time == pytest.approx(np.full(3, 0.2))
    assert other.lines[1].time - one.lines[1].time == pytest.approx(np.full(3, 0.4))
    for a, b in zip(one.lines, other.lines, strict=True):
        assert np.array_equal(a.displacement, b.displacement)


@pytest.mark.parametrize("name", ["npp", "n0p"])
def test_a_block_of_a_diagonal_is_the_way_from_target_to_target(name):
    volume = Volume((0.0, 0.0, 0.0), (0.01, 0.02, 0.03), 2)
    lines = tuple(Line(DIAGONAL, name, "", 0, way) for way in (FORWARD, BACKWARD))
    run = Run(Plan("diagonal", volume, lines, 0.1, SAMPLING))
    run.measure(0)
    run.measure(1)
    events = assemble(run.plan, 0, run.commands, run.arrivals, run.readings)
    assert [stop.settled for stop in stops_of(events)] == [True] * 6
    blocks = blocks_of(events)
    axes = "XYZ" if name == "npp" else "XZ"
    length = np.linalg.norm([0.01, 0.02, 0.03] if name == "npp" else [0.01, 0.03])
    assert [(block.block, block.axis) for block in blocks] == [(1, axes), (2, axes)] * 2
    assert [block.nominal_displacement for block in blocks] == pytest.approx(
        [length, length, -length, -length]
    )
    assert [block.displacement for block in blocks] == pytest.approx(
        [length, length, -length, -length], abs=0.2e-6
    )
    forth, back = lines_of(events)
    assert forth.setup == back.setup == f"{name} diagonal"
    assert forth.displacement[-1] == pytest.approx(2 * length, abs=0.2e-6)


def test_least_squares_takes_diagonals_beside_linear_lines():
    """They tell positioning and squareness, and of the straightness what is symmetrical."""
    volume = Volume((0.01, 0.0, 0.02), (0.01, 0.02, 0.01), 4)
    lines = [Line(LINEAR, name, "", 0, way) for name in "xyz" for way in (FORWARD, BACKWARD)]
    lines += [Line(DIAGONAL, name, "", 0, FORWARD) for name in LINE_NAMES[DIAGONAL]]
    lines += [Line(DIAGONAL, name, "", 0, FORWARD, (0.0, 0.0, 0.035)) for name in ("pp0", "np0")]
    plan = Plan("ISO 230-6", volume, tuple(lines), 0.05)
    cell = make_cell(noise=1e-9, high=(0.1, 0.1, 0.1), tilt=20e-6)
    result = solve(simulate(plan, cell), "least_squares")
    truth = cell.truth(volume)
    for name in TRANSLATIONS:
        known = np.isfinite(result.curves[name])
        assert known.all() == (name in ("E_XX", "E_YY", "E_ZZ"))
        assert result.curves[name][known] == pytest.approx(truth[name][known], abs=20e-9)
    for name, (factor, curves) in SQUARENESS_SLOPES.items():
        slopes = [np.polyfit(volume.nodes(moving_axis(c)), truth[c], 1)[0] for c in curves]
        # What is left is of second order in the tilt of the setups.
        assert result.figure(name).value == pytest.approx(factor * sum(slopes), abs=0.1e-6)
