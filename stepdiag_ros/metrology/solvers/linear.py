"""What the two formulations of Ibaraki & Hata have in common: both are linear in the readings."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stepdiag_ros.metrology.geometry import FRAME, TRANSLATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.lengths import length_readings
from stepdiag_ros.metrology.solvers.observations import Observations
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.solvers.rotations import rotation_remarks, turned, with_rotations
from stepdiag_ros.metrology.solvers.summary import make_result

DIAGONALS = ("ppp", "npp", "pnp")
"""The three step diagonals that the equations of both formulations are written for."""


class LinearMap(NamedTuple):
    """A formulation as a matrix on the readings' excess over a perfect machine and setup.

    Attributes:
        curves: shape (9(N+1), n).
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
    measurement: Measurement,
    observations: Observations,
    linear: LinearMap,
    used_lines: Sequence[str],
    remarks: Sequence[str],
    frame: str = FRAME,
    aligned: bool = False,
) -> VolumetricErrors:
    """Return the result of a linear formulation, its covariance propagated from the readings.

    Readings that two displacements share, and the zero that a setup shares, are in it: the map acts
    on the readings, which are independent, and not on displacements, which are not. The values are
    those of the document, which takes all rotations as zero; the uncertainties contain what
    rotations do that the run shows or that are plausible (``rotations``).

    Args:
        method: name of the solver.
        measurement: that is solved.
        observations: its readings.
        linear: the formulation.
        used_lines: names of the lines that it uses.
        remarks: in words.
        frame: of the curves, in words.
        aligned: the formulation takes beams and mirrors as perfectly aligned; its uncertainties
            contain the tilts that least squares finds in the same readings, unknown where it finds
            none.
    """
    noise, noise_remarks = noise_of(observations)
    excess = observations.excess
    both = turned(measurement, observations)
    plausible = measurement.plausible
    systematic = length_readings(observations, plausible)
    if aligned and plausible.misaligned:
        tilts = both.design.tilt_readings() @ _root(both.tilts, both.tilt_covariance)
        systematic = np.column_stack([systematic, tilts])
    by_readings, by_parameters = (
        np.column_stack([matrix * noise, matrix @ systematic])
        for matrix in (linear.curves, linear.parameters)
    )
    moment = both.rotations.second_moment
    by_mode = linear.parameters @ both.by_reading
    values = linear.parameters @ excess
    uncertainties = np.sqrt(
        np.sum(by_parameters**2, axis=1) + np.sum((by_mode @ moment) * by_mode, axis=1)
    )
    figures = [
        Figure(name, float(value), float(uncertainty), "m")
        for name, value, uncertainty in zip(linear.names, values, uncertainties, strict=True)
    ]
    size = len(linear.curves)
    estimate = with_rotations(
        linear.curves @ excess,
        by_readings @ by_readings.T,
        np.zeros((size, 0)),
        both,
        -linear.curves @ both.by_reading,
        predicted=False,
    )
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
        remarks=[*remarks, *noise_remarks, *rotation_remarks(measurement, both.rotations)],
        frame=frame,
        chain=measurement.chain,
        shown=TRANSLATIONS,
        by_readings=by_readings @ by_readings.T,
    )


def _root(mean: Vector, covariance: Vector) -> Vector:
    """Return columns whose products sum to the second moment of what has this mean."""
    moment = covariance + np.outer(mean, mean)
    if not np.all(np.isfinite(moment)):
        return np.full(moment.shape, np.nan)
    values, vectors = np.linalg.eigh(moment)
    root: Vector = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


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


def remarks_on_unused(formulation: str, observations: Observations) -> list[str]:
    """Say which step diagonals lie beyond the three that a formulation's equations use."""
    unused = sorted({s.line for s in observations.setups if s.diagonal and s.line not in DIAGONALS})
    return [f"The {formulation} formulation cannot use {', '.join(unused)}."] if unused else []
