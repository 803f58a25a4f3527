"""Sizes of the chosen effects, fitted together, and how uncertain they are, singly and jointly."""

from collections.abc import Mapping, Sequence

import numpy as np

from stepdiag_ros.metrology.discrepancy.ranking import Ranker, orthonormal
from stepdiag_ros.metrology.geometry import Vector

_NEAR = 15.0
"""Evidence behind the chosen setting beyond which another setting of it is out of the question."""


class Sizes:
    """The sizes of chosen candidates, all fitted together beside the baseline.

    A size that the run does not determine is zero, its covariances NaN.

    Args:
        ranker: of the run.
        chosen: candidates, in an order that all arrays follow.

    Attributes:
        values: candidate → its sizes, SI, shape (sizes,).
        covariance: of all sizes, one candidate's after another's, shape (all sizes, all sizes).
    """

    def __init__(self, ranker: Ranker, chosen: Sequence[int]) -> None:
        found = ranker.found
        self._place: dict[int, slice] = {}
        told: list[int] = []
        end = 0
        for index in chosen:
            own = found.of(index)
            count = own.stop - own.start
            real = found.units.real[own]
            told += [end + int(number) for number in np.flatnonzero(real)]
            self._place[index] = slice(end, end + count)
            end += count
        every = np.zeros(end)
        self.covariance: Vector = np.full((end, end), np.nan)
        if told:
            columns = np.column_stack([found.columns.dense(found.of(i)) for i in chosen])[:, told]
            unknown = ranker.unknown(chosen)
            if unknown:
                span = orthonormal(unknown)
                columns = columns - span @ (span.T @ columns)
            every[told], self.covariance[np.ix_(told, told)] = solved(columns, ranker.gap)
        self.values: Mapping[int, Vector] = {i: every[self._place[i]] for i in chosen}
        for index in chosen:
            rest = [other for other in chosen if other != index]
            here = self._place[index]
            self.covariance[here, here] += _of_setting(ranker, index, rest)

    def of(self, index: int) -> Vector:
        """Return the covariance of one candidate's sizes, shape (sizes, sizes)."""
        own: Vector = self.covariance[self._place[index], self._place[index]]
        return own

    def in_order(self, order: Sequence[int]) -> Vector:
        """Return the joint covariance with the candidates in another order."""
        places = [np.arange(self._place[i].start, self._place[i].stop) for i in order]
        rows = np.concatenate(places) if places else np.zeros(0, dtype=np.int64)
        ordered: Vector = self.covariance[np.ix_(rows, rows)]
        return ordered


def _of_setting(ranker: Ranker, index: int, rest: list[int]) -> Vector:
    """Return what covariance is added because the numbers of the setting may be others."""
    found, ranking = ranker.found, ranker.ranking(rest)
    own = found.candidates[index].effect
    near = [
        other
        for other, (name, candidate) in enumerate(zip(found.names, found.candidates, strict=True))
        if name == found.names[index]
        and candidate.effect is own
        and ranking.evidence[other] > ranking.evidence[index] - _NEAR
    ]
    added = np.zeros((len(own.sizes), len(own.sizes)))
    if len(near) < 2:
        return added
    span = ranker.span(rest)
    gap = ranker.gap - span @ (span.T @ ranker.gap)

    def alone(other: int) -> Vector:
        columns = found.columns.dense(found.of(other))
        return solved(columns - span @ (span.T @ columns), gap)[0]

    weights = np.exp(ranking.evidence[near] - np.max(ranking.evidence[near]))
    best = alone(index)
    for other, weight in zip(near, weights / np.sum(weights), strict=True):
        away = alone(other) - best
        added += weight * np.outer(away, away)
    return added


def solved(columns: Vector, gap: Vector) -> tuple[Vector, Vector]:
    """Return the sizes by which columns fit a gap with unit noise, and their covariance."""
    lengths = np.linalg.norm(columns, axis=0)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    inverse = np.linalg.pinv((columns / scale).T @ (columns / scale))
    values: Vector = inverse @ ((columns / scale).T @ gap) / scale
    covariance: Vector = inverse / np.outer(scale, scale)
    return values, covariance
