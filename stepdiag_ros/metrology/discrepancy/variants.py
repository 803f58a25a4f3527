"""Would the named effects, or fewer of them, explain more if they were not the same everywhere?

Effects of the catalogue put together can look like a shape of none of them: a sag with the
product of three positions like two sags with two each, a reversal error that grows along another
axis like a reversal error and something else. Each named effect is therefore tried in variants that
the catalogue does not have, its size growing with a position or with time: in its own place, beside
it, in the place of another finding, or of both. A variant that is clearly likelier than what was
named shows that the names are not those of the cause.

Evidence is counted as for the names themselves (``selection``).
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.candidates import Signatures
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, Vector

ODDS = 20.0
"""Odds of a variant against the named effects beyond which these are not believed."""
_KNOWN = 0.98
"""Share of a variant that a candidate must show for the catalogue to have it already."""
_RANK_LIMIT = 1e-8


def better_variant(
    found: Signatures,
    gap: Vector,
    sizes: Mapping[int, Sequence[float]],
    problem: Whitened,
    stops: Stops,
) -> str:
    """Say which variant of a named effect explains a gap better than the names; empty if none.

    Args:
        found: the candidates.
        gap: whitened and projected, shape (rows,).
        sizes: chosen candidate → its sizes, SI.
        problem: whitened, the baseline projected out.
        stops: of the run.
    """
    chosen = list(sizes)
    if not chosen:
        return ""
    labels, owners, variants = _variants(found, sizes, problem, stops)
    if not labels:
        return ""
    blocks = {index: _real(found.units.dense(found.of(index))) for index in chosen}
    fit = _Fits([*(blocks[index] for index in chosen), variants], gap)
    start = np.cumsum([0, *(blocks[index].shape[1] for index in chosen)])
    columns = {index: list(range(start[n], start[n + 1])) for n, index in enumerate(chosen)}
    # Schwarz's penalty for each size and the share of each effect among its kind.
    size_cost = 0.5 * np.log(len(gap))
    cost = {
        index: size_cost * len(columns[index]) - float(np.log(found.share[index]))
        for index in chosen
    }
    named = fit.evidence([c for index in chosen for c in columns[index]]) - sum(cost.values())
    best, words = named + np.log(ODDS), ""
    for number, (label, owner) in enumerate(zip(labels, owners, strict=True)):
        for out in _replaced(chosen, owner):
            kept = [index for index in chosen if index not in out]
            own = size_cost + np.log(len(labels)) - float(np.log(found.share[owner]))
            # Beside the effect itself, a variant is one more size of it.
            if owner in kept:
                own += float(np.log(found.share[owner]))
            evidence = (
                fit.evidence([*(c for i in kept for c in columns[i]), int(start[-1]) + number])
                - sum(cost[index] for index in kept)
                - own
            )
            if evidence > best:
                best = evidence
                beside = [found.candidates[index].label for index in kept]
                words = label + (f" beside {' and '.join(beside)}" if beside else "")
    if not words:
        return ""
    odds = min(float(np.exp(min(best - named, 50.0))), 1e9)
    return f"{words}, which the catalogue does not have, explains it better (odds {odds:.0e})"


def _replaced(chosen: list[int], owner: int) -> Iterator[tuple[int, ...]]:
    """Yield which findings a variant of one of them may stand for: up to two."""
    for count in range(3):
        for out in combinations(chosen, count):
            if count < 2 or owner in out:
                yield out


def _variants(
    found: Signatures, sizes: Mapping[int, Sequence[float]], problem: Whitened, stops: Stops
) -> tuple[list[str], list[int], Vector]:
    """Return labels, whose variant each is, and unit columns beyond the baseline."""
    ways = [
        (f"growing along {letter}", stops.share[:, axis])
        for axis, letter in enumerate(AXES)
        if stops.travel[axis] > 0.0
    ]
    if stops.duration > 0.0:
        ways.append(("growing with time", (stops.time - stops.time.min()) / stops.duration))
    labels, owners, columns = [], [], []
    for index, values in sizes.items():
        candidate = found.candidates[index]
        whole = candidate.effect.columns(candidate.setting, stops) @ np.asarray(values)
        for words, share in ways:
            labels.append(f"{candidate.label} {words}")
            owners.append(index)
            columns.append(whole * share)
    raw = problem.of(np.column_stack(columns)[problem.baseline.good])
    left = problem.projected(raw)
    lengths, before = np.linalg.norm(left, axis=0), np.linalg.norm(raw, axis=0)
    seen = np.flatnonzero(lengths > _RANK_LIMIT**0.5 * before)
    left = left[:, seen] / lengths[seen]
    squares = found.units.products(left) ** 2
    told = np.add.reduceat(squares, found.first, axis=0) if len(found.first) else squares
    new = np.flatnonzero(np.max(told, axis=0, initial=0.0) < _KNOWN)
    kept = seen[new]
    return [labels[n] for n in kept], [owners[n] for n in kept], left[:, new]


class _Fits:
    """Least squares by any choice of some columns, from their products alone."""

    def __init__(self, blocks: list[Vector], gap: Vector) -> None:
        columns = np.column_stack(blocks)
        self._products = columns.T @ columns
        self._parts = columns.T @ gap

    def evidence(self, chosen: list[int]) -> float:
        """Return half of what χ² loses by the chosen columns together."""
        if not chosen:
            return 0.0
        values, vectors = np.linalg.eigh(self._products[np.ix_(chosen, chosen)])
        real = values > _RANK_LIMIT
        parts = vectors[:, real].T @ self._parts[chosen]
        return 0.5 * float(np.sum(parts**2 / values[real]))


def _real(units: Vector) -> Vector:
    real: Vector = units[:, np.any(units != 0.0, axis=0)]
    return real
