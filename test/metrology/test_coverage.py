"""The 95 % bands must hold what they promise, over many simulated runs."""

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve

RUNS = 200


@pytest.mark.parametrize("method", ["setup_robust", "least_squares"])
@pytest.mark.parametrize("known", [True, False])
def test_bands_cover_as_often_as_they_promise(method, known):
    plan = make_plan(6, repeats=2, directions=("forward", "backward"))
    inside = total = 0
    for run in range(RUNS):
        # A new machine and new misalignments every time, so that no luck of one is averaged.
        cell = make_cell(seed=run)
        measured = simulate(plan, cell, seed=1000 + run)
        if not known:
            for line in measured.lines:
                line.standard_uncertainty[:] = np.nan
        result = solve(measured, method)
        truth = cell.truth(plan.volume)
        for name in TRANSLATIONS:
            uncertainty = result.standard_uncertainty[name]
            # Points that are zero by definition of the frame have no uncertainty.
            free = uncertainty > 1e-15
            error = np.abs(result.curves[name] - truth[name])[free]
            inside += np.count_nonzero(error <= 1.96 * uncertainty[free])
            total += np.count_nonzero(free)
    assert total > RUNS * 45
    assert 0.93 <= inside / total <= 0.97
