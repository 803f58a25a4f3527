"""The true largest error of a simulated cell stands beside that of a result, in the same frame."""

import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan

from stepdiag_ros.evaluation.build import truth_of
from stepdiag_ros.evaluation.report import true_largest
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.standards.volumetric import of_result


def true(cell, plan):
    return true_largest(truth_of(cell, plan.volume, []), cell.chain)


def test_it_is_what_a_solver_finds_of_a_machine_that_does_not_turn():
    cell, plan = make_cell(noise=0.0, tilt=0.0), make_plan()
    found = of_result(solve(by_noise_alone(simulate(plan, cell)), "least_squares"), cell.chain)
    assert true(cell, plan).value == pytest.approx(found.value, abs=1e-9)
    assert true(cell, plan).position == pytest.approx(found.position)


def test_rotations_of_the_axes_are_in_it():
    plan = make_plan()
    still, turning = make_cell(rotation=0.0), make_cell(rotation=100e-6)
    assert abs(true(turning, plan).value - true(still, plan).value) > 0.1e-6
