"""Inverse of the normal matrix in a time that grows as the number of its entries.

On every diagonal the axes stand at nodes k or N - k, give or take one. So if the nodes are folded
in the middle, k and N - k to one level, a reading ties a level to its neighbours only: the curves'
part of the normal matrix is block tridiagonal, bordered by the angles and zeros of the setups. A
general inverse costs n³ operations for n unknowns; this one n² times the 18 values of a level.
"""

from itertools import pairwise

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.solvers.observations import Integers
from stepdiag_ros.metrology.solvers.positive import inverse_positive


def fold(curve_column: Integers, rows: Integers, count: int) -> list[Integers] | None:
    """Return the unknowns of each level and, last, those of the border.

    Args:
        curve_column: unknown of each curve at each node, ``count`` where it is fixed, shape
            (curves, nodes).
        rows: unknowns in the curves' places of each reading, shape (readings, places).
        count: number of unknowns.

    Returns:
        None if some reading ties levels that are not neighbours.
    """
    nodes = np.arange(curve_column.shape[1])
    level_of_node = np.minimum(nodes, nodes[::-1])
    level = np.full(count + 1, -1)
    for columns in curve_column:
        level[columns] = level_of_node
    level[count] = -1
    tied = level[rows]
    high = np.max(tied, axis=1, initial=0)
    low = np.min(np.where(tied < 0, high[:, None], tied), axis=1, initial=count)
    if np.any(high - low > 1):
        return None
    order = np.argsort(level[:count], kind="stable")
    starts = np.searchsorted(level[order], np.arange(np.max(level) + 2))
    levels = [order[a:b] for a, b in pairwise(starts)]
    return [*(one for one in levels if len(one)), order[: starts[0]]]


def places_in(levels: list[Integers]) -> Integers:
    """Return the place of each unknown where these stand in the order of their levels."""
    order = np.concatenate(levels)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return place


def inverse_folded(normal: Vector, levels: list[Integers], place: Integers) -> Vector | None:
    """Return the inverse of a bordered block tridiagonal matrix; None if it is not positive.

    Args:
        normal: symmetric, shape (n, n), unknowns in the order of their levels.
        levels: as ``fold`` returns them.
        place: as ``places_in`` returns it.

    Returns:
        shape (n, n), unknowns in their own order.
    """
    ends = np.cumsum([len(level) for level in levels])
    inner = int(ends[-2])
    spans = [
        slice(int(end) - len(level), int(end)) for level, end in zip(levels, ends, strict=True)
    ]
    inverse = np.empty_like(normal)
    core = inverse[:inner, :inner]
    if not _invert_tridiagonal(normal, spans[:-1], core):
        return None
    border = normal[:inner, inner:]
    pulled = core @ border
    last = inverse_positive(normal[inner:, inner:] - border.T @ pulled)
    if last is None:
        return None
    across = -pulled @ last
    core -= across @ pulled.T
    inverse[:inner, inner:] = across
    inverse[inner:, :inner] = across.T
    inverse[inner:, inner:] = last
    whole: Vector = inverse.take(place, axis=0).take(place, axis=1)
    return whole


def _invert_tridiagonal(matrix: Vector, spans: list[slice], inverse: Vector) -> bool:
    """Invert the block tridiagonal part into ``inverse``; return whether it is positive.

    Forth: D_j = A_jj - A_jh D_h⁻¹ A_hj, with h before j. Back, with i after j and
    W_j = D_j⁻¹ A_ji: row j of the inverse is -W_j times row i, and its own block D_j⁻¹ + W_j (row
    i, block i) W_jᵀ.
    """
    pivots: list[Vector] = []
    ties: list[Vector] = []
    for number, here in enumerate(spans):
        pivot = matrix[here, here]
        if number:
            pivot = pivot - matrix[spans[number - 1], here].T @ ties[-1]
        inverted = inverse_positive(pivot)
        if inverted is None:
            return False
        pivots.append(inverted)
        if number + 1 < len(spans):
            ties.append(inverted @ matrix[here, spans[number + 1]])
    inverse[spans[-1], spans[-1]] = pivots[-1]
    for number in range(len(spans) - 2, -1, -1):
        here, after = spans[number], spans[number + 1]
        row = -ties[number] @ inverse[after, after.start :]
        inverse[here, after.start :] = row
        inverse[after.start :, here] = row.T
        inverse[here, here] = pivots[number] - row[:, : after.stop - after.start] @ ties[number].T
    return True
