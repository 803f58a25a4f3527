from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import by_noise_alone, make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.metrology.plausible import PLAUSIBLE_SHIFT, Plausible
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.linear import noise_of
from stepdiag_ros.metrology.solvers.noise_factor import exceeds_chance, widening
from stepdiag_ros.metrology.solvers.observations import observe, unevenly_spaced
from stepdiag_ros.metrology.solvers.positive import inverse_positive


def measure(noise=0.1e-6, seed=1, **plan):
    made = make_plan(**plan)
    high = tuple(6 * s for s in made.volume.step)
    return simulate(made, make_cell(noise=noise, high=high), seed)


def truth_of(measured):
    high = tuple(6 * s for s in measured.volume.step)
    return make_cell(high=high).truth(measured.volume)


@pytest.mark.parametrize(
    ("plan", "freedom"),
    [
        # Degrees of freedom for N = 12
        ({"diagonals": ("ppp", "npp", "pnp"), "linear": ()}, 0),
        ({"diagonals": ("ppp", "npp", "pnp")}, 33),
        ({}, 67),
        ({"directions": ("forward", "backward")}, 247),
        ({"directions": ("forward", "backward"), "orders": ("XYZ", "YZX", "ZXY")}, 823),
    ],
)
def test_degrees_of_freedom_of_a_plan(plan, freedom):
    plan = make_plan(12, **plan)
    measured = simulate(plan, make_cell(high=(0.12,) * 3))
    found = solve(measured, "least_squares").degrees_of_freedom
    # Here every order has an alignment of its own.
    extra = {823: -8 * 2}.get(freedom, 0)
    assert found == freedom + extra


def test_four_diagonals_alone_tell_squareness_and_shape_but_no_scale():
    measured = by_noise_alone(measure(linear=(), noise=1e-9))
    result = solve(measured, "least_squares")
    truth = truth_of(measured)
    for name in ("E_XX", "E_YY", "E_ZZ"):
        assert np.all(np.isnan(result.curves[name][1:]))
        assert np.isnan(result.figure(f"positioning {name}").value)
        assert np.isnan(result.figure(f"positioning {name}").standard_uncertainty)
    for name in ("E_YX", "E_ZX", "E_XY", "E_ZY", "E_XZ", "E_YZ"):
        assert result.curves[name] == pytest.approx(truth[name], abs=20e-9)
        assert np.isfinite(result.figure(f"straightness {name}").value)
    for name in ("C0Y", "B0Z", "A0Z"):
        assert result.figure(name).standard_uncertainty < 1e-6
    # Each diagonal's own length error is told, though no axis's scale is.
    ends = {name: truth[name][-1] for name in TRANSLATIONS}
    assert result.figure("diagonal ppp").value == pytest.approx(
        sum(ends.values()) / np.sqrt(3), abs=20e-9
    )
    (words,) = result.not_determined
    assert "E_XX, E_YY, E_ZZ" in words
    # Which lines to add is found by planning.undetermined alone.
    assert "linear line" not in words


def test_three_diagonals_alone_cannot_tell_squareness():
    result = solve(measure(linear=(), diagonals=("ppp", "npp", "pnp")), "least_squares")
    for name in ("C0Y", "B0Z", "A0Z", "positioning E_XX", "tilt ppp XYZ 1"):
        assert np.isnan(result.figure(name).value)
        assert np.isnan(result.figure(name).standard_uncertainty)
    assert np.isfinite(result.figure("straightness E_XY").value)
    assert np.all(np.isfinite(result.curves["E_YX"]))
    assert np.isnan(result.chi_squared)
    assert any("No degree of freedom" in remark for remark in result.remarks)


def test_one_linear_line_tells_one_curve():
    measured = measure(diagonals=(), linear=("y",))
    result = solve(measured, "least_squares")
    truth = truth_of(measured)
    known = [name for name in TRANSLATIONS if np.all(np.isfinite(result.curves[name]))]
    assert known == ["E_YY"]
    assert result.curves["E_YY"] == pytest.approx(truth["E_YY"], abs=0.8e-6)
    told = " ".join(result.not_determined)
    for name in TRANSLATIONS:
        assert (name in told) == (name != "E_YY")
    size = len(result.nodes[0])
    place = slice(4 * size, 5 * size)
    assert np.all(np.isfinite(result.covariance[place, place]))
    assert np.isnan(result.covariance[2, 2])


def test_every_further_line_keeps_what_was_known():
    measured = measure(noise=0.05e-6)
    truth = truth_of(measured)
    before = set()
    for count in range(1, len(measured.lines) + 1):
        result = solve(replace(measured, lines=measured.lines[:count]), "least_squares")
        known = {
            (name, node)
            for name in TRANSLATIONS
            for node in np.flatnonzero(np.isfinite(result.curves[name]))
        }
        assert before <= known
        before = known
        for name, node in known:
            error = abs(result.curves[name][node] - truth[name][node])
            assert error <= 5 * result.standard_uncertainty[name][node] + 2e-9
    assert len(before) == 9 * 7


