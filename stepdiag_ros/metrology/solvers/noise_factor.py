"""Are residuals larger than chance makes them, and by what are all uncertainties enlarged then."""

import numpy as np

from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR, COVERAGE_PROBABILITY

_NO_NOISE = 1e-14
"""m: noise below this is rounding."""
_SIGNIFICANT = 2.3263
"""Standard normal quantile of p = 0.01, one-sided."""


def noise_factor(squares: float, freedom: int, known: bool) -> float:
    """Return the factor on all variances: χ²/dof where that is more than chance explains.

    Args:
        squares: weighted sum of squares of the residuals.
        freedom: its degrees of freedom.
        known: the readings came with uncertainties, by which the squares are weighted.
    """
    if not known:
        return max(squares / freedom, _NO_NOISE**2) if freedom > 0 else float("nan")
    if freedom > 0 and exceeds_chance(squares, freedom):
        return squares / freedom
    return 1.0


def widening(freedom: float) -> float:
    """Return the factor on variances that are estimated from few residuals, at least 1.

    A figure's u is widened so that 1.96 u is the coverage interval of Student's distribution (GUM
    G.3), whose k is larger than 1.96: 3.2 for 3 degrees of freedom, 2.0 for 60.

    Args:
        freedom: degrees of freedom of the estimate; infinite where the noise is known.
    """
    from scipy.special import stdtrit

    if not np.isfinite(freedom):
        return 1.0
    if freedom <= 0:
        return float("nan")
    student = float(stdtrit(freedom, 0.5 + 0.5 * COVERAGE_PROBABILITY))
    return max(student / COVERAGE_FACTOR, 1.0) ** 2


def exceeds_chance(chi_squared: float, freedom: int) -> bool:
    """Say whether χ² is too large for chance, p < 0.01 (Wilson & Hilferty 1931, any dof ≥ 1)."""
    spread = 2.0 / (9.0 * freedom)
    normal = (np.cbrt(chi_squared / freedom) - (1.0 - spread)) / np.sqrt(spread)
    return bool(normal > _SIGNIFICANT)
