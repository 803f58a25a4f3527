from dataclasses import replace

import numpy as np
import pytest
from case_tables import load_case, rms_error
from cells_for_tests import by_noise_alone, make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.geometry import CHAINS, TRANSLATIONS, beam_direction, line_signs
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import NotDeterminable, solve, solve_all
from stepdiag_ros.metrology.solvers.monte_carlo import replicable, replicate
from stepdiag_ros.metrology.solvers.observations import observe
from stepdiag_ros.metrology.solvers.ranges import range_excess
from stepdiag_ros.metrology.solvers.summary import deviations_from_line


@pytest.mark.parametrize(
    ("case", "bars"),
    [
        ("paper_like", {"conventional": 13.8, "setup_robust": 0.065, "least_squares": 0.045}),
        ("four_diagonals", {"conventional": 39.6, "setup_robust": 0.071, "least_squares": 0.054}),
    ],
)
def test_reference_scores(case, bars):
    measured, truth = load_case(case)
    results, reasons = solve_all(measured)
    # The tables do not say the machine's chain; two orders of moves are missing besides.
    assert set(reasons) <= {"soons", "rigid_body"}
    for method, bar in bars.items():
        digits = 1 if method == "conventional" else 3
        assert round(rms_error(results[method], truth) * 1e6, digits) <= bar
    # The conventional formulation has one answer: what its equations give.
    assert rms_error(results["conventional"], truth) * 1e6 == pytest.approx(
        bars["conventional"], abs=0.05
    )
    best = results["least_squares"]
    assert best.chi_squared == pytest.approx(best.degrees_of_freedom, rel=0.1)
    assert not best.not_determined


def increments_of(measured, line):
    """Displacements of the moves of X, Y, Z of a line's blocks 1..N, forward pass."""
    (values,) = [m.displacement for m in measured.lines if m.line.name == line]
    return np.diff(values).reshape(-1, 3).T


def curves_from(increments):
    """Curves by name from {moving axis: {error: Δe(k)}}."""
    return {
        f"E_{error.upper()}{moving.upper()}": np.concatenate([[0.0], np.cumsum(values)])
        for moving, errors in increments.items()
        for error, values in errors.items()
    }


@pytest.fixture
def one_pass():
    plan = make_plan(diagonals=("ppp", "npp", "pnp"), step=(0.01, 0.008, 0.005))
    return simulate(plan, make_cell(high=(0.06, 0.048, 0.03)), seed=8)


def test_conventional_is_equations_6_to_14_without_setup_errors(one_pass):
    """Equations (6)-(14) as printed, block by block, n: read from the other end."""
    a = np.array(one_pass.volume.step)
    g = np.linalg.norm(a) / (2 * a)
    ppp, npp, pnp = (increments_of(one_pass, line) for line in ("ppp", "npp", "pnp"))
    expected = curves_from(
        {
            "x": {
                "x": g[0] * (ppp[0] + npp[0][::-1]) - a[0],
                "y": g[1] * (ppp[0] - pnp[0]),
                "z": g[2] * (pnp[0] - npp[0][::-1]),
            },
            "y": {
                "x": g[0] * (ppp[1] - npp[1]),
                "y": g[1] * (ppp[1] + pnp[1][::-1]) - a[1],
                "z": g[2] * (npp[1] - pnp[1][::-1]),
            },
            "z": {
                "x": g[0] * (ppp[2] - npp[2]),
                "y": g[1] * (ppp[2] - pnp[2]),
                "z": g[2] * (npp[2] + pnp[2]) - a[2],
            },
        }
    )
    result = solve(one_pass, "conventional")
    for name in TRANSLATIONS:
        assert result.curves[name] == pytest.approx(expected[name], abs=1e-15)
    assert "nominal" in result.frame


