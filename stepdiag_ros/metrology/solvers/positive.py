"""Inverse of the symmetric positive definite matrices of least squares."""

from functools import reduce
from operator import iadd
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, solve_triangular

Matrix = NDArray[np.float64]
Integers = NDArray[np.int64]

_RANK_LIMIT = 1e-11
"""Pivots of the normal matrix below this share of its largest entry count as zero."""
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

    Cholesky with pivots finds what is not determined several times as fast as eigenvectors. With a
    unit of weight put on that, the matrix is positive definite; its inverse less that unit is the
    pseudo-inverse.

    Args:
        normal: to be inverted, shape (n, n).
        unweighted: the same for equal weights.

    Returns:
        the inverse, and orthonormal directions that are not determined, shape (n, r).

    Raises:
        ValueError: the two do not determine the same directions.
    """
    unseen = _null_directions(unweighted)
    unit = float(np.trace(normal)) / len(normal)
    nothing = unseen @ unseen.T
    inverse = inverse_positive(normal + unit * nothing)
    if inverse is None:
        raise ValueError("the weighted matrix does not determine what the unweighted one does")
    inverse -= nothing / unit
    return inverse, unseen


def _null_directions(matrix: Matrix) -> Matrix:
    """Return orthonormal directions that a positive semidefinite matrix makes zero, (n, r)."""
    limit = _RANK_LIMIT * float(np.max(np.diag(matrix)))
    factor, pivots, rank, _ = lapack.dpstrf(matrix, tol=limit, lower=1)
    if rank == len(matrix):
        return np.zeros((rank, 0))
    order = pivots - 1
    null = np.zeros((len(matrix), len(matrix) - rank))
    null[order[rank:]] = np.eye(len(matrix) - rank)
    # With A = L Lᵀ in the order of the pivots, A x = 0 where x1 = -L11⁻ᵀ L21ᵀ x2.
    null[order[:rank]] = -solve_triangular(
        factor[:rank, :rank], factor[rank:, :rank].T, lower=True, trans="T", check_finite=False
    )
    directions: Matrix = np.linalg.qr(null)[0]
    return directions
