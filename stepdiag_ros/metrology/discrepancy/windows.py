"""A reading that jumps and jumps back in one alignment: the window of time that fits best."""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector

_LEAST = 2
"""Stops in a window: one alone is a wrong reading."""
_HIDDEN = 1e-6
"""Share of the square of a window beyond what is free below which only rounding is left of it."""


@dataclass(frozen=True)
class Window:
    """Two times between which the reading is shifted.

    Attributes:
        begin: between the last stop before it and the first one in it, s.
        end: between the last stop in it and the next, s.
        tried: number of windows of which this is the best.
    """

    begin: float
    end: float
    tried: int


def best_window(problem: Whitened, stops: Stops, gap: Vector, span: Vector) -> Window | None:
    """Return the window that takes most of a gap; None without any window to try.

    Args:
        problem: whitened, the baseline projected out.
        stops: of the run.
        gap: beyond what is free and ``span``, shape (rows,).
        span: orthonormal columns beside what is free, shape (rows, k).
    """
    best, most, tried = (float("nan"), float("nan")), 0.0, 0
    for setup in range(len(stops.setups)):
        rows = np.flatnonzero(stops.setup == setup)
        rows = rows[np.argsort(stops.time[rows], kind="stable")]
        # Columns that are 1 from a stop on: a window is the difference of two of them.
        begins = np.zeros((len(stops.time), len(rows)))
        begins[rows] = np.tri(len(rows))
        whitened = problem.of(begins[problem.baseline.good])
        seen = np.any(whitened != 0.0, axis=1)
        whitened = whitened[seen]
        free = np.vstack([problem.span[seen].T @ whitened, span[seen].T @ whitened])
        product = whitened.T @ whitened
        gram = product - free.T @ free
        share = whitened.T @ gap[seen]
        first, after = np.triu_indices(len(rows), _LEAST)
        inside = first > 0
        first, after = first[inside], after[inside]
        if not first.size:
            continue
        squares, before = (
            matrix[first, first] + matrix[after, after] - 2.0 * matrix[first, after]
            for matrix in (gram, product)
        )
        real = squares > _HIDDEN * before
        gains = np.where(real, (share[first] - share[after]) ** 2 / np.where(real, squares, 1.0), 0)
        tried += int(np.count_nonzero(real))
        place = int(np.argmax(gains))
        if gains[place] > most:
            most = float(gains[place])
            times = stops.time[rows]
            best = _between(times, int(first[place])), _between(times, int(after[place]))
    return Window(*best, tried) if most > 0.0 else None


def _between(times: Vector, place: int) -> float:
    return 0.5 * float(times[place - 1] + times[place])