def test_setup_robust_is_equations_15_to_19(one_pass):
    a = np.array(one_pass.volume.step)
    norm = np.linalg.norm(a)
    ppp, npp, pnp = (increments_of(one_pass, line) for line in ("ppp", "npp", "pnp"))
    exx, eyy, ezz = (
        np.diff(line.displacement) - a["xyz".index(line.line.name)]
        for line in one_pass.lines
        if line.line.kind == "linear"
    )
    mean = np.mean
    l_xx = mean(-2 * a[0] / norm * (exx + a[0]) + ppp[0] + npp[0][::-1])
    l_yy = mean(-2 * a[1] / norm * (eyy + a[1]) + ppp[1] + pnp[1][::-1])
    l_zz = mean(-2 * a[2] / norm * (ezz + a[2]) + npp[2] + pnp[2])
    l_yx, l_zx, l_yz = (
        mean(ppp[0] - pnp[0]),
        mean(pnp[0] - npp[0][::-1]),
        mean(ppp[2] - pnp[2]),
    )
    l_xz = -l_zx - l_xx - l_yy - l_zz
    l_xy = -l_yx - l_zx - l_xz
    l_zy = -l_yx - l_yz - l_xy
    g = norm / (2 * a)
    expected = curves_from(
        {
            "x": {
                "x": exx,
                "y": g[1] * (ppp[0] - pnp[0] - l_yx),
                "z": g[2] * (pnp[0] - npp[0][::-1] - l_zx),
            },
            "y": {
                "x": g[0] * (ppp[1] - npp[1] - l_xy),
                "y": eyy,
                "z": g[2] * (npp[1] - pnp[1][::-1] - l_zy),
            },
            "z": {
                "x": g[0] * (ppp[2] - npp[2] - l_xz),
                "y": g[1] * (ppp[2] - pnp[2] - l_yz),
                "z": ezz,
            },
        }
    )
    result = solve(one_pass, "setup_robust")
    for name in TRANSLATIONS:
        assert result.curves[name] == pytest.approx(expected[name], abs=1e-15)
    for name, value in {"xx": l_xx, "yx": l_yx, "xy": l_xy, "zy": l_zy, "xz": l_xz}.items():
        assert result.figure(f"lambda {name}").value == pytest.approx(value, abs=1e-15)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("orders", [("XYZ",), ("ZXY", "YZX")])
def test_without_noise_every_method_finds_the_truth_of_unequal_blocks(chain, orders):
    step, origin = (0.012, 0.02, 0.007), (0.1, -0.2, 0.05)
    high = tuple(o + 5 * s for o, s in zip(origin, step, strict=True))
    plan = make_plan(5, step, origin, orders=orders, directions=("backward", "forward"))

    def worst(method, tilt):
        # A cosine error of a linear line cannot be told by any method.
        straight = {line: [0.0] * 4 for line in "xyz"}
        cell = make_cell(chain=chain, low=origin, high=high, noise=0.0, tilt=tilt, lines=straight)
        truth = cell.truth(plan.volume)
        result = solve(simulate(plan, cell), method)
        return max(np.max(np.abs(result.curves[n] - truth[n])) for n in TRANSLATIONS)

    assert worst("least_squares", 1e-3) < 1e-9  # exact model: no cosine error left
    assert worst("setup_robust", 2e-5) < 2e-9  # exact to first order
    assert worst("setup_robust", 1e-3) > 20 * worst("least_squares", 1e-3)
    assert worst("conventional", 1e-3) > 1e-6


def test_conventional_is_right_on_a_perfect_setup_but_for_its_frame():
    plan = make_plan()
    cell = make_cell(noise=0.0, tilt=0.0)
    result = solve(simulate(plan, cell), "conventional")
    truth = cell.truth(plan.volume)
    for name in ("E_XX", "E_YY", "E_ZZ"):
        assert result.curves[name] == pytest.approx(truth[name], abs=1e-9)
    reference = solve(simulate(plan, cell), "least_squares")
    for name in ("C0Y", "B0Z", "A0Z", "straightness E_YX", "positioning E_YY"):
        found = result.figure(name)
        assert found.value == pytest.approx(reference.figure(name).value, abs=1e-9)


def test_tilts_are_those_of_the_setup():
    plan = make_plan()
    lines = {"ppp": [3e-4, -2e-4, 0, 0], "npp": [-1e-4, 5e-4, 0, 0]}
    cell = make_cell(noise=0.0, lines=lines, size=0.0, squareness=(0.0, 0.0, 0.0))
    result = solve(simulate(plan, cell), "least_squares")
    # Linear lines are misaligned as well, by a cosine error of some 1e-8 that nothing can tell.
    for line, (one, two, _, _) in lines.items():
        assert result.figure(f"tilt {line} XYZ 1").value == pytest.approx(one, abs=2e-7)
        assert result.figure(f"tilt {line} XYZ 2").value == pytest.approx(two, abs=2e-7)


