"""Least squares on lengths: Gauss-Newton with full covariance, prior knowledge and a check of fit.

Lengths of a metre known to a nanometre leave no room for finite differences: models return their
derivatives, too.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal

Model = Callable[[Vector], tuple[Vector, Vector]]
"""Parameters, shape (p,) → predicted readings, shape (n,), and their derivatives, shape (n, p)."""

_LARGEST_CONDITION = 1e10
_MOST_STEPS = 60
_HALVINGS = 30
_NOISE_ROUNDS = 50
_FALSE_ALARMS = 0.01
"""Share of good sets of readings of which one reading is named all the same."""


class PoorGeometry(Refusal):
    """The points do not determine what is asked for; the text says why and what to do."""


@dataclass(frozen=True)
class Prior:
    """What is known of some parameters beforehand.

    Attributes:
        places: indices of these parameters.
        values: shape (k,).
        covariance: shape (k, k), positive definite.
    """

    places: tuple[int, ...]
    values: Vector
    covariance: Vector


@dataclass(frozen=True)
class Adjustment:
    """Result of a least-squares adjustment.

    Attributes:
        parameters: shape (p,).
        covariance: shape (p, p); NaN if neither the readings' uncertainty nor a residual is known.
        residuals: reading less prediction, m, shape (n,).
        uncertainty: standard uncertainties of the readings, given or estimated, m, shape (n,).
        redundancy: share of each reading that the others check, 0..1, shape (n,).
        degrees_of_freedom: readings and priors less parameters.
        chi_squared: of readings and priors; NaN if the uncertainty was estimated from the fit.
        condition: of the weighted design matrix with columns of unit length.
        estimated: the readings' uncertainty was not given and is that of the residuals.
    """

    parameters: Vector
    covariance: Vector
    residuals: Vector
    uncertainty: Vector
    redundancy: Vector
    degrees_of_freedom: int
    chi_squared: float
    condition: float
    estimated: bool

    @property
    def standard_uncertainty(self) -> Vector:
        """Return the standard uncertainties of the parameters, shape (p,)."""
        made: Vector = np.sqrt(np.diag(self.covariance))
        return made

    @property
    def coverage_factor(self) -> float:
        """Return k for 95 %: normal, or Student's where the uncertainty is from the residuals."""
        if not self.estimated:
            return 1.96
        from scipy.special import stdtrit

        freedom = float(np.sum(self.redundancy))
        return float(stdtrit(freedom, 0.975)) if freedom >= 0.5 else float("nan")

    @property
    def standardised(self) -> Vector:
        """Return every residual over its own standard deviation, shape (n,).

        NaN where no other reading checks it.
        """
        # A share of a thousandth is rounding of the computation, not a check.
        checked = self.redundancy > 1e-3
        spread = self.uncertainty * np.sqrt(np.where(checked, self.redundancy, np.nan))
        made: Vector = self.residuals / np.where(spread > 0, spread, np.nan)
        return made

    def suspicious(self) -> list[int]:
        """Return the readings whose residual is too large for their uncertainty, worst first.

        Baarda's data snooping; the more readings there are, the larger one may be by chance.
        """
        from scipy.special import ndtri

        size = np.nan_to_num(np.abs(self.standardised))
        limit = -float(ndtri(0.5 * _FALSE_ALARMS / len(size)))
        return [int(i) for i in np.argsort(-size) if size[i] > limit]


def adjust(
    model: Model,
    observed: Vector,
    uncertainty: Vector,
    start: Vector,
    prior: Prior | None = None,
) -> Adjustment:
    """Adjust parameters to readings by weighted least squares.

    Args:
        model: returns predictions and their derivatives.
        observed: readings, m, shape (n,).
        uncertainty: their standard uncertainties, m, shape (n,), independent; all NaN if unknown,
            then equal and estimated from the residuals.
        start: parameters to begin with, shape (p,).
        prior: knowledge of some of the parameters.

    Raises:
        PoorGeometry: the readings do not determine the parameters.
        ValueError: some but not all uncertainties are known, or one is not positive.
    """
    known = np.isfinite(uncertainty)
    if known.any() and not known.all():
        raise Refusal(
            "some readings have an uncertainty and some have none; give all of them one, or none",
            fault="mismatch",
            aspect="uncertainty",
        )
    if known.all():
        if np.any(uncertainty <= 0):
            raise Refusal(
                "the uncertainty of a reading is not more than zero",
                fault="out_of_range",
                aspect="uncertainty",
            )
        return _adjust(model, observed, uncertainty, start, prior, estimated=False)
    # Without a prior the noise does not move the estimate; with one the two are weighed.
    noise = 1e-6
    for _ in range(_NOISE_ROUNDS):
        made = _adjust(model, observed, np.full(len(observed), noise), start, prior, estimated=True)
        freedom = float(np.sum(made.redundancy))
        if freedom < 0.5:
            nothing = np.full_like(made.covariance, np.nan)
            unknown = np.full(len(observed), np.nan)
            return replace(made, covariance=nothing, uncertainty=unknown)
        found = float(np.sqrt(np.sum(made.residuals**2) / freedom))
        # Noise below a picometre is rounding of exact numbers.
        found = max(found, 1e-12)
        if abs(found - noise) <= 1e-9 * noise:
            break
        noise = found
    return made


