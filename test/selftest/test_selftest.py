"""``stepdiag selftest``: right software passes, software that is broken on purpose does not."""

import json
import math
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from stepdiag_ros import cli
from stepdiag_ros.commands.selftest import solve_as_a_user
from stepdiag_ros.metrology.air import edlen_index
from stepdiag_ros.metrology.forward import Alignment, ErrorCurves, reading
from stepdiag_ros.metrology.solvers import methods, solvers, summary
from stepdiag_ros.selftest import evaluations, judging, session
from stepdiag_ros.selftest.problems import (
    ALIGNED,
    ANGULAR,
    DIAGONALS,
    KINDS,
    MISALIGNED,
    NOISY,
    TILTED,
    UNKNOWN_NOISE,
    draw,
    tilts,
)
from stepdiag_ros.selftest.record import Check, SelftestRecord, SolvedProblem, worst
from stepdiag_ros.selftest.tables import write_problem

solve_by_commands = partial(solve_as_a_user, cli.main)


def silent(done, text):
    assert 0.0 <= done <= 1.0
    assert isinstance(text, str)


def solved(kind, seed=11):
    """Solve one problem of a kind as a user does, and judge it."""
    return session._solved(1, draw(kind, np.random.default_rng(seed)), solve_by_commands)


@cache
def passes(kind):
    """Return whether a problem of a kind is solved by the software as it is."""
    return solved(kind).passed


@pytest.fixture(scope="module")
def record():
    return session.run_selftest(20240229, len(KINDS), solve_by_commands, silent)


def test_the_software_passes_and_every_kind_was_judged(record):
    failed = [
        (problem.kind, problem.failure, [c for c in problem.checks if not c.passed])
        for problem in record.problems
        if not problem.passed
    ]
    assert not failed
    assert [p.kind for p in record.problems] == [*KINDS, *evaluations.EVALUATIONS]
    for problem in record.problems:
        named = {check.what.partition(":")[0] for check in problem.checks}
        assert set(judging.JUDGED.get(problem.kind, ())) <= named


def test_limits_are_small_beside_what_they_guard(record):
    """A limit as large as the errors would pass anything."""
    for number in range(1, len(KINDS) + 1):
        solved_problem = record.problems[number - 1]
        problem = draw(solved_problem.kind, np.random.default_rng([20240229, number]))
        for check in solved_problem.checks:
            if check.unit == "m":
                assert check.limit < 0.25 * problem.largest_error, check


def test_the_same_seed_draws_the_same_problems(record):
    again = session.run_selftest(20240229, 2, solve_by_commands, silent)
    for one, other in zip(record.problems[:2], again.problems[:2], strict=True):
        assert one.description == other.description
        assert one.checks == other.checks


@pytest.mark.parametrize("kind", [k for k in KINDS if k != ANGULAR])
def test_readings_are_those_of_the_packages_own_model(kind):
    """Two independent simulations agree: neither is wrong alone."""
    problem = draw(kind, np.random.default_rng(4))
    nodes = [
        problem.origin[axis] + problem.step[axis] * np.arange(problem.blocks + 1)
        for axis in range(3)
    ]
    errors = ErrorCurves.from_curves(nodes, problem.curves)
    for line, readings in zip(problem.passes, problem.readings, strict=True):
        nominal, first, second = tilts(line.name, problem.step)
        one, two, three, four = problem.angles[line.setup]
        beam = math.sqrt(1 - one**2 - two**2) * nominal + one * first + two * second
        normal = math.sqrt(1 - three**2 - four**2) * nominal + three * first + four * second
        places = np.array([problem.position(node) for node in line.nodes(problem.blocks)])
        expected = reading(places, Alignment(beam, normal, np.zeros(3)), errors, problem.chain)
        difference = readings - expected
        noise = problem.noise * 7.0 * math.sqrt(2.0) + 1e-14
        assert np.max(np.abs(difference - difference[0])) < noise


