"""Comparison of a solved reference problem with the known answer, and its limits.

Three kinds of limits, none of them chosen to fit:

- Rounding, where readings have no noise and the method's model is exact. Every number is rounded
  2^-53 relative to the longest length; some hundred of them meet in a result, times ‖a‖/2a.
- Second order, where a method neglects it. Setups turned by δl (beam) and δm (mirror) give a line
  the scale σ = |δl|²/2 - δl·δm, and each reading δm·t with the error vector t of the machine. In
  Ibaraki & Hata, eqs. (16)-(19), at most 8 of the former meet (over the diagonal's length), and 64
  of the latter (40, and 24 more in the alternative formulation), times ‖a‖/2a.
- Chance, where readings have noise: the deviation in its own covariance is χ²-distributed. The
  probability of what was found is given as the deviation of a normal quantity that is as rare.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, BODY_DIAGONALS, ROTATIONS, TRANSLATIONS, Vector
from stepdiag_ros.metrology.solvers.noise_factor import widening
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.selftest.problems import (
    ALIGNED,
    ANGULAR,
    DIAGONALS,
    MISALIGNED,
    NOISY,
    TILTED,
    UNKNOWN_NOISE,
    Problem,
)
from stepdiag_ros.selftest.record import Check

FALSE_ALARM = 1e-7
"""Probability with which chance alone fails one statistical check."""

Answer = Mapping[str, Any]
"""The JSON document that ``stepdiag solve --json`` prints."""

_FORMULATIONS = ("conventional", "setup_robust", "alternative")
_ROBUST = ("setup_robust", "alternative", "least_squares")
JUDGED: dict[str, tuple[str, ...]] = {
    ALIGNED: (*_FORMULATIONS, "least_squares"),
    TILTED: ("least_squares",),
    MISALIGNED: ("setup_robust", "alternative"),
    NOISY: _ROBUST,
    UNKNOWN_NOISE: ("least_squares",),
    DIAGONALS: ("least_squares",),
    ANGULAR: ("rigid_body",),
}
"""Kind of problem → methods whose model holds for it."""

_SQUARENESS = {
    # Right-handed turn of an axis's line: +C of Y moves its far end to -X, +B of Z to +X, +A of Z
    # to -Y; and the same slopes of the other axis, counted from the square the other way.
    "C0Y": (-1.0, ("E_XY", "E_YX")),
    "B0Z": (+1.0, ("E_XZ", "E_ZX")),
    "A0Z": (-1.0, ("E_YZ", "E_ZY")),
}
_EPSILON = 2.0**-52
_CONVERGED = 1e-13
_ROUNDINGS = 200.0


def judge(problem: Problem, answer: Answer, results: Mapping[str, VolumetricErrors]) -> list[Check]:
    """Compare the answers to a problem with what is true.

    Args:
        problem: as it was drawn.
        answer: JSON document of the command line.
        results: of the library for the same table, with covariances; empty if not wanted.
    """
    checks = []
    methods: dict[str, Any] = answer["methods"]
    for method in JUDGED[problem.kind]:
        if method not in methods:
            checks.append(_missing(method, answer))
            continue
        found = methods[method]
        if problem.kind == ANGULAR:
            checks.extend(_angular(problem, method, found))
        elif problem.noise == 0.0:
            checks.extend(_exact(problem, method, found))
        elif problem.kind == DIAGONALS:
            checks.extend(_diagonals(method, found, problem))
        elif method in results:
            checks.extend(_by_chance(problem, method, results[method]))
    if results:
        checks.append(_same(methods, results))
    return checks


def _missing(method: str, answer: Answer) -> Check:
    reason = answer.get("not_solved", {}).get(method, "the method is not there")
    return Check(f"{method}: an answer", math.nan, 0.0, "1", f"none was given: {reason}")


def _values(curve: Sequence[float | None]) -> Vector:
    return np.array([math.nan if value is None else value for value in curve], dtype=np.float64)


def _deviation(
    found: Mapping[str, Any], truth: Mapping[str, Vector], names: Sequence[str]
) -> float:
    return float(max(np.max(np.abs(_values(found["curves"][n]) - truth[n])) for n in names))


def _slope_weights(problem: Problem, axis: str) -> Vector:
    way = problem.step[AXES.index(axis)] * np.arange(problem.blocks + 1)
    centred = way - np.mean(way)
    weights: Vector = centred / np.sum(centred**2)
    return weights


def squareness(problem: Problem, name: str) -> float:
    """Return the true squareness: sum of slopes of least-squares lines, rad."""
    factor, pair = _SQUARENESS[name]
    slopes = [_slope_weights(problem, curve[3]) @ problem.curves[curve] for curve in pair]
    return factor * float(np.sum(slopes))


def _squareness_limit(problem: Problem, name: str, limit: float) -> float:
    """Return the largest change of a squareness by curves that change by no more than a limit."""
    weights = [_slope_weights(problem, curve[3]) for curve in _SQUARENESS[name][1]]
    return limit * float(sum(np.sum(np.abs(w)) for w in weights))


def rounding(problem: Problem) -> float:
    """Return the rounding that a curve may have, m."""
    longest = problem.diagonal + problem.largest_error
    return problem.gain * (_ROUNDINGS * _EPSILON * longest + _CONVERGED)


def second_order(problem: Problem) -> float:
    """Return the second order that Ibaraki & Hata's formulations may leave in a curve, m."""
    scale, tilt = 0.0, 0.0
    for one, two, three, four in problem.angles.values():
        scale = max(scale, abs((one**2 + two**2) / 2.0 - one * three - two * four))
        tilt = max(tilt, math.hypot(three, four))
    return problem.gain * (8.0 * scale * problem.diagonal + 64.0 * tilt * problem.largest_error)