@pytest.mark.parametrize("seed", range(5))
def test_every_part_of_a_run_can_be_solved_live(seed):
    """The matrix of some parts is singular up to rounding only: none is regular."""
    directions = ("forward", "backward")
    measured = measure(seed=seed, blocks=12, repeats=2, directions=directions)
    for count in range(1, len(measured.lines) + 1):
        part = replace(measured, lines=measured.lines[:count])
        result = solve(part, "least_squares")
        known = np.concatenate([result.standard_uncertainty[name] for name in TRANSLATIONS])
        assert np.nanmax(known) < 5e-6, count


def cut(measured, setup, first_stop):
    """Forget the stops of a setup from one stop on."""
    lines = []
    for line in measured.lines:
        if line.setup == setup:
            displacement = line.displacement.copy()
            displacement[first_stop:] = np.nan
            line = replace(line, displacement=displacement)
        lines.append(line)
    return replace(measured, lines=tuple(lines))


def test_partial_lines_are_used_as_far_as_they_go():
    measured = measure(diagonals=(), linear=("x", "y"))
    result = solve(cut(measured, "x", 4), "least_squares")
    assert np.all(np.isfinite(result.curves["E_XX"][:4]))
    assert np.all(np.isnan(result.curves["E_XX"][4:]))
    assert any("E_XX at the nodes 4, 5, 6" in words for words in result.not_determined)
    whole = by_noise_alone(measure())
    partial = solve(cut(whole, "ppp XYZ", 9), "least_squares")
    assert not partial.not_determined
    for name in TRANSLATIONS:
        assert np.all(
            partial.standard_uncertainty[name]
            >= solve(whole, "least_squares").standard_uncertainty[name] - 1e-15
        )


def test_a_line_without_any_reading_does_not_count():
    whole = measure()
    result = solve(cut(whole, "ppn XYZ", 0), "least_squares")
    without = replace(whole, lines=tuple(m for m in whole.lines if m.setup != "ppn XYZ"))
    expected = solve(without, "least_squares")
    assert result.lines == expected.lines == 6
    for name in TRANSLATIONS:
        assert np.array_equal(result.curves[name], expected.curves[name])


def scaled_uncertainty(measured, factor):
    return replace(
        measured,
        lines=tuple(
            replace(line, standard_uncertainty=factor * line.standard_uncertainty)
            for line in measured.lines
        ),
    )


def test_unknown_noise_is_estimated_from_the_residuals():
    measured = by_noise_alone(measure(repeats=3))
    known = solve(measured, "least_squares")
    unknown = solve(scaled_uncertainty(measured, np.nan), "least_squares")
    for name in TRANSLATIONS:
        assert unknown.curves[name] == pytest.approx(known.curves[name], abs=1e-14)
        assert unknown.standard_uncertainty[name] == pytest.approx(
            known.standard_uncertainty[name], rel=0.12
        )
    assert np.isnan(unknown.chi_squared)
    assert any("estimated from the residuals" in remark for remark in unknown.remarks)
    saturated = measure(diagonals=("ppp", "npp", "pnp"), linear=())
    nothing = solve(scaled_uncertainty(saturated, np.nan), "least_squares")
    assert np.all(np.isnan(nothing.standard_uncertainty["E_YX"][1:]))
    assert np.all(np.isfinite(nothing.curves["E_YX"]))


@pytest.mark.parametrize("method", ["least_squares", "setup_robust"])
@pytest.mark.parametrize(("runs", "least"), [(150, 0.93), (1000, 0.94)], ids=["few", "many"])
def test_values_lie_inside_u_where_the_noise_is_estimated_from_three_degrees_of_freedom(
    method, runs, least
):
    # A machine with all errors. One line is repeated: k = 1.96 for u itself holds 83 %.
    plan, inside = make_plan(1, (0.06,) * 3, diagonals=("ppp", "npp", "pnp"), repeats=2), []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        cell = make_cell(seed, noise=0.5e-6, rotation=1e-6, mirror=20e-6)
        run = simulate(plan, cell, seed)
        kept = [line for line in run.lines if not line.line.repeat or line.line.name == "ppp"]
        scales = dict.fromkeys((line.setup for line in kept), 0.0)
        scales = {setup: PLAUSIBLE_SHIFT * rng.standard_normal() for setup in scales}
        lines = [
            replace(
                line,
                displacement=line.displacement * (1.0 + scales[line.setup]),
                standard_uncertainty=np.full(len(line.time), np.nan),
            )
            for line in kept
        ]
        run = replace(run, lines=tuple(lines), plausible=Plausible(rotation=1e-6))
        result, truth = solve(run, method), cell.truth(plan.volume)
        for name in TRANSLATIONS:
            u = result.standard_uncertainty[name][1]
            if u > 1e-12:
                inside.append(abs(result.curves[name][1] - truth[name][1]) < 1.96 * u)
    assert len(inside) == 6 * runs
    assert np.mean(inside) > least


