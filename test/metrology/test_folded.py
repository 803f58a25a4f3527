"""The fast inverse is the inverse, and steps aside where the matrix has another structure."""

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.folded import fold, inverse_folded, places_in
from stepdiag_ros.metrology.solvers.observations import observe


def normal_matrix(blocks, chain="", **plan):
    made = make_plan(blocks, step=(0.004, 0.005, 0.003), **plan)
    design = Design(observe(simulate(made, make_cell())), chain)
    weighted = design.matrix * np.sqrt(design.weight)[:, None]
    return weighted.T @ weighted, design


def inverted(normal, levels):
    order = np.concatenate(levels)
    return inverse_folded(normal[np.ix_(order, order)], levels, places_in(levels))


@pytest.mark.parametrize("blocks", [2, 3, 8, 9, 30])
def test_inverse_of_a_plan_is_the_inverse(blocks):
    normal, design = normal_matrix(blocks, orders=("ZXY", "YXZ"))
    levels = fold(design.curve_column, design._curve_places, design.count)
    assert sorted(np.concatenate(levels)) == list(range(design.count))
    assert max(len(level) for level in levels[:-1]) <= 18
    inverse = inverted(normal, levels)
    scale = np.sqrt(np.outer(np.diag(inverse), np.diag(inverse)))
    assert inverse / scale == pytest.approx(np.linalg.inv(normal) / scale, abs=1e-9)
    assert design.covariance / scale == pytest.approx(inverse / scale, abs=1e-9)


def test_rotations_have_levels_of_twice_the_size():
    _, design = normal_matrix(8, "YXZ", orders=("XYZ", "YZX", "ZXY"))
    levels = fold(design.curve_column, design._curve_places, design.count)
    assert max(len(level) for level in levels[:-1]) == 36


def test_readings_that_tie_far_levels_are_seen():
    _, design = normal_matrix(8)
    places = design._curve_places.copy()
    places[3, 0] = design.curve_column[0, 4]
    places[3, 1] = design.curve_column[1, 1]
    assert fold(design.curve_column, places, design.count) is None


def test_a_matrix_that_is_not_positive_has_no_inverse():
    normal, design = normal_matrix(8)
    levels = fold(design.curve_column, design._curve_places, design.count)
    for at in (0, 60, design.count - 1):
        broken = normal.copy()
        broken[at, at] = -1.0
        assert inverted(broken, levels) is None
