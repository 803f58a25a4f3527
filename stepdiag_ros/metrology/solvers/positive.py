"""Inverse of the symmetric positive definite matrices of least squares."""

from functools import reduce
from operator import iadd
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Matrix = NDArray[np.float64]
Integers = NDArray[np.int64]

_RANK_LIMIT = 1e-11
"""Eigenvalues of the scaled normal matrix below this share of the largest count as zero."""
_AT_ONCE = 500_000
"""Products of entries that are made at a time."""


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
    # Both routines leave zeros above the diagonal.
    whole: Matrix = inverse + inverse.T
    whole.flat[:: len(whole) + 1] = inverse.diagonal()
    return whole


def normal_of_entries(columns: Integers, values: Matrix, weight: Matrix, count: int) -> Matrix:
    """Return the weighted normal matrix of a sparse matrix, shape (count, count).

    Args:
        columns: of the entries of each row, shape (entries, rows); ``count`` for entries that are
            left out. Each column belongs to one of the entries.
        values: of the entries, same shape.
        weight: of the rows, shape (rows,).
        count: number of columns.
    """
    width = count + 1
    weighted, rows = values * weight, columns * width
    one, other = np.triu_indices(len(columns))
    pairs = max(1, _AT_ONCE // max(columns.shape[1], 1))

    def sums(start: int) -> NDArray[Any]:
        first, second = one[start : start + pairs], other[start : start + pairs]
        # Two columns meet in one pair of entries only: on one side of the diagonal, whichever.
        places = rows[first] + columns[second]
        products = weighted[first] * values[second]
        return np.bincount(places.ravel(), products.ravel(), width * width)

    total = reduce(iadd, map(sums, range(0, len(one), pairs)))
    half: Matrix = total.reshape(width, width)[:count, :count]
    normal: Matrix = half + half.T
    normal.flat[:: count + 1] -= np.diag(half)
    return normal


def inverse_of_rank(normal: Matrix, unweighted: Matrix) -> tuple[Matrix, Matrix]:
    """Invert on the determined directions; which these are does not depend on weights.

    Args:
        normal: to be inverted, shape (n, n).
        unweighted: the same for equal weights.

    Returns:
        the inverse, and orthonormal directions that are not determined, shape (n, r).
    """
    values, vectors = np.linalg.eigh(unweighted)
    none = values <= _RANK_LIMIT * values[-1]
    seen = vectors[:, ~none]
    inverse: Matrix = seen @ np.linalg.solve(seen.T @ normal @ seen, seen.T)
    return inverse, vectors[:, none]
