"""Proposed plans: what they promise is what simulation and solver give; wishes and refusals."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from cells_for_tests import make_cell
from refused import a_fault, refused

from stepdiag_ros.configuration import available, load_machine, load_plan, plan_from_text
from stepdiag_ros.evaluation.build import truth_of
from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, Plan
from stepdiag_ros.metrology.plausible import NOTHING, Plausible
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.visibility import DETERMINED, visibility
from stepdiag_ros.planning import limits
from stepdiag_ros.planning.assessment import assess
from stepdiag_ros.planning.candidates import (
    EDGE_LINES,
    FOUR_DIAGONALS,
    LINEAR_AXES,
    PURPOSES,
    Scheme,
    lines_of,
    of_expectation,
    travel_box,
    travel_machine,
    volume_in,
)
from stepdiag_ros.planning.expectation import (
    POSITIONING,
    expect,
    expect_with_rotations,
    worst,
)
from stepdiag_ros.planning.limits import warnings
from stepdiag_ros.planning.plan_text import plan_text
from stepdiag_ros.planning.proposal import COVERAGE_FACTOR, propose
from stepdiag_ros.planning.request import Request
from stepdiag_ros.run.feasibility import beyond_machine
from stepdiag_ros.text import numbers

MACHINE = load_machine("demo")[0]
NOISE = 0.1e-6


class Wish(dict):
    """A wish that a cache can keep."""

    def __hash__(self):
        return hash(tuple(self.items()))


@cache
def proposed(purpose, **wishes):
    if PURPOSES[purpose].kinds:
        wishes.setdefault("blocks", 4)
    return propose(Request(purpose, MACHINE, **wishes))


def usual(blocks=10):
    """Return three linear lines and four step diagonals over the travel of the machine."""
    volume = volume_in(*travel_box(MACHINE, 0.005), blocks)
    scheme = Scheme("", (LINEAR_AXES, FOUR_DIAGONALS))
    return Plan("usual", volume, lines_of(scheme, volume, 1, (FORWARD,)), 0.05)


def cell_over(volume, rotation=0.0):
    low = np.asarray(volume.origin)
    high = low + volume.blocks * np.asarray(volume.step)
    return make_cell(
        seed=5,
        low=low,
        high=high,
        positioning=1e-6,
        size=0.7e-6,
        rotation=rotation,
        squareness=(12e-6, -8e-6, 15e-6),
        tilt=50e-6,
        mirror=5e-6,
        noise=NOISE,
        held=0.0,
    )


def of_noise(measurement):
    """Return lines of which nothing but noise is plausible."""
    return replace(measurement, plausible=NOTHING)


@pytest.mark.parametrize("purpose", PURPOSES)
def test_every_purpose_gets_a_plan_that_the_machine_can_run(purpose):
    plan = proposed(purpose).chosen.plan
    assert beyond_machine(plan, MACHINE) == ""
    assert plan_from_text(plan_text(plan), "written") == plan


@pytest.mark.parametrize("purpose", ["squareness", "straightness", "volumetric", "quick"])
def test_least_squares_gives_the_uncertainty_that_was_promised(purpose):
    plan = proposed(purpose).chosen.plan
    result = solve(of_noise(simulate(plan, cell_over(plan.volume), seed=3)), "least_squares")
    # Where χ² is a little unlucky the solver enlarges; here it must not.
    expectation = expect(plan, NOISE)
    for name in SQUARENESS:
        promised = expectation.squareness[name]
        given = result.figure(name).standard_uncertainty
        assert given == pytest.approx(promised, rel=1e-6, nan_ok=True)
    for name, promised in expectation.positioning.items():
        if math.isfinite(promised):
            given = np.max(result.standard_uncertainty[name])
            assert given == pytest.approx(promised, rel=1e-6)
    assert expectation.degrees_of_freedom == result.degrees_of_freedom


@pytest.mark.parametrize("rotation", [3e-6, 30e-6])
def test_a_plan_promises_the_uncertainty_that_plausible_rotations_leave(rotation):
    plan = proposed("volumetric").chosen.plan
    promised = expect_with_rotations(plan, NOISE, "YXZ", rotation)
    measured = simulate(plan, cell_over(plan.volume), seed=3)
    measured = replace(measured, chain="YXZ", plausible=Plausible(rotation))
    result = solve(measured, "least_squares")
    for name in SQUARENESS:
        told = result.figure(name).standard_uncertainty
        # The promise is for axes that turn as much as is plausible; here they do not.
        assert 0.7 * promised.squareness[name] < told < 1.1 * promised.squareness[name]
        # It is another quantity than what noise alone leaves, and must not be taken for it.
        assert told > 10.0 * expect(plan, NOISE).squareness[name]
    for name in POSITIONING:
        told = np.max(result.standard_uncertainty[name])
        assert 0.7 * promised.positioning[name] < told < 1.1 * promised.positioning[name]
    told = of_result(result, "YXZ", measured.plausible).standard_uncertainty
    assert 0.0 < told <= 1.1 * promised.volumetric


def test_without_plausible_rotations_a_plan_promises_no_less_than_noise_makes():
    plan = proposed("volumetric").chosen.plan
    by_noise, stiff = expect(plan, NOISE), expect_with_rotations(plan, NOISE, "YXZ", 0.0)
    turning = expect_with_rotations(plan, NOISE, "YXZ", 3e-6)
    for name in SQUARENESS:
        assert stiff.squareness[name] >= by_noise.squareness[name] * (1 - 1e-9)
        # The laser's scale is left.
        assert stiff.squareness[name] < turning.squareness[name]


def test_an_overrun_that_is_wished_is_in_every_plan():
    plan = proposed("volumetric", overrun=0.003).chosen.plan
    assert plan.overrun == 0.003 and proposed("volumetric").chosen.plan.overrun == 0.0


@pytest.mark.parametrize("overrun", [0.0, 0.002])
def test_a_plan_without_run_up_says_that_its_ends_show_no_reversal(overrun):
    plan = proposed("volumetric", overrun=overrun).chosen.plan
    said = assess(plan, MACHINE, NOISE).limits
    assert any("--overrun" in text for text in said) == (overrun == 0.0)


def test_the_scatter_of_simulated_results_is_the_promised_uncertainty():
    """Not only does the solver say so: the results do scatter so."""
    candidate = proposed("squareness", time_limit=2 * 3600.0).chosen
    expectation = expect(candidate.plan, NOISE)
    cell = cell_over(candidate.plan.volume)
    runs = 60
    found = np.array(
        [
            [
                solve(of_noise(simulate(candidate.plan, cell, seed=seed))).figure(n).value
                for n in SQUARENESS
            ]
            for seed in range(runs)
        ]
    )
    promised = np.array([expectation.squareness[name] for name in SQUARENESS])
    ratio = np.std(found, axis=0, ddof=1) / promised
    assert np.all(np.abs(ratio - 1.0) < 4.0 / np.sqrt(2.0 * runs)), ratio
    figures = {f.name: f.value for f in truth_of(cell, candidate.plan.volume, ()).figures}
    truth = np.array([figures[name] for name in SQUARENESS])
    assert np.all(np.abs(found.mean(axis=0) - truth) < 4.0 * promised / np.sqrt(runs))


@pytest.mark.parametrize(
    ("purpose", "chain"),
    [("squareness", "YXZ"), ("straightness", "YXZ"), ("volumetric", "YXZ"), ("volumetric", "")],
)
def test_the_promise_is_what_the_solver_expects_of_the_plan(purpose, chain):
    """The search adds up what lines tell; the solver is asked for the whole plan, by itself."""
    box = {"low": (0.0, 0.0, 0.0), "high": (0.3, 0.25, 0.2), "blocks": 4}
    machine = replace(MACHINE, chain=chain)
    proposal = propose(Request(purpose, machine, **box))
    for one in (proposal.chosen, *proposal.front[:2]):
        whole = expect_with_rotations(one.plan, NOISE, chain, machine.rotations)
        told = worst(of_expectation(whole, PURPOSES[purpose].figures).values())
        # Of six chains that may be the one, the search takes the strongest modes.
        assert one.uncertainty == pytest.approx(COVERAGE_FACTOR * told, rel=1e-3 if chain else 0.05)


def test_the_angular_promise_is_that_of_the_rigid_body_solver():
    candidate = proposed("angular").chosen
    assert set(candidate.determined) == set(ROTATIONS) - {"E_BY"}
    expectation = expect(candidate.plan, NOISE, "YXZ")
    cell = cell_over(candidate.plan.volume, rotation=5e-6)
    result = solve(of_noise(simulate(candidate.plan, cell, seed=1)), "rigid_body")
    for name in ROTATIONS:
        promised = expectation.angular[name]
        given = result.standard_uncertainty[name]
        if name in candidate.determined:
            assert np.max(given) == pytest.approx(promised, rel=1e-6)
        else:
            assert not math.isfinite(promised)
            assert np.any(np.isnan(given))


@pytest.mark.parametrize("wish", [{}, {"time_limit": 2.0 * 3600.0}], ids=str)
def test_every_plan_of_the_frontier_takes_longer_and_is_better_than_the_one_before(wish):
    proposal = proposed("volumetric", **wish)
    for quick, slow in pairwise(proposal.front):
        assert quick.duration.total < slow.duration.total
        assert quick.uncertainty > slow.uncertainty
    # The proposed plan is there once, not beside the same lines in another order.
    for one in proposal.front:
        if one is not proposal.chosen:
            assert sorted(map(str, one.plan.lines)) != sorted(map(str, proposal.chosen.plan.lines))


def test_a_wished_uncertainty_is_reached_by_the_shortest_plan_that_reaches_it():
    loose = proposed("volumetric", until=Wish({"volumetric": 20e-6}))
    fine = proposed("volumetric", until=Wish({"volumetric": 14e-6}))
    for proposal, wish in ((loose, 20e-6), (fine, 14e-6)):
        assert proposal.chosen.uncertainty <= wish * 1.001
        for other in proposal.front:
            if other.duration.total < proposal.chosen.duration.total:
                assert other.uncertainty > wish
    assert loose.chosen.duration.total < fine.chosen.duration.total


def test_a_time_limit_is_kept_by_the_best_plan_within_it():
    limit = 2.5 * 3600.0
    proposal = proposed("volumetric", time_limit=limit)
    assert proposal.chosen.duration.total <= limit
    for other in proposal.front:
        if other.duration.total <= limit:
            assert other.uncertainty >= proposal.chosen.uncertainty * (1 - 1e-9)


def test_one_curve_alone_may_be_wished():
    proposal = proposed("volumetric", until=Wish({"E_XX": 0.5e-6}))
    plan = proposal.chosen.plan
    whole = expect_with_rotations(plan, NOISE, "YXZ", MACHINE.rotations)
    assert COVERAGE_FACTOR * whole.positioning["E_XX"] <= 0.5e-6 * 1.001
    assert proposal.chosen.uncertainty == pytest.approx(
        COVERAGE_FACTOR * whole.positioning["E_XX"], rel=1e-3
    )


@pytest.mark.parametrize(
    ("purpose", "wishes", "said"),
    [
        ("volumetric", {"until": Wish({"volumetric": 1e-9})}, a_fault("not_found", "0.001")),
        ("volumetric", {"time_limit": 600.0}, a_fault("not_found", "10")),
        (
            "volumetric",
            {"until": Wish({"volumetric": 1e-6}), "time_limit": 9000.0},
            a_fault("not_found", "2", "30"),
        ),
        ("volumetric", {"high": (0.95, 0.1, 0.1)}, a_fault("out_of_range", "X", aspect="box")),
        ("volumetric", {"low": (0.5, 0.1, 0.1), "high": (0.4, 0.2, 0.2)}, a_fault("too_few", "X")),
        ("volumetric", {"margin": 0.3}, a_fault("too_few", "Y")),
        ("iso230-2", {"overrun": 0.01}, a_fault("out_of_range", "0.01", aspect="overrun")),
        ("squareness", {"spacing": 0.001}, a_fault("not_found", "100")),
        ("nothing", {}, a_fault("unknown", "nothing")),
        ("squareness", {"stop_uncertainty": 0.0}, a_fault("out_of_range", aspect="uncertainty")),
    ],
)
def test_what_cannot_be_is_refused_in_words(purpose, wishes, said):
    with refused(Refusal, said):
        propose(Request(purpose, MACHINE, **wishes))


def test_angular_errors_need_the_chain():
    with refused(Refusal, "missing"):
        propose(Request("angular", travel_machine((0.8, 0.5, 0.4))))
    plain = propose(Request("volumetric", travel_machine((0.8, 0.5, 0.4))))
    assert "chain is not known" in assess(plain.chosen.plan, plain.request.machine, NOISE).limits[0]


@pytest.mark.parametrize("purpose", ["iso230-2", "iso230-6"])
def test_tests_by_standard_keep_to_it(purpose):
    plan = proposed(purpose).chosen.plan
    assert plan.overrun > 0.0
    for name in {line.name for line in plan.lines}:
        passes = [line for line in plan.lines if line.name == name]
        for direction in (FORWARD, BACKWARD):
            assert sum(line.direction == direction for line in passes) == 5
        stops = passes[0].stops(plan.volume)
        length = float(np.linalg.norm(stops[-1] - stops[0]))
        assert len(stops) >= max(5.0, 5.0 * length)


@pytest.mark.parametrize("blocks", [3, 7, 12, 100])
def test_the_grid_fills_the_box_with_round_steps(blocks):
    low, high = travel_box(MACHINE, 0.005)
    volume = volume_in(low, high, blocks)
    for axis in range(3):
        nodes = volume.nodes(axis)
        side = high[axis] - low[axis]
        assert low[axis] - 1e-9 <= nodes[0] and nodes[-1] <= high[axis] + 1e-9
        assert nodes[-1] - nodes[0] >= 0.985 * side
        step = volume.step[axis] * 1e6
        assert abs(step - round(step)) < 1e-6


def test_a_narrower_box_is_kept():
    request = Request("quick", MACHINE, low=(0.1, 0.0, 0.0), high=(0.5, 0.3, 0.2))
    volume = propose(request).chosen.plan.volume
    assert volume.origin == (0.1, 0.0, 0.0)
    assert [round(step * volume.blocks, 6) for step in volume.step] == [0.4, 0.3, 0.2]


def test_what_would_show_an_angular_error_does_show_it():
    """The remedies in the limits are tried here again, by hand."""
    plan = usual()
    said = " ".join(assess(plan, MACHINE, NOISE).limits)
    assert "E_AX, E_CX, E_AZ, E_BZ, E_CZ: not determined; the move orders XYZ, YZX, ZXY" in said
    assert "E_BX: not determined; a linear line x shifted by 0,0,0.39 m" in said
    assert "E_BY: not determined, and no linear line" in said
    before = visibility(plan, "YXZ", NOISE)
    assert before.row("E_BX").status != DETERMINED
    edge = next(group for group in EDGE_LINES if group.names == ("x",) and group.corner[2] == 1)
    more = lines_of(Scheme("", (edge,)), plan.volume, 1, (FORWARD,))
    after = visibility(replace(plan, lines=plan.lines + more), "YXZ", NOISE)
    assert after.row("E_BX").status == DETERMINED


def test_what_is_right_only_without_rotations_is_named():
    plan = proposed("quick").chosen.plan
    assessment = assess(plan, MACHINE, NOISE)
    named = next(text for text in assessment.limits if "right only if" in text)
    for name in (*TRANSLATIONS, *SQUARENESS):
        leaning = (
            assessment.seen.row(name).status == DETERMINED
            and assessment.seen_rotating.row(name).status != DETERMINED
        )
        assert (name in named) == leaning, name


def test_unwise_plans_are_warned_of():
    demo = replace(load_plan("demo")[0], pause_for_setup=True)
    assert warnings(demo) == []
    split = replace(demo, lines=(*demo.lines[1:], demo.lines[0]))
    assert "x: aligned more than once" in warnings(split)[0]
    orders = load_plan("move_orders")[0]
    assert "one_alignment_per_diagonal" in " ".join(warnings(orders))


@pytest.mark.parametrize("name", available("plans"))
def test_every_plan_written_is_read_back_the_same(name):
    plan = load_plan(name)[0]
    assert plan_from_text(plan_text(plan, ["a comment"]), name) == plan


def test_a_plan_with_lines_in_an_odd_order_is_read_back_the_same():
    plan = load_plan("demo")[0]
    rng = np.random.default_rng(2)
    lines = [line for line in plan.lines if line.repeat == 0]
    mixed = replace(plan, name='a "name"\\', lines=tuple(lines[i] for i in rng.permutation(14)))
    assert plan_from_text(plan_text(mixed), "mixed") == mixed
    with refused(Refusal, "out_of_order", "1"):
        plan_text(replace(plan, lines=plan.lines[2:]))


def test_one_coverage_factor():
    assert COVERAGE_FACTOR == numbers.COVERAGE_FACTOR


def test_what_would_help_is_the_same_on_the_coarse_grid_that_it_is_tried_on(monkeypatch):
    plan = usual(12)
    seen = visibility(plan, "YXZ", NOISE)
    coarse = limits.remedies(plan, "YXZ", NOISE, seen)
    monkeypatch.setattr(limits, "_BLOCKS_TO_TRY", 12)
    assert limits.remedies(plan, "YXZ", NOISE, seen) == coarse
    assert len(coarse) == 4