def solve_by(monkeypatch, method, solver):
    """Put another solver in the place of a method's."""
    monkeypatch.setitem(methods(), method, replace(methods()[method], solve=solver))


def flipped(solver, name):
    def broken(measurement):
        result = solver(measurement)
        return replace(result, curves={**result.curves, name: -result.curves[name]})

    return broken


@pytest.mark.parametrize(
    ("method", "kind", "name"),
    [
        ("conventional", ALIGNED, "E_ZY"),
        ("setup_robust", MISALIGNED, "E_XZ"),
        ("alternative", MISALIGNED, "E_ZX"),
        ("least_squares", TILTED, "E_XY"),
        ("least_squares", UNKNOWN_NOISE, "E_XX"),
        ("setup_robust", NOISY, "E_YX"),
        ("rigid_body", ANGULAR, "E_XX"),
    ],
)
def test_a_wrong_sign_in_one_curve_fails(monkeypatch, method, kind, name):
    assert passes(kind)
    solve_by(monkeypatch, method, flipped(solvers()[method], name))
    broken = solved(kind)
    assert not broken.passed
    assert any(c.what.startswith(method) and not c.passed for c in broken.checks)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_wrong_uncertainty_fails(monkeypatch, factor):
    solver = solvers()["least_squares"]

    def broken(measurement):
        result = solver(measurement)
        return replace(result, covariance=factor**2 * result.covariance)

    solve_by(monkeypatch, "least_squares", broken)
    assert not solved(NOISY).passed


def test_a_number_where_nothing_is_known_fails(monkeypatch):
    solver = solvers()["least_squares"]

    def broken(measurement):
        result = solver(measurement)
        return replace(result, curves={k: np.nan_to_num(v) for k, v in result.curves.items()})

    solve_by(monkeypatch, "least_squares", broken)
    assert not solved(DIAGONALS).passed


def test_a_wrong_sign_of_squareness_fails(monkeypatch):
    slopes = {k: (-f if k == "B0Z" else f, p) for k, (f, p) in summary.SQUARENESS_SLOPES.items()}
    monkeypatch.setattr(summary, "SQUARENESS_SLOPES", slopes)
    failed = [c.what for c in solved(ALIGNED).checks if not c.passed]
    assert failed
    assert all("B0Z" in what for what in failed)


def test_a_solver_that_breaks_is_a_failure_and_not_the_end(monkeypatch):
    def broken(measurement):
        raise ZeroDivisionError(f"no luck with {len(measurement.lines)} lines")

    solve_by(monkeypatch, "least_squares", broken)
    failed = solved(TILTED)
    assert not failed.passed
    assert "no luck" in failed.failure


def test_wrong_functions_fail(monkeypatch):
    rng = np.random.default_rng
    monkeypatch.setattr(
        evaluations, "edlen_index", lambda t, p, h, w: edlen_index(t, p, h, w) + 1e-9
    )
    assert not all(check.passed for check in evaluations.air(rng(1))[1])
    evaluate = evaluations.evaluate

    def without_reversal(runs):
        found = evaluate(runs)
        return replace(found, parameters={**found.parameters, "R": found.parameters["R↑"]})

    monkeypatch.setattr(evaluations, "evaluate", without_reversal)
    failed = [c.what for c in evaluations.iso230_2(rng(1))[1] if not c.passed]
    assert failed == ["ISO 230-2: R"]
    squareness_from = evaluations.squareness_from

    def other_sign(lengths):
        found = squareness_from(lengths)
        values = tuple(replace(one, theta=-one.theta) for one in found.values)
        return replace(found, values=values)

    assert all(check.passed for check in evaluations.squareness(rng(1))[1])
    monkeypatch.setattr(evaluations, "squareness_from", other_sign)
    assert not any(check.passed for check in evaluations.squareness(rng(1))[1])
    locate = evaluations.locate

    def beside(points, changes, uncertainty):
        found = locate(points, changes, uncertainty)
        return replace(found, position=found.position + 1e-9)

    assert all(check.passed for check in evaluations.tracker(rng(1))[1])
    monkeypatch.setattr(evaluations, "locate", beside)
    assert not all(check.passed for check in evaluations.tracker(rng(1))[1])