def _exact(problem: Problem, method: str, found: Mapping[str, Any]) -> list[Check]:
    limit, why = rounding(problem), "rounding; the model is exact"
    if method != "least_squares":
        beyond = second_order(problem)
        if beyond > 0.0:
            limit, why = limit + beyond, "second order of the setups' angles, which it neglects"
    checks = [
        Check(
            f"{method}: curves",
            _deviation(found, problem.curves, TRANSLATIONS),
            limit,
            "m",
            why,
        )
    ]
    for name in _SQUARENESS:
        value = found["figures"][name]["value"]
        checks.append(
            Check(
                f"{method}: {name}",
                abs((math.nan if value is None else value) - squareness(problem, name)),
                _squareness_limit(problem, name, limit),
                "rad",
                f"{why}; slopes of curves",
            )
        )
    if method == "least_squares":
        deviation = 0.0
        for setup, angles in problem.angles.items():
            for which in range(2) if setup.partition(" ")[0] in BODY_DIAGONALS else ():
                value = found["figures"][f"tilt {setup} {which + 1}"]["value"]
                deviation = max(
                    deviation, abs((math.nan if value is None else value) - angles[which])
                )
        shortest = min(problem.step) * problem.blocks
        checks.append(
            Check(
                f"{method}: setup angles", deviation, limit / shortest, "rad", f"{why}, by length"
            )
        )
    return checks


def _rare(tail: float) -> float:
    """Return the deviation of a normal quantity that is exceeded with this probability."""
    from scipy.special import ndtri

    return float(-ndtri(max(tail, 1e-300) / 2.0)) if tail < 1.0 else 0.0


def chance_check(what: str, squares: float, rank: int, reference_freedom: int = 0) -> Check:
    """Check a sum of squares of deviations in their covariance.

    Args:
        what: quantity, and whose answer.
        squares: dᵀ C⁻¹ d.
        rank: of the covariance C.
        reference_freedom: degrees of freedom from which the scale of C was estimated; 0: known.
    """
    from scipy.special import chdtr, chdtrc, fdtr, fdtrc

    if reference_freedom:
        ratio = squares / rank
        below, above = fdtr(rank, reference_freedom, ratio), fdtrc(rank, reference_freedom, ratio)
        law = f"F({rank}, {reference_freedom})"
    else:
        below, above = chdtr(rank, squares), chdtrc(rank, squares)
        law = f"χ²({rank})"
    why = f"{law} of deviations in their covariance, false alarm {FALSE_ALARM:g}"
    rare = _rare(min(1.0, 2.0 * min(float(below), float(above))))
    return Check(what, rare, _rare(FALSE_ALARM), "σ", why)


