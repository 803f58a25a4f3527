"""Whether what is left can be noise: the total, and a few shapes in which real things come.

The total of many readings is a blunt test: a gap that repeats its shape in every pass may be clear
and yet small beside the sum of all noise. So the gap is also tested against shapes that need no
name: each pass shifted and inclined, each stop of a setup off in all its passes, each axis that has
just moved off in its sense, something smooth over the volume, everything changing slowly with time.

Every test is an F test. Where the noise was taken from differences of passes, these are a part of
the readings' own freedom: what they hold is taken out of the total, so that only the rest
is tested against them (lack of fit against pure error). The memory of the noise from stop to
stop is estimated too; a shape that is slow in time suffers more from its error than one that jumps,
which each shape's own degrees of freedom of the noise take into account.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.chance import tail
from stepdiag_ros.metrology.discrepancy.loose import pass_shapes
from stepdiag_ros.metrology.discrepancy.noise import Noise
from stepdiag_ros.metrology.discrepancy.places import RANK_LIMIT, Places
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.plan import FORWARD

ALL = "all readings"
_SLOW = 8
"""Cosines over the time of the run that count as slow."""
_SMOOTH = 3
"""Degree up to which products of positions count as smooth over the volume."""


@dataclass(frozen=True)
class LackOfFit:
    """The test of a fit against the noise.

    Attributes:
        chi_squared: of all readings.
        freedom: its degrees of freedom.
        p_value: chance of so bad a fit in any of the shapes tried.
        shape: in which the fit is worst, in words.
        by_shape: shape → chance by itself.
    """

    chi_squared: float
    freedom: int
    p_value: float
    shape: str
    by_shape: dict[str, float]


@dataclass(frozen=True)
class _Columns:
    """A shape as orthonormal columns beyond the baseline.

    Attributes:
        problem: whitened, the baseline projected out.
        span: shape (rows, k).
    """

    problem: Whitened
    span: Vector

    @property
    def rank(self) -> int:
        return int(self.span.shape[1])

    def mean_slowness(self) -> float:
        return float(np.mean(self.problem.slowness(self.span)))

    def squares(self, gap: Vector, found: Vector) -> tuple[float, int]:
        """Return the same as ``Places.squares``."""
        parts = self.span.T @ gap
        squares = float(parts @ parts)
        if not found.shape[1] or not self.rank:
            return squares, self.rank
        # The inverse of 1 - a·aᵀ, where what lies in the findings altogether is lost.
        left, values, _ = np.linalg.svd(self.span.T @ found, full_matrices=False)
        beyond = 1.0 - values**2
        lost = beyond < RANK_LIMIT
        within = (left.T @ parts) ** 2
        squares += float(np.sum(within[~lost] * values[~lost] ** 2 / beyond[~lost]))
        return squares, self.rank - int(np.count_nonzero(lost))


class LackOfFitTest:
    """The test for one run.

    Together, the shapes of a long run would be the largest thing that a diagnosis makes. So each is
    made, used for all gaps that are asked about, and dropped.

    Args:
        problem: whitened, the baseline projected out.
        stops: of the run.
        noise: that the problem was whitened with.
    """

    def __init__(self, problem: Whitened, stops: Stops, noise: Noise) -> None:
        self._problem = problem
        self._stops = stops
        self._noise = noise
        self._pure = noise.freedom if noise.shown else 0.0

    def _made(self) -> Iterator[tuple[str, _Columns | Places]]:
        for words, columns in _shapes(self._stops):
            yield words, self._spanned(columns)
        for words, place, sign in _places(self._stops):
            yield words, Places(self._problem, place, sign)

    @property
    def noise_freedom(self) -> dict[str, float]:
        """Return the degrees of freedom of the noise as each shape suffers from it."""
        return {words: self._noise_freedom(shape) for words, shape in self._made()}

    def __call__(self, *gaps: tuple[Vector, Vector]) -> list[LackOfFit]:
        """Test gaps.

        Args:
            gaps: of each the gap, whitened, baseline and findings projected out, shape (rows,), and
                orthonormal columns of the findings beyond the baseline, shape (rows, k).
        """
        freedoms = [self._problem.freedom - span.shape[1] for _, span in gaps]
        totals = [float(gap @ gap) for gap, _ in gaps]
        chances = [{ALL: self._of_all(*one)} for one in zip(totals, freedoms, strict=True)]
        for words, shape in self._made():
            noise_freedom = self._noise_freedom(shape)
            for (gap, span), freedom, found in zip(gaps, freedoms, chances, strict=True):
                squares, count = shape.squares(gap, span)
                # As many shapes as there is freedom left are not a test of their own.
                if 0 < count < 0.9 * freedom:
                    found[words] = _chance(squares, count, noise_freedom)
        return [_judged(*one) for one in zip(totals, freedoms, chances, strict=True)]

    def _of_all(self, total: float, freedom: int) -> float:
        """Return the probability of what the total has beyond the differences behind the noise."""
        pure = self._pure if self._pure < freedom else 0.0
        # In units of the noise that they show, these have as much as they have degrees of freedom.
        squares = max(total - self._noise.shown * pure, 0.0)
        return _chance(squares, freedom - pure, self._noise.freedom)

    def _noise_freedom(self, shape: _Columns | Places) -> float:
        """Return the degrees of freedom of the noise as a shape suffers from it."""
        if not shape.rank:
            return self._noise.freedom
        # A memory larger by δ makes the mean square of the shape larger by slowness·δ; relative
        # variances add: 2/ν of the noise's square, 1/ν of its memory.
        return self._noise.freedom / (1.0 + 0.5 * shape.mean_slowness() ** 2)

    def _spanned(self, columns: NDArray[np.generic]) -> _Columns:
        left = self._problem.left_of(columns)
        lengths = np.linalg.norm(left, axis=0)
        if not np.all(lengths > 0.0):
            left = left[:, lengths > 0.0]
        left /= lengths[lengths > 0.0]
        values, vectors = np.linalg.eigh(left.T @ left)
        real = values > RANK_LIMIT * max(float(values.max(initial=0.0)), 1e-300)
        return _Columns(self._problem, left @ (vectors[:, real] / np.sqrt(values[real])))


def _judged(total: float, freedom: int, chances: dict[str, float]) -> LackOfFit:
    worst = min(chances, key=lambda words: chances[words])
    combined = float(-np.expm1(len(chances) * np.log1p(-min(chances[worst], 1.0 - 1e-16))))
    return LackOfFit(total, freedom, combined, worst, chances)


def _chance(squares: float, freedom: float, noise_freedom: float) -> float:
    if freedom < 1.0:
        return 1.0
    return float(tail(np.array(squares), freedom, noise_freedom))


def _shapes(stops: Stops) -> Iterator[tuple[str, NDArray[np.generic]]]:
    zeros, slopes = pass_shapes(stops)
    yield "whole passes shifted or inclined", np.column_stack([zeros, slopes])
    yield "whole passes bent", np.column_stack([slopes**2, slopes**3])
    setups = stops.setup[:, None] == np.arange(len(stops.setups))
    moved = np.column_stack([setups * stops.moved[:, axis][:, None] for axis in range(3)])
    yield "the axis that has just moved", moved
    scaled = stops.position / np.where(stops.travel > 0.0, stops.travel, 1.0)
    yield "smooth over the volume", _smooth(scaled, stops.direction)
    yield (
        "the sense in which an axis came, with its place",
        np.column_stack(
            [
                (stops.direction * stops.last_sense)[:, axis][:, None]
                * np.column_stack([np.ones(len(scaled)), scaled])
                for axis in range(len(AXES))
            ]
        ),
    )
    slow = _slow(stops)
    yield (
        "slow changes with time",
        np.column_stack([slow, *(slow * scaled[:, axis][:, None] for axis in range(len(AXES)))]),
    )


def _places(stops: Stops) -> Iterator[tuple[str, NDArray[np.int64], Vector]]:
    length = np.bincount(stops.pass_index, minlength=len(stops.lines))
    forward = np.array([line.direction == FORWARD for line in stops.lines])[stops.pass_index]
    way = np.where(forward, stops.number, length[stops.pass_index] - 1 - stops.number)
    place = stops.setup * (int(way.max()) + 1) + way
    # Where no place was measured twice this shape is all readings once more.
    if len(np.unique(place)) < len(place):
        yield "the same places in all passes", place, np.ones(len(place))
    if 0 < np.count_nonzero(forward) < len(forward):
        yield "forward against backward, place by place", place, np.where(forward, 1.0, -1.0)


def _slow(stops: Stops) -> Vector:
    """Return cosines over the time of each run, whose clocks have nothing to do with each other."""
    parts = []
    for run in np.unique(stops.run):
        here = stops.run == run
        since = stops.time - stops.time[here].min()
        span = float(since[here].max())
        u = since / span if span > 0.0 else np.zeros(len(since))
        parts += [np.cos(np.pi * order * u) * here for order in range(1, _SLOW + 1)]
    return np.column_stack(parts)


def _smooth(share: Vector, direction: Vector) -> Vector:
    """Return displacements along X, Y, Z by products of the positions of several axes."""
    u = 2.0 * share - 1.0
    powers = [
        degrees
        for degrees in product(range(_SMOOTH + 1), repeat=len(AXES))
        if sum(degrees) <= _SMOOTH and np.count_nonzero(degrees) > 1
    ]
    return np.column_stack(
        [
            direction[:, axis] * np.prod(u ** np.array(degrees), axis=1)
            for degrees in powers
            for axis in range(len(AXES))
        ]
    )