@pytest.mark.parametrize("method", ["conventional", "setup_robust", "alternative", "least_squares"])
def test_covariance_is_that_of_the_readings_with_shared_zeros_and_stops(method):
    plan = make_plan(4, directions=("forward", "backward"))
    cell = make_cell(high=(0.04,) * 3)
    result = solve(by_noise_alone(simulate(plan, cell)), method)
    runs = np.array(
        [
            np.concatenate(
                list(solve(by_noise_alone(simulate(plan, cell, seed)), method).curves.values())
            )
            for seed in range(300)
        ]
    )
    expected = result.covariance
    found = np.cov(runs.T)
    sigma = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    free = sigma > 0
    # 300 runs: standard deviation of a correlation is at most 1/√300.
    assert np.max(np.abs((found - expected)[free] / sigma[free])) < 5.0 / np.sqrt(300)
    assert np.max(np.abs(found[~free])) < 1e-26
    assert np.sqrt(np.diag(expected)).reshape(9, -1) == pytest.approx(
        np.array(list(result.standard_uncertainty.values()))
    )


@pytest.mark.parametrize("method", replicable())
def test_replicates_have_the_covariance_of_the_result(method):
    measured = by_noise_alone(simulate(make_plan(4), make_cell(high=(0.04,) * 3)))
    result = solve(measured, method)
    drawn = replicate(measured, 2000, seed=1, method=method)
    centre = np.concatenate(list(result.curves.values()))
    assert drawn.shape == (2000, len(centre))
    expected = np.sqrt(np.diag(result.covariance))
    known = np.isfinite(centre)
    assert np.array_equal(np.isfinite(drawn).all(axis=0), known)
    drawn, centre, expected = drawn[:, known], centre[known], expected[known]
    assert np.std(drawn, axis=0) == pytest.approx(expected, rel=0.1, abs=1e-15)
    assert np.all(np.abs(np.mean(drawn, axis=0) - centre) < 5 * expected / np.sqrt(2000) + 1e-11)


def test_replicates_refuse_what_they_cannot_do():
    measured = simulate(make_plan(3), make_cell())
    with refused(Refusal, "out_of_range"):
        replicate(measured, 0)
    with refused(Refusal, "unknown", aspect="replicated method"):
        replicate(measured, 1, method="guess")
    with refused(Refusal, "undetermined"):
        replicate(without_uncertainty(measured), 1)


def without_uncertainty(measured):
    return replace(
        measured,
        lines=tuple(
            replace(line, standard_uncertainty=np.full(len(line.time), np.nan))
            for line in measured.lines
        ),
    )


def only(measured, *names):
    return replace(measured, lines=tuple(m for m in measured.lines if m.line.name in names))


def test_registry_says_what_is_missing():
    measured = simulate(make_plan(diagonals=("ppp", "npp")), make_cell())
    results, reasons = solve_all(measured)
    assert set(results) == {"least_squares", "rigid_body"}
    assert "pnp" in reasons["conventional"]
    with refused(NotDeterminable, "missing", about="z", aspect="lines"):
        solve(
            only(simulate(make_plan(), make_cell()), "x", "y", "ppp", "npp", "pnp"), "setup_robust"
        )
    with refused(Refusal, "unknown", aspect="method"):
        solve(measured, "guess")
    with refused(NotDeterminable, "too_few"):
        solve(Measurement(measured.volume, ()), "least_squares")


def test_a_fourth_diagonal_and_linear_lines_that_cannot_be_used_are_mentioned():
    results, _ = solve_all(simulate(make_plan(), make_cell()))
    assert any("ppn" in remark for remark in results["conventional"].remarks)
    assert any("linear" in remark for remark in results["conventional"].remarks)
    assert any("ppn" in remark for remark in results["setup_robust"].remarks)
    assert results["conventional"].lines == 3
    assert results["setup_robust"].lines == 6
    assert results["least_squares"].lines == 7


