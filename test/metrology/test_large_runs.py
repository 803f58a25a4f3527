"""Long runs: memory in proportion to the stops; what is left out of very large boxes is said."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from hidden_runs import NOISE, hidden_run
from refused import refused

from stepdiag_ros.evaluation.diagnosing import verdict_on
from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline, whitened
from stepdiag_ros.metrology.discrepancy.candidates import signatures
from stepdiag_ros.metrology.discrepancy.diagnose import diagnose
from stepdiag_ros.metrology.discrepancy.summary import NOT_DIAGNOSED
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import limits, linear, solve, solve_all
from stepdiag_ros.metrology.solvers.limits import (
    BUDGET,
    DIAGNOSIS,
    MOST_STOPS,
    MOST_VALUES,
    VISIBILITY,
    TooLarge,
    left_out,
    left_out_sentence,
)
from stepdiag_ros.metrology.uncertainty.budget import make_budget
from stepdiag_ros.metrology.uncertainty.instrument import Instrument


@pytest.fixture(scope="module")
def problem():
    run = hidden_run()
    stops = stops_of(run)
    return stops, whitened(fit_baseline(run, stops), NOISE, 0.2)


def test_whitening_and_its_transpose_belong_together(problem):
    _, one = problem
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((len(one.baseline.gap), 3))
    vectors = rng.standard_normal((len(one.gap), 4))
    np.testing.assert_allclose(
        vectors.T @ one.of(columns), one.pulled(vectors).T @ columns, rtol=1e-9
    )


def test_candidates_are_the_columns_of_their_effects_beyond_the_baseline(problem):
    stops, one = problem
    found = signatures(catalogue().values(), stops, one)
    vectors = np.random.default_rng(2).standard_normal((len(one.gap), 2))
    products = found.columns.products(vectors)
    for index in range(0, len(found.candidates), 17):
        candidate = found.candidates[index]
        plain = candidate.effect.columns(candidate.setting, stops)[one.baseline.good]
        shown = found.lengths[found.of(index)] > 0.0
        expected = one.projected(one.of(plain)) * shown
        scale = np.linalg.norm(one.of(plain), axis=0)
        np.testing.assert_allclose(
            found.columns.dense(found.of(index)) / scale, expected / scale, atol=1e-9
        )
        np.testing.assert_allclose(
            products[found.of(index)].T / scale, vectors.T @ expected / scale, atol=1e-8
        )
        np.testing.assert_allclose(
            found.lengths[found.of(index)], np.linalg.norm(expected, axis=0), rtol=1e-6
        )
        units = found.units.dense(found.of(index))
        told = found.units.real[found.of(index)]
        np.testing.assert_allclose(units.T @ units, np.diag(told * 1.0), atol=1e-9)


def kept(repeats):
    """Return the stops of a run, and how many numbers its candidates are kept as."""
    run = simulate(make_plan(blocks=3, repeats=repeats), make_cell(noise=0.1e-6), seed=1)
    stops = stops_of(run)
    one = whitened(fit_baseline(run, stops), 0.1e-6, 0.0)
    found = signatures(catalogue().values(), stops, one)
    assert found.columns.count > len(stops.time)
    return len(stops.time), found.columns.changes.nnz + found.units.changes.nnz


def test_what_is_kept_of_candidates_grows_with_the_stops_and_not_with_their_square():
    (few, small), (many, large) = kept(4), kept(16)
    assert large / small < 1.3 * many / few


@pytest.mark.parametrize("method", ["conventional", "setup_robust", "alternative"])
def test_readings_that_are_taken_a_few_at_a_time_give_the_same(monkeypatch, method):
    run = simulate(make_plan(blocks=3, repeats=2), make_cell(noise=0.2e-6), seed=3)
    whole = solve(run, method)
    monkeypatch.setattr(linear, "_AT_ONCE", 7)
    parts = solve(run, method)
    for name, values in whole.curves.items():
        np.testing.assert_allclose(parts.curves[name], values, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(parts.covariance, whole.covariance, rtol=1e-9, atol=1e-28)
    for one, other in zip(parts.figures, whole.figures, strict=True):
        assert one.value == pytest.approx(other.value, rel=1e-9, abs=1e-18, nan_ok=True)
        assert one.standard_uncertainty == pytest.approx(
            other.standard_uncertainty, rel=1e-9, nan_ok=True
        )


def test_nothing_is_left_out_up_to_the_limit():
    rigid, nine = MOST_VALUES // 18 - 1, MOST_VALUES // 9 - 1
    assert left_out(12, MOST_STOPS) == {} == left_out(rigid, MOST_STOPS)
    assert left_out_sentence(12, MOST_STOPS, ("rigid_body", DIAGNOSIS)) == ""
    assert set(left_out(12, MOST_STOPS + 1)) == {DIAGNOSIS}
    assert set(left_out(rigid + 1)) == {"rigid_body", VISIBILITY}
    assert set(left_out(nine)) == {"rigid_body", VISIBILITY}
    assert {"conventional", DIAGNOSIS} < set(left_out(nine + 1))
    assert "least_squares" not in left_out(100_000)


def test_what_is_left_out_of_a_large_box_is_said_with_the_number_that_is_not():
    blocks = MOST_VALUES // 9
    run = simulate(make_plan(blocks=blocks, step=(0.0005,) * 3), make_cell(noise=0.1e-6), seed=1)
    results, reasons = solve_all(run)
    assert list(results) == ["least_squares"]
    why = left_out(blocks)
    assert {name: reasons[name] for name in why if name in reasons} == {
        name: words for name, words in why.items() if name not in (BUDGET, DIAGNOSIS, VISIBILITY)
    }
    assert str(blocks - 1) in why["conventional"]
    assert str(MOST_VALUES // 18 - 1) in why["rigid_body"]
    verdict = verdict_on(run)
    assert verdict.name == NOT_DIAGNOSED and str(blocks - 1) in verdict.sentence
    with refused(TooLarge, "too_many", str(blocks - 1)):
        make_budget(run, Instrument())
    said = left_out_sentence(blocks, 1000, ("least_squares", "conventional", DIAGNOSIS))
    assert "conventional" in said and DIAGNOSIS in said and "rigid_body" not in said


def test_a_run_of_too_many_stops_is_solved_and_not_diagnosed(monkeypatch):
    run = simulate(make_plan(blocks=2, repeats=2), make_cell(noise=0.1e-6), seed=1)
    monkeypatch.setattr(limits, "MOST_STOPS", run.stop_count - 1)
    with refused(TooLarge, "too_many", str(run.stop_count), str(run.stop_count - 1)):
        diagnose(run)
    verdict = verdict_on(run)
    assert verdict.name == NOT_DIAGNOSED and str(run.stop_count) in verdict.sentence
    assert make_budget(run, Instrument()).sources
    results, _ = solve_all(run)
    assert "least_squares" in results and "rigid_body" in results


EVALUATED = """
import pathlib, re, sys
from cells_for_tests import make_cell, make_plan
from stepdiag_ros.evaluation.diagnosing import verdict_on
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve_all

