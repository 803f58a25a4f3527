"""How expanded uncertainties are made of standard uncertainties."""

from dataclasses import dataclass
from math import isnan, nan

COVERAGE_FACTOR = 1.96
"""U = 1.96 u holds the true value with a probability of 95 % (normal distribution)."""
COVERAGE_PROBABILITY = 0.95


@dataclass(frozen=True)
class Expanded:
    """An expanded uncertainty with its coverage factor (GUM 6.2), for a probability of 95 %.

    Attributes:
        value: U, in the unit of its quantity; NaN if not known.
        coverage_factor: k.
    """

    value: float = nan
    coverage_factor: float = COVERAGE_FACTOR

    @classmethod
    def of_normal(cls, standard_uncertainty: float) -> "Expanded":
        """Expand a standard uncertainty by the factor of a normal distribution."""
        return cls(COVERAGE_FACTOR * standard_uncertainty)

    def times(self, factor: float) -> "Expanded":
        """Return the expanded uncertainty of the quantity times a positive constant."""
        return Expanded(self.value * factor, self.coverage_factor)


def larger(first: Expanded, second: Expanded) -> Expanded:
    """Return the larger of two expanded uncertainties, of which one may be unknown."""
    return second if isnan(first.value) or second.value > first.value else first
