"""The least-squares problem of a measurement: its matrix, what it leaves open, its solution.

Readings of one setup at one place are repeats and enter as their weighted mean; the spread among
them goes into χ². The matrix is that of the nominal setup; it is factored once, and since
misalignments are small the iteration with the exact model converges in a few steps.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.forward import perpendiculars
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.solvers.observations import Integers, Observations
from stepdiag_ros.metrology.solvers.positive import inverse_positive

_FIXED_AT_END = ((0, 1), (0, 2), (2, 1))
"""Moving axis and error direction of E_YX, E_ZX, E_YZ, which end at zero (IH eq. 17)."""
_PAIRS = np.triu_indices(12)
"""Pairs of the twelve entries of a row, each once."""
_INFLATION_LIMIT = 1e8
"""Variance inflation (diagonal of C times that of H) beyond which a rank analysis is made."""
_RANK_LIMIT = 1e-11
"""Eigenvalues of the scaled normal matrix below this share of the largest count as zero."""
_CONVERGED = 1e-13
_LARGEST_TILT = 0.2
_ITERATIONS = 60


@dataclass(frozen=True)
class Fit:
    """A solution.

    Attributes:
        curves: m, shape (..., 9(N+1)) in the order of ``geometry.TRANSLATIONS``.
        tilts: rad, shape (..., diagonal setups, 2).
        fitted: excess of the readings' group means by the model, m, shape (..., groups).
        squares: weighted sum of squares of all residuals, NaN for replicates.
    """

    curves: Vector
    tilts: Vector
    fitted: Vector
    squares: float


class Design:
    """The matrix of a measurement and its pseudo-inverse.

    Args:
        observations: the readings.

    Attributes:
        tilt_setups: indices of the setups that have two angles.
        unseen: orthonormal directions of the unknowns that the readings do not tell, (p, r).
        degrees_of_freedom: readings minus determined unknowns.
        tilt_known: 1 where a tilt is determined, else NaN, shape (diagonal setups, 2).
    """

    def __init__(self, observations: Observations) -> None:
        self.observations = observations
        volume = observations.volume
        self._size = volume.blocks + 1
        self.tilt_setups = [i for i, setup in enumerate(observations.setups) if setup.diagonal]
        self._group, self._first = observations.groups()
        known = observations.noise_known
        single = 1.0 / observations.uncertainty**2 if known else np.ones(len(self._group))
        self.weight: Vector = np.bincount(self._group, single).astype(np.float64)
        self.mean: Vector = np.bincount(self._group, single * observations.excess) / self.weight
        self._repeat_squares = float(
            np.sum(single * (observations.excess - self.mean[self._group]) ** 2)
        )
        self._setup = observations.setup[self._first]
        self._way = observations.position[self._first]
        self._directions = np.array([setup.direction for setup in observations.setups])
        self._pairs = np.array(
            [perpendiculars(self._directions[setup]) for setup in self.tilt_setups]
        ).reshape(-1, 2, 3)
        # Tilts are counted in metres at this distance, so that all unknowns are of one size.
        self._arm = float(np.linalg.norm(np.asarray(volume.step)) * volume.blocks)
        self._number_unknowns()
        self._columns, self._values = self._entries()
        self._factor()
        self.degrees_of_freedom = len(self._group) - (self._count - self.unseen.shape[1])

    def _number_unknowns(self) -> None:
        free = np.ones((3, 3, self._size), dtype=bool)
        free[:, :, 0] = False
        for axis, error in _FIXED_AT_END:
            free[axis, error, -1] = False
        curves = int(np.count_nonzero(free))
        setups, tilted = len(self.observations.setups), len(self.tilt_setups)
        self._count = curves + 2 * tilted + setups
        # Curve values that are zero by definition share a column beyond the last, which is cut off.
        self._curve_column = np.full((3, 3, self._size), self._count)
        self._curve_column[free] = np.arange(curves)
        self._tilt_column = curves + np.arange(2 * tilted).reshape(tilted, 2)
        self._zero_column = curves + 2 * tilted + np.arange(setups)

    def _entries(self) -> tuple[Integers, Vector]:
        """Return columns and values of the twelve entries of each row of the nominal matrix."""
        groups = len(self._first)
        columns = np.full((groups, 12), self._count)
        values = np.zeros((groups, 12))
        node = self.observations.node[self._first]
        direction = self._directions[self._setup]
        for axis in range(3):
            moves = node[:, axis] >= 0
            for error in range(3):
                place = 3 * axis + error
                columns[moves, place] = self._curve_column[axis, error, node[moves, axis]]
                values[moves, place] = direction[moves, error]
        for row, setup in enumerate(self.tilt_setups):
            here = self._setup == setup
            columns[here, 9:11] = self._tilt_column[row]
            values[here, 9:11] = self._way[here] @ self._pairs[row].T / self._arm
        columns[:, 11] = self._zero_column[self._setup]
        values[:, 11] = 1.0
        self._curve_places = columns[:, :9]
        return columns, values

    @property
    def matrix(self) -> Vector:
        """Return the nominal matrix, shape (groups, p): readings' excess by unknowns, m."""
        matrix = np.zeros((len(self._columns), self._count + 1))
        # Columns of a row differ except for the cut-off one.
        matrix[np.arange(len(self._columns))[:, None], self._columns] = self._values
        nominal: Vector = matrix[:, : self._count]
        return nominal

    def _factor(self) -> None:
        """Invert the normal matrix, by Cholesky if all is determined, else by rank analysis."""
        normal = self._normal(self.weight)
        self.unseen: Vector = np.zeros((self._count, 0))
        inverse = inverse_positive(normal)
        if inverse is None or not np.all(np.diag(inverse) * np.diag(normal) <= _INFLATION_LIMIT):
            inverse = self._pseudo_inverse(normal, self._normal(np.ones(len(self.weight))))
        self.covariance: Vector = inverse

    def _normal(self, weight: Vector) -> Vector:
        width = self._count + 1
        columns, values = self._columns, self._values
        weighted = values * weight[:, None]
        one, other = _PAIRS
        products = weighted[:, one] * values[:, other]
        places = columns[:, one] * width + columns[:, other]
        half = np.bincount(places.reshape(-1), products.reshape(-1), minlength=width * width)
        half = half.reshape(width, width)[: self._count, : self._count]
        normal: Vector = half + half.T
        normal.flat[:: self._count + 1] -= np.diag(half)
        return normal

    def _pseudo_inverse(self, normal: Vector, unweighted: Vector) -> Vector:
        """Invert on the determined directions; which these are does not depend on weights."""
        values, vectors = np.linalg.eigh(unweighted)
        none = values <= _RANK_LIMIT * values[-1]
        self.unseen = vectors[:, none]
        seen = vectors[:, ~none]
        reduced: Vector = seen @ np.linalg.solve(seen.T @ normal @ seen, seen.T)
        return reduced

    def fit(self, means: Vector | None = None) -> Fit:
        """Solve for the curves, tilts and zeros by the exact model.

        Args:
            means: excess of the readings' group means to solve for, m, shape (groups,) or for many
                replicates (replicates, groups); those of the observations if None.

        Raises:
            ValueError: the iteration does not converge: a tilt far beyond any alignment.
        """
        given = self.mean if means is None else means
        unknowns = np.zeros((*given.shape[:-1], self._count))
        modelled = np.zeros(given.shape)
        many = given.ndim > 1
        solver = (
            (self.matrix * self.weight[:, None]) @ self.covariance if many else np.empty((0, 0))
        )
        for _ in range(_ITERATIONS):
            left = given - modelled
            pulled = left @ solver if many else self.covariance @ self._pull(left * self.weight)
            change: Vector = np.asarray(pulled)
            unknowns = unknowns + change
            modelled = self._model(unknowns)
            size = float(np.max(np.abs(change)))
            if size <= _CONVERGED:
                break
        else:
            if not size <= 1e-11:
                raise ValueError(
                    "the least-squares iteration does not converge: a setup must be misaligned by "
                    "far more than any laser still reads; check the lines' names and positions"
                )
        squares = float("nan")
        if not many:
            squares = float(np.sum(self.weight * (given - modelled) ** 2)) + self._repeat_squares
        return Fit(
            self._padded(unknowns)[..., self._curve_column.reshape(-1)],
            unknowns[..., self._tilt_column] / self._arm,
            modelled,
            squares,
        )

    def _pull(self, weighted: Vector) -> Vector:
        """Return the transposed matrix times weighted residuals, shape (p,)."""
        pulled = (self._values * weighted[:, None]).reshape(-1)
        sums = np.bincount(self._columns.reshape(-1), pulled, minlength=self._count + 1)
        return sums[: self._count].astype(np.float64)

    def _padded(self, unknowns: Vector) -> Vector:
        return np.concatenate([unknowns, np.zeros((*unknowns.shape[:-1], 1))], axis=-1)

    def _model(self, unknowns: Vector) -> Vector:
        """Return the exact model's excess of the readings over a perfect machine and setup, m."""
        tilts = unknowns[..., self._tilt_column] / self._arm
        tilts = np.clip(tilts, -_LARGEST_TILT, _LARGEST_TILT)
        change = np.zeros((*unknowns.shape[:-1], *self._directions.shape))
        if self.tilt_setups:
            square = np.sum(tilts**2, axis=-1, keepdims=True)
            # sqrt(1-x)-1 without cancellation
            shortening = -square / (1.0 + np.sqrt(1.0 - square))
            nominal = self._directions[self.tilt_setups]
            change[..., self.tilt_setups, :] = shortening * nominal + np.sum(
                tilts[..., :, :, None] * self._pairs, axis=-2
            )
        turned = change[..., self._setup, :]
        errors = self._padded(unknowns)[..., self._curve_places]
        errors = np.sum(errors.reshape(*errors.shape[:-1], 3, 3), axis=-2)
        excess: Vector = np.sum(
            turned * (self._way + errors) + self._directions[self._setup] * errors, axis=-1
        )
        return excess + unknowns[..., self._zero_column[self._setup]]

    @property
    def tilt_known(self) -> Vector:
        """Return 1 where a tilt is determined, else NaN, shape (diagonal setups, 2)."""
        hidden = np.linalg.norm(self.unseen[self._tilt_column], axis=-1)
        return np.where(hidden <= 1e-6, 1.0, np.nan)

    def tilt_uncertainty(self) -> Vector:
        """Return the standard uncertainties of the tilts for unit scale, rad; NaN where unknown."""
        variance = np.diag(self.covariance)[self._tilt_column]
        uncertainty: Vector = self.tilt_known * np.sqrt(variance) / self._arm
        return uncertainty

    def curve_covariance(self) -> Vector:
        """Return the covariance of the stacked curves for unit scale, m²."""
        place = self._curve_column.reshape(-1)
        padded = np.zeros((self._count + 1, self._count + 1))
        padded[:-1, :-1] = self.covariance
        covariance: Vector = padded.take(place, axis=0).take(place, axis=1)
        return covariance

    def curves_unseen(self) -> Vector:
        """Return the curves' part of the undetermined directions, shape (9(N+1), r)."""
        padded = np.concatenate([self.unseen, np.zeros((1, self.unseen.shape[1]))])
        part: Vector = padded[self._curve_column.reshape(-1)]
        return part
