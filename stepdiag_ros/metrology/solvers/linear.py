"""What the two formulations of Ibaraki & Hata have in common: both are linear in the readings."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stepdiag_ros.metrology.geometry import FRAME, TRANSLATIONS, Vector
from stepdiag_ros.metrology.solvers.observations import Observations
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.solvers.summary import CurveEstimate, make_result

DIAGONALS = ("ppp", "npp", "pnp")
"""The three step diagonals that the equations of both formulations are written for."""


class LinearMap(NamedTuple):
    """A formulation as a matrix on the readings' excess over a perfect machine and setup.

    Attributes:
        curves: shape (9(N+1), n); rows of NaN where the formulation does not tell a value.
        parameters: shape (m, n), setup parameters in m.
        names: of the parameters.
    """

    curves: Vector
    parameters: Vector
    names: tuple[str, ...]


def noise_of(observations: Observations) -> tuple[Vector, list[str]]:
    """Return standard uncertainties of the readings (m, NaN if nobody can tell) and remarks.

    Unknown ones are estimated from repeated readings of the same setup at the same place.
    """
    if observations.noise_known:
        return observations.uncertainty, []
    squares, freedom = observations.pure_error()
    if freedom == 0:
        return np.full(len(observations.displacement), np.nan), [
            "The readings have no uncertainty and no repeats: uncertainties are unknown."
        ]
    noise = float(np.sqrt(squares / freedom))
    return np.full(len(observations.displacement), noise), [
        f"The readings have no uncertainty: {noise * 1e6:.3g} µm was taken from their repeats "
        f"({freedom} degrees of freedom)."
    ]


def apply(
    method: str,
    observations: Observations,
    linear: LinearMap,
    used_lines: Sequence[str],
    remarks: Sequence[str],
    frame: str = FRAME,
) -> VolumetricErrors:
    """Return the result of a linear formulation, its covariance propagated from the readings.

    Readings that two displacements share, and the zero that a setup shares, are in it: the map acts
    on the readings, which are independent, and not on displacements, which are not.
    """
    noise, noise_remarks = noise_of(observations)
    excess = observations.excess
    told = np.all(np.isfinite(linear.curves), axis=1)
    curves = np.where(told[:, None], linear.curves, 0.0)
    spread = curves * noise
    values, uncertainties = (
        linear.parameters @ excess,
        np.linalg.norm(linear.parameters * noise, axis=1),
    )
    figures = [
        Figure(name, float(value), float(uncertainty), "m")
        for name, value, uncertainty in zip(linear.names, values, uncertainties, strict=True)
    ]
    estimate = CurveEstimate(curves @ excess, spread @ spread.T, np.eye(len(curves))[:, ~told])
    by_curve = told.reshape(len(TRANSLATIONS), -1)
    untold = [name for name, row in zip(TRANSLATIONS, by_curve, strict=True) if not np.all(row)]
    used = [
        setup in used_lines for setup in (observations.setups[i].line for i in observations.setup)
    ]
    return make_result(
        method,
        observations.volume,
        estimate,
        used_lines,
        len(set(observations.passes[np.array(used)])),
        figures,
        not_determined=[f"{', '.join(untold)}: these lines do not tell them."] if untold else [],
        remarks=[*remarks, *noise_remarks],
        frame=frame,
    )


def accumulate(increments: Vector) -> Vector:
    """Sum Δe over the intervals to e at the nodes, from zero at the first (IH section 3.3).

    Args:
        increments: of axis i in direction j over interval k, shape (3, 3, N, ...), in this order.

    Returns:
        shape (9(N+1), ...), in the order of ``geometry.TRANSLATIONS``.
    """
    summed = np.concatenate(
        [np.zeros_like(increments[:, :, :1]), np.cumsum(increments, axis=2)], axis=2
    )
    stacked: Vector = summed.reshape(-1, *increments.shape[3:])
    return stacked


def remarks_on_unused(
    formulation: str, observations: Observations, used: Sequence[str] = DIAGONALS
) -> list[str]:
    """Say which diagonals lie beyond those that a formulation's equations use."""
    unused = sorted({s.line for s in observations.setups if s.diagonal and s.line not in used})
    return [f"The {formulation} formulation cannot use {', '.join(unused)}."] if unused else []
