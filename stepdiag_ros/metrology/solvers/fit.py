"""A solution of the least-squares problem."""

from dataclasses import dataclass

from stepdiag_ros.metrology.geometry import Vector


@dataclass(frozen=True)
class Fit:
    """A solution.

    Attributes:
        unknowns: of the design, m, shape (..., p).
        curves: m and rad, shape (..., c(N+1)) in the order of ``Design.names``.
        tilts: rad, shape (..., diagonal setups, 2).
        fitted: excess of the readings' group means by the model, m, shape (..., groups).
        squares: weighted sum of squares of all residuals, NaN for replicates.
    """

    unknowns: Vector
    curves: Vector
    tilts: Vector
    fitted: Vector
    squares: float
