"""A self-test from the first problem drawn to the record."""

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from stepdiag_ros.bags.table import read_table
from stepdiag_ros.evaluation.solving import solve_reproducibly
from stepdiag_ros.selftest.evaluations import EVALUATIONS
from stepdiag_ros.selftest.judging import FALSE_ALARM, Answer, judge
from stepdiag_ros.selftest.problems import KINDS, NOISY, UNKNOWN_NOISE, Problem, draw
from stepdiag_ros.selftest.record import (
    Check,
    SelftestRecord,
    SolvedProblem,
    describe_platform,
    now,
)
from stepdiag_ros.selftest.tables import write_problem

Solve = Callable[[Path], Answer]
"""Takes a run table with ``case.yaml`` beside it, returns the JSON document of its results."""
Progress = Callable[[float, str], None]

_STATISTICAL = 8
"""Statistical checks that one problem has at most."""


def run_selftest(seed: int, count: int, solve: Solve, progress: Progress) -> SelftestRecord:
    """Draw problems, have them solved and compare with the known answers.

    Args:
        seed: of everything random: the same seed and count draw the same problems.
        count: number of step-diagonal problems; kinds take turns. The evaluations of single
            functions come on top, one each.
        solve: how a user solves a run table.
        progress: called with the done share and what is being done.

    Raises:
        ValueError: no problem is asked for.
    """
    if count < 1:
        raise ValueError(f"{count} problems are asked for; expected 1 or more")
    date, begin = now(), time.monotonic()
    kinds, evaluations = list(KINDS), list(EVALUATIONS)
    solved: list[SolvedProblem] = []
    whole = count + len(evaluations)
    for number in range(1, count + 1):
        kind = kinds[(number - 1) % len(kinds)]
        progress((number - 1) / whole, f"{number} of {whole}: {kind}")
        problem = draw(kind, np.random.default_rng([seed, number]))
        solved.append(_solved(number, problem, solve))
    for place, kind in enumerate(evaluations):
        number = count + 1 + place
        progress((number - 1) / whole, f"{number} of {whole}: {kind}")
        solved.append(_evaluated(number, kind, np.random.default_rng([seed, number])))
    progress(1.0, "")
    return SelftestRecord(
        seed=seed,
        problems=tuple(solved),
        platform=describe_platform(),
        date=date,
        seconds=time.monotonic() - begin,
        false_alarm=FALSE_ALARM * _STATISTICAL * whole,
    )


def _solved(number: int, problem: Problem, solve: Solve) -> SolvedProblem:
    checks: list[Check] = []
    failure = ""
    with TemporaryDirectory(prefix="stepdiag_selftest_") as folder:
        table = write_problem(problem, Path(folder))
        try:
            answer = solve(table)
            noisy = problem.kind in (NOISY, UNKNOWN_NOISE)
            results = solve_reproducibly(read_table(table))[0] if noisy else {}
            checks = judge(problem, answer, results)
        # Whatever goes wrong inside is a failed problem, and the others are still to be tested.
        except Exception as error:
            failure = f"{type(error).__name__}: {error}"
    return SolvedProblem(number, problem.kind, str(problem), tuple(checks), failure)


def _evaluated(number: int, kind: str, rng: np.random.Generator) -> SolvedProblem:
    try:
        description, checks = EVALUATIONS[kind](rng)
    except Exception as error:
        return SolvedProblem(number, kind, "", (), f"{type(error).__name__}: {error}")
    return SolvedProblem(number, kind, description, tuple(checks))
