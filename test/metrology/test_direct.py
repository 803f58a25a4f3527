"""Directly measured errors: their table, and the comparison of a result with them."""

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan
from refused import a_fault, refused

from stepdiag_ros.metrology.comparison import compare_directly, in_result_frame
from stepdiag_ros.metrology.direct_reading import read_direct
from stepdiag_ros.metrology.geometry import TRANSLATIONS, moving_axis
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.table_one import table_one

HEADER = "name,position_m,repeat,value,standard_uncertainty,definition\n"
GOOD = (
    "# optical flat 123, certificate 45\n"
    + HEADER
    + "E_YX,0.02,0,3e-7,1e-7,\nE_YX,0.00,0,1e-7,1e-7,\nE_YX,0.01,0,2e-7,1e-7,\n"
    + "\nE_YX,0.00,1,3e-7,1e-7,\nE_YX,0.01,1,2e-7,1e-7,\nE_YX,0.02,1,5e-7,1e-7,\n"
    + "B0Z,,0,1e-5,2e-6,angle\nB0Z,,1,3e-5,2e-6,angle\nC0Y,,,4e-6,,rotation\n"
)
VOLUME = make_plan(blocks=6).volume


def true_squareness(cell):
    """Return the sums of slopes of least-squares lines; those of the waves belong to it."""
    slopes = {
        name: np.polyfit(VOLUME.nodes(moving_axis(name)), curve, 1)[0]
        for name, curve in cell.truth(VOLUME).items()
    }
    return {
        "C0Y": -slopes["E_XY"] - slopes["E_YX"],
        "B0Z": slopes["E_XZ"] + slopes["E_ZX"],
        "A0Z": -slopes["E_YZ"] - slopes["E_ZY"],
    }


def truth_table(cell, seed=0, noise=3e-8, stated=5e-8, repeats=3, shift=0.0):
    """Return the table of a direct measurement of a cell, straightedges lying askew."""
    rng = np.random.default_rng(seed)
    curves = cell.truth(VOLUME)
    rows = []
    for name in TRANSLATIONS:
        way = VOLUME.nodes(moving_axis(name))
        for repeat in range(repeats):
            askew = rng.normal(0, 1e-4) if name[2] != name[3] else 0.0
            values = curves[name] + askew * way + rng.normal(0, 1e-5)
            values = values + noise * rng.standard_normal(len(way)) + shift * (way > way[2])
            rows += [
                f"{name},{float(p)!r},{repeat},{float(v)!r},{stated},"
                for p, v in zip(way, values, strict=True)
            ]
    for name, angle in true_squareness(cell).items():
        rows.append(f"{name},,0,{angle},1e-6,rotation")
    return read_direct(HEADER + "\n".join(rows), "table")


