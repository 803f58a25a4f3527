"""Columns of many candidates beyond the baseline, kept as what changes from reading to reading.

A counter may slip at any stop, so a run has more candidates than stops, and readings × candidates
grows with the square of its length. Nearly all of these columns are steps. Kept are therefore the
changes D from one reading to the next, which are sparse: with S the running sum, W the whitening
and 1 - Q Qᵀ what is beyond the baseline, the columns are (1 - Q Qᵀ) W S D. Their products with a
few vectors V are Dᵀ Sᵀ Wᵀ (1 - Q Qᵀ) V; only few columns at a time are ever written out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stepdiag_ros.metrology.discrepancy.baseline import AT_ONCE, Whitened
from stepdiag_ros.metrology.geometry import Vector


class ColumnChanges(NamedTuple):
    """Changes of some columns from one reading to the next, those that are not zero.

    Attributes:
        values: m per unit, column after column, shape (entries,).
        rows: reading of each, rising within a column, shape (entries,).
        counts: entries of each column, shape (k,).
    """

    values: Vector
    rows: NDArray[np.int32]
    counts: NDArray[np.int64]


@dataclass(frozen=True)
class Columns:
    """Columns of the readings, whitened and beyond the baseline.

    Attributes:
        changes: of each column from one reading to the next, m per unit, shape (n, c).
        problem: whitened, the baseline projected out.
    """

    changes: sparse.csc_array
    problem: Whitened

    @classmethod
    def of(cls, changes: Sequence[ColumnChanges], problem: Whitened) -> "Columns":
        """Join the changes of several blocks of columns, see ``changes_of``."""
        # One sparse array: to make one of each block and join them takes ten times as long.
        none = ColumnChanges(np.zeros(0), np.zeros(0, np.int32), np.zeros(0, np.int64))
        values, rows, counts = (np.concatenate(parts) for parts in zip(none, *changes, strict=True))
        ends = np.append(0, np.cumsum(counts)).astype(np.int32)
        shape = (len(problem.baseline.gap), len(counts))
        return cls(sparse.csc_array((values, rows, ends), shape=shape), problem)

    @property
    def count(self) -> int:
        """Return the number of columns."""
        return int(self.changes.shape[1])

    @property
    def real(self) -> NDArray[np.bool_]:
        """Say which columns are not zero, shape (c,)."""
        return np.asarray(np.diff(self.changes.indptr) > 0)

    def chosen(self, places: NDArray[np.int64]) -> "Columns":
        """Return some of the columns."""
        return Columns(sparse.csc_array(self.changes[:, places]), self.problem)

    def turned(self, matrix: sparse.csc_array) -> "Columns":
        """Return combinations of the columns, shape of the matrix (c, k)."""
        made = sparse.csc_array(self.changes @ matrix)
        made.eliminate_zeros()
        return Columns(made, self.problem)

    def raw(self, places: slice | NDArray[np.int64]) -> Vector:
        """Return columns as they are before the baseline is taken away, shape (rows, k)."""
        return self.problem.of(np.cumsum(self.changes[:, places].toarray(), axis=0))

    def dense(self, places: slice | NDArray[np.int64]) -> Vector:
        """Return columns beyond the baseline, shape (rows, k)."""
        return self.problem.projected(self.raw(places))

    def raw_products(self, vectors: Vector) -> Vector:
        """Return the products of all ``raw`` columns with vectors, shape (c, k).

        Args:
            vectors: shape (rows, k).
        """
        summed = np.cumsum(self.problem.pulled(vectors)[::-1], axis=0)[::-1]
        products: Vector = self.changes.T @ summed
        return products

    def products(self, vectors: Vector) -> Vector:
        """Return the products of all columns with vectors, shape (c, k).

        Args:
            vectors: shape (rows, k).
        """
        return self.raw_products(self.problem.projected(vectors))

    def lengths(self) -> tuple[Vector, Vector]:
        """Return the lengths of all columns, raw and beyond the baseline, shape (c,) each."""
        before, after = np.zeros(self.count), np.zeros(self.count)
        for start in range(0, self.count, AT_ONCE):
            here = slice(start, min(start + AT_ONCE, self.count))
            raw = self.raw(here)
            before[here] = np.linalg.norm(raw, axis=0)
            after[here] = np.linalg.norm(self.problem.projected(raw), axis=0)
        return before, after


def changes_of(columns: Vector) -> ColumnChanges:
    """Return columns of the readings as their changes from one reading to the next.

    Args:
        columns: shape (n, k).
    """
    steps = np.diff(columns, axis=0, prepend=0.0).T
    column, row = np.nonzero(steps)
    counts = np.bincount(column, minlength=len(steps))
    return ColumnChanges(steps[column, row], row.astype(np.int32), counts)


def in_blocks(
    first: NDArray[np.int64], count: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield candidates, few at a time, with the places of all their columns.

    Args:
        first: column of each candidate's first size, shape (candidates,).
        count: number of its sizes, shape (candidates,).
    """
    block = np.cumsum(count) // AT_ONCE
    for number in np.unique(block):
        members = np.flatnonzero(block == number)
        yield (
            members,
            np.concatenate([np.arange(first[one], first[one] + count[one]) for one in members]),
        )
