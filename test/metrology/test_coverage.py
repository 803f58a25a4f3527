"""The 95 % bands must hold what they promise, over many simulated runs."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan

from stepdiag_ros.metrology.cell import Misalignment, SimulatedCell
from stepdiag_ros.metrology.forward import ErrorCurves
from stepdiag_ros.metrology.geometry import CHAINS, ROTATIONS, TRANSLATIONS
from stepdiag_ros.metrology.plausible import ORDINARY, mode_count, modes
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.standards.volumetric import of_result, volumetric_accuracy

SHARES = {10: (0.92, 0.99), 200: (0.93, 0.97)}
"""Number of runs → between which bounds the share of values inside their 95 % must lie.

The few are for every day: u too small by a half leaves them less than 90 %. The many are slow.
"""


def share_inside(pairs):
    """Return the share of curve values whose truth lies inside value ± 1.96 u."""
    inside = total = runs = 0
    for result, truth in pairs:
        runs += 1
        for name in TRANSLATIONS:
            uncertainty = result.standard_uncertainty[name]
            # Points that are zero by definition of the frame have no uncertainty.
            free = uncertainty > 1e-15
            error = np.abs(result.curves[name] - truth[name])[free]
            inside += np.count_nonzero(error <= 1.96 * uncertainty[free])
            total += np.count_nonzero(free)
    assert total > runs * 45
    return inside / total


@pytest.mark.parametrize("method", ["setup_robust", "least_squares"])
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("count", SHARES, ids=["few", "many"])
def test_bands_cover_as_often_as_they_promise(method, known, count):
    plan = make_plan(6, repeats=2, directions=("forward", "backward"))

    def runs():
        for run in range(count):
            # A new machine and new misalignments every time, so that no luck of one is averaged.
            cell = make_cell(seed=run)
            measured = by_noise_alone(simulate(plan, cell, seed=1000 + run))
            if not known:
                for line in measured.lines:
                    line.standard_uncertainty[:] = np.nan
            yield solve(measured, method), cell.truth(plan.volume)

    least, most = SHARES[count]
    assert least <= share_inside(runs()) <= most


@pytest.mark.parametrize("method", ["setup_robust", "alternative", "least_squares"])
@pytest.mark.parametrize("chain_known", [True, False])
@pytest.mark.parametrize("count", SHARES, ids=["few", "many"])
def test_bands_hold_on_machines_that_turn_and_whose_zero_wanders(method, chain_known, count):
    """Nine rotations of 1 to 30 µrad, any chain, 0.2 µm of the zero from pass to pass."""
    plan = make_plan(6, repeats=2, directions=("forward", "backward"))
    rng = np.random.default_rng(7)

    def runs():
        for run in range(count):
            size = 10.0 ** rng.uniform(-6.0, -4.5)
            cell = make_cell(seed=run, chain=CHAINS[run % 6], rotation=size)
            measured = simulate(plan, cell, seed=1000 + run)
            for line in measured.lines:
                line.displacement[:] += 0.2e-6 * rng.standard_normal()
            if not chain_known:
                measured = replace(measured, chain="")
            yield solve(measured, method), cell.truth(plan.volume)

    assert SHARES[count][0] <= share_inside(runs()) <= 0.995


LARGEST = {10: 0.9, 200: 0.94}
"""Number of runs → share of them in which the true largest error must lie within value ± 1.96 u."""


def turning_cell(seed, chain, size, side, blocks):
    """Return a cell whose rotations are of the plausible size, which the method leaves out."""
    rng = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, blocks + 1)
    curves = {}
    for name in TRANSLATIONS:
        wave = np.sin(np.pi * np.arange(1, 4)[:, None] * share + rng.uniform(0.0, 6.0, (3, 1)))
        curves[name] = size * (wave - wave[:, :1]).T @ rng.standard_normal(3) / np.sqrt(3.0)
    for name in ROTATIONS:
        shapes = modes(share, mode_count(blocks))
        curves[name] = ORDINARY.rotation * shapes @ rng.standard_normal(shapes.shape[1])
    errors = ErrorCurves.from_curves([side * share] * 3, curves)
    tilts = Misalignment(1e-4, 1e-4)
    return SimulatedCell("cell", chain, errors, seed=seed, misalignment=tilts, reading_noise=1e-7)


@pytest.mark.parametrize(
    ("method", "size", "side"),
    [
        ("least_squares", 1e-6, 0.5),
        ("least_squares", 0.05e-6, 0.12),
        ("least_squares", 5e-6, 1.0),
        ("setup_robust", 1e-6, 0.5),
    ],
)
@pytest.mark.parametrize("count", LARGEST, ids=["few", "many"])
def test_the_largest_error_lies_within_its_uncertainty(method, size, side, count):
    """The largest error of the map is at one place; the true one is elsewhere, or points elsewhere.

    The zero scatters by 0.2 µm from pass to pass.
    """
    plan = make_plan(6, step=(side / 6,) * 3, repeats=2, directions=("forward", "backward"))
    nodes = [nodes - nodes[0] for nodes in plan.volume.all_nodes]
    inside = 0
    for run in range(count):
        chain = CHAINS[run % 6]
        cell = turning_cell(run, chain, size, side, 6)
        measured = simulate(plan, cell, seed=1000 + run)
        for line in measured.lines:
            line.displacement[:] += 0.2e-6 * np.random.default_rng(run).standard_normal()
        found = of_result(solve(measured, method), chain, measured.plausible)
        truth = ErrorCurves.from_curves(nodes, cell.truth(plan.volume))
        off = abs(found.value - volumetric_accuracy(truth, chain).value)
        inside += off <= 1.96 * found.standard_uncertainty
    assert inside >= LARGEST[count] * count
