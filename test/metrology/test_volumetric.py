"""Volumetric accuracy: the document's machines, rotations through the chain, the unknown."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.forward import ErrorCurves, tool_point
from stepdiag_ros.metrology.geometry import CHAINS, ROTATIONS, TRANSLATIONS
from stepdiag_ros.metrology.plausible import NOTHING, ORDINARY, Plausible
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers.least_squares import solve_least_squares
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import (
    MACHINES_OF_RL,
    PLANAR_MACHINE_OF_RL,
    LinearMachine,
    VolumetricAccuracy,
    of_result,
    volumetric_accuracy,
)
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

NODES = (np.linspace(0.1, 0.6, 6), np.linspace(-0.2, 0.3, 5), np.linspace(0.0, 0.4, 4))


@pytest.mark.parametrize(
    ("machine", "diagonal", "volume"),
    list(zip(MACHINES_OF_RL, (0, 29, 14), (122, 50, 115), strict=True)),
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_the_three_machines_of_the_document(machine, diagonal, volume):
    assert round(machine.diagonal_result * 1e6) == diagonal
    found = volumetric_accuracy(machine.errors)
    assert round(found.value * 1e6) == volume
    assert found.value == pytest.approx(np.linalg.norm(machine.linear_error), rel=1e-9)


def test_the_planar_machine_of_the_document():
    lengths = PLANAR_MACHINE_OF_RL.length_errors(("pp0", "np0"))
    assert 0 < max(lengths.values()) < 0.001e-6
    found = volumetric_accuracy(PLANAR_MACHINE_OF_RL.errors)
    assert found.value > 25e-6
    assert found.vector == pytest.approx((25e-6, -25e-6, 0.0))


def test_length_errors_are_those_of_pythagoras():
    from decimal import Decimal, getcontext

    getcontext().prec = 40
    machine = LinearMachine("any", (0.4, 0.3, 0.7), (12e-6, -5e-6, 40e-6))
    actual = sum(
        (Decimal(length) * (1 + Decimal(rate))) ** 2
        for length, rate in zip(machine.travel, machine.linear_error, strict=True)
    ).sqrt()
    nominal = sum(Decimal(length) ** 2 for length in machine.travel).sqrt()
    expected = float(actual - nominal)
    assert machine.length_errors()["npp"] == pytest.approx(expected, rel=1e-9)


def curves(seed, rotations):
    rng = np.random.default_rng(seed)
    made = {}
    for name in TRANSLATIONS + (ROTATIONS if rotations else ()):
        size = 20e-6 if name in ROTATIONS else 5e-6
        made[name] = size * rng.standard_normal(len(NODES["XYZ".index(name[3])]))
    return made


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("rotations", [False, True])
def test_no_place_in_the_volume_is_worse(chain, rotations):
    errors = ErrorCurves.from_curves(NODES, curves(4, rotations))
    found = volumetric_accuracy(errors, chain)
    rng = np.random.default_rng(1)
    places = np.column_stack([rng.uniform(nodes[0], nodes[-1], 20000) for nodes in NODES])
    actual, _ = tool_point(places, errors, chain)
    zero, _ = tool_point(np.array([[nodes[0] for nodes in NODES]]), errors, chain)
    vectors = actual - places - (zero[0] - [nodes[0] for nodes in NODES])
    assert np.max(np.linalg.norm(vectors, axis=1)) <= found.value * (1 + 1e-4)
    at_the_place, _ = tool_point(np.array([found.position]), errors, chain)
    expected = at_the_place[0] - found.position - (zero[0] - [nodes[0] for nodes in NODES])
    np.testing.assert_allclose(found.vector, expected, atol=1e-15)


def test_planes_done_apart_give_the_same(monkeypatch):
    errors = ErrorCurves.from_curves(NODES, curves(4, True))
    whole = volumetric_accuracy(errors, "YXZ")
    monkeypatch.setattr("stepdiag_ros.metrology.standards.volumetric.MOST_POINTS", 1)
    assert volumetric_accuracy(errors, "YXZ") == whole


def result_of(values, covariance=None):
    return VolumetricErrors(
        method="by hand",
        nodes=NODES,
        curves=values,
        standard_uncertainty={name: np.zeros(len(curve)) for name, curve in values.items()},
        figures=(),
        lines=1,
        chi_squared=np.nan,
        degrees_of_freedom=0,
        covariance=np.empty((0, 0)) if covariance is None else covariance,
    )


@pytest.mark.parametrize("rotations", [False, True])
def test_the_uncertainty_is_that_of_shifted_curves(rotations):
    values = curves(7, rotations)
    size = sum(len(curve) for curve in values.values())
    rng = np.random.default_rng(3)
    roots = rng.standard_normal((size, 4)) * 1e-9
    found = of_result(result_of(values, roots @ roots.T), "ZXY", NOTHING)

    def length(shift):
        moved, place = {}, 0
        for name, curve in values.items():
            moved[name] = curve + shift[place : place + len(curve)]
            place += len(curve)
        corner = np.array([nodes[0] for nodes in NODES])
        shifted = [nodes - nodes[0] for nodes in NODES]
        errors = ErrorCurves.from_curves(shifted, moved)
        points = np.array([np.zeros(3), np.asarray(found.position) - corner])
        actual, _ = tool_point(points, errors, "ZXY")
        return np.linalg.norm(actual[1] - points[1] - actual[0])

    changes = [length(root) - length(-root) for root in roots.T]
    assert found.at_the_place == pytest.approx(0.5 * np.linalg.norm(changes), rel=1e-3)
    assert found.standard_uncertainty >= found.at_the_place


@pytest.mark.parametrize("chain", CHAINS)
def test_rotations_that_were_not_solved_for_are_in_the_uncertainty(chain):
    values = curves(7, False)
    known = Plausible(rotation=5e-6)
    size = sum(len(curve) for curve in values.values())
    found = of_result(result_of(values, np.zeros((size, size))), chain, known)
    along, corner = np.asarray(found.vector) / found.value, [nodes[0] for nodes in NODES]
    place, travel = np.asarray(found.position), [np.ptp(nodes) for nodes in NODES]
    rng = np.random.default_rng(2)
    drawn = []
    for _ in range(400):
        # Brownian paths, whose spread at a share u of the travel is √u of that at its end.
        turns = {
            name: np.array([0.0, 5e-6 * np.sqrt(share) * rng.standard_normal()])
            for axis, share in zip("XYZ", (place - corner) / travel, strict=True)
            for name in (f"E_A{axis}", f"E_B{axis}", f"E_C{axis}")
        }
        reached = [np.array([0.0, max(way, 1e-3)]) for way in place - corner]
        errors = ErrorCurves.from_curves(reached, turns)
        moved, _ = tool_point((place - corner)[None, :], errors, chain)
        drawn.append((moved[0] - (place - corner)) @ along)
    assert np.std(drawn) == pytest.approx(found.standard_uncertainty, rel=0.12)
    unknown_chain = of_result(result_of(values, np.zeros((size, size))), "", known)
    assert found.standard_uncertainty <= 1.8 * unknown_chain.standard_uncertainty
    assert unknown_chain.standard_uncertainty > 0.0


def test_a_curve_that_is_not_determined_makes_it_unknown():
    values = curves(1, False)
    values["E_ZY"] = values["E_ZY"].copy()
    values["E_ZY"][2] = np.nan
    found = of_result(result_of(values))
    assert np.isnan(found.value)
    assert "not determined are E_ZY" in found.remarks[0]
    del values["E_ZY"]
    assert "not determined are E_ZY" in of_result(result_of(values)).remarks[0]


def test_rotations_need_a_chain_and_those_that_are_missing_are_named():
    values = curves(1, True)
    with refused(Refusal, "missing"):
        of_result(result_of(values))
    del values["E_BY"]
    assert "E_BY" in of_result(result_of(values), "XYZ").remarks[0]
    assert "angular errors" in of_result(result_of(curves(1, False))).remarks[0]


def test_a_solved_map_has_the_volumetric_accuracy_of_its_machine():
    plan = make_plan(repeats=2)
    cell = make_cell(noise=0.05e-6)
    result = solve_least_squares(simulate(plan, cell))
    curves_of_cell = cell.truth(plan.volume)
    truth = replace(result, curves={name: curves_of_cell[name] for name in TRANSLATIONS})
    found, true = of_result(result), of_result(truth)
    assert found.standard_uncertainty > 0
    assert abs(found.value - true.value) < 4 * found.standard_uncertainty
    assert found.frame == result.frame


def test_the_rms_is_that_of_all_nodes():
    errors = ErrorCurves.from_curves(NODES, curves(5, True))
    grid = np.stack(np.meshgrid(*NODES, indexing="ij"), axis=-1).reshape(-1, 3)
    actual, _ = tool_point(grid, errors, "YXZ")
    vectors = (actual - grid) - (actual - grid)[0]
    expected = np.sqrt(np.mean(np.sum(vectors**2, axis=1)))
    assert volumetric_accuracy(errors, "YXZ").rms == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("rotations", [False, True])
def test_no_correlation_makes_the_uncertainty_larger_than_its_limit(rotations):
    values = curves(8, rotations)
    spreads = {
        name: np.abs(curve) * 0.01 + 1e-9 * np.arange(len(curve)) for name, curve in values.items()
    }
    every = np.concatenate(list(spreads.values()))
    rng = np.random.default_rng(4)
    found = []
    signs = [np.ones(len(every)), *rng.choice([-1.0, 1.0], (50, len(every)))]
    for row in signs:
        together = np.outer(every * row, every * row)
        result = replace(result_of(values, together), standard_uncertainty=spreads)
        found.append(of_result(result, "ZXY", NOTHING))
    limits = {one.uncertainty_limit for one in found}
    assert len(limits) == 1 and max(one.standard_uncertainty for one in found) <= max(limits)
    # At the place found and along the vector it is reached where every error pulls the same way.
    weights = np.array([np.nan])
    for row in np.eye(len(every)):
        result = replace(result_of(values, np.outer(row, row)), standard_uncertainty=spreads)
        found_one = of_result(result, "ZXY", NOTHING)
        weights = np.append(weights, found_one.at_the_place)
    assert max(limits) >= weights[1:] @ every


def test_an_uncertainty_that_is_not_known_has_no_limit():
    values = curves(8, False)
    spreads = {name: np.full(len(curve), np.nan) for name, curve in values.items()}
    found = of_result(replace(result_of(values), standard_uncertainty=spreads))
    assert np.isnan(found.uncertainty_limit) and found.value > 0.0


def test_a_place_with_a_smaller_error_and_a_larger_uncertainty_bounds_the_volume():
    plan = make_plan(blocks=6, step=(0.03,) * 3, linear=("y", "z"), repeats=2)
    result = solve_least_squares(simulate(plan, make_cell(high=(0.18,) * 3), 3))
    found = of_result(result, "YXZ")
    expanded = 1.96 * found.standard_uncertainty
    error_map = VolumetricMap.of_result(result, "YXZ", ORDINARY)
    places = error_map.some_nodes(1000)
    vectors = error_map.errors(places)
    lengths = np.linalg.norm(vectors, axis=1)
    along = vectors / np.maximum(lengths, 1e-12)[:, None]
    variances = np.einsum("ni,nij,nj->n", along, error_map.covariance_at(places), along)
    bounds = lengths + 1.96 * np.sqrt(np.maximum(variances, 0.0))
    assert found.upper_bound(expanded) == pytest.approx(np.max(bounds), rel=1e-3)
    # In proportion, where the budget knows of more.
    assert found.upper_bound(2.0 * expanded) > np.max(bounds)
    assert VolumetricAccuracy(1e-6, (0.0,) * 3, (0.0,) * 3).upper_bound(2e-6) == pytest.approx(3e-6)