def test_a_table_is_read_as_it_is_meant():
    direct = read_direct(GOOD, "artefact.csv")
    assert direct.notes == ("optical flat 123, certificate 45",)
    curve = direct.curves["E_YX"]
    np.testing.assert_allclose(curve.positions, [0.0, 0.01, 0.02])
    np.testing.assert_allclose(curve.values, [[1e-7, 2e-7, 3e-7], [3e-7, 2e-7, 5e-7]])
    np.testing.assert_allclose(curve.mean, [2e-7, 2e-7, 4e-7])
    # Stated 0.1 µm, and two repeats 0.2 µm apart: s/√2 = 0.1 µm.
    mean, uncertainty = curve.evaluate(np.eye(3))
    np.testing.assert_allclose(mean, [2e-7, 2e-7, 4e-7])
    np.testing.assert_allclose(uncertainty, [np.sqrt(2) * 1e-7, 1e-7, np.sqrt(2) * 1e-7])
    # From the first to the last both repeats say 0.2 µm: only what is stated is left.
    np.testing.assert_allclose(
        np.ravel(curve.evaluate(np.array([[-1.0, 0.0, 1.0]]))), [2e-7, np.sqrt(2) * 1e-7]
    )
    # Larger than 90° is a negative right-handed rotation for B0Z alone.
    assert direct.squareness["B0Z"].mean == pytest.approx(-2e-5)
    assert direct.squareness["C0Y"].mean == pytest.approx(4e-6)
    assert np.isnan(direct.squareness["C0Y"].standard_uncertainty)
    short = read_direct("name,position_m,value\nE_AX,0,0\nE_AX,1,1e-6\nE_AX,2,2e-6\n", "short")
    assert np.all(np.isnan(short.curves["E_AX"].evaluate(np.eye(3))[1]))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (GOOD, "", a_fault("too_few", "a.csv", "position_m", aspect="header")),
        (GOOD, HEADER, a_fault("too_few", "a.csv", aspect="values")),
        ("value,", "wert,", a_fault("missing", "value", "a.csv")),
        ("repeat,", "run,", a_fault("unknown", "run", "a.csv")),
        ("E_YX,0.02,0", "E_YW,0.02,0", a_fault("unknown", "E_YW", "a.csv", "3")),
        ("0.02,0,3e-7", "0.02,0,3 µm", a_fault("malformed", "3 µm", "a.csv", "3")),
        ("0.02,0,3e-7", "0.02,0,0.3", a_fault("out_of_range", "3", "0.3")),
        ("0.02,0,3e-7", ",0,3e-7", a_fault("malformed", "3", "position_m")),
        ("0.02,0,3e-7", "nan,0,3e-7", a_fault("malformed", "nan", "3", "position_m")),
        ("0.02,0,3e-7", "0.02,-1,3e-7", a_fault("malformed", "-1", "3")),
        (
            "3e-7,1e-7,\nE_YX,0.00,0",
            "3e-7,0,\nE_YX,0.00,0",
            a_fault("out_of_range", "3", "standard_uncertainty", "0"),
        ),
        (
            "3e-7,1e-7,\nE_YX,0.00,0",
            "3e-7\nE_YX,0.00,0",
            a_fault("too_few", "3", "4", "6", aspect="cells"),
        ),
        (
            "0.02,0,3e-7",
            "0.01,0,3e-7",
            a_fault("twice", "5", "E_YX", "0.01", "0", "3"),
        ),
        ("E_YX,0.02,1,5e-7,1e-7,\n", "", a_fault("mismatch", "a.csv", "E_YX", "1")),
        (
            "1e-5,2e-6,angle",
            "1e-5,2e-6,",
            a_fault("unknown", "10", "B0Z"),
        ),
        ("B0Z,,0", "B0Z,0.1,0", a_fault("too_many", "10", "B0Z")),
        ("B0Z,,1", "B0Z,,0", a_fault("twice", "11", "B0Z", "0", "10")),
        ("0.02,0,3e-7,1e-7,", "0.02,0,3e-7,1e-7,angle", a_fault("too_many", "3", "E_YX")),
    ],
)
def test_a_wrong_table_is_refused_in_one_sentence(old, new, message):
    assert old in GOOD
    with refused(Refusal, message) as refusal:
        read_direct(GOOD.replace(old, new, 1), "a.csv")
    assert "\n" not in str(refusal.value)


PLACED = (
    "name,position_m,value,x_m,y_m,z_m,reflector_z_m\n"
    "E_YX,0.00,0,,0.1,0.2,0.05\nE_YX,0.01,1e-7,,0.1,0.2,0.05\nE_YX,0.02,0,,0.1,0.2,0.05\n"
)


def test_the_place_of_a_curve_is_read_and_must_be_one():
    place = read_direct(PLACED, "a.csv").curves["E_YX"].place
    assert np.isnan(place.standing[0]) and place.standing[1:] == (0.1, 0.2)
    assert place.reflector == (0.0, 0.0, 0.05)
    for old, new in (("1e-7,,0.1", "1e-7,,0.3"), ("0.2,0.05", "0.2,"), ("0.2,0.05", "x,0.05")):
        with refused(Refusal, None, "a.csv"):
            read_direct(PLACED.replace(old, new, 1), "a.csv")


def test_two_positions_show_no_shape():
    with refused(Refusal, "too_few", "E_XX", "2", aspect="positions"):
        read_direct("name,position_m,value\nE_XX,0,0\nE_XX,1,1e-6\n", "a.csv")


def result_and_cell(noise=0.1e-6, seed=2):
    cell = make_cell(noise=noise)
    plan = make_plan(blocks=6, repeats=3)
    return solve(simulate(plan, cell, seed=seed), "least_squares"), cell


def test_a_right_direct_measurement_agrees_and_a_wrong_one_does_not():
    result, cell = result_and_cell()
    compared = compare_directly(result, truth_table(cell))
    assert [curve.name for curve in compared.curves] == list(TRANSLATIONS)
    errors = np.concatenate([curve.normalised_error for curve in compared.curves])
    errors = errors[np.isfinite(errors)]
    assert np.mean(np.abs(errors) <= 1.0) > 0.9
    assert 0.2 < np.sqrt(np.mean(errors**2)) < 0.7
    assert all(abs(angle.normalised_error) < 1.0 for angle in compared.squareness)
    assert compared.not_compared == {}
    wrong = compare_directly(result, truth_table(cell, shift=2e-6))
    for curve in wrong.curves:
        assert np.nanmax(np.abs(curve.normalised_error)) > 1.5, curve.name


