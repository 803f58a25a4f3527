"""Replicates of a whole estimate: the same lines measured again and again, with other readings.

An ``Estimator`` is a solver made ready for many sets of readings at once: the formulations of
Ibaraki & Hata as one matrix, least squares as its iteration with the exact model on all sets
together.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from stepdiag_ros.metrology.geometry import TRANSLATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.catalogue import methods
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.linear import LinearMap, noise_of
from stepdiag_ros.metrology.solvers.observations import Integers, Observations, observe
from stepdiag_ros.metrology.solvers.rotations import Rotations, turned

_CHUNK = 2_000_000


class Estimator(Protocol):
    """A method on the readings of one measurement.

    Curves are stacked: those of the method, then rotations that it does not give in its result, but
    takes out of it as far as the readings show them.

    Attributes:
        observations: the readings.
        names: of the method's curves, in the order in which they are stacked.
        beside: names of the rotations that are stacked behind them.
        models_cosine: the tilt of a diagonal is in the model to the second order.
    """

    observations: Observations
    names: tuple[str, ...]
    beside: tuple[str, ...]
    models_cosine: bool

    def solution(self) -> Vector:
        """Return the stacked curves of the readings themselves, shape (k,), as the solver does."""

    def curves(self, excess: Vector) -> Vector:
        """Return the stacked curves of many sets of readings, shape (count, k).

        Args:
            excess: of the readings over a perfect machine and setup, m, shape (count, n).

        Returns:
            m (rad for rotations); NaN where not determined.
        """

    def jacobian(self) -> Vector:
        """Return the derivatives of the curves by the readings, shape (k, n); NaN as above."""

    def by_direct(self) -> Vector:
        """Return what one standard uncertainty of each direct row does to the curves, (k, rows).

        No rows where nothing was measured directly, or the method does not use it.
        """


class LinearEstimator:
    """A formulation that is one matrix on the readings.

    Args:
        observations: the readings.
        linear: the matrix.
    """

    names = TRANSLATIONS
    beside: tuple[str, ...] = ()
    models_cosine = False

    def __init__(self, observations: Observations, linear: LinearMap) -> None:
        self.observations = observations
        self._matrix = linear.curves

    def solution(self) -> Vector:
        """Return the stacked curves of the readings themselves; see ``Estimator``."""
        found: Vector = self._matrix @ self.observations.excess
        return found

    def curves(self, excess: Vector) -> Vector:
        """Return the stacked curves of many sets of readings; see ``Estimator``."""
        found: Vector = excess @ self._matrix.T
        return found

    def jacobian(self) -> Vector:
        """Return the matrix; see ``Estimator``."""
        return self._matrix

    def by_direct(self) -> Vector:
        """Return no rows; see ``Estimator``."""
        return np.zeros((len(self._matrix), 0))


class LeastSquaresEstimator:
    """Least squares with the exact model of the setups.

    Args:
        measurement: the finished lines, and what was measured directly.
        observations: the readings of it.
        rotations: estimate the nine rotations as free curves too; if not, they are random functions
            beside the translations, as ``least_squares`` has them.
    """

    models_cosine = True

    def __init__(
        self, measurement: Measurement, observations: Observations, rotations: bool
    ) -> None:
        self._turned = None if rotations else turned(measurement, observations)
        self._design = (
            Design(observations, measurement.chain) if self._turned is None else self._turned.design
        )
        observations = self._design.observations
        self.observations = observations
        self.names = self._design.names
        self.beside = () if self._turned is None else self._turned.names
        group = self._design.group
        known = observations.noise_known
        single = 1.0 / observations.uncertainty**2 if known else np.ones(len(group))
        # Readings of one place and setup act through their weighted mean alone.
        self._share = single / self._design.weight[group]
        self._group, self._groups = group, len(self._design.weight)
        unseen = np.linalg.norm(self._design.curves_unseen(), axis=1)
        beside = len(self.beside) * (observations.volume.blocks + 1)
        self._unknown = np.concatenate([unseen > 1e-6, np.zeros(beside, dtype=np.bool_)])

    def solution(self) -> Vector:
        """Return the stacked curves of the readings themselves; see ``Estimator``."""
        found: Vector = np.where(self._unknown, np.nan, self._solved(self._design.mean, None))
        return found

    def _solved(self, means: Vector, given: Vector | None) -> Vector:
        fit = self._design.fit(given)
        if self._turned is None:
            return fit.curves
        factors = self._turned.factors(means - fit.fitted)
        curves = fit.curves + factors @ self._turned.change.T
        return np.concatenate([curves, factors @ self._turned.curves.T], axis=-1)

    def curves(self, excess: Vector) -> Vector:
        """Return the stacked curves of many sets of readings; see ``Estimator``."""
        gather = np.zeros((excess.shape[1], self._groups))
        gather[np.arange(excess.shape[1]), self._group] = self._share
        return self.curves_of_means(excess @ gather)

    def curves_of_means(self, means: Vector) -> Vector:
        """Return the stacked curves of many sets of group means, m, shape (count, groups)."""
        curves = np.empty((len(means), len(self._unknown)))
        rows = max(1, _CHUNK // (9 * self._groups))
        for start in range(0, len(means), rows):
            part = slice(start, start + rows)
            curves[part] = self._solved(means[part], means[part])
        curves[:, self._unknown] = np.nan
        return curves

    def jacobian(self) -> Vector:
        """Return the derivatives of ``curves`` at the readings themselves; see ``Estimator``."""
        model, change = self._design.derivatives(self._design.fit())
        by_group = self._design.of_curves(change)
        if self._turned is not None:
            factors = self._turned.factor_changes(model, change)
            by_group += self._turned.change @ factors
            by_group = np.concatenate([by_group, self._turned.curves @ factors])
        by_group[self._unknown] = np.nan
        by_reading: Vector = by_group[:, self._group] * self._share
        return by_reading

    def by_direct(self) -> Vector:
        """Return what each direct row does to the curves; see ``Estimator``."""
        design = self._design
        change = design.covariance @ (design.direct.matrix.T * np.sqrt(design.direct.weight))
        padded = np.concatenate([change, np.zeros((1, change.shape[1]))])
        found: Vector = np.zeros((len(self._unknown), change.shape[1]))
        places = design.curve_column.reshape(-1)
        found[: len(places)] = padded[places] / design.curve_scale[:, None]
        found[self._unknown] = np.nan
        return found

    def misfit(self) -> tuple[Vector, Integers, int]:
        """Return what nothing explains of the mean reading at each place: no curve, no rotation.

        Returns:
            mean readings less the fitted ones, m, shape (groups,); number of the group of each
            reading, shape (n,); degrees of freedom that are left, those of repeats not counted.
        """
        left: Vector = self._design.mean - self._design.fit().fitted
        repeated = self._design.repeat_freedom
        if self._turned is None:
            return left, self._group, self._design.degrees_of_freedom - repeated
        rest = self._turned.left_by_rotations(left)
        return rest, self._group, self._turned.rotations.degrees_of_freedom - repeated

    @property
    def rotations(self) -> Rotations | None:
        """Return what the readings show of rotations that are not in the model; None without."""
        return None if self._turned is None else self._turned.rotations

    def noisy(self, count: int, noise: float, rng: np.random.Generator) -> Vector:
        """Return curves of readings drawn around the fitted model.

        Args:
            count: number of replicates.
            noise: standard uncertainty of a reading of unit weight, m.
            rng: of the noise.
        """
        fitted = self._design.fit().fitted
        spread = noise / np.sqrt(self._design.weight)
        curves = np.empty((count, len(self._unknown)))
        rows = max(1, _CHUNK // (9 * self._groups))
        by_direct = self.by_direct()
        for start in range(0, count, rows):
            end = min(count, start + rows)
            drawn = fitted + spread * rng.standard_normal((end - start, self._groups))
            curves[start:end] = self.curves_of_means(drawn)
            if by_direct.size:
                curves[start:end] += (
                    rng.standard_normal((end - start, by_direct.shape[1])) @ by_direct.T
                )
        return curves


def linear(
    formulation: Callable[[Observations], LinearMap],
) -> Callable[[Measurement, Observations], LinearEstimator]:
    """Return what makes a formulation that is linear in the readings an estimator."""
    return lambda _, observations: LinearEstimator(observations, formulation(observations))


def replicable() -> tuple[str, ...]:
    """Return the methods that many sets of readings can be solved by at once."""
    return tuple(name for name, one in methods().items() if one.estimator is not None)


def estimator(measurement: Measurement, observations: Observations, method: str) -> Estimator:
    """Return a method made ready for many sets of readings.

    Args:
        measurement: the finished lines; ``rigid_body`` needs their chain.
        observations: the readings of it.
        method: one of ``replicable``.

    Raises:
        NotDeterminable: the lines are not enough for this method, or the chain is not known.
        ValueError: no such method.
    """
    chosen = methods().get(method)
    if chosen is None or chosen.estimator is None:
        raise Refusal(
            f"'{method}' is not a method for this; use one of {', '.join(replicable())}",
            fault="unknown",
            aspect="replicated method",
        )
    return chosen.estimator(measurement, observations)


def replicate(
    measurement: Measurement, count: int, seed: int = 0, method: str = "least_squares"
) -> Vector:
    """Return the curves of many replicates of a measurement (JCGM 101, by the readings' noise).

    Each replicate draws new noise of the readings' standard uncertainty around what the fitted
    model says (least squares) or around the readings themselves (the two formulations that have no
    fit), and is solved like the measurement. The noise is independent between readings; repeats are
    drawn as their mean. ``uncertainty.monte_carlo`` draws from all sources, not the noise alone.

    Args:
        measurement: lines with known standard uncertainties, or with repeats to take them from.
        count: number of replicates, at least 1.
        seed: of the noise.
        method: one of ``replicable``.

    Returns:
        m, shape (count, 9(N+1)) in the order of ``geometry.TRANSLATIONS``; for ``rigid_body`` those
        and the rotations in rad, shape (count, 18(N+1)); NaN where not determined.

    Raises:
        NotDeterminable: the lines are not enough for this method.
        ValueError: no such method, fewer than one replicate, or a noise that nobody knows.
    """
    if count < 1:
        raise Refusal(f"count is {count}; expected 1 or more replicates", fault="out_of_range")
    observations = observe(measurement)
    rng = np.random.default_rng(seed)
    solver = estimator(measurement, observations, method)
    if isinstance(solver, LeastSquaresEstimator):
        # Weights are 1/u² where the noise is known and plain counts of repeats where it is not.
        unit = 1.0 if observations.noise_known else float(_known_noise(observations)[0])
        size = len(solver.names) * (observations.volume.blocks + 1)
        return solver.noisy(count, unit, rng)[:, :size]
    noise = _known_noise(observations)
    drawn = observations.excess + noise * rng.standard_normal((count, len(noise)))
    return solver.curves(drawn)


def _known_noise(observations: Observations) -> Vector:
    noise, remarks = noise_of(observations, widened=False)
    if not np.all(np.isfinite(noise)):
        raise Refusal(
            remarks[0] + " Measure repeats, or give the readings an uncertainty.",
            fault="undetermined",
        )
    return noise
