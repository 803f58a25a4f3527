"""All candidates judged on one gap beside what is named already: gain, sizes, evidence.

Candidates are many and their columns long, and they are judged again and again beside other
findings. What a candidate gains follows from products of columns alone: those of its own sizes with
each other and with the gap, which are made once, and those with the findings, which are few.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.discrepancy.baseline import AT_ONCE
from stepdiag_ros.metrology.discrepancy.candidates import Signatures
from stepdiag_ros.metrology.discrepancy.chance import LookElsewhere, tail
from stepdiag_ros.metrology.geometry import Vector

_NEW = 1e-2
"""Share of a size's column beyond findings and earlier sizes below which it adds nothing new."""
_MARGIN = 2.0
"""Standard uncertainties by which a size may lie beyond its plausible range."""
_FAR = 3.0
"""Factor beyond its plausible range at which a size costs three times the evidence."""
_IMPLAUSIBLE = float(np.log(20.0))
"""Evidence that a size beyond its plausible range costs."""


@dataclass(frozen=True)
class Ranking:
    """All candidates judged on one gap, given what is named already.

    Attributes:
        gain: the best of each candidate's by evidence, shape (candidates,).
        columns: number that it takes.
        chance: least chance of each candidate, not corrected.
        evidence: logarithm of each candidate's share of the probability, but for a constant.
        cost: evidence that sizes beyond their plausible range have cost it.
    """

    gain: Vector
    columns: Vector
    chance: Vector
    evidence: Vector
    cost: Vector


@dataclass(frozen=True)
class _Group:
    """Candidates with the same number m of sizes; columns scaled to unit length.

    Attributes:
        members: of the candidates, shape (k,).
        places: of their columns, shape (k, m).
        products: of their columns with each other, shape (k, m, m).
        low: smallest plausible sizes, shape (k, m).
        high: largest ones, shape (k, m).
    """

    members: NDArray[np.int64]
    places: NDArray[np.int64]
    products: Vector
    low: Vector
    high: Vector