def _by_chance(problem: Problem, method: str, result: VolumetricErrors) -> list[Check]:
    """Check a noisy answer: its deviation in its own covariance, and the size of its residuals."""
    deviation = np.concatenate([result.curves[n] - problem.curves[n] for n in TRANSLATIONS])
    covariance = result.covariance[: len(deviation), : len(deviation)]
    values, vectors = np.linalg.eigh(covariance)
    seen = values > 1e-9 * values[-1]
    squares = float(np.sum((vectors[:, seen].T @ deviation) ** 2 / values[seen]))
    rank, freedom = int(np.count_nonzero(seen)), result.degrees_of_freedom
    estimated = freedom if problem.kind == UNKNOWN_NOISE else 0
    if estimated:
        # The covariance is widened for coverage; F is the law of the estimated one.
        squares *= widening(freedom)
    checks = [chance_check(f"{method}: curves and uncertainty", squares, rank, estimated)]
    if np.isfinite(result.chi_squared) and freedom > 0:
        checks.append(chance_check(f"{method}: residuals", result.chi_squared, freedom))
    return checks


def _diagonals(method: str, found: Mapping[str, Any], problem: Problem) -> list[Check]:
    """Four diagonals alone: squareness is determined, the three scales must be unknown."""
    scales = [found["curves"][f"E_{axis}{axis}"][1:] for axis in AXES]
    numbers = sum(value is not None for curve in scales for value in curve)
    limit = _rare(FALSE_ALARM / len(_SQUARENESS))
    checks = [
        Check(
            f"{method}: numbers for E_XX, E_YY, E_ZZ",
            float(numbers),
            0.0,
            "1",
            "diagonals do not determine the scales of the axes: unknown, not a number",
        )
    ]
    for name in _SQUARENESS:
        figure = found["figures"][name]
        value, own = figure["value"], figure["standard_uncertainty"]
        # Scales that are not told are taken as zero: their size, times the tilts, is left.
        shortest = min(problem.step) * problem.blocks
        tilt = max(math.hypot(*angles[2:]) for angles in problem.angles.values())
        left = problem.largest_error / shortest * tilt * problem.diagonal
        margin = 8.0 * problem.gain * left / shortest
        away = math.nan
        if value is not None and own:
            away = max(abs(value - squareness(problem, name)) - margin, 0.0) / own
        checks.append(
            Check(
                f"{method}: {name}",
                away,
                limit,
                "σ",
                f"normal, false alarm {FALSE_ALARM:g} over all three",
            )
        )
    return checks


def _angular(problem: Problem, method: str, found: Mapping[str, Any]) -> list[Check]:
    """All 21 errors: what is a number must be right, and there must be such numbers."""
    angle = max(float(np.max(np.abs(problem.curves[name]))) for name in ROTATIONS)
    tilt = max(math.hypot(*angles[2:]) for angles in problem.angles.values())
    length = problem.diagonal + problem.dead_path
    # Products of two of: angles (six in a chain), tilt, relative errors; over all lengths.
    small = 6.0 * angle + tilt + problem.largest_error / length
    limit = 16.0 * problem.blocks * problem.gain * small**2 * length + rounding(problem)
    checks = []
    for names, unit, size in (
        (TRANSLATIONS, "m", 1.0),
        (ROTATIONS, "rad", min(problem.step)),
    ):
        worst, numbers = 0.0, 0
        for name in names:
            # Zero at the first node by definition.
            away = np.abs(_values(found["curves"][name]) - problem.curves[name])[1:]
            known = away[np.isfinite(away)]
            numbers += len(known)
            worst = max(worst, float(np.max(known, initial=0.0)))
        checks.append(
            Check(
                f"{method}: {numbers} determined values of curves in {unit}",
                worst if numbers else math.nan,
                limit / size,
                unit,
                "second order of angles, tilts and errors",
            )
        )
    return checks


def _same(methods: Mapping[str, Any], results: Mapping[str, VolumetricErrors]) -> Check:
    """The command line and the library must give the same numbers bit for bit."""
    different = 0
    for method, result in results.items():
        for part in ("curves", "standard_uncertainty"):
            printed = methods.get(method, {}).get(part, {})
            for name, curve in getattr(result, part).items():
                values = _values(printed.get(name, []))
                if len(values) != len(curve):
                    different += len(curve)
                    continue
                same = (values == curve) | (np.isnan(values) & np.isnan(curve))
                different += int(np.count_nonzero(~same))
    return Check(
        "values that differ between command line and library",
        float(different),
        0.0,
        "1",
        "the same computation, bit-identical",
    )
