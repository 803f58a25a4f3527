"""A figure, and a place in the volume, of two measurements."""

from dataclasses import dataclass
from math import nan, sqrt

import numpy as np

from stepdiag_ros.metrology.comparison import normalised_error
from stepdiag_ros.metrology.geometry import Vector


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
    """

    name: str
    unit: str
    before: float
    after: float
    before_uncertainty: float
    after_uncertainty: float
    difference_uncertainty: float

    @classmethod
    def of(
        cls,
        name: str,
        unit: str,
        values: tuple[float, float],
        uncertainties: tuple[float, float],
        covariance: float = 0.0,
    ) -> "FigureChange":
        """Return a figure of both.

        Args:
            name: see the class.
            unit: ``m`` or ``rad``.
            values: before and after.
            uncertainties: standard uncertainties, before and after.
            covariance: of the two values, by what both measurements share.
        """
        variance = uncertainties[0] ** 2 + uncertainties[1] ** 2 - 2.0 * covariance
        spread = sqrt(max(variance, 0.0)) if np.isfinite(variance) else nan
        return cls(name, unit, *values, *uncertainties, spread)

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