def test_the_widening_is_that_of_student():
    assert widening(np.inf) == 1.0
    assert widening(3) == pytest.approx((3.182446 / 1.96) ** 2, rel=1e-6)
    assert widening(1e9) == 1.0
    assert np.isnan(widening(0))
    observations = observe(scaled_uncertainty(measure(repeats=2), np.nan))
    wide, plain = noise_of(observations)[0], noise_of(observations, widened=False)[0]
    assert wide == pytest.approx(plain * np.sqrt(widening(observations.pure_error()[1])))


def test_too_large_residuals_enlarge_the_uncertainties_and_say_so():
    measured = by_noise_alone(measure(repeats=3))
    right = solve(measured, "least_squares")
    assert not any("not in the model" in remark for remark in right.remarks)
    wrong = solve(scaled_uncertainty(measured, 0.5), "least_squares")
    ratio = wrong.chi_squared / wrong.degrees_of_freedom
    assert ratio == pytest.approx(4 * right.chi_squared / right.degrees_of_freedom, rel=1e-6)
    assert wrong.standard_uncertainty["E_XY"] == pytest.approx(
        right.standard_uncertainty["E_XY"] * np.sqrt(right.chi_squared / right.degrees_of_freedom),
        rel=1e-6,
    )
    assert any("not in the model" in remark for remark in wrong.remarks)
    cautious = solve(scaled_uncertainty(measured, 2.0), "least_squares")
    assert cautious.standard_uncertainty["E_XY"] == pytest.approx(
        2 * right.standard_uncertainty["E_XY"], rel=1e-6
    )


def test_noisy_lines_weigh_less():
    measured = measure(repeats=2, noise=0.01e-6)
    rng = np.random.default_rng(3)
    noisy = tuple(
        replace(
            line,
            displacement=line.displacement + 3e-6 * rng.standard_normal(len(line.time)),
            standard_uncertainty=np.full(len(line.time), 3e-6),
        )
        if line.line.repeat == 1
        else line
        for line in measured.lines
    )
    truth = truth_of(measured)
    result = solve(replace(measured, lines=noisy), "least_squares")
    worst = max(np.max(np.abs(result.curves[n] - truth[n])) for n in TRANSLATIONS)
    assert worst < 0.1e-6


def test_uncertainty_of_a_stop_from_few_readings_does_not_decide_its_weight():
    measured = measure()
    rng = np.random.default_rng(2)
    lines = tuple(
        replace(
            line,
            standard_uncertainty=0.1e-6 * np.sqrt(rng.chisquare(9, len(line.time)) / 9),
        )
        for line in measured.lines
    )
    found = observe(replace(measured, lines=lines)).uncertainty
    assert np.all(np.abs(found / 0.1e-6 - 1) < 0.35)
    assert len(np.unique(found)) <= len(lines) + 2
    loud = lines[3].standard_uncertainty.copy()
    loud[5] = 5e-6
    lines = (*lines[:3], replace(lines[3], standard_uncertainty=loud), *lines[4:])
    observed = observe(replace(measured, lines=lines))
    assert np.count_nonzero(observed.uncertainty == 5e-6) == 1


def test_large_tilts_converge_and_are_mentioned():
    plan = make_plan()
    lines = {name: [0.03, -0.02, 0, 0] for name in ("ppp", "npp", "pnp", "ppn")}
    cell = make_cell(noise=0.0, lines=lines)
    result = solve(by_noise_alone(simulate(plan, cell)), "least_squares")
    truth = cell.truth(plan.volume)
    for name in TRANSLATIONS:
        assert result.curves[name] == pytest.approx(truth[name], abs=2e-9)
    assert any("mrad" in remark for remark in result.remarks)


def test_any_kind_of_diagonals_can_be_estimated_from():
    measured = measure(diagonals=("ppp", "pnp", "ppn"), noise=1e-9)
    result = solve(measured, "least_squares")
    truth = truth_of(measured)
    for name in TRANSLATIONS:
        assert result.curves[name] == pytest.approx(truth[name], abs=20e-9)


