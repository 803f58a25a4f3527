"""Whether what is left can be noise: the total, and a few shapes in which real things come.

The total of many readings is a blunt test: a gap that repeats its shape in every pass may be clear
and yet small beside the sum of all noise. So the gap is also tested against shapes that need no
name: each pass shifted and inclined, each stop of a setup off in all its passes, each axis that has
just moved off in its sense, everything changing slowly with time.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.chance import tail
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.plan import FORWARD

ALL = "all readings"
_RANK_LIMIT = 1e-6
_SLOW_NOISE = 3.0
"""The variance of slow noise, (1+ρ)/(1-ρ) times that of a reading, is less well known by that: the
relative variance 2/ν of the estimate, and 4/ν more by that of ρ, 1/ν."""
_SLOW = 8
"""Cosines over the time of the run that count as slow."""


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


class LackOfFitTest:
    """The test for one run; the shapes are made once.

    Args:
        problem: whitened, the baseline projected out.
        stops: of the run.
        noise_freedom: degrees of freedom of the noise.
    """

    def __init__(self, problem: Whitened, stops: Stops, noise_freedom: float) -> None:
        self._problem = problem
        self._noise_freedom = noise_freedom
        good = problem.baseline.good
        self._shapes = {
            words: problem.projected(problem.of(columns[good])) for words, columns in _shapes(stops)
        }

    def __call__(self, gap: Vector, span: Vector) -> LackOfFit:
        """Test a gap.

        Args:
            gap: whitened, baseline and findings projected out, shape (rows,).
            span: orthonormal columns of the findings beyond the baseline, shape (rows, k).
        """
        freedom = self._problem.freedom - span.shape[1]
        total = float(gap @ gap)
        chances = {ALL: self._chance(total, freedom, self._noise_freedom)}
        for words, columns in self._shapes.items():
            left = columns - span @ (span.T @ columns)
            values, vectors = np.linalg.eigh(left.T @ left)
            real = values > _RANK_LIMIT * max(float(values[-1]), 1e-300)
            # As many shapes as there is freedom left are no test of their own.
            count = int(np.count_nonzero(real))
            if not 0 < count < 0.9 * freedom:
                continue
            parts = vectors[:, real].T @ (left.T @ gap)
            squares = float(np.sum(parts**2 / values[real]))
            chances[words] = self._chance(squares, count, self._noise_freedom / _SLOW_NOISE)
        worst = min(chances, key=lambda words: chances[words])
        combined = float(-np.expm1(len(chances) * np.log1p(-min(chances[worst], 1.0 - 1e-16))))
        return LackOfFit(total, freedom, combined, worst, chances)

    def _chance(self, squares: float, freedom: int, noise_freedom: float) -> float:
        if freedom < 1:
            return 1.0
        return float(tail(np.array(squares), float(freedom), noise_freedom))


def _shapes(stops: Stops) -> Iterator[tuple[str, Vector]]:
    passes = stops.pass_index[:, None] == np.arange(len(stops.lines))
    length = np.array([np.count_nonzero(stops.pass_index == i) for i in range(len(stops.lines))])
    along = 2.0 * stops.number / np.maximum(length[stops.pass_index] - 1, 1) - 1.0
    yield (
        "whole passes shifted or inclined",
        np.column_stack([passes, passes * along[:, None]]).astype(np.float64),
    )
    yield (
        "whole passes bent",
        np.column_stack([passes * along[:, None] ** 2, passes * along[:, None] ** 3]),
    )
    forward = np.array([line.direction == FORWARD for line in stops.lines])[stops.pass_index]
    way = np.where(forward, stops.number, length[stops.pass_index] - 1 - stops.number)
    key = stops.setup * (int(way.max()) + 1) + way
    _, place = np.unique(key, return_inverse=True)
    place = place.reshape(-1)
    yield "the same places in all passes", (place[:, None] == np.arange(place.max() + 1)) * 1.0
    turned = (place[:, None] == np.arange(place.max() + 1)) * np.where(forward, 1.0, -1.0)[:, None]
    if 0 < np.count_nonzero(forward) < len(forward):
        yield "forward against backward, place by place", turned
    setups = stops.setup[:, None] == np.arange(len(stops.setups))
    moved = np.column_stack([setups * stops.moved[:, axis][:, None] for axis in range(3)])
    yield "the axis that has just moved", moved
    span = float(stops.time.max() - stops.time.min())
    u = (stops.time - stops.time.min()) / span if span > 0.0 else np.zeros(len(stops.time))
    slow = np.column_stack([np.cos(np.pi * order * u) for order in range(1, _SLOW + 1)])
    scaled = stops.position / np.where(stops.travel > 0.0, stops.travel, 1.0)
    yield (
        "slow changes with time",
        np.column_stack([slow, *(slow * scaled[:, axis][:, None] for axis in range(3))]),
    )