class Ranker:
    """Judges the candidates of a run on its gap.

    Args:
        found: the candidates.
        gap: whitened and projected, shape (rows,).
        luck: what chance does on this plan.
    """

    def __init__(self, found: Signatures, gap: Vector, luck: LookElsewhere) -> None:
        self.found = found
        self.gap = gap
        self.luck = luck
        self._lengths: Vector = np.where(found.lengths > 0.0, found.lengths, 1.0)
        self._parts: Vector = found.columns.products(gap[:, None])[:, 0] / self._lengths
        self._groups = [self._group(int(m)) for m in np.unique(found.count)]
        self._rankings: dict[tuple[int, ...], Ranking] = {}
        # Schwarz's penalty comes later; equal shares for a candidate's first 1, 2 … sizes.
        self._prior: Vector = np.log(found.share) - np.log(np.maximum(found.count, 1))

    def _group(self, count: int) -> _Group:
        found = self.found
        members = np.flatnonzero(found.count == count)
        places = found.first[members][:, None] + np.arange(count)
        products = self._products(places)
        sizes = [found.candidates[index].effect.sizes for index in members]
        low = np.array([[size.low for size in some] for some in sizes]).reshape(-1, count)
        high = np.array([[size.high for size in some] for some in sizes]).reshape(-1, count)
        return _Group(members, places, products, low, high)

    def _products(self, places: NDArray[np.int64]) -> Vector:
        """Return the products of each candidate's scaled columns, shape (k, m, m)."""
        count = places.shape[1]
        if count == 1:
            return (self.found.lengths[places] > 0.0)[:, :, None].astype(np.float64)
        products = np.zeros((len(places), count, count))
        each = max(AT_ONCE // count, 1)
        for start in range(0, len(places), each):
            some = places[start : start + each]
            scaled = self.found.columns.dense(some.reshape(-1)) / self._lengths[some.reshape(-1)]
            scaled = scaled.reshape(-1, *some.shape)
            products[start : start + each] = np.einsum(
                "nki,nkj->kij", scaled, scaled, optimize=True
            )
        return products

    def span(self, chosen: Sequence[int]) -> Vector:
        """Return orthonormal columns of candidates and their unknowns, shape (rows, k)."""
        if not chosen:
            return np.zeros((len(self.gap), 0))
        parts = [self.found.units.dense(self.found.of(index)) for index in chosen]
        return orthonormal([*parts, *self.unknown(chosen)])

    def unknown(self, chosen: Sequence[int]) -> list[Vector]:
        """Return what the run does not determine of candidates, in columns of unit length."""
        parts = []
        for index in chosen:
            columns = self.found.unknown.get(index)
            if columns is not None:
                lengths = np.linalg.norm(columns, axis=0)
                parts.append(columns[:, lengths > 1e-6] / lengths[lengths > 1e-6])
        return parts

    def ranking(self, given: Sequence[int]) -> Ranking:
        """Judge all candidates beside given ones."""
        key = tuple(sorted(given))
        if key not in self._rankings:
            self._rankings[key] = self._ranked(key)
        return self._rankings[key]

    def _ranked(self, given: tuple[int, ...]) -> Ranking:
        found = self.found
        most = int(np.max(found.count, initial=1))
        count = len(found.candidates)
        gain, number = np.full((count, most), np.nan), np.full((count, most), np.nan)
        beyond = np.zeros((count, most))
        span = self.span(given)
        shared = found.columns.products(span) / self._lengths[:, None]
        parts = self._parts - shared @ (span.T @ self.gap)
        for group in self._groups:
            here = shared[group.places]
            products = group.products - here @ np.swapaxes(here, 1, 2)
            solved = _solved(products, parts[group.places])
            size = group.places.shape[1]
            gain[group.members, :size], number[group.members, :size] = solved.gain, solved.number
            scale = self._lengths[group.places]
            over = np.maximum(
                solved.values / scale - group.high, group.low - solved.values / scale
            ) - _MARGIN * (solved.uncertainty / scale)
            limit = np.maximum(np.abs(group.low), np.abs(group.high))
            cost = np.where(over > (_FAR - 1.0) * limit, 3.0, np.where(over > 0.0, 1.0, 0.0))
            beyond[group.members, :size] = np.where(solved.told, cost, 0.0)
        score = 0.5 * gain - 0.5 * number * np.log(len(self.gap)) + self._prior[:, None]
        score[~np.isfinite(score)] = -np.inf
        chance = np.ones_like(gain)
        real = np.isfinite(gain)
        chance[real] = tail(gain[real], number[real], self.luck.freedom)
        which = np.argmax(score, axis=1)
        rows = np.arange(count)
        top = np.max(score, axis=1, initial=-np.inf)
        safe = np.where(np.isfinite(top), top, 0.0)
        evidence = safe + np.log(np.maximum(np.sum(np.exp(score - safe[:, None]), axis=1), 1e-300))
        cost = _IMPLAUSIBLE * np.sum(beyond, axis=1)
        evidence -= cost
        evidence[~np.isfinite(top)] = -np.inf
        evidence[list(given)] = -np.inf
        return Ranking(
            gain[rows, which],
            number[rows, which],
            np.min(chance, axis=1, initial=1.0),
            evidence,
            cost,
        )


@dataclass(frozen=True)
class _Solved:
    """A group's candidates, each fitted alone by its first 1, 2 … m sizes; arrays (k, m).

    Attributes:
        gain: of the first 1, 2 … sizes; NaN where a size adds nothing new.
        number: of columns that count among these; NaN where a size adds nothing new.
        values: by all sizes that add something, of columns of unit length; 0 for others.
        uncertainty: of the values.
        told: which sizes add something new.
    """

    gain: Vector
    number: Vector
    values: Vector
    uncertainty: Vector
    told: NDArray[np.bool_]


def _solved(products: Vector, parts: Vector) -> _Solved:
    """Solve many small systems at once, size after size (Cholesky's decomposition).

    Args:
        products: of the columns with each other, shape (k, m, m).
        parts: of the columns with the gap, shape (k, m).
    """
    count, size = parts.shape
    lower = np.zeros_like(products)
    along = np.zeros_like(parts)
    told = np.zeros(parts.shape, dtype=np.bool_)
    for j in range(size):
        left = products[:, j, j] - np.sum(lower[:, j, :j] ** 2, axis=1)
        own = products[:, j, j]
        told[:, j] = (own > _NEW**2) & (left > _NEW**2 * own)
        root = np.sqrt(np.where(told[:, j], left, 1.0))
        lower[:, j, j] = root
        along[:, j] = (parts[:, j] - np.sum(lower[:, j, :j] * along[:, :j], axis=1)) / root
        along[~told[:, j], j] = 0.0
        for i in range(j + 1, size):
            rest = products[:, i, j] - np.sum(lower[:, i, :j] * lower[:, j, :j], axis=1)
            lower[:, i, j] = np.where(told[:, j], rest / root, 0.0)
        lower[~told[:, j], j, :j] = 0.0
    inverse = np.linalg.inv(lower) if count else lower
    values = np.einsum("kji,kj->ki", inverse, along)
    # A size that is not told has a one in the decomposition, which is nobody's variance.
    squares = np.where(told[:, :, None], inverse, 0.0) ** 2
    gain = np.where(told, np.cumsum(along**2, axis=1), np.nan)
    number = np.where(told, np.cumsum(told, axis=1), np.nan)
    return _Solved(gain, number, values, np.sqrt(np.sum(squares, axis=1)), told)


def orthonormal(parts: list[Vector]) -> Vector:
    """Return orthonormal columns that span what some columns of unit length do, shape (rows, k)."""
    left, values, _ = np.linalg.svd(np.column_stack(parts), full_matrices=False)
    span: Vector = left[:, values > 1e-4]
    return span
