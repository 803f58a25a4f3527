"""Least squares with random effects whose sizes the readings themselves determine.

    y = X β + Z b + r,     b_j ~ N(0, s²_g(j)),     r_i ~ N(0, s²_0 u_i²)

β is free, b is drawn from groups of a common size s_g (one for straightness, one for the wander of
the zero, ...), and the readings' own uncertainty u_i counts up to a common factor s_0. β and b
together follow from Henderson's mixed-model equations, whose inverse is their covariance; their
determinant gives the restricted likelihood of the sizes (Patterson and Thompson 1971):

    C = [X Z]ᵀ W [X Z] / s²_0 + diag(0, 1/s²_g),      W = diag(1/u²)
    -2 log L = n log s²_0 + Σ log s²_g(j) + log |C| + rᵀ W r / s²_0 + Σ b²_j / s²_g(j)

A size from a few effects is uncertain itself, so the result is not an estimate at the best
sizes: it is the mean over many sizes that are as likely as the readings and what is known of sizes
beforehand make them. The spread of their estimates is part of the covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry

_DRAWS = 40
_SEED = 19710612
_DIFFERENCE = 0.05
_FARTHEST = 6.0
"""Standard deviations from what is usual beyond which no size is looked for."""
_FLATTEST = 0.05
"""Least curvature of the likelihood in a logarithm of a size that is believed."""


@dataclass(frozen=True)
class GroupSize:
    """What is known of the size of one group of effects before the readings speak.

    Attributes:
        name: in words.
        median: of its log-normal distribution, in the unit of the effects.
        factor: one standard deviation up or down is this factor.
        least: no smaller size is believed.
    """

    name: str
    median: float
    factor: float
    least: float = 0.0


@dataclass(frozen=True)
class Effects:
    """Random effects.

    Attributes:
        design: Z, effect of each on the readings where its size is 1, shape (n, m).
        group: of each effect, index into ``sizes``; the first, s_0, has no effect, shape (m,).
        sizes: what is known of s_0 and of the size of each group.
    """

    design: Vector
    group: NDArray[np.intp]
    sizes: tuple[GroupSize, ...]


@dataclass(frozen=True)
class MixedFit:
    """Free parameters and random effects together.

    Attributes:
        mean: of β and b, shape (p + m,).
        covariance: shape (p + m, p + m), with that of the sizes in it.
        sizes: s_0 and the groups' sizes, the likeliest ones, shape (g,).
    """

    mean: Vector
    covariance: Vector
    sizes: Vector


class _Equations:
    """The mixed-model equations of one set of readings, for any sizes."""

    def __init__(self, y: Vector, uncertainty: Vector, free: Vector, effects: Effects) -> None:
        rows = np.hstack([free, effects.design]) / uncertainty[:, None]
        right = y / uncertainty
        self._normal = rows.T @ rows
        self._right = rows.T @ right
        self._square = float(right @ right)
        self._count = len(y)
        self._free = free.shape[1]
        self._group = effects.group
        self._median = np.log([size.median for size in effects.sizes])
        self._spread = np.log([size.factor for size in effects.sizes])
        least = np.array([size.least for size in effects.sizes])
        lowest = self._median - _FARTHEST * self._spread
        self.lowest = np.maximum(lowest, np.log(np.maximum(least, 1e-300)))

    def solve(self, logs: Vector) -> tuple[float, Vector, Vector, Vector]:
        """Return what sizes say.

        Returns:
            -2 log (likelihood times prior), its derivatives by the logarithms of the sizes, the
            solution, and C⁻¹.
        """
        noise = np.exp(2.0 * logs[0])
        penalty = np.zeros(len(self._right))
        penalty[self._free :] = np.exp(-2.0 * logs[self._group])
        root, inverse = _root_and_inverse(self._normal / noise + np.diag(penalty))
        solution: Vector = inverse @ (self._right / noise)
        left = self._square - 2.0 * float(solution @ self._right)
        left += float(solution @ self._normal @ solution)
        away = (logs - self._median) / self._spread
        badness = (
            self._count * 2.0 * logs[0]
            + 2.0 * float(np.sum(logs[self._group]))
            + 2.0 * float(np.sum(np.log(root)))
            + left / noise
            + float(solution**2 @ penalty)
            + float(away @ away)
        )
        shrunk = penalty * np.diag(inverse)
        derivatives = 2.0 * away / self._spread
        derivatives[0] += 2.0 * (self._count - len(penalty) + float(shrunk.sum()) - left / noise)
        by_effect = 2.0 * (1.0 - shrunk - penalty * solution**2)
        derivatives += np.bincount(
            self._group, weights=by_effect[self._free :], minlength=len(logs)
        )
        return badness, derivatives, solution, inverse

    def likeliest(self) -> tuple[Vector, Vector]:
        """Return the likeliest logarithms of the sizes and a root of their rough covariance."""
        from scipy.optimize import minimize

        highest = self._median + _FARTHEST * self._spread
        found = minimize(
            lambda logs: self.solve(logs)[:2],
            self._median,
            method="L-BFGS-B",
            jac=True,
            bounds=list(zip(self.lowest, highest, strict=True)),
        ).x
        curvature = np.array(
            [
                (self.solve(found + step)[1] - self.solve(found - step)[1]) / (4.0 * _DIFFERENCE)
                for step in _DIFFERENCE * np.eye(len(found))
            ]
        )
        values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
        root: Vector = vectors / np.sqrt(np.maximum(values, _FLATTEST))
        return found, root


def _root_and_inverse(matrix: Vector) -> tuple[Vector, Vector]:
    """Return the diagonal of the Cholesky root of a positive definite matrix, and its inverse."""
    from scipy.linalg import lapack

    root, failed = lapack.dpotrf(matrix, lower=1)
    if failed:
        raise PoorGeometry("the readings do not determine the free unknowns; choose other places")
    inverse, _ = lapack.dpotri(root, lower=1)
    lower = np.tril(inverse)
    whole: Vector = lower + np.tril(lower, -1).T
    return np.diag(root), whole


def fit(y: Vector, uncertainty: Vector, free: Vector, effects: Effects) -> MixedFit:
    """Estimate free parameters and random effects; see the module.

    Sizes are drawn around the likeliest ones, always the same draws, by the curvature there.

    Args:
        y: readings less what the model says at the parameters' start, shape (n,).
        uncertainty: u_i, shape (n,).
        free: X, shape (n, p), of full rank.
        effects: the rest of the model.
    """
    equations = _Equations(y, uncertainty, free, effects)
    centre, root = equations.likeliest()
    # Each draw beside its mirror image, so that the mean draw is the likeliest one.
    half = np.random.default_rng(_SEED).standard_normal((_DRAWS // 2, len(centre)))
    draws = np.concatenate([half, -half])
    count = free.shape[1] + effects.design.shape[1]
    mean, square = np.zeros(count), np.zeros((count, count))
    for draw in draws:
        logs = np.maximum(centre + root @ draw, equations.lowest)
        _, _, solution, inverse = equations.solve(logs)
        mean += solution / _DRAWS
        square += (inverse + np.outer(solution, solution)) / _DRAWS
    return MixedFit(mean, square - np.outer(mean, mean), np.exp(centre))


def fit_with_sizes(
    y: Vector, uncertainty: Vector, free: Vector, effects: Effects, sizes: Sequence[float]
) -> MixedFit:
    """Return the same where all sizes are given, s_0 first."""
    logs = np.log(np.asarray(sizes, dtype=np.float64))
    _, _, solution, inverse = _Equations(y, uncertainty, free, effects).solve(logs)
    return MixedFit(solution, inverse, np.exp(logs))
