"""The 95 % bands must hold what they promise, over many simulated runs."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan

from stepdiag_ros.metrology.geometry import CHAINS, TRANSLATIONS
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve

RUNS = 200


def share_inside(pairs):
    """Return the share of curve values whose truth lies inside value ± 1.96 u."""
    inside = total = 0
    for result, truth in pairs:
        for name in TRANSLATIONS:
            uncertainty = result.standard_uncertainty[name]
            # Points that are zero by definition of the frame have no uncertainty.
            free = uncertainty > 1e-15
            error = np.abs(result.curves[name] - truth[name])[free]
            inside += np.count_nonzero(error <= 1.96 * uncertainty[free])
            total += np.count_nonzero(free)
    assert total > RUNS * 45
    return inside / total


@pytest.mark.parametrize("method", ["setup_robust", "least_squares"])
@pytest.mark.parametrize("known", [True, False])
def test_bands_cover_as_often_as_they_promise(method, known):
    plan = make_plan(6, repeats=2, directions=("forward", "backward"))

    def runs():
        for run in range(RUNS):
            # A new machine and new misalignments every time, so that no luck of one is averaged.
            cell = make_cell(seed=run)
            measured = by_noise_alone(simulate(plan, cell, seed=1000 + run))
            if not known:
                for line in measured.lines:
                    line.standard_uncertainty[:] = np.nan
            yield solve(measured, method), cell.truth(plan.volume)

    assert 0.93 <= share_inside(runs()) <= 0.97


@pytest.mark.parametrize("method", ["setup_robust", "alternative", "least_squares"])
@pytest.mark.parametrize("chain_known", [True, False])
def test_bands_hold_on_machines_that_turn_and_whose_zero_wanders(method, chain_known):
    """Nine rotations of 1 to 30 µrad, any chain, 0.2 µm of the zero from pass to pass."""
    plan = make_plan(6, repeats=2, directions=("forward", "backward"))
    rng = np.random.default_rng(7)

    def runs():
        for run in range(RUNS):
            size = 10.0 ** rng.uniform(-6.0, -4.5)
            cell = make_cell(seed=run, chain=CHAINS[run % 6], rotation=size)
            measured = simulate(plan, cell, seed=1000 + run)
            for line in measured.lines:
                line.displacement[:] += 0.2e-6 * rng.standard_normal()
            if not chain_known:
                measured = replace(measured, chain="")
            yield solve(measured, method), cell.truth(plan.volume)

    share = share_inside(runs())
    assert 0.93 <= share <= 0.995