@pytest.mark.parametrize("method", ["conventional", "setup_robust"])
def test_unknown_noise_is_taken_from_repeats(method):
    plan = make_plan(repeats=4)
    measured = simulate(plan, make_cell())
    known, unknown = solve(measured, method), solve(without_uncertainty(measured), method)
    for name in TRANSLATIONS:
        assert unknown.curves[name] == pytest.approx(known.curves[name], abs=1e-18)
        assert unknown.standard_uncertainty[name] == pytest.approx(
            known.standard_uncertainty[name], rel=0.1
        )
    assert any("repeats" in remark for remark in unknown.remarks)
    single = solve(without_uncertainty(simulate(make_plan(), make_cell())), method)
    assert np.all(np.isnan(single.standard_uncertainty["E_YX"]))
    assert np.all(np.isfinite(single.curves["E_YX"]))


def test_a_gap_is_named_and_other_passes_fill_it():
    once = simulate(make_plan(), make_cell())

    def with_gap(measured, index, stop):
        lines = list(measured.lines)
        displacement = lines[index].displacement.copy()
        displacement[stop] = np.nan
        lines[index] = replace(lines[index], displacement=displacement)
        return replace(measured, lines=tuple(lines))

    index = next(i for i, m in enumerate(once.lines) if m.line.name == "pnp")
    gap = with_gap(once, index, 5)  # after the move of Y in block 2, downwards from node 5 to 4
    with refused(NotDeterminable, "missing", "Y", "5", "pnp", aspect="move"):
        solve(gap, "conventional")
    assert np.all(np.isfinite(solve(gap, "least_squares").curves["E_YX"]))
    twice = with_gap(simulate(make_plan(repeats=2), make_cell()), 6 + 4, 5)
    assert np.all(np.isfinite(solve(twice, "conventional").curves["E_YX"]))


def test_lines_that_contradict_the_volume_are_refused():
    measured = simulate(make_plan(), make_cell())
    target = measured.lines[3].target.copy()
    target[4, 0] += 0.002
    lines = list(measured.lines)
    lines[3] = replace(lines[3], target=target)
    with refused(Refusal, "mismatch", "ppp", "XYZ", "4", "X", aspect="node"):
        observe(replace(measured, lines=tuple(lines)))
    lines[3] = replace(measured.lines[3], setup="x")
    with refused(Refusal, "mismatch", "x", "ppp", aspect="beam"):
        observe(replace(measured, lines=tuple(lines)))


def test_figures_follow_their_definitions():
    measured = by_noise_alone(simulate(make_plan(), make_cell()))
    result = solve(measured, "least_squares")
    x, y, z = result.nodes

    def slope(nodes, name):
        return np.polyfit(nodes, result.curves[name], 1)[0]

    assert result.figure("C0Y").value == pytest.approx(-slope(y, "E_XY") - slope(x, "E_YX"))
    assert result.figure("B0Z").value == pytest.approx(slope(z, "E_XZ") + slope(x, "E_ZX"))
    assert result.figure("A0Z").value == pytest.approx(-slope(z, "E_YZ") - slope(y, "E_ZY"))
    assert result.figure("C0Y").unit == "rad"
    # E_YX of the generated cell, right-handed 30 µrad
    assert result.figure("C0Y").value == pytest.approx(30e-6, abs=80e-6)
    bend = result.curves["E_ZX"] - np.polyval(np.polyfit(x, result.curves["E_ZX"], 1), x)
    found = result.figure("straightness E_ZX")
    assert found.value == pytest.approx(np.ptp(bend))
    high, low = np.argmax(bend), np.argmin(bend)
    matrix = deviations_from_line(x)
    row = matrix[high] - matrix[low]
    size = len(x)
    block = result.covariance[2 * size : 3 * size, 2 * size : 3 * size]
    excess = range_excess(bend, matrix @ block @ matrix.T)
    assert found.standard_uncertainty == pytest.approx(np.hypot(np.sqrt(row @ block @ row), excess))
    assert result.figure("positioning E_YY").value == result.curves["E_YY"][-1]
    direction = beam_direction("npp", np.array(measured.volume.step))
    ends = {n: curve[-1] for n, curve in result.curves.items()}
    expected = sum(
        line_signs("npp")[axis] * direction[error] * ends[f"E_{'XYZ'[error]}{'XYZ'[axis]}"]
        for axis in range(3)
        for error in range(3)
    )
    assert result.figure("diagonal npp").value == pytest.approx(expected)
    with refused(KeyError, None, "nonsense"):
        result.figure("nonsense")
