"""Inverse of the symmetric positive definite matrices of least squares."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Matrix = NDArray[np.float64]


def is_positive(matrix: Matrix) -> bool:
    """Say whether a symmetric matrix is positive definite."""
    return not lapack.dpotrf(matrix, lower=1)[1]


def inverse_positive(matrix: Matrix) -> Matrix | None:
    """Return the inverse by Cholesky, or None if the matrix is not positive definite.

    LAPACK's own routines for this (potrf, potri): several times faster than a general inverse.
    """
    lower, failed = lapack.dpotrf(matrix, lower=1)
    if failed:
        return None
    inverse, failed = lapack.dpotri(lower, lower=1, overwrite_c=1)
    if failed:
        return None
    half = np.tril(inverse)
    whole: Matrix = half + np.tril(half, -1).T
    return whole
