"""The error map: the solver's signs, its box, its uncertainty, what it does not know."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan
from refused import a_fault, refused

from stepdiag_ros.metrology.forward import ErrorCurves, tool_point
from stepdiag_ros.metrology.geometry import CHAINS, CURVES, ROTATIONS, TRANSLATIONS, moving_axis
from stepdiag_ros.metrology.plausible import NOTHING
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers.least_squares import solve_least_squares
from stepdiag_ros.metrology.target_correction import place_of, target_for
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

NODES = (np.linspace(0.1, 0.5, 5), np.linspace(-0.2, 0.3, 6), np.linspace(-0.4, 0.0, 3))


def random_map(chain="YXZ", seed=1, names=CURVES, size=20e-6):
    rng = np.random.default_rng(seed)
    curves = {}
    for name in names:
        curve = size * rng.standard_normal(len(NODES[moving_axis(name)]))
        curves[name] = curve - curve[0] if name in TRANSLATIONS else curve
    return VolumetricMap(NODES, curves, chain=chain)


def places(count=200, seed=5):
    low, high = [n[0] for n in NODES], [n[-1] for n in NODES]
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


@pytest.mark.parametrize("chain", CHAINS)
def test_a_map_says_where_the_tool_is_by_the_forward_model(chain):
    made = random_map(chain)
    where = places()
    corner = made.low
    errors = ErrorCurves.from_curves([n - n[0] for n in NODES], made.curves)
    actual, _ = tool_point(where - corner, errors, chain)
    at_corner, _ = tool_point(np.zeros((1, 3)), errors, chain)
    assert made.errors(where) == pytest.approx(actual - (where - corner) - at_corner, abs=1e-13)
    assert made.errors(corner[None]) == pytest.approx(np.zeros((1, 3)), abs=1e-15)


def test_a_map_tells_something_if_any_node_but_the_first_is_determined():
    whole = random_map()
    assert whole.tells_any_node()

    def told_at(*known):
        """Return the map in which only these nodes of X are determined."""
        curves = {
            name: np.where(np.isin(np.arange(len(curve)), known), curve, np.nan)
            if moving_axis(name) == 0
            else curve
            for name, curve in whole.curves.items()
        }
        return replace(whole, curves=curves)

    assert told_at(4).tells_any_node() and told_at(0).tells_any_node()
    assert not told_at().tells_any_node()
    corner = {name: np.where(np.arange(len(c)), np.nan, c) for name, c in whole.curves.items()}
    assert not replace(whole, curves=corner).tells_any_node()


def test_a_solved_map_is_the_machine_but_for_a_turn_of_the_whole():
    cell, plan = make_cell(noise=0.0, tilt=0.0, squareness=(50e-6, -30e-6, 40e-6)), make_plan()
    solved = VolumetricMap.of_result(solve_least_squares(simulate(plan, cell)))
    grid = solved.grid()
    actual, _ = tool_point(grid, cell.errors, cell.chain)
    apart = (actual - grid) - solved.errors(grid)
    apart -= apart[0]
    # What is left is the turn by which the frame of the results is defined.
    turns = np.concatenate(
        [np.cross(np.eye(3)[i], grid - grid[0])[:, :, None] for i in range(3)], 2
    )
    angles, *_ = np.linalg.lstsq(turns.reshape(-1, 3), apart.ravel(), rcond=None)
    assert np.max(np.abs(apart - turns @ angles)) < 2e-9
    assert np.max(np.abs(solved.errors(grid))) > 3e-6


def test_outside_the_box_nothing_is_known():
    made = random_map()
    beyond = np.array([[0.1 - 1e-6, 0.0, -0.2], [0.3, 0.3 + 1e-6, -0.2], [0.3, 0.0, 0.1]])
    assert not made.inside(beyond).any()
    assert np.all(np.isnan(made.errors(beyond)))
    edge = np.array([[0.5, 0.3, 0.0], [0.1 - 1e-12, -0.2, -0.4]])
    assert made.inside(edge).all() and np.all(np.isfinite(made.errors(edge)))


def test_what_is_not_determined_is_unknown_where_it_acts_and_only_there():
    known = random_map()
    holes = {**known.curves, "E_YX": known.curves["E_YX"].copy()}
    holes["E_YX"][2] = np.nan
    made = replace(known, curves=holes)
    where = np.array([[0.19, 0.0, -0.1], [0.21, 0.0, -0.1], [0.45, 0.0, -0.1]])
    assert np.isnan(made.errors(where)).any(axis=1).tolist() == [False, True, False]
    assert made.unknown_curves == ("E_YX",)
    # X is the second of YXZ: its rotations act through Z alone.
    turning = {**known.curves, "E_BX": np.full(5, np.nan)}
    made = replace(known, curves=turning)
    where = np.array([[0.3, 0.1, -0.4], [0.3, 0.1, -0.3]])
    assert np.isnan(made.errors(where)).any(axis=1).tolist() == [False, True]


def test_rotations_that_were_not_estimated_are_named_and_a_zero_by_definition_is_no_finding():
    made = random_map(names=TRANSLATIONS)
    assert len(made.left_out) == 9
    cell, plan = make_cell(), make_plan()
    result = solve_least_squares(simulate(plan, cell))
    unknown = result.curves["E_YX"].copy()
    unknown[1:-1] = np.nan
    cut = VolumetricMap.of_result(replace(result, curves={**result.curves, "E_YX": unknown}))
    assert np.isnan(cut.errors(cut.high[None])).all()


def test_the_uncertainty_is_that_of_many_repeated_measurements():
    cell, plan = make_cell(noise=0.2e-6), make_plan(blocks=4)
    run = by_noise_alone(simulate(plan, cell, seed=0))
    first = VolumetricMap.of_result(solve_least_squares(run), plausible=NOTHING)
    where = np.array([[0.013, 0.031, 0.007], [0.04, 0.04, 0.04], [0.0, 0.04, 0.02]])
    told = first.standard_uncertainty_at(where)
    found = [
        VolumetricMap.of_result(solve_least_squares(simulate(plan, cell, seed=seed))).errors(where)
        for seed in range(120)
    ]
    assert np.std(found, axis=0) == pytest.approx(told, rel=0.3, abs=1e-9)
    limit = first.uncertainty_limit_at(where)
    assert np.all(limit >= told * (1 - 1e-9)) and np.all(limit < 10 * told + 1e-12)
    bare = replace(first, covariance=np.empty((0, 0)))
    assert np.isnan(bare.standard_uncertainty_at(where)).all()
    assert np.isnan(first.standard_uncertainty_at(where + 1.0)).all()


@pytest.mark.parametrize("chain", ["YXZ", "ZXY"])
def test_left_out_rotations_act_with_what_they_did_to_the_curves(chain):
    # A map of all eighteen curves, of which nine are zero and as uncertain, says the same.
    some = random_map(names=TRANSLATIONS)
    count = sum(len(NODES[moving_axis(name)]) for name in CURVES)
    roots = 1e-6 * np.random.default_rng(6).standard_normal((count, 30))
    joint = roots @ roots.T
    own = sum(len(curve) for curve in some.curves.values())
    left = replace(some, chain=chain, covariance=joint[:own, :own].copy(), turned_factor=roots)
    zeros = {name: np.zeros(len(NODES[moving_axis(name)])) for name in ROTATIONS}
    whole = replace(left, curves={**some.curves, **zeros}, covariance=joint)
    where = places()
    assert not whole.left_out and len(left.left_out) == 9
    np.testing.assert_allclose(left.covariance_at(where), whole.covariance_at(where), rtol=1e-9)
    # Where the result does not tell, they are as large as is plausible, and add to the curves.
    untold = replace(left, turned_factor=np.empty((0, 0)))
    rigid = replace(untold, plausible=NOTHING)
    added = np.square(untold.standard_uncertainty_at(where)) - np.square(
        rigid.standard_uncertainty_at(where)
    )
    assert np.all(added > -1e-20) and np.max(added) > (0.2 * 10e-6) ** 2 * 0.3**2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"chain": ""}, a_fault("missing", aspect="chain")),
        ({"chain": "XXZ"}, a_fault("unknown", "XXZ", aspect="chain")),
        ({"curves": {}}, a_fault("missing", "E_XX", aspect="curves")),
        (
            {"curves": {"E_QQ": np.zeros(5)}},
            a_fault("unknown", "E_QQ", aspect="curve"),
        ),
        ({"curves": {"E_XX": np.zeros(4)}}, a_fault("mismatch", "4", "5")),
        ({"nodes": (NODES[0][::-1], *NODES[1:])}, a_fault("out_of_order", "X")),
    ],
)
def test_a_map_that_contradicts_itself_is_refused(change, words):
    with refused(Refusal, words):
        replace(random_map(), **change)


def test_a_corrected_target_brings_the_tool_to_the_wanted_place():
    made = random_map(size=300e-6)
    wanted = places()
    sent = target_for(made, wanted)
    assert np.max(np.abs(sent - wanted)) > 100e-6
    inside = made.inside(sent)
    assert np.mean(inside) > 0.9
    tool = sent + made.errors(sent)
    assert tool[inside] == pytest.approx(wanted[inside], abs=2e-12)
    assert place_of(made, sent) == pytest.approx(wanted, abs=2e-12)
    # Less the error at the wanted place alone is not enough for errors as large as these.
    once = wanted - made.errors(wanted)
    again = made.inside(once)
    left = once[again] + made.errors(once[again]) - wanted[again]
    assert np.max(np.abs(left)) > 1e-8


def test_beyond_the_edge_the_correction_goes_on_unchanged_and_the_unknown_stays_unknown():
    made = random_map()
    beyond, edge = np.array([[0.52, 0.1, -0.2]]), np.array([[0.5, 0.1, -0.2]])
    moved, there = target_for(made, beyond) - beyond, target_for(made, edge) - edge
    assert moved == pytest.approx(there, abs=1e-8) and np.any(np.abs(moved) > 1e-6)
    unknown = replace(made, curves={**made.curves, "E_XX": np.full(5, np.nan)})
    assert np.isnan(target_for(unknown, edge)).all()


def test_errors_that_no_machine_has_are_refused():
    steep = {name: np.zeros(len(NODES[moving_axis(name)])) for name in TRANSLATIONS}
    steep["E_XX"] = np.array([0.0, 0.3, 0.0, 0.3, 0.0])
    with refused(Refusal, "failed"):
        target_for(VolumetricMap(NODES, steep), np.array([[0.23, 0.0, -0.2]]))


@pytest.mark.parametrize(("recorded", "share"), [(True, 0.05), (False, 1e-6)])
def test_the_factors_of_places_make_their_covariance(recorded, share):
    """A recorded result has plausible rotations: drawn by the modes of most of their variance."""
    measured = simulate(make_plan(6, repeats=2), make_cell())
    solved = VolumetricMap.of_result(solve_least_squares(measured), "YXZ")
    if recorded:
        solved = replace(solved, turned_factor=np.empty((0, 0)))
    where = solved.grid()
    factors = solved.factors_at(where)
    made = np.einsum("nik,njk->nij", factors, factors)
    expected = solved.covariance_at(where)
    assert np.max(np.abs(made - expected)) < share * np.max(np.abs(expected))
    assert np.max(np.trace(made, axis1=1, axis2=2)) > 1e-14
