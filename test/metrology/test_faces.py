"""Step diagonals of faces: two-dimensional tests, as of machines with two axes."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell
from hidden_runs import with_change
from refused import refused
from test_direct_in_solve import measured_directly, true_squareness, uncertain

from stepdiag_ros.metrology.discrepancy import CONSISTENT, NAMED, diagnose
from stepdiag_ros.metrology.discrepancy.extra_lines import alignments
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.geometry import TRANSLATIONS, move_orders, translation
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import Plan, axes_at_hand
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import NotDeterminable, solve, solve_all
from stepdiag_ros.metrology.visibility import DETERMINED, INVISIBLE, visibility

FACES = {"xy": ("pp0", "np0"), "xz": ("p0p", "n0p"), "yz": ("0pp", "0np")}
SQUARE_OF = {"xy": "C0Y", "xz": "B0Z", "yz": "A0Z"}
SHARES = {10: (0.91, 1.0), 200: (0.93, 0.97)}
"""Number of machines → the least and largest share of curve values inside their 95 %."""
COUNTS = pytest.mark.parametrize("machines", SHARES, ids=["few", "many"])


def face_plan(plane="xy", blocks=6, step=(0.02, 0.02, 0.02), repeats=2, groups=None, **options):
    """Return a plan of the linear lines and both step diagonals of a face."""
    groups = groups or [
        {"kind": "linear", "names": list(plane)},
        {"kind": "step_diagonal", "names": list(FACES[plane])},
    ]
    mapping = {
        "step_m": list(step),
        "blocks": blocks,
        "repeats": repeats,
        "directions": ["forward", "backward"],
        "feed_m_per_s": 0.05,
        "lines": groups,
        **options,
    }
    return Plan.from_mapping(mapping, "face plan")


def in_plane(plane):
    axes = ["xyz".index(letter) for letter in plane]
    return [translation(error, axis) for axis in axes for error in axes]


def machine(seed=3, rotation=0.0, noise=0.1e-6, tilt=150e-6, chain="YXZ"):
    return make_cell(seed, chain, high=(0.12,) * 3, noise=noise, tilt=tilt, rotation=rotation)


@pytest.mark.parametrize("plane", FACES)
@pytest.mark.parametrize("step", [(0.02, 0.02, 0.02), (0.02, 0.012, 0.015)])
@pytest.mark.parametrize("method", ["setup_robust", "least_squares"])
def test_both_methods_are_exact_without_noise(plane, step, method):
    plan = face_plan(plane, step=step)
    cell = machine(noise=0.0, tilt=5e-6)
    result = solve(simulate(plan, cell), method)
    truth = cell.truth(plan.volume)
    for name in in_plane(plane):
        np.testing.assert_allclose(result.curves[name], truth[name], atol=2e-10)


@pytest.mark.parametrize("plane", FACES)
def test_of_the_third_axis_nothing_is_known_and_nothing_is_zero(plane):
    plan = face_plan(plane)
    results, refused = solve_all(simulate(plan, machine()))
    assert {"setup_robust", "least_squares", "rigid_body"} <= set(results)
    assert {"conventional", "alternative", "soons"} <= set(refused)
    for result in results.values():
        for name in set(TRANSLATIONS) - set(in_plane(plane)):
            assert np.all(np.isnan(result.curves[name][1:]))
            assert np.all(np.isnan(result.standard_uncertainty[name][1:]))
            assert any(name in words for words in result.not_determined)
        for name in set(SQUARE_OF.values()) - {SQUARE_OF[plane]}:
            assert np.isnan(result.figure(name).value)
    assert np.isfinite(results["setup_robust"].figure(SQUARE_OF[plane]).value)


def coverage(machines, method, rotation, angles, wander=0.0):
    """Return the shares of curve values and of squareness inside their 95 %."""
    plan, inside, square = face_plan(), [], []
    for run in range(machines):
        cell = machine(seed=run, rotation=rotation)
        lines = simulate(plan, cell, seed=1000 + run)
        rng = np.random.default_rng(run)
        for line in lines.lines:
            line.displacement[:] += wander * rng.standard_normal()
        if not rotation:
            lines = by_noise_alone(lines)
        if angles:
            lines = replace(lines, direct=measured_directly(cell, angles, run))
        result = solve(lines, method)
        truth = cell.truth(plan.volume)
        for name in in_plane("xy"):
            u = result.standard_uncertainty[name]
            free = u > 1e-15
            inside.append(np.abs(result.curves[name] - truth[name])[free] <= 1.96 * u[free])
        figure = result.figure("C0Y")
        error = abs(figure.value - true_squareness(truth)[figure.name])
        square.append(error <= 1.96 * figure.standard_uncertainty)
    return np.mean(np.concatenate(inside)), np.mean(square)


@pytest.mark.parametrize("method", ["setup_robust", "least_squares"])
@COUNTS
def test_bands_hold_where_no_axis_turns(method, machines):
    least, most = SHARES[machines]
    inside, square = coverage(machines, method, 0.0, ())
    assert least <= inside <= most
    assert least - 0.02 <= square <= most + 0.02


@pytest.mark.parametrize("method", ["setup_robust", "least_squares"])
@COUNTS
def test_bands_hold_or_widen_on_machines_that_turn_and_whose_zero_wanders(method, machines):
    inside, square = coverage(machines, method, 10e-6, (), wander=0.2e-6)
    assert inside >= SHARES[machines][0]
    assert square >= SHARES[machines][0] - 0.02


@COUNTS
def test_bands_hold_on_machines_that_turn_where_the_angles_in_the_plane_were_measured(machines):
    """All nine angles of 3 µrad act; a face shows those about its normal alone."""
    least, most = SHARES[machines]
    inside, square = coverage(machines, "least_squares", 3e-6, ("E_CX", "E_CY"))
    assert least <= inside <= most
    assert least - 0.02 <= square <= most + 0.02


def test_six_faces_and_three_lines_tell_all_nine_curves():
    groups = [{"kind": "linear", "names": ["x", "y", "z"]}]
    groups += [{"kind": "step_diagonal", "names": list(names)} for names in FACES.values()]
    plan = face_plan(groups=groups)
    cell = machine(noise=0.0, tilt=5e-6)
    truth = cell.truth(plan.volume)
    for method in ("setup_robust", "least_squares"):
        result = solve(simulate(plan, cell), method)
        for name in TRANSLATIONS:
            np.testing.assert_allclose(result.curves[name], truth[name], atol=2e-10)
        assert result.not_determined == ()


@pytest.mark.parametrize("missing", ["x", "y", "pp0", "np0"])
def test_the_formulation_says_which_line_is_missing(missing):
    """Least squares needs less: any three of these four lines tell the face."""
    lines = simulate(face_plan(), machine(), seed=4)
    truth = machine().truth(face_plan().volume)
    left = tuple(line for line in lines.lines if line.line.name != missing)
    with refused(NotDeterminable, "missing", about=missing, aspect="lines"):
        solve(replace(lines, lines=left), "setup_robust")
    result = solve(replace(lines, lines=left))
    for name in in_plane("xy"):
        error = np.abs(result.curves[name] - truth[name])
        assert np.all(error <= 4.5 * result.standard_uncertainty[name] + 1e-12)


def test_diagonals_of_iso_230_6_are_no_steps():
    groups = [
        {"kind": "linear", "names": ["x", "y"]},
        {"kind": "diagonal", "names": ["pp0", "np0"]},
    ]
    with pytest.raises(NotDeterminable):
        solve(simulate(face_plan(groups=groups), machine()), "setup_robust")


def test_noise_from_repeats_makes_the_bands_of_the_formulation():
    lines = uncertain(simulate(face_plan(), machine(), seed=2), np.nan)
    known = solve(simulate(face_plan(), machine(), seed=2), "setup_robust")
    found = solve(lines, "setup_robust")
    assert found.standard_uncertainty["E_YX"][3] == pytest.approx(
        known.standard_uncertainty["E_YX"][3], rel=0.2
    )


@pytest.mark.parametrize("plane", FACES)
def test_the_table_of_a_plan_says_what_a_face_tells(plane):
    rows = {row.name: row for row in visibility(face_plan(plane), "", 0.1e-6).rows}
    for name in TRANSLATIONS:
        wanted = DETERMINED if name in in_plane(plane) else INVISIBLE
        assert rows[name].status == wanted
    assert rows[SQUARE_OF[plane]].status == DETERMINED


def test_moves_of_a_face():
    assert move_orders("pp0") == ("XY", "YX")
    assert move_orders("0np") == ("YZ", "ZY")
    assert len(move_orders("ppp")) == 6
    plan = face_plan(groups=[{"kind": "step_diagonal", "names": ["np0"], "orders": ["YX"]}])
    stops = plan.lines[0].stops(plan.volume)
    assert len(stops) == 2 * 6 + 1
    np.testing.assert_allclose(stops[:4, :2], [[0.12, 0], [0.12, 0.02], [0.10, 0.02], [0.10, 0.04]])
    assert np.all(stops[:, 2] == 0.0)
    assert plan.lines[0].setup == "np0 YX"


def test_a_group_gives_each_diagonal_the_orders_of_its_own_axes():
    groups = [
        {"kind": "step_diagonal", "names": ["ppp", "pp0", "p0p"], "orders": ["XYZ", "YX", "XZ"]}
    ]
    found = dict.fromkeys((line.name, line.order) for line in face_plan(groups=groups).lines)
    assert list(found) == [("ppp", "XYZ"), ("pp0", "YX"), ("p0p", "XZ")]
    shifted = {"kind": "step_diagonal", "names": ["pp0"], "offset_m": [0, 0, 0.05]}
    assert np.all(face_plan(groups=[shifted]).lines[0].stops(face_plan().volume)[:, 2] == 0.05)


@pytest.mark.parametrize(
    ("group", "named"),
    [
        ({"names": ["pp0"], "orders": ["XYZ"]}, "pp0"),
        ({"names": ["pp0"], "orders": ["XZ"]}, "pp0"),
        ({"names": ["ppp"], "orders": ["XY"]}, "ppp"),
        ({"names": ["pp0", "ppp"], "orders": ["XY"]}, "ppp"),
        ({"names": ["pp0"], "orders": ["XY", "XZ"]}, "XZ"),
        ({"names": ["pp0"], "offset_m": [0.01, 0, 0]}, "offset_m"),
        ({"names": ["ppp"], "offset_m": [0.01, 0, 0]}, "offset_m"),
        ({"names": ["pp"]}, "pp"),
    ],
)
def test_orders_and_shifts_that_a_diagonal_cannot_have_are_refused(group, named):
    with refused(Refusal, None, named) as caught:
        face_plan(groups=[{"kind": "step_diagonal", **group}])
    assert str(caught.value).startswith("face plan: ")


def test_a_face_at_another_height_counts_by_its_lever():
    """On a machine that turns, faces at both ends of Z show what tilts them."""
    groups = [{"kind": "linear", "names": ["x", "y", "z"]}]
    for height in (0.0, 0.12):
        groups.append(
            {"kind": "step_diagonal", "names": ["pp0", "np0"], "offset_m": [0, 0, height]}
        )
    lines = simulate(face_plan(groups=groups), machine(rotation=3e-6))
    rigid = solve(lines, "rigid_body")
    assert rigid.chi_squared < rigid.degrees_of_freedom + 5 * np.sqrt(rigid.degrees_of_freedom)
    assert all(isinstance(line, MeasuredLine) for line in lines.lines)


def hidden(effect, seed=5, **plan):
    lines = simulate(face_plan(**plan), machine(seed=seed), seed)
    stops = stops_of(lines)
    added = np.zeros(len(stops.time)) if effect is None else effect.readings(stops)
    return with_change(lines, added)


def test_the_diagnosis_of_a_face_names_backlash_and_is_content_without():
    backlash = ActiveEffect(BACKLASH, {"axis": "X"}, {"lost_motion": 1e-6})
    assert diagnose(hidden(None)).verdict == CONSISTENT
    found = diagnose(hidden(backlash))
    assert found.verdict == NAMED
    assert [finding.label for finding in found.findings] == ["backlash of X"]


@pytest.mark.parametrize("plane", FACES)
def test_further_lines_stay_on_the_two_axes(plane):
    plan = face_plan(plane)
    assert axes_at_hand(plan.lines) == plane.upper()
    for option in alignments(plan.volume, True, plane.upper()):
        for line in option.lines:
            moved = np.ptp(line.stops(plan.volume), axis=0) > 0
            still = np.array([letter not in plane for letter in "xyz"])
            assert not np.any(moved & still)
            assert not np.any(np.asarray(line.offset)[still])
    body = [{"kind": "step_diagonal", "names": ["ppp"]}, {"kind": "linear", "names": ["x"]}]
    assert axes_at_hand(face_plan(groups=body).lines) == "XYZ"
    alone = [{"kind": "linear", "names": ["x", "y"]}]
    assert axes_at_hand(face_plan(groups=alone).lines) == "XYZ"
