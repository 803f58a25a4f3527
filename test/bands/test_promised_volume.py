"""What a plan promises of the volume, against what is printed for worst plausible machines."""

import numpy as np
from plausible_machines import ANGLE, NOISE, draw

from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.volumetric_map import VolumetricMap, places_of
from stepdiag_ros.planning.expectation import expect_with_rotations

MACHINES = 60


def test_half_of_the_machines_get_a_smaller_uncertainty_of_the_volume_than_is_promised():
    ratios = []
    for machine in map(draw, range(MACHINES)):
        if not machine.noise_told:
            continue
        plan = machine.steps(passes=1)
        promised = expect_with_rotations(plan, NOISE, machine.chain, ANGLE).volumetric
        measurement = machine.measure(plan)
        result = solve(measurement)
        error_map = VolumetricMap.of_result(result, machine.chain, measurement.plausible)
        covariance = error_map.covariance_at(places_of([nodes[[0, -1]] for nodes in result.nodes]))
        printed = np.sqrt(np.max(np.diagonal(covariance, axis1=1, axis2=2)))
        ratios.append(printed / promised)
    assert 0.9 < np.median(ratios) < 1.1