def test_linear_lines_beside_the_volumes_edge_serve_as_well():
    measured = measure(offset=(0.0, 0.005, 0.013), noise=1e-9, diagonals=("ppp", "npp", "pnp"))
    shifted = [line for line in measured.lines if line.line.name == "x"]
    assert shifted[0].target[0] == pytest.approx([0.0, 0.005, 0.013])
    with refused(Refusal, "mismatch", aspect="node"):
        solve(measured, "least_squares")
    only_x = replace(measured, lines=tuple(shifted))
    truth = truth_of(measured)
    assert solve(only_x, "least_squares").curves["E_XX"] == pytest.approx(truth["E_XX"], abs=10e-9)


def test_unevenly_spaced_targets_are_told_from_a_contradiction():
    measured = measure(noise=1e-9)
    x = next(one for one in measured.lines if one.line.name == "x")
    target = x.target.copy()
    target[1, 0] += 0.003
    uneven = replace(measured, lines=(replace(x, target=target),))
    with refused(Refusal, "mismatch", "x", aspect="spacing"):
        solve(uneven, "least_squares")
    assert unevenly_spaced(uneven.lines, uneven.volume) == ("x",)
    # Evenly spaced beside the nodes is a contradiction; uneven on the nodes is none.
    beside = replace(x, target=x.target + np.array([0.003, 0.0, 0.0]))
    with refused(Refusal, "mismatch", aspect="node"):
        solve(replace(measured, lines=(beside,)), "least_squares")
    assert unevenly_spaced((beside, *measured.lines), measured.volume) == ()


def test_chi_squared_threshold_is_that_of_the_distribution():
    from scipy.stats import chi2

    for freedom in (1, 2, 5, 33, 67, 1000):
        limit = chi2.isf(0.01, freedom)
        assert not exceeds_chance(0.98 * limit, freedom)
        assert exceeds_chance(1.02 * limit, freedom)


def test_inverse_of_a_positive_matrix():
    rng = np.random.default_rng(0)
    square = rng.standard_normal((150, 150))
    positive = square @ square.T + np.eye(150)
    inverse = inverse_positive(positive)
    assert inverse @ positive == pytest.approx(np.eye(150), abs=1e-9)
    assert inverse_positive(-positive) is None
    positive[100, 100] = -1.0
    assert inverse_positive(positive) is None


def assert_covariance_is_the_inverse(design):
    weighted = design.matrix * np.sqrt(design.weight)[:, None]
    normal = weighted.T @ weighted
    expected = np.linalg.inv(normal)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert design.covariance / scale == pytest.approx(expected / scale, abs=1e-9)


@pytest.mark.parametrize("blocks", [1, 2, 3, 4, 5, 7, 8, 12, 13])
def test_covariance_is_the_inverse_of_the_normal_matrix(blocks):
    plan = make_plan(blocks, orders=("ZXY", "YXZ"), step=(0.004, 0.005, 0.003))
    design = Design(observe(simulate(plan, make_cell())))
    assert_covariance_is_the_inverse(design)
    assert design.unseen.shape[1] == 0


def test_a_line_of_another_shape_is_solved_all_the_same():
    plan = make_plan(8)
    cell = make_cell(noise=0.0, high=(0.08,) * 3, lines={line: [0.0] * 4 for line in "xyz"})
    measured = simulate(plan, cell)
    # X runs ahead to its third node before Y and Z move: no diagonal's usual stops.
    moved = "XXX" + 8 * "YZ" + "XXXXX"
    counts = np.cumsum([np.eye(3)["XYZ".index(axis)] for axis in moved], axis=0)
    target = 0.01 * np.vstack([np.zeros(3), counts])
    kept = measured.lines[3]
    readings = cell.displacement(target, cell.alignment(kept.setup, "ppp", (0.01,) * 3))
    odd_line = replace(kept, target=target, displacement=readings - readings[0])
    lines = (*measured.lines[:3], odd_line, *measured.lines[4:])
    changed = replace(
        measured,
        lines=tuple(replace(m, standard_uncertainty=np.full(len(m.time), 1e-7)) for m in lines),
    )
    assert_covariance_is_the_inverse(Design(observe(changed)))
    truth = cell.truth(plan.volume)
    result = solve(changed, "least_squares")
    assert not result.not_determined
    for name in TRANSLATIONS:
        assert result.curves[name] == pytest.approx(truth[name], abs=1e-9)


def test_rank_analysis_agrees_with_the_singular_values_of_the_matrix():
    for plan in ({"linear": ()}, {"diagonals": ("ppp",)}, {"diagonals": ("npp", "ppn")}, {}):
        design = Design(observe(measure(**plan)))
        rank = np.linalg.matrix_rank(design.matrix, tol=1e-9)
        assert design.unseen.shape[1] == design.matrix.shape[1] - rank
        assert np.max(np.abs(design.matrix @ design.unseen), initial=0.0) < 1e-7
