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
    from scipy.special import chdtri

    if not np.all(np.isfinite(covariance)):
        return float("nan")
    if not np.any(covariance):
        return 0.0
    variances, vectors = np.linalg.eigh(covariance)
    told = np.flatnonzero(variances > _RANK_LIMIT * variances[-1])
    variances, vectors = variances[told], vectors[:, told]
    root = vectors * np.sqrt(variances)
    squares = float(np.sum((vectors.T @ values) ** 2 / variances))
    by_chance = float(chdtri(float(len(told)), _BY_CHANCE))
    true = values * (max(1.0 - by_chance / squares, 0.0) if squares > 0.0 else 0.0)
    drawn = true + _draws(root.shape[1]) @ root.T
    # Draws along the rows: the extremes of many columns at once are found several times as fast.
    ranges = np.ptp(np.ascontiguousarray(drawn.T), axis=0)
    return max(float(np.mean(ranges) - np.ptp(true)), 0.0)


@lru_cache(maxsize=4)
def _draws(count: int) -> Vector:
    """Return the same standard normal numbers for every curve, shape (``_DRAWS``, count)."""
    draws: Vector = np.random.default_rng(0).standard_normal((_DRAWS, count))
    draws.flags.writeable = False
    return draws
