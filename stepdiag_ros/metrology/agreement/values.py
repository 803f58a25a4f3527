"""A figure, and a place in the volume, of two measurements."""

from dataclasses import dataclass
from math import inf, nan, sqrt

import numpy as np

from stepdiag_ros.metrology.comparison import COVERAGE, normalised_error
from stepdiag_ros.metrology.geometry import SQUARENESS, Vector

REVERSAL = "mean reversal"
FAMILIES = ("volume", "squareness", "positioning", "straightness", "angular", "diagonal", REVERSAL)
"""Kinds of figures; the name of each figure but a squareness begins with it."""


@dataclass(frozen=True)
class FigureChange:
    """One figure of both measurements.

    Attributes:
        name: for example ``squareness C0Y``, ``straightness E_YX``, ``volume, rms``.
        unit: ``m`` or ``rad``.
        before: of the first; NaN where not determined.
        after: of the second.
        before_uncertainty: standard uncertainty; NaN where not known.
        after_uncertainty: of the second.
        difference_uncertainty: standard uncertainty of after minus before.
        degrees_of_freedom: of that uncertainty; infinite where it is known.
        changed: chance does not explain the change, although there are many figures; None
            where that is undetermined.
    """

    name: str
    unit: str
    before: float
    after: float
    before_uncertainty: float
    after_uncertainty: float
    difference_uncertainty: float
    degrees_of_freedom: float = inf
    changed: bool | None = None

    @classmethod
    def of(
        cls,
        name: str,
        unit: str,
        values: tuple[float, float],
        uncertainties: tuple[float, float],
        covariance: float = 0.0,
        degrees_of_freedom: tuple[float, float] = (inf, inf),
    ) -> "FigureChange":
        """Return a figure of both.

        Args:
            name: see the class.
            unit: ``m`` or ``rad``.
            values: before and after.
            uncertainties: standard uncertainties, before and after.
            covariance: of the two values, by what both measurements share.
            degrees_of_freedom: of the uncertainties; that of the difference has the effective ones
                of Welch and Satterthwaite (JCGM 100:2008, G.4.1).
        """
        variance = uncertainties[0] ** 2 + uncertainties[1] ** 2 - 2.0 * covariance
        spread = sqrt(max(variance, 0.0)) if np.isfinite(variance) else nan
        parts = sum(u**4 / n for u, n in zip(uncertainties, degrees_of_freedom, strict=True))
        freedom = variance**2 / parts if parts > 0.0 else inf
        return cls(name, unit, *values, *uncertainties, spread, freedom)

    @property
    def difference(self) -> float:
        """Return after minus before."""
        return self.after - self.before

    @property
    def normalised_error(self) -> float:
        """Return E_n; NaN where not known."""
        spread = np.array([self.difference_uncertainty])
        return float(normalised_error(np.array([self.difference]), spread)[0])

    @property
    def probability(self) -> float:
        """Return the probability that chance alone makes as large a change; NaN where not known."""
        return float(chance_of(np.array([self.normalised_error]), self.degrees_of_freedom)[0])

    @property
    def family(self) -> str:
        """Return which of ``FAMILIES`` it belongs to."""
        if self.name in SQUARENESS:
            return "squareness"
        return next(family for family in FAMILIES if self.name.startswith(family))

    @property
    def factor(self) -> float:
        """Return how many times smaller its size is after; NaN where not known or nothing was."""
        if not abs(self.before) > 0.0 or not np.isfinite(self.after):
            return nan
        return abs(self.before) / abs(self.after) if self.after else float("inf")


@dataclass(frozen=True)
class PlaceChange:
    """How the error vector at one place of the volume changed.

    Attributes:
        position: machine coordinates, m, shape (3,).
        before: error vector, m, shape (3,).
        after: of the second measurement.
        difference_uncertainty: standard uncertainty of each component of after minus before, m,
            shape (3,); NaN where not known.
        length: of the difference of the vectors, m.
        length_uncertainty: its standard uncertainty along the difference, m; NaN where not known.
            The place was chosen because the difference is largest there: chance adds to it.
    """

    position: Vector
    before: Vector
    after: Vector
    difference_uncertainty: Vector
    length: float
    length_uncertainty: float


def chance_of(normalised_errors: Vector, degrees_of_freedom: float = inf) -> Vector:
    """Return the probability that chance alone makes a difference as large, of either sign.

    Args:
        normalised_errors: E_n, shape (n,); NaN where not known.
        degrees_of_freedom: of the uncertainties in it (Student's t); infinite: normal distribution.
    """
    from scipy.special import ndtr, stdtr

    # E_n is by the expanded uncertainty, k = 2.
    size = COVERAGE * np.abs(normalised_errors)
    lower = stdtr(degrees_of_freedom, -size) if np.isfinite(degrees_of_freedom) else ndtr(-size)
    made: Vector = 2.0 * lower
    return made
