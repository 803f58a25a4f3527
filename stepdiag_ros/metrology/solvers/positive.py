"""Inverse of the symmetric positive definite matrices of least squares, with numpy alone.

A solver node should not have to load scipy, and LAPACK's general inverse is several times slower.
"""

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

_SMALL = 48


def inverse_positive(matrix: Matrix) -> Matrix | None:
    """Return the inverse by Cholesky, or None if the matrix is not positive definite."""
    try:
        lower = np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    inverted = _inverse_lower(lower)
    inverse: Matrix = inverted.T @ inverted
    return inverse


def inverse_with_islands(matrix: Matrix, islands: NDArray[np.int64]) -> Matrix | None:
    """Return the inverse of a matrix in which some groups of unknowns do not meet one another.

    The groups are eliminated first, each alone (Schur complement); only the rest is dense. With
    half of the unknowns in groups this is about three times faster than a dense inverse.

    Args:
        matrix: shape (p, p).
        islands: unknowns of each group, shape (groups, size); no entry of the matrix joins two
            groups.

    Returns:
        shape (p, p), or None if the matrix is not positive definite.
    """
    count, size = islands.shape
    if count == 0 or size == 0:
        return inverse_positive(matrix)
    flat = islands.reshape(-1)
    rest = np.delete(np.arange(len(matrix)), flat)
    blocks = matrix[islands[:, :, None], islands[:, None, :]]
    try:
        np.linalg.cholesky(blocks)
    except np.linalg.LinAlgError:
        return None
    own = np.linalg.inv(blocks)
    bridge = matrix.take(flat, axis=0).take(rest, axis=1)
    solved = (own @ bridge.reshape(count, size, -1)).reshape(count * size, -1)
    inner = inverse_positive(matrix.take(rest, axis=0).take(rest, axis=1) - bridge.T @ solved)
    if inner is None:
        return None
    across = solved @ inner
    outer = across @ solved.T
    for group in range(count):
        place = slice(group * size, (group + 1) * size)
        outer[place, place] += own[group]
    ordered = np.block([[outer, -across], [-across.T, inner]])
    back = np.empty(len(matrix), dtype=np.int64)
    back[flat] = np.arange(len(flat))
    back[rest] = len(flat) + np.arange(len(rest))
    inverse: Matrix = ordered.take(back, axis=0).take(back, axis=1)
    return inverse


def _inverse_lower(lower: Matrix) -> Matrix:
    """Invert a lower triangular matrix by halves: nearly all of it is matrix products."""
    if len(lower) <= _SMALL:
        return np.asarray(np.linalg.inv(lower), dtype=np.float64)
    half = len(lower) // 2
    first, last = _inverse_lower(lower[:half, :half]), _inverse_lower(lower[half:, half:])
    inverted = np.zeros_like(lower)
    inverted[:half, :half] = first
    inverted[half:, half:] = last
    inverted[half:, :half] = -last @ (lower[half:, :half] @ first)
    return inverted