def test_zero_and_slope_of_a_straightedge_do_not_matter():
    result, cell = result_and_cell()
    exact = compare_directly(result, truth_table(cell, noise=0.0))
    for curve in exact.curves:
        if curve.reference == "deviation from the least-squares line":
            assert np.max(np.abs(curve.difference)) < 0.3e-6
            assert np.mean(curve.direct) == pytest.approx(0.0, abs=1e-15)
        else:
            assert curve.direct[0] == 0.0
            assert np.isnan(curve.normalised_error[0])


@pytest.mark.parametrize(("runs", "within"), [(15, 0.16), (60, 0.08)], ids=["few", "many"])
def test_the_uncertainty_of_the_difference_is_its_scatter(runs, within):
    cell = make_cell()
    plan = make_plan(blocks=6)
    errors = []
    for seed in range(runs):
        result = solve(by_noise_alone(simulate(plan, cell, seed=seed)), "setup_robust")
        direct = truth_table(cell, seed=seed, noise=5e-8, stated=5e-8, repeats=1)
        # With one repeat what is stated holds the repeatability.
        errors += [c.normalised_error for c in compare_directly(result, direct).curves]
    found = np.concatenate(errors)
    assert np.nanstd(found) * 2.0 == pytest.approx(1.0, abs=within)


def test_other_positions_than_the_nodes_are_interpolated_and_those_beyond_refused():
    result, _ = result_and_cell(noise=0.0)
    rows = [
        f"E_XX,{p},0,{np.interp(p, result.nodes[0], result.curves['E_XX'])},1e-8,"
        for p in (0.005, 0.0123, 0.037)
    ]
    inside = read_direct(HEADER + "\n".join(rows), "a.csv")
    compared = compare_directly(result, inside).curves[0]
    assert np.max(np.abs(compared.difference)) < 1e-12
    beyond = read_direct(HEADER + "\n".join([*rows, "E_XX,0.2,0,0,1e-8,"]), "a.csv")
    with refused(Refusal, "out_of_range", "E_XX", "X", "0.2"):
        compare_directly(result, beyond)


def test_what_a_method_does_not_tell_is_said():
    result, _ = result_and_cell()
    direct = read_direct(
        HEADER + "".join(f"E_BY,{p},0,1e-6,1e-7,\n" for p in (0.0, 0.01, 0.02)), "a.csv"
    )
    assert compare_directly(result, direct).not_compared == {"E_BY": "which it does not estimate"}


def test_measured_straightness_and_squareness_make_the_curves_of_figures_7_to_9():
    _, cell = result_and_cell()
    direct = truth_table(cell, noise=0.0)
    found = in_result_frame(direct)
    true = cell.truth(VOLUME)
    assert set(found) == set(TRANSLATIONS)
    for name, repeats in found.items():
        for values in repeats:
            np.testing.assert_allclose(values, true[name], atol=1e-12, err_msg=name)


def test_table_1_holds_the_definitions_of_the_paper():
    result, cell = result_and_cell(noise=0.0)
    rows = {
        row.label: row for row in table_one({"least_squares": result}, truth_table(cell, noise=0))
    }
    assert next(iter(rows)) == "Positioning error in X" and len(rows) == 12
    straight = rows["Straightness of X axis (Y direction)"]
    way, curve = result.nodes[0], result.curves["E_YX"]
    bent = curve - np.polyval(np.polyfit(way, curve, 1), way)
    assert straight.estimated["least_squares"].value == pytest.approx(np.ptp(bent))
    assert straight.measured.value == pytest.approx(np.ptp(bent), rel=0.02)
    slopes = {
        name: np.polyfit(result.nodes[moving_axis(name)], result.curves[name], 1)[0]
        for name in TRANSLATIONS
    }
    angles = true_squareness(cell)
    for label, pair, angle in (
        ("Squareness of X-Y", ("E_XY", "E_YX"), -angles["C0Y"]),
        ("Squareness of X-Z", ("E_XZ", "E_ZX"), angles["B0Z"]),
        ("Squareness of Y-Z", ("E_ZY", "E_YZ"), -angles["A0Z"]),
    ):
        row = rows[label]
        expected = 0.06 * (slopes[pair[0]] + slopes[pair[1]])
        assert row.estimated["least_squares"].value == pytest.approx(expected)
        assert row.measured.value == pytest.approx(0.06 * angle)
    with refused(Refusal, "too_few", aspect="results"):
        table_one({})
