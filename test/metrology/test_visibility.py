"""The visibility table: wording, agreement with what the solvers can do, further effects."""

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.geometry import CURVES, ROTATIONS, SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.visibility import (
    CONFOUNDED,
    DETERMINED,
    INVISIBLE,
    PARTLY,
    measured_visibility,
    visibility,
)

ORDERS = ("XYZ", "YZX", "ZXY")
FIVE = {"E_AX", "E_CX", "E_AZ", "E_BZ", "E_CZ"}


def seen(table):
    return {name for name in ROTATIONS if table.row(name).status != INVISIBLE}


@pytest.mark.parametrize("orders", [("XYZ",), ORDERS])
def test_step_diagonals_show_five_of_the_nine_rotations(orders):
    """Ibaraki & Hata 2010, section 4.2, chain YXZ."""
    table = visibility(make_plan(6, linear=(), orders=orders), "YXZ", 0.1e-6)
    assert seen(table) == FIVE
    hidden = table.row("E_BY")
    assert hidden.words == "invisible: E_XY, E_ZY can do the same"
    assert np.isnan(hidden.end)
    assert np.isnan(hidden.largest)


def test_linear_lines_show_three_more_rotations_but_never_the_first_axis_about_itself():
    table = visibility(make_plan(6, orders=ORDERS), "YXZ", 0.1e-6)
    assert seen(table) == FIVE | {"E_BX", "E_AY", "E_CY"}
    assert table.row("E_AX").status == table.row("E_CZ").status == DETERMINED
    for name in ("E_CX", "E_AZ", "E_BZ"):
        row = table.row(name)
        assert row.status == PARTLY
        assert row.words.startswith("partly determined: the shape, not the slope; the rest with E_")
        assert np.isnan(row.end)
        assert 1e-6 < row.largest < 100e-6
    assert table.row("E_AY").confounded_with == ("E_CY",)
    assert table.row("E_CY").words == "confounded with E_AY"


def test_a_plan_without_turning_axes_determines_all_translations_and_squareness():
    table = visibility(make_plan(6), "", 0.1e-6)
    assert [row.name for row in table.rows] == [*TRANSLATIONS, "C0Y", "B0Z", "A0Z"]
    assert set(table.named(DETERMINED)) == {row.name for row in table.rows}
    assert table.rank == table.unknowns
    assert table.condition_number > 1.0


def test_a_line_that_is_missing_is_told():
    one = visibility(make_plan(6, diagonals=(), linear=("y",)), "", 0.1e-6)
    assert one.named(DETERMINED) == ("E_YY",)
    assert one.row("E_XZ").words == "invisible: no line sees it"
    three = visibility(make_plan(6, linear=(), diagonals=("ppp", "npp", "pnp")), "", 0.1e-6)
    assert three.row("E_XX").status == PARTLY
    for name in SQUARENESS:
        assert three.row(name).status == CONFOUNDED


@pytest.mark.parametrize("chain", ["", "YXZ", "ZXY"])
def test_expected_uncertainties_are_those_of_the_solver(chain):
    """Before the measurement the same numbers as after it."""
    plan = make_plan(5, orders=ORDERS, repeats=2)
    noise = 0.07e-6
    measured = simulate(plan, make_cell(noise=noise, chain=chain or "YXZ"))
    result = solve(by_noise_alone(measured), "rigid_body" if chain else "least_squares")
    table = visibility(plan, chain, noise)
    assert table.stop_uncertainty == pytest.approx(noise)
    determined = 0
    for name in CURVES if chain else TRANSLATIONS:
        row = table.row(name)
        known = np.isfinite(result.curves[name])
        assert np.all(known) == (row.status == DETERMINED)
        if row.status == DETERMINED:
            spread = result.standard_uncertainty[name]
            assert row.end == pytest.approx(spread[-1], rel=1e-6, abs=1e-15)
            assert row.largest == pytest.approx(np.max(spread), rel=1e-6)
            assert row.condition >= 1.0 - 1e-9
            determined += 1
        if chain:
            told = [words for words in result.not_determined if words.startswith(f"{name}:")]
            assert told == ([] if row.status == DETERMINED else [f"{name}: {row.words}."])
    for name in SQUARENESS:
        figure = result.figure(name)
        assert np.isfinite(figure.value) == (table.row(name).status == DETERMINED)
        assert table.row(name).end == pytest.approx(
            figure.standard_uncertainty, rel=1e-6, nan_ok=True
        )
    assert determined >= 4


def test_partners_can_really_do_the_same():
    """A change of one rotation is made up for by the other one and the setups, to the last bit."""
    plan = make_plan(4, orders=ORDERS)
    cell = make_cell(noise=0.0, tilt=0.0, rotation=0.0)
    from stepdiag_ros.metrology.solvers.design import Design
    from stepdiag_ros.metrology.solvers.observations import observe

    design = Design(observe(simulate(plan, cell)), "YXZ")
    row = measured_visibility(simulate(plan, cell)).row("E_AY")
    (partner,) = row.confounded_with
    names = [row.name, partner]
    inside = np.concatenate(
        [design.curve_column[design.names.index(name)] for name in names]
        + [design.tilt_column.reshape(-1), design.zero_column]
    )
    inside = inside[inside < design.count]
    values = np.linalg.svd(design.matrix[:, inside], compute_uv=False)
    assert values[-1] < 1e-9 * values[0]
    # Neither of them alone.
    for name in names:
        alone = np.concatenate([design.curve_column[design.names.index(name)], inside[8:]])
        alone = alone[alone < design.count]
        values = np.linalg.svd(design.matrix[:, np.unique(alone)], compute_uv=False)
        assert values[-1] > 1e-6 * values[0]


def test_wrong_input_says_one_sentence():
    plan = make_plan(3)
    with refused(Refusal, "out_of_range", "0"):
        visibility(plan, "YXZ", 0.0)
    with refused(Refusal, "unknown", "XXY"):
        visibility(plan, "XXY", 1e-7)
    with pytest.raises(KeyError):
        visibility(plan, "", 1e-7).row("E_AX")
