"""Bands of readings that are far more certain than rotations are small, as on the fly."""

from dataclasses import replace

import numpy as np
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR

MACHINES = 24
NOISE = 12e-9
ROTATION = 10e-6
"""rad: as large as machine files assume, and of any smooth shape."""


def test_rotations_of_any_shape_are_within_the_uncertainty_of_the_curves():
    plan = make_plan(blocks=12)
    inside = []
    for seed in range(MACHINES):
        cell = make_cell(seed=seed, high=(0.12,) * 3, noise=NOISE, rotation=ROTATION, mirror=2e-5)
        lines = simulate(plan, cell)
        known = [
            replace(line, standard_uncertainty=np.full(len(line.time), NOISE))
            for line in lines.lines
        ]
        measured = replace(
            lines, lines=tuple(known), chain=cell.chain, plausible=Plausible(ROTATION)
        )
        result, truth = solve(measured), cell.truth(plan.volume)
        for name, curve in truth.items():
            if name in result.curves:
                u = result.standard_uncertainty[name]
                known_u = u > 0.0
                missed = np.abs(result.curves[name] - curve)[known_u]
                inside.extend(missed <= COVERAGE_FACTOR * u[known_u])
    assert np.mean(inside) > 0.93
