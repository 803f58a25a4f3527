"""Readings that were rounded when they were noted, and how much of that no repeat can show.

A reading in steps of q is off by up to q / 2, with a standard uncertainty of q / √12
(JCGM 100:2008, F.2.2.1). Where the scatter is smaller than the step, every repeat of a stop is
rounded to the same value: the error stays, and repeats agree too well. Of readings with a scatter
σ, the repeats of a stop share an error of variance

    C(σ) = q² / (2 π²) · Σ exp(-(2 π k σ / q)²) / k²,    k = 1, 2, …

(Fourier series of the rounding error, B. Widrow and I. Kollár, Quantization Noise, 2008, on the
characteristic function of rounded values), and scatter with the variance s² = σ² + q²/12 - C(σ).
"""

import numpy as np
from numpy.typing import ArrayLike

from stepdiag_ros.metrology.geometry import Vector

_STEPS = tuple(float(f"{first}e{power}") for power in range(-6, -10, -1) for first in (10, 5, 2))
"""That are looked for, m: from 10 µm to 2 nm, below which no reading is known."""
NEGLIGIBLE = 0.1
"""Share of the scatter below which what repeats hide of the rounding is nothing beside it."""
_LEAST_READINGS = 8
_NEAR = 1e-4
"""Distance from a multiple, in steps, that arithmetic may have left."""
_TERMS = np.arange(1, 400)[:, None]


def reading_step(displacement: ArrayLike) -> float:
    """Return the step that readings come in, m; 0 if none is seen.

    Args:
        displacement: readings, m; NaN where one is missing.

    Returns:
        the coarsest of 10 µm, 5 µm, 2 µm, 1 µm, … 2 nm of which all readings are multiples.
    """
    values = np.asarray(displacement, dtype=np.float64)
    values = values[np.isfinite(values)]
    few = values[:_LEAST_READINGS]
    for step in _STEPS:
        if _multiples(few, step) and _multiples(values, step):
            return step if len(np.unique(values)) >= _LEAST_READINGS else 0.0
    return 0.0


def _multiples(values: Vector, step: float) -> bool:
    counted = values / step
    return bool(np.all(np.abs(counted - np.round(counted)) < _NEAR))


def shared_rounding(scatter: float, step: float) -> float:
    """Return the standard deviation of the rounding error that all repeats of a stop share, m.

    Args:
        scatter: standard deviation s that the rounded repeats show, m.
        step: that readings come in, m; 0 if they are not rounded.
    """
    if not step > 0.0:
        return 0.0
    true = np.linspace(0.0, 1.0, 201)
    shared = _shared(true)
    shown = true**2 + 1.0 / 12.0 - shared
    return step * float(np.sqrt(np.interp((scatter / step) ** 2, shown, shared)))


def _shared(scatter: Vector) -> Vector:
    """Return C(σ) with step and σ in units of the step."""
    terms = np.exp(-((2.0 * np.pi * _TERMS * scatter) ** 2)) / _TERMS**2
    variance: Vector = np.sum(terms, axis=0) / (2.0 * np.pi**2)
    return variance
