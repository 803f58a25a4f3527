"""Replicates of a whole estimate: the same lines measured again and again, with new noise."""

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.conventional import conventional_map
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.linear import noise_of
from stepdiag_ros.metrology.solvers.observations import Observations, observe
from stepdiag_ros.metrology.solvers.setup_robust import setup_robust_map

_CHUNK = 2_000_000


def replicate(
    measurement: Measurement, count: int, seed: int = 0, method: str = "least_squares"
) -> Vector:
    """Return the curves of many replicates of a measurement (JCGM 101, by the readings' noise).

    Each replicate draws new noise of the readings' standard uncertainty around what the fitted
    model says (least squares) or around the readings themselves (the two formulations that have no
    fit), and is solved like the measurement. The noise is independent between readings; repeats are
    drawn as their mean.

    Args:
        measurement: lines with known standard uncertainties, or with repeats to take them from.
        count: number of replicates, at least 1.
        seed: of the noise.
        method: ``conventional``, ``setup_robust`` or ``least_squares``.

    Returns:
        m, shape (count, 9(N+1)) in the order of ``geometry.TRANSLATIONS``; NaN where not
        determined.

    Raises:
        NotDeterminable: the lines are not enough for this method.
        ValueError: no such method, fewer than one replicate, or a noise that nobody knows.
    """
    if count < 1:
        raise ValueError(f"count is {count}; expected 1 or more replicates")
    observations = observe(measurement)
    rng = np.random.default_rng(seed)
    if method == "least_squares":
        return _least_squares(observations, count, rng)
    if method not in ("conventional", "setup_robust"):
        raise ValueError(f"'{method}' is no method; use conventional, setup_robust, least_squares")
    linear = conventional_map if method == "conventional" else setup_robust_map
    noise = _known_noise(observations)
    drawn = observations.excess + noise * rng.standard_normal((count, len(noise)))
    curves: Vector = drawn @ linear(observations).curves.T
    return curves


def _least_squares(observations: Observations, count: int, rng: np.random.Generator) -> Vector:
    design = Design(observations)
    fit = design.fit()
    # Weights are 1/u² where the noise is known and plain counts of repeats where it is not.
    scale = 1.0 if observations.noise_known else _known_noise(observations)[0]
    noise = scale / np.sqrt(design.weight)
    known = np.linalg.norm(design.curves_unseen(), axis=1) <= 1e-6
    curves = np.empty((count, len(known)))
    rows = max(1, _CHUNK // (9 * len(noise)))
    for start in range(0, count, rows):
        end = min(count, start + rows)
        drawn = fit.fitted + noise * rng.standard_normal((end - start, len(noise)))
        curves[start:end] = design.fit(drawn).curves
    curves[:, ~known] = np.nan
    return curves


def _known_noise(observations: Observations) -> Vector:
    noise, remarks = noise_of(observations)
    if not np.all(np.isfinite(noise)):
        raise ValueError(remarks[0] + " Measure repeats, or give the readings an uncertainty.")
    return noise
