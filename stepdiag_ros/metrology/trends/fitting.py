"""Least squares with a variance between runs that the history itself shows.

The covariance of the values is that of their own uncertainties, plus one variance for all runs
(reproducibility), plus what runs of one instrument share. A shared error is an unknown of its own
with a measured value 0 and its standard uncertainty, which gives the same result as the covariance
matrix would, and leaves all weights diagonal. The variance between runs is that by which weighted
residuals are as large as expected: R. C. Paule and J. Mandel, Consensus values and weighting
factors, J. Res. NBS 87 (1982) 377.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector

_STEPS = 50
_CLOSE = 1e-3
_DEPENDENT = 1e-6
"""A column of which less than this is left beside the others is one that they determine."""


@dataclass(frozen=True)
class Fit:
    """Result of ``fit``.

    Attributes:
        coefficients: of each column.
        covariance: of the coefficients.
        between: standard deviation between runs, beyond their own uncertainties.
        root_weights: of each row, reciprocal of its standard uncertainty.
        residuals: of each row, times its root weight.
        basis: orthonormal columns that span the weighted design.
        degrees_of_freedom: rows less columns.
    """

    coefficients: Vector
    covariance: Vector
    between: float
    root_weights: Vector
    residuals: Vector
    basis: Vector
    degrees_of_freedom: int


def fit(design: Vector, values: Vector, own: Vector, varies: Vector) -> Fit:
    """Fit columns to values.

    Args:
        design: rows × columns, of full rank.
        values: of each row.
        own: variance of each row that is known.
        varies: 1 for each row that varies from run to run, 0 for the others.
    """
    degrees = len(values) - design.shape[1]
    plain = values - design @ np.linalg.lstsq(design, values)[0]
    least = 0.0 if np.all(own > 0.0) else 1e-12 * float(np.var(values)) or 1.0
    between = max(least, float(plain @ plain) / degrees - float(np.mean(own)))
    for _ in range(_STEPS):
        roots = 1.0 / np.sqrt(own + between * varies)
        basis, triangle = np.linalg.qr(roots[:, None] * design)
        scaled = roots * values
        residuals = scaled - basis @ (basis.T @ scaled)
        surplus = float(residuals @ residuals) - degrees
        # χ² is convex in the variance, so that Newton's steps come to its root from below.
        fall = float(np.sum(varies * (roots * residuals) ** 2))
        before, between = between, max(least, between + surplus / fall if fall else least)
        if abs(between - before) <= _CLOSE * between:
            break
    inverse = np.linalg.inv(triangle)
    return Fit(
        inverse @ (basis.T @ (roots * values)),
        inverse @ inverse.T,
        float(np.sqrt(before)),
        roots,
        residuals,
        basis,
        degrees,
    )


def left_over(columns: Vector, basis: Vector) -> tuple[Vector, Vector]:
    """Return what columns have beyond a basis, and for which of them that is not nearly nothing.

    Args:
        columns: rows × any number.
        basis: orthonormal columns.
    """
    beyond = columns - basis @ (basis.T @ columns)
    size = np.linalg.norm(beyond, axis=0)
    return beyond, size > _DEPENDENT * np.linalg.norm(columns, axis=0)