def test_a_check_without_a_number_fails():
    assert not Check("x", math.nan, 1.0, "m", "").passed
    assert Check("x", 0.0, 0.0, "1", "").passed
    checks = [Check("near", 0.9, 1.0, "m", ""), Check("nothing", math.nan, 1.0, "m", "")]
    assert worst(checks).what == "nothing"
    assert not SolvedProblem(1, "kind", "", ()).passed
    assert not SelftestRecord(1, (), {}, "", 0.0, 0.0).passed


def test_tables_hold_the_same_doubles(tmp_path):
    from stepdiag_ros.bags.table import read_table

    problem = draw(NOISY, np.random.default_rng(3))
    measured = read_table(write_problem(problem, tmp_path))
    assert measured.chain == problem.chain
    assert measured.volume.step == problem.step
    for line, readings in zip(measured.lines, problem.readings, strict=True):
        assert np.array_equal(line.displacement, readings)


def test_the_command_line_prints_and_writes_a_record(tmp_path, capsys):
    target = tmp_path / "record.json"
    words = ["selftest", "--seed", "5", "--problems", "2"]
    assert cli.main([*words, "--json", "--output", str(target)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads(target.read_text())
    assert printed["seed"] == 5
    assert printed["passed"] is True
    assert {"stepdiag", "Python", "numpy", "scipy", "BLAS", "platform"} <= set(printed["platform"])
    assert len(printed["problems"]) == 2 + len(evaluations.EVALUATIONS)
    for problem in printed["problems"]:
        for check in problem["checks"]:
            assert check["why"]
    assert cli.main([*words, "--every-check", "--output", str(tmp_path / "record.txt")]) == 0
    text = capsys.readouterr().out
    assert "seed 5" in text
    assert "every answer is within its limit" in text
    assert "least_squares: setup angles" in text
    assert "FAIL" not in text
    assert "every answer is within its limit" in (tmp_path / "record.txt").read_text()


@pytest.mark.parametrize("words", [[], ["--json"]])
def test_a_record_replaces_an_earlier_one_and_no_other_file(
    tmp_path, capsys, monkeypatch, record, words
):
    monkeypatch.setattr(session, "run_selftest", lambda *_: record)
    target = tmp_path / "record.txt"
    for _ in range(2):
        assert cli.main(["selftest", *words, "--output", str(target)]) == 0
    assert "record.txt" in capsys.readouterr().err
    target.write_text("chain: YXZ\n")
    assert cli.main(["selftest", *words, "--output", str(target)]) == 1
    assert "record.txt" in capsys.readouterr().err
    assert target.read_text() == "chain: YXZ\n"


def test_the_command_line_ends_with_1_if_anything_fails(monkeypatch, capsys):
    solver = solvers()["conventional"]
    solve_by(monkeypatch, "conventional", flipped(solver, "E_ZY"))
    assert cli.main(["selftest", "--seed", "5", "--problems", "1"]) == 1
    text = capsys.readouterr().out
    assert "FAIL: problem 1." in text
    assert "conventional: curves" in text


@pytest.mark.parametrize(
    "words", [["--problems", "0"], ["--problems", "2.5"], ["--seed", "-1"], ["--seed", "x"]]
)
def test_wrong_options_are_refused(words, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["selftest", *words])
    assert end.value.code == 2
    assert words[1] in capsys.readouterr().err


def test_a_folder_that_is_not_there_is_refused_before_anything_is_done(tmp_path, capsys):
    target = tmp_path / "nowhere" / "record.txt"
    assert cli.main(["selftest", "--output", str(target)]) == 1
    assert "there is no folder" in capsys.readouterr().err
