"""KIMM: four step diagonals and three linear axes; identified and measured straightness."""

import numpy as np
import pytest
from cells_for_tests import by_noise_alone

from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.metrology.comparison import compare_directly
from stepdiag_ros.metrology.direct_reading import read_direct
from stepdiag_ros.metrology.geometry import moving_axis
from stepdiag_ros.metrology.repeats import line_errors
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve

STRAIGHTNESS = ("E_YX", "E_ZX", "E_XY", "E_ZY", "E_XZ", "E_YZ")


def measured(seed):
    plan, cell = load_plan("kimm")[0], load_cell("demo")[0]
    # That the cell does not turn is known.
    return by_noise_alone(simulate(plan, cell, seed=seed, readings_per_stop=25)), cell


def straightedge(volume, truth, seed):
    """Return six straightnesses measured with a straightedge of 0.1 µm (k = 2) that lies askew."""
    rng = np.random.default_rng(seed)
    rows = ["name,position_m,repeat,value,standard_uncertainty"]
    for name in STRAIGHTNESS:
        way = volume.nodes(moving_axis(name))
        values = truth[name] + 5e-8 * rng.standard_normal(len(way)) + 2e-4 * way
        for position, value in zip(way.tolist(), values.tolist(), strict=True):
            rows.append(f"{name},{position!r},0,{value!r},5e-8")
    return read_direct("\n".join(rows), "straightedge.csv")


@pytest.mark.parametrize("method", ["alternative", "setup_robust", "least_squares"])
def test_identified_straightness_is_that_of_a_straightedge(method):
    """95 % of the points lie within E_n = ±1, and the differences are some 0.1 µm."""
    errors = []
    for seed in range(8):
        measurement, cell = measured(seed)
        direct = straightedge(measurement.volume, cell.truth(measurement.volume), seed + 50)
        compared = compare_directly(solve(measurement, method), direct)
        assert [curve.name for curve in compared.curves] == list(STRAIGHTNESS)
        errors += [curve.normalised_error for curve in compared.curves]
        largest = max(np.max(np.abs(curve.difference)) for curve in compared.curves)
        assert 0.05e-6 < largest < 0.5e-6
    assert np.mean(np.abs(errors) <= 1.0) == pytest.approx(0.955, abs=0.03)


def test_the_four_diagonals_are_drawn_with_their_setup_errors():
    """Fig. 2: the demonstration's setups of 150 µrad make steps of micrometres within a block."""
    lines = {line.name: line for line in line_errors(measured(7)[0])}
    assert set(lines) == {"x", "y", "z", "ppp XYZ", "npp XYZ", "pnp XYZ", "ppn XYZ"}
    for name, line in lines.items():
        assert len(line.errors) == 3
        if len(name) > 1:
            assert np.ptp(line.errors[0][:4]) > 0.2e-6