blocks, repeats = int(sys.argv[1]), int(sys.argv[2])
plan = make_plan(blocks=blocks, orders=("XYZ", "YZX", "ZXY"), repeats=repeats)
run = simulate(plan, make_cell(noise=0.1e-6), seed=1)
assert solve_all(run)[0] and verdict_on(run).name != "NOT DIAGNOSED"
# Not ru_maxrss: that of a new process begins with the memory of the one that started it.
peak = re.search(r"VmHWM:\\s+(\\d+) kB", pathlib.Path("/proc/self/status").read_text())
print(run.stop_count, int(peak[1]) / 1024.0)
"""


def evaluated(blocks, repeats):
    """Solve and diagnose a run in a process; return its stops and the process' peak memory, MB."""
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    done = subprocess.run(
        [sys.executable, "-c", EVALUATED, str(blocks), str(repeats)],
        cwd=Path(__file__).parents[1],
        env={**os.environ, **one_thread},
        capture_output=True,
        text=True,
        check=True,
    )
    stops, peak = done.stdout.split()
    return int(stops), float(peak)


def test_memory_of_five_thousand_stops_is_bounded_and_grows_with_them():
    _, bare = evaluated(2, 1)
    few, some = evaluated(12, 5)
    many, most = evaluated(12, 10)
    assert 4500 < many == 2 * few
    assert most < 300.0
    assert (most - bare) / (some - bare) < 1.3 * many / few
