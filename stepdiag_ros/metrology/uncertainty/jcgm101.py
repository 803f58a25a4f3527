"""Propagation of distributions by a Monte Carlo method (JCGM 101:2008), for any model.

Blocks of trials are added until the estimate, its standard uncertainty and both endpoints of the
coverage interval have settled within the numerical tolerance (clause 7.9), and the interval of the
GUM uncertainty framework is compared with the one found (clause 8).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal

Sampler = Callable[[int, np.random.Generator], Vector]
"""Number of trials and source of random numbers → values of the output quantities, (trials, m)."""

BLOCK = 10_000
"""Trials in a block for a coverage probability up to 0.99 (clause 7.9.4 b)."""
FEWEST_BLOCKS = 5
"""The clause allows two, but their spread is known with one degree of freedom only: of many output
quantities some would stop far too early by chance."""
VALIDATION_SHARE = 0.2
"""Of δ, within which a Monte Carlo result has to settle that validates another one (clause 8.2)."""

_COLUMNS = 16
"""Quantities that are sorted together, to need little memory."""


@dataclass(frozen=True)
class TrialOutcome:
    """What the trials say of each output quantity; all vectors have shape (m,).

    Attributes:
        estimate: mean of the trials.
        standard_uncertainty: their standard deviation.
        low: of the probabilistically symmetric coverage interval.
        high: of the same.
        shortest_low: of the shortest coverage interval.
        shortest_high: of the same.
        tolerance: within which the results were to settle: the numerical tolerance δ of the
            standard uncertainty (clause 7.9.2), or the share of it that was asked for.
        settled: whether they have.
        trials: number of trials.
        blocks: number of blocks.
        coverage: probability.
    """

    estimate: Vector
    standard_uncertainty: Vector
    low: Vector
    high: Vector
    shortest_low: Vector
    shortest_high: Vector
    tolerance: Vector
    settled: NDArray[np.bool_]
    trials: int
    blocks: int
    coverage: float


@dataclass(frozen=True)
class Validation:
    """Comparison of the GUM uncertainty framework with Monte Carlo (clause 8.1); shapes (m,).

    Attributes:
        low_difference: d_low = |y - U - y_low|.
        high_difference: d_high = |y + U - y_high|.
        tolerance: δ.
        passed: both differences are no larger than δ.
    """

    low_difference: Vector
    high_difference: Vector
    tolerance: Vector
    passed: NDArray[np.bool_]


def numerical_tolerance(uncertainty: float, digits: int) -> float:
    """Return δ = 10^l / 2 of an uncertainty written as c·10^l with c of so many digits (7.9.2).

    NaN for an unknown uncertainty, 0 for one that is zero.
    """
    if not math.isfinite(uncertainty):
        return math.nan
    if uncertainty <= 0.0:
        return 0.0
    # Written out, since c is the rounded number: 0.0996 with two digits is 10·10^-2.
    written = f"{uncertainty:.{digits - 1}e}"
    exponent = int(written.split("e")[1]) - digits + 1
    return 0.5 * 10.0**exponent


def tolerances(uncertainty: Vector, digits: int) -> Vector:
    """Return the numerical tolerances of several uncertainties, shape (m,)."""
    return np.array([numerical_tolerance(float(value), digits) for value in uncertainty])


def coverage_intervals(values: Vector, coverage: float) -> tuple[Vector, Vector, Vector, Vector]:
    """Return symmetric and shortest coverage intervals of trials (clause 7.7).

    Args:
        values: trials, shape (trials, m).
        coverage: probability p, 0 < p < 1.

    Returns:
        low, high (probabilistically symmetric), low, high (shortest), each shape (m,).

    Raises:
        ValueError: too few trials for this probability.
    """
    count = len(values)
    inside = math.floor(coverage * count + 0.5)
    if not 0 < inside < count:
        raise Refusal(
            f"{count} trials are too few for a coverage probability of {coverage:g}",
            fault="too_few",
            aspect="trials",
        )
    ordered = np.sort(values, axis=0)
    first = (count - inside) // 2
    widths = ordered[inside:] - ordered[: count - inside]
    shortest = np.argmin(widths, axis=0)
    column = np.arange(values.shape[1])
    return (
        ordered[first],
        ordered[first + inside],
        ordered[shortest, column],
        ordered[shortest + inside, column],
    )


def monte_carlo(
    sample: Sampler,
    coverage: float = 0.95,
    digits: int = 1,
    most_trials: int = 1_000_000,
    seed: int = 0,
    share: float = 1.0,
    progress: Callable[[float], None] | None = None,
) -> TrialOutcome:
    """Run the adaptive procedure of clause 7.9.4.

    Args:
        sample: draws trials of the output quantities.
        coverage: probability of the coverage intervals.
        digits: significant digits of the standard uncertainties that are to be right, 1 or 2.
        most_trials: where the procedure stops, settled or not.
        seed: of the random numbers; the same seed gives the same result.
        share: of δ, within which the results are to settle; ``VALIDATION_SHARE`` for a validation.
        progress: called with the part (0..1) of the most trials that is done.

    Raises:
        ValueError: an argument is out of range.
    """
    if not 0.5 <= coverage < 1.0:
        raise Refusal(
            f"the coverage probability is {coverage:g}; expected 0.5 to 1, e.g. 0.95",
            fault="out_of_range",
        )
    if digits not in (1, 2):
        raise Refusal(f"digits is {digits}; expected 1 or 2", fault="out_of_range")
    block = max(BLOCK, math.ceil(100.0 / (1.0 - coverage)))
    if most_trials < FEWEST_BLOCKS * block:
        raise Refusal(
            f"at most {most_trials} trials were asked for; the fewest are {FEWEST_BLOCKS} blocks"
            f" of {block}",
            fault="too_few",
            aspect="limit",
        )
    rng = np.random.default_rng(seed)
    # Kept as deviations from the first block's mean, for which seven digits are plenty.
    blocks: list[NDArray[np.float32]] = []
    origin: Vector = np.zeros(0)
    found: list[Vector] = []
    while True:
        values = np.asarray(sample(block, rng), dtype=np.float64)
        if not blocks:
            origin = values.mean(axis=0)
        blocks.append((values - origin).astype(np.float32))
        low, high, _, _ = coverage_intervals(values, coverage)
        found.append(np.array([values.mean(axis=0), values.std(axis=0, ddof=1), low, high]))
        if progress is not None:
            progress(min(1.0, len(blocks) * block / most_trials))
        if len(blocks) < FEWEST_BLOCKS:
            continue
        # From sums over blocks; the trials themselves are joined once, at the end.
        means, spreads = np.array([f[0] for f in found]), np.array([f[1] for f in found])
        overall = np.sqrt(
            (np.sum((block - 1) * spreads**2, axis=0) + block * _squares(means))
            / (len(blocks) * block - 1)
        )
        tolerance = share * tolerances(overall, digits)
        scatter = np.std(np.array(found), axis=0, ddof=1) / math.sqrt(len(blocks))
        unsettled = 2.0 * scatter > tolerance
        settled = ~np.any(unsettled, axis=0)
        if bool(np.all(settled)) or (len(blocks) + 1) * block > most_trials:
            break
    parts = []
    for column in range(0, blocks[0].shape[1], _COLUMNS):
        everything = np.concatenate([values[:, column : column + _COLUMNS] for values in blocks])
        parts.append(coverage_intervals(everything, coverage))
    low, high, shortest_low, shortest_high = (
        origin + np.concatenate(ends) for ends in zip(*parts, strict=True)
    )
    return TrialOutcome(
        estimate=means.mean(axis=0),
        standard_uncertainty=overall,
        low=low,
        high=high,
        shortest_low=shortest_low,
        shortest_high=shortest_high,
        tolerance=tolerance,
        settled=settled,
        trials=len(blocks) * block,
        blocks=len(blocks),
        coverage=coverage,
    )


def validate(
    estimate: Vector, expanded: Vector, outcome: TrialOutcome, uncertainty: Vector, digits: int = 1
) -> Validation:
    """Compare y ± U of the GUM uncertainty framework with the symmetric interval (clause 8.1).

    Args:
        estimate: y, shape (m,).
        expanded: U for the coverage probability of the outcome, shape (m,).
        outcome: of the Monte Carlo method.
        uncertainty: standard uncertainties u(y) of the framework, from which δ is taken.
        digits: significant digits of u(y) that count.
    """
    tolerance = tolerances(uncertainty, digits)
    low = np.abs(estimate - expanded - outcome.low)
    high = np.abs(estimate + expanded - outcome.high)
    return Validation(low, high, tolerance, (low <= tolerance) & (high <= tolerance))


def _squares(values: Vector) -> Vector:
    centred = values - values.mean(axis=0)
    summed: Vector = np.sum(centred**2, axis=0)
    return summed
