"""One statistic for many differences at once: of a hundred nodes some exceed their U by chance."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan

import numpy as np

from stepdiag_ros.metrology.geometry import Vector

SIGNIFICANT = 0.05
"""Probability below which a difference is no longer put down to chance: that of |E_n| > 1."""
FIXED = 1e-15
"""m or rad: a value with a smaller standard uncertainty is fixed by the frame and does not
count.
"""
_RANK = 1e-9
"""Of the largest eigenvalue of the correlations: what is smaller is rounding, not information."""


@dataclass(frozen=True)
class JointTest:
    """What all differences together say.

    Attributes:
        chi_squared: dᵀ C⁻¹ d of the differences d with their covariance C; NaN where not known.
        degrees_of_freedom: independent differences in it.
        probability: of so large a chi squared, or a larger one, where nothing has changed; NaN
            where not known.
    """

    chi_squared: float = nan
    degrees_of_freedom: int = 0
    probability: float = nan

    @property
    def known(self) -> bool:
        """Say whether there is anything to judge by."""
        return bool(np.isfinite(self.probability))

    @property
    def significant(self) -> bool:
        """Say whether chance is not a good explanation (p < ``SIGNIFICANT``)."""
        return self.known and self.probability < SIGNIFICANT


def joint_test(difference: Vector, covariance: Vector) -> JointTest:
    """Return what all differences together say.

    Values that are not known, or fixed by the frame, are left out. Differences that follow from
    others (a singular covariance) count once.

    Args:
        difference: in SI, shape (n,); NaN where not known.
        covariance: of the differences, shape (n, n); NaN rows where not known. If a covariance
            between two known values is missing, the result is undetermined.
    """
    from scipy.linalg import eigh
    from scipy.special import chdtrc

    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    used = np.flatnonzero(np.isfinite(difference) & (spread > FIXED))
    if not used.size:
        return JointTest()
    correlation = covariance[np.ix_(used, used)]
    correlation /= spread[used, None]
    correlation /= spread[used]
    if not np.all(np.isfinite(correlation)):
        return JointTest()
    sizes, directions = eigh(correlation, overwrite_a=True, check_finite=False)
    told = sizes > _RANK * sizes[-1]
    along = directions[:, told].T @ (difference[used] / spread[used])
    chi_squared = float(np.sum(along**2 / sizes[told]))
    freedom = int(np.count_nonzero(told))
    return JointTest(chi_squared, freedom, float(chdtrc(freedom, chi_squared)))


def significant_of_many(probabilities: Mapping[str, float]) -> tuple[str, ...]:
    """Return which of many tests chance does not explain, although there are many (Holm 1979).

    The probability that any is named where nothing has changed is at most ``SIGNIFICANT``.

    Args:
        probabilities: by name, those of large differences by chance; NaN does not count.

    Returns:
        names, the least probable first.
    """
    known = {name: value for name, value in probabilities.items() if np.isfinite(value)}
    named: list[str] = []
    for place, name in enumerate(sorted(known, key=known.__getitem__)):
        if known[name] * (len(known) - place) >= SIGNIFICANT:
            break
        named.append(name)
    return tuple(named)