def _adjust(
    model: Model,
    observed: Vector,
    uncertainty: Vector,
    start: Vector,
    prior: Prior | None,
    *,
    estimated: bool,
) -> Adjustment:
    parameters = np.array(start, dtype=np.float64)
    prior_rows, prior_residual = _prior_rows(prior, len(parameters))

    count = len(observed)

    def weighted(at: Vector) -> tuple[Vector, Vector]:
        predicted, derivatives = model(at)
        residual = np.concatenate([(observed - predicted) / uncertainty, prior_residual(at)])
        rows = np.concatenate([derivatives / uncertainty[:, None], prior_rows])
        return residual, rows

    def rounding() -> Vector:
        # Of each weighted residual: a difference of metres in units of micrometres or less.
        terms = np.abs(rows) @ np.abs(parameters)
        terms[:count] += np.abs(observed) / uncertainty
        made: Vector = np.finfo(np.float64).eps * terms
        return made

    residual, rows = weighted(parameters)
    left = float(residual @ residual)
    for _ in range(_MOST_STEPS):
        step, condition = _step(rows, residual)
        share = 1.0
        blur = rounding()
        # Near the minimum χ² changes by less than its own rounding, which must not stop a step.
        allowed = left * 1e-12 + 1e-12 + float((2.0 * np.abs(residual) + blur) @ blur)
        for _ in range(_HALVINGS):
            tried, tried_rows = weighted(parameters + share * step)
            if float(tried @ tried) <= left + allowed:
                break
            share *= 0.5
        else:
            break
        parameters = parameters + share * step
        gain = left - float(tried @ tried)
        residual, rows, left = tried, tried_rows, float(tried @ tried)
        finest = 1e-9 * np.sqrt(1.0 + left) + np.linalg.norm(blur)
        settled = np.linalg.norm(rows @ (share * step)) < finest
        if share == 1.0 and (settled or abs(gain) < 1e-15 * left):
            break
    _, condition = _step(rows, residual)
    lengths = np.linalg.norm(rows, axis=0)
    q, r = np.linalg.qr(rows / lengths)
    inverse = np.linalg.inv(r) / lengths[:, None]
    return Adjustment(
        parameters=parameters,
        covariance=inverse @ inverse.T,
        residuals=residual[:count] * uncertainty,
        uncertainty=uncertainty,
        redundancy=np.clip(1.0 - np.sum(q[:count] ** 2, axis=1), 0.0, 1.0),
        degrees_of_freedom=len(residual) - len(parameters),
        chi_squared=float("nan") if estimated else left,
        condition=condition,
        estimated=estimated,
    )


def _prior_rows(prior: Prior | None, size: int) -> tuple[Vector, Callable[[Vector], Vector]]:
    if prior is None:
        return np.empty((0, size)), lambda _at: np.empty(0)
    places = list(prior.places)
    whitening = np.linalg.inv(np.linalg.cholesky(prior.covariance))
    rows = np.zeros((len(places), size))
    rows[:, places] = whitening

    def residual(at: Vector) -> Vector:
        made: Vector = whitening @ (prior.values - at[places])
        return made

    return rows, residual


def _step(rows: Vector, residual: Vector) -> tuple[Vector, float]:
    """Return the Gauss-Newton step and the condition number of the columns at unit length."""
    lengths = np.linalg.norm(rows, axis=0)
    if len(rows) < rows.shape[1] or np.any(lengths == 0):
        raise PoorGeometry(
            "there are fewer independent readings than unknowns; measure more points"
        )
    u, s, vt = np.linalg.svd(rows / lengths, full_matrices=False)
    condition = float(s[0] / s[-1]) if s[-1] > 0 else float("inf")
    if not condition < _LARGEST_CONDITION:
        raise PoorGeometry("the points do not determine all unknowns; choose other places")
    return (vt.T @ ((u.T @ residual) / s)) / lengths, condition
