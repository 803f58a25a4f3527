"""What chance does: the largest gain of any candidate on a run that lacks nothing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.discrepancy.baseline import AT_ONCE
from stepdiag_ros.metrology.discrepancy.candidates import Signatures
from stepdiag_ros.metrology.geometry import Vector

_DRAWS = 2000
_BATCH = 250
_TAIL = 0.05
"""Share of the draws by which the far tail is extrapolated."""


def tail(gain: Vector, columns: Vector | float, freedom: float) -> Vector:
    """Return the chance of such a gain of χ² by so many columns, noise estimated (F test)."""
    from scipy.special import fdtrc

    gain = np.asarray(gain, dtype=np.float64)
    chance: Vector = np.asarray(fdtrc(columns, freedom, gain / columns))
    return chance


def coverage_factor(freedom: float) -> float:
    """Return the factor from a standard uncertainty to half of a 95 % coverage interval.

    Args:
        freedom: degrees of freedom of the noise (Student's distribution).
    """
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.975))


def tail_of(luck: Vector, found: float) -> float:
    """Return the share of draws beyond a value; beyond all of them as their exponential tail.

    Args:
        luck: what noise has given in each draw, shape (draws,).
        found: what the run gives.
    """
    ordered = np.sort(luck)
    start = float(ordered[int(0.95 * len(ordered))])
    if found <= start:
        return float(np.mean(luck >= found))
    slope = float(np.mean(ordered[ordered > start] - start))
    return float(0.05 * np.exp(-(found - start) / slope))


@dataclass(frozen=True)
class LookElsewhere:
    """The null distribution of the best candidate of a plan.

    Attributes:
        trials: number of independent candidates that would be as lucky as all these together.
        freedom: degrees of freedom of the noise.
    """

    trials: float
    freedom: float

    def corrected(self, chance: float) -> float:
        """Return the chance that any candidate does as well as one did with this chance alone."""
        return float(-np.expm1(-self.trials * chance))

    def threshold(self, level: float) -> float:
        """Return the gain of one column beyond which the corrected chance is below a level."""
        from scipy.special import fdtri

        single = -np.log1p(-level) / self.trials
        return float(fdtri(1.0, self.freedom, 1.0 - single))


def look_elsewhere(found: Signatures, freedom: float, seed: int) -> LookElsewhere:
    """Draw runs that lack nothing and note the least chance that any candidate shows in each.

    The candidates overlap, so that they are as many independent ones as the distribution
    of the luckiest shows, fewer than their number. The noise of every draw is estimated as that of
    the run.

    Args:
        found: the candidates, projected and orthonormal.
        freedom: degrees of freedom of the noise estimate.
        seed: of the draws.
    """
    units = found.units.chosen(np.flatnonzero(found.units.real))
    if not units.count:
        return LookElsewhere(1.0, freedom)
    rng = np.random.default_rng(seed)
    rows = len(units.problem.gap)
    order = _numbers(found)
    lucky = np.ones(_DRAWS)
    for start in range(0, _DRAWS, _BATCH):
        draws = rng.standard_normal((_BATCH, rows), dtype=np.float32).astype(np.float64)
        variance = rng.chisquare(freedom, _BATCH) / freedom
        squares = units.products(draws.T)
        np.square(squares, out=squares)
        for size in range(1, int(order.max()) + 1):
            gain = _largest_gain(squares, np.flatnonzero(order == size), size)
            chance = tail(gain / variance, float(size), freedom)
            lucky[start : start + _BATCH] = np.minimum(lucky[start : start + _BATCH], chance)
    least = np.sort(lucky)[: int(_TAIL * _DRAWS)]
    # P(luckiest < p) = 1 - exp(-trials·p), at the end of the sorted tail.
    return LookElsewhere(max(1.0, float(-np.log1p(-_TAIL) / least[-1])), freedom)


def _largest_gain(squares: Vector, last: NDArray[np.int64], size: int) -> Vector:
    """Return the largest gain of any candidate by its first columns in each draw, shape (draws,).

    Args:
        squares: of the products of all columns with each draw, shape (c, draws).
        last: of these columns, of each candidate that has so many.
        size: how many.
    """
    largest = np.zeros(squares.shape[1])
    for start in range(0, len(last), AT_ONCE):
        here = last[start : start + AT_ONCE]
        gain = squares[here]
        for back in range(1, size):
            gain = gain + squares[here - back]
        largest = np.maximum(largest, np.max(gain, axis=0))
    return largest


def _numbers(found: Signatures) -> NDArray[np.int64]:
    """Return of each real column the how manieth of its candidate it is, from 1."""
    real = found.units.real
    numbers: list[int] = []
    for index in range(len(found.candidates)):
        here = int(np.count_nonzero(real[found.of(index)]))
        numbers.extend(range(1, here + 1))
    return np.array(numbers)
