"""How much larger the range of estimated values is than that of the true ones.

The largest minus the smallest of values that scatter picks those that err most: on average it is
too large, the more so the flatter the true curve. The figure stays as its standard defines it, and
its uncertainty contains the excess. As the true values are not known, the estimate is drawn towards
zero as far as its own uncertainty explains it (James & Stein 1961, Proc. 4th Berkeley Symp. 1, 361,
with a quantile of χ² instead of its mean: an excess that is taken too small makes a false band, one
that is taken too large a wide one).
"""

from functools import lru_cache

import numpy as np

from stepdiag_ros.metrology.geometry import Vector

_BY_CHANCE = 0.2
"""Chance of χ² by noise alone up to which a curve is taken as flat."""
_DRAWS = 500
_RANK_LIMIT = 1e-9


def range_excess(values: Vector, covariance: Vector) -> float:
    """Return by how much the largest minus the smallest of estimated values is too large, mean.

    Args:
        values: estimated; zero where the true curve is flat, but for noise; shape (n,).
        covariance: of them, shape (n, n).

    Returns:
        The excess in the unit of the values; NaN where the covariance is not known.
    """
    if not np.all(np.isfinite(covariance)):
        return float("nan")
    if not np.any(covariance):
        return 0.0
    variances, vectors = _spectrum(covariance)
    true = values * (1.0 - _share(values, variances, vectors))
    drawn = true + draws(len(variances)) @ (vectors * np.sqrt(variances)).T
    # Draws along the rows: the extremes of many columns at once are found several times as fast.
    ranges = np.ptp(np.ascontiguousarray(drawn.T), axis=0)
    return max(float(np.mean(ranges) - np.ptp(true)), 0.0)


def share_by_chance(values: Vector, covariance: Vector) -> float:
    """Return the share of estimated values that their own uncertainty may explain, 0 to 1.

    Args:
        values: estimated, shape (n,).
        covariance: of them, shape (n, n).
    """
    return _share(values, *_spectrum(covariance)) if np.any(covariance) else 0.0


def _spectrum(covariance: Vector) -> tuple[Vector, Vector]:
    variances, vectors = np.linalg.eigh(covariance)
    told = np.flatnonzero(variances > _RANK_LIMIT * variances[-1])
    return variances[told], vectors[:, told]


def _share(values: Vector, variances: Vector, vectors: Vector) -> float:
    from scipy.special import chdtri

    along = vectors.T @ values
    # What no variance explains is known all the better.
    beside = values - vectors @ along
    squares = float(np.sum(along**2 / variances))
    squares += float(beside @ beside) / (_RANK_LIMIT * float(variances[-1]))
    by_chance = float(chdtri(float(len(variances)), _BY_CHANCE))
    return min(by_chance / squares, 1.0) if squares > 0.0 else 1.0


@lru_cache(maxsize=4)
def draws(count: int) -> Vector:
    """Return the same standard normal numbers for every curve, shape (``_DRAWS``, count)."""
    draws: Vector = np.random.default_rng(0).standard_normal((_DRAWS, count))
    draws.flags.writeable = False
    return draws
