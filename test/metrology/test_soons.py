"""Angular errors from three move orders (Ibaraki & Hata 2010, eqs. 24-29)."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.geometry import CHAINS, moving_axis
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.result import NotDeterminable
from stepdiag_ros.metrology.solvers.soons import (
    Equation,
    angle_uncertainty,
    angles_not_seen,
    angles_seen,
    equations_of,
    matrix_of_equations,
)

STEP = (0.01, 0.013, 0.007)
BLOCKS = 5
ORDERS = ("XYZ", "YZX", "ZXY")


def measured(chain="YXZ", noise=0.0, seed=0, shared=True, rotation=2e-5, cell_seed=3, **plan):
    made = replace(
        make_plan(
            blocks=BLOCKS,
            step=STEP,
            diagonals=plan.pop("diagonals", ("ppp", "npp", "pnp")),
            orders=plan.pop("orders", ORDERS),
            **plan,
        ),
        one_alignment_per_diagonal=shared,
    )
    high = tuple(BLOCKS * size for size in STEP)
    cell = make_cell(
        chain=chain, high=high, noise=noise, rotation=rotation, tilt=1.5e-4, seed=cell_seed
    )
    return simulate(made, cell, seed=seed), cell


def truth(cell, volume, name):
    axis = moving_axis(name)
    values = cell.errors.at(axis, volume.nodes(axis))[:, "XYZABC".index(name[2])]
    return values - values[0]


def test_the_five_equations_are_those_of_the_paper():
    """IH (24)-(28): DA, CB are Y moves, HG, DC are X moves, EH and FE likewise."""
    x, y, z = range(3)
    assert equations_of("YXZ") == (
        Equation(y, x, "pnp"),
        Equation(x, z, "pnp"),
        Equation(y, x, "npp"),
        Equation(y, z, "npp"),
        Equation(x, z, "npp"),
    )
    assert angles_seen("YXZ") == ("E_AX", "E_CX", "E_AZ", "E_BZ", "E_CZ")
    assert angles_not_seen("YXZ") == ("E_BX", "E_AY", "E_BY", "E_CY")


def test_the_coefficients_are_those_of_the_corrected_unequal_step_form():
    """METROLOGY, "The printed formulas, checked"; a move is counted along +axis here.

    The paper's differences are, with the senses of its moves: R_DA - R_CB of pnp is Y backwards
    before minus after X, R_AD - R_BC of npp is Y after minus before X, and so on.
    """
    a_x, a_y, a_z = STEP
    norm = np.linalg.norm(STEP)
    found = matrix_of_equations("YXZ", np.array(STEP)) * norm
    ax, cx, az, bz, cz = np.eye(5)
    expected = [
        a_y * (-a_z * ax + a_x * cx),
        a_x * (a_z * bz + a_y * cz),
        a_y * (-a_z * ax - a_x * cx),
        a_y * (-a_z * az - a_x * cz),
        a_x * (a_z * bz - a_y * cz),
    ]
    # Of (26) the X axis runs backwards, of (28) the X moves do: the sign of the whole equation.
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("chain", CHAINS)
def test_five_angles_of_any_chain_come_out_right(chain):
    measurement, cell = measured(chain)
    result = solve(measurement, "soons")
    assert tuple(result.curves) == angles_seen(chain)
    for name, curve in result.curves.items():
        true = truth(cell, measurement.volume, name)
        # Second order: angle times tilt and squareness, some 1e-4 of the angles.
        assert np.max(np.abs(curve - true)) < 5e-3 * np.max(np.abs(true)) + 1e-9, name
    for name in angles_not_seen(chain):
        assert any(name in text for text in result.not_determined)


def test_translations_and_alignment_alone_give_no_angle():
    measurement, _ = measured(rotation=0.0)
    for curve in solve(measurement, "soons").curves.values():
        assert np.max(np.abs(curve)) < 3e-7


def test_the_standard_uncertainty_holds_over_many_runs():
    deviations = []
    for seed in range(60):
        measurement, cell = measured(noise=0.1e-6, seed=seed)
        result = solve(measurement, "soons")
        deviations += [
            (result.curves[name][1:] - truth(cell, measurement.volume, name)[1:])
            / result.standard_uncertainty[name][1:]
            for name in result.curves
        ]
    spread = np.concatenate(deviations)
    assert np.sqrt(np.mean(spread**2)) == pytest.approx(1.0, abs=0.1)
    assert 0.92 < np.mean(np.abs(spread) < 1.96) < 0.98


def test_what_equation_29_says_of_the_uncertainty():
    sizes = angle_uncertainty(Volume((0, 0, 0), (0.01,) * 3, 12), "YXZ", 0.1e-6)
    turn = sizes["E_AX"]
    assert turn.worst_per_block == pytest.approx(3.5e-5, rel=0.02)
    assert turn.worst_over_travel == pytest.approx(4.2e-4, rel=0.02)
    assert turn.standard_per_block == pytest.approx(np.sqrt(3) * 1e-5)
    assert turn.standard_over_travel == pytest.approx(6e-5)
    assert set(sizes) == set(angles_seen("YXZ"))


def test_orders_aligned_one_by_one_tell_the_shapes_only():
    measurement, cell = measured(shared=False)
    result = solve(measurement, "soons")
    assert all(np.all(np.isnan(curve)) for curve in result.curves.values())
    assert any("one_alignment_per_diagonal" in text for text in result.not_determined)
    assert not any(figure.name.startswith("angular") for figure in result.figures)
    for name in result.curves:
        true = truth(cell, measurement.volume, name)
        way = measurement.volume.nodes(moving_axis(name))
        bent = true - np.polyval(np.polyfit(way, true, 1), way)
        figure = result.figure(f"shape {name}")
        assert figure.value == pytest.approx(np.ptp(bent), rel=0.02, abs=1e-8)


def test_what_is_missing_is_said():
    measurement, _ = measured()
    with refused(NotDeterminable, "missing", aspect="chain"):
        solve(replace(measurement, chain=""), "soons")
    with refused(NotDeterminable, "missing", "pnp", "npp", aspect="orders"):
        lines = tuple(line for line in measurement.lines if line.line.name != "npp")
        solve(replace(measurement, lines=lines), "soons")
    one_order, _ = measured(orders=("XYZ",))
    with refused(NotDeterminable, "missing", "XYZ", "YZX", "ZXY", aspect="orders"):
        solve(one_order, "soons")
    with refused(Refusal, "unknown", "YXY"):
        equations_of("YXY")


def test_the_estimate_that_uses_everything_agrees():
    measurement, _ = measured(
        noise=0.1e-6, seed=5, repeats=5, diagonals=("ppp", "npp", "pnp", "ppn")
    )
    soons, rigid = solve(measurement, "soons"), solve(measurement, "rigid_body")
    compared = 0
    for name, curve in soons.curves.items():
        known = np.isfinite(rigid.curves[name]) & (soons.standard_uncertainty[name] > 0)
        gap = np.abs(curve - rigid.curves[name])[known]
        # The worse of two estimates from the same readings: var(difference) = difference of var.
        assert np.all(gap <= 4 * soons.standard_uncertainty[name][known]), name
        assert np.all(
            rigid.standard_uncertainty[name][known] <= soons.standard_uncertainty[name][known]
        )
        compared += int(np.count_nonzero(known))
    assert compared > 0
