"""What the readings at the same places have in common, as a space beyond the baseline.

A long run has almost as many places as readings, and orthonormal columns of all of them would be
the largest thing that a diagnosis makes. Whitened, each column meets only its neighbours along a
pass. So the space S of the columns is known by the band of their products; the baseline and what
was found span B. The space of both is that of S and of what S leaves of B, so that no matrix is
larger than places times the columns of B.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded

from stepdiag_ros.metrology.discrepancy.baseline import AT_ONCE, Whitened
from stepdiag_ros.metrology.geometry import Vector

RANK_LIMIT = 1e-6
"""Squared sine of an angle below which one direction lies in a space of others."""


class Places:
    """The space in which each place has a value of its own, the same in all its readings.

    Args:
        problem: whitened, the baseline projected out.
        place: number of the place of each stop.
        sign: with which the value of its place is in the reading of each stop, 1 or -1.
    """

    def __init__(self, problem: Whitened, place: NDArray[np.int64], sign: Vector) -> None:
        good = problem.baseline.good
        numbers, own = np.unique(place[good], return_inverse=True)
        self._problem = problem
        self._columns = _whitened(problem, own.reshape(-1), sign[good], len(numbers))
        self._factor = cholesky_banded(_band(self._columns.T @ self._columns))

    @cached_property
    def _alone(self) -> tuple[Vector, Vector]:
        """Return the space's part that S does not hold, nothing being found."""
        return self._beyond(self._problem.span)

    @property
    def rank(self) -> int:
        """Return the dimensions of the space beyond the baseline."""
        return self._rank(self._alone[0])

    def _rank(self, turn: Vector) -> int:
        # S has a dimension for each place; it may hold some of the directions of B.
        return int(self._columns.shape[1] + turn.shape[1] - turn.shape[0])

    def squares(self, gap: Vector, found: Vector) -> tuple[float, int]:
        """Return the gap's square within the space beyond the baseline and what was found.

        Args:
            gap: whitened, baseline and findings projected out, shape (rows,).
            found: orthonormal columns of the findings beyond the baseline, shape (rows, k).

        Returns:
            the square and the dimensions of the space.
        """
        spanned = np.column_stack([self._problem.span, found])
        turn = (self._beyond(spanned) if found.shape[1] else self._alone)[0]
        within = self._within(gap)
        beyond = turn.T @ (spanned.T @ (gap - within))
        return float(gap @ within + beyond @ beyond), self._rank(turn)

    def mean_slowness(self) -> float:
        """Return the mean of ``Whitened.slowness`` over orthonormal columns of the space."""
        turn, solved = self._alone
        span = self._problem.span
        total = self._slowness_of_columns() - float(np.sum(self._problem.slowness(span)))
        for start in range(0, turn.shape[1], AT_ONCE):
            some = turn[:, start : start + AT_ONCE]
            left = span @ some - self._columns @ (solved @ some)
            total += float(np.sum(self._problem.slowness(left)))
        return total / self.rank

    def _beyond(self, spanned: Vector) -> tuple[Vector, Vector]:
        """Return how orthonormal columns turn into those of what S leaves of their space.

        Returns:
            the turn, shape (k, r), and the values at the places that follow the columns best,
            shape (places, k).
        """
        products = self._columns.T @ spanned
        solved: Vector = cho_solve_banded((self._factor, False), products)
        values, vectors = np.linalg.eigh(np.eye(spanned.shape[1]) - products.T @ solved)
        real = values > RANK_LIMIT
        return vectors[:, real] / np.sqrt(values[real]), solved

    def _within(self, gap: Vector) -> Vector:
        """Return the part of a gap that lies in S."""
        solved = cho_solve_banded((self._factor, False), self._columns.T @ gap)
        within: Vector = self._columns @ solved
        return within

    def _slowness_of_columns(self) -> float:
        """Return the sum of the slowness over orthonormal columns of S."""
        passes = self._problem.baseline.passes
        follows = np.flatnonzero(passes[1:] == passes[:-1]) + 1
        steps = sparse.csc_array(self._columns[follows].T @ self._columns[follows - 1])
        total = 0.0
        for start in range(0, steps.shape[1], AT_ONCE):
            some = steps[:, start : start + AT_ONCE].toarray()
            solved = cho_solve_banded((self._factor, False), some)
            total += 2.0 * float(np.trace(solved[start:]))
        return total


def _whitened(
    problem: Whitened, place: NDArray[np.int64], sign: Vector, count: int
) -> sparse.csr_array:
    """Return the columns of all places, whitened; ``place`` and ``sign`` of each reading."""
    parts = []
    for start in range(0, count, AT_ONCE):
        numbers = np.arange(start, min(start + AT_ONCE, count))
        at = np.where(place[:, None] == numbers, sign[:, None], 0.0)
        parts.append(sparse.csr_array(problem.of(at)))
    return sparse.csr_array(sparse.hstack(parts, format="csr"))


def _band(products: sparse.csr_array) -> Vector:
    """Return the upper band of a symmetric matrix as ``scipy.linalg.cholesky_banded`` wants it."""
    upper = sparse.coo_array(sparse.triu(products))
    away = upper.col - upper.row
    width = int(away.max(initial=0))
    band = np.zeros((width + 1, products.shape[1]))
    band[width - away, upper.col] = upper.data
    return band
