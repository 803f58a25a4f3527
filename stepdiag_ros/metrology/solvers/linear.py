"""What the two formulations of Ibaraki & Hata have in common: both are linear in the readings."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import FRAME, TRANSLATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.lengths import length_readings
from stepdiag_ros.metrology.solvers.noise_factor import widening
from stepdiag_ros.metrology.solvers.observations import Observations
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.solvers.rotations import (
    root_of,
    rotation_remarks,
    turned,
    with_rotations,
)
from stepdiag_ros.metrology.solvers.summary import make_result

DIAGONALS = ("ppp", "npp", "pnp")
"""The three step diagonals that the equations of both formulations are written for."""


class LinearMap(NamedTuple):
    """A formulation as a matrix on the readings' excess over a perfect machine and setup.

    Attributes:
        curves: shape (9(N+1), n); rows of NaN where the formulation does not determine a value.
        parameters: shape (m, n), setup parameters in m.
        names: of the parameters.
    """

    curves: Vector
    parameters: Vector
    names: tuple[str, ...]


Formulation = Callable[[Observations, slice], LinearMap]
"""Makes the columns of some readings of a formulation's matrix."""
_AT_ONCE = 1024
"""Readings whose columns are made at a time: the whole matrix grows with curves times readings."""


def noise_of(observations: Observations, widened: bool = True) -> tuple[Vector, list[str]]:
    """Return standard uncertainties of the readings (m, NaN if unknown) and remarks.

    Unknown ones are estimated from repeated readings of the same setup at the same place, and
    widened so that 1.96 u is the coverage interval of Student's distribution.

    Args:
        observations: the readings.
        widened: give uncertainties for coverage; if not, the standard deviation of the noise.
    """
    if observations.noise_known:
        return observations.uncertainty, observations.rounding_remarks
    squares, freedom = observations.pure_error()
    if freedom == 0:
        return np.full(len(observations.displacement), np.nan), [
            "The readings have no uncertainty and no repeats: uncertainties are unknown."
        ]
    noise = float(np.sqrt(squares / freedom))
    factor = np.sqrt(widening(freedom)) if widened else 1.0
    return np.full(len(observations.displacement), factor * noise), [
        f"The readings have no uncertainty: {noise * 1e6:.3g} µm was taken from their repeats "
        f"({freedom} degrees of freedom)."
    ]


def apply(
    method: str,
    measurement: Measurement,
    observations: Observations,
    formulation: Formulation,
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
        formulation: the method's matrix.
        used_lines: names of the lines that it uses.
        remarks: in words.
        frame: of the curves, in words.
        aligned: the formulation takes beams and mirrors as perfectly aligned; its uncertainties
            contain the tilts that least squares finds in the same readings, unknown where it finds
            none.
    """
    noise, noise_remarks = noise_of(observations)
    both = turned(measurement, replace(observations, direct=None))
    plausible = measurement.plausible
    systematic = length_readings(observations, plausible)
    if aligned and plausible.misaligned:
        moment = both.tilt_covariance + np.outer(both.tilts, both.tilts)
        tilts = both.design.tilt_readings() @ root_of(moment)
        systematic = np.column_stack([systematic, tilts])
    applied = _applied(formulation, observations, noise, systematic, both.by_reading)
    told, size = applied.told, len(applied.told)
    covariance = applied.covariance + applied.systematic @ applied.systematic.T
    by_mode = applied.by_mode[size:]
    uncertainties = np.sqrt(
        np.diag(covariance)[size:]
        + np.sum((by_mode @ both.rotations.second_moment) * by_mode, axis=1)
    )
    figures = [
        Figure(name, float(value), float(uncertainty), "m")
        for name, value, uncertainty in zip(
            applied.names, applied.values[size:], uncertainties, strict=True
        )
    ]
    covariance = covariance[:size, :size]
    estimate = with_rotations(
        applied.values[:size],
        covariance,
        np.eye(size)[:, ~told],
        both,
        -applied.by_mode[:size],
        predicted=False,
    )
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
        not_determined=untold and [f"{', '.join(untold)}: these lines do not determine them."],
        remarks=[*remarks, *noise_remarks, *rotation_remarks(measurement, both.rotations)],
        frame=frame,
        chain=measurement.chain,
        shown=TRANSLATIONS,
        by_readings=covariance,
    )


@dataclass(frozen=True)
class _Applied:
    """Matrix of a formulation: p curve values (zero where undetermined), then parameters.

    Attributes:
        told: which curve values the formulation determines, shape (9(N+1),).
        names: of the parameters.
        values: m, shape (p,).
        covariance: by the noise of the readings, m², shape (p, p).
        systematic: effects of what shifts many readings at once, m, shape (p, q).
        by_mode: effects of the rotations' modes, m/rad, shape (p, k).
    """

    told: NDArray[np.bool_]
    names: tuple[str, ...]
    values: Vector
    covariance: Vector
    systematic: Vector
    by_mode: Vector


def _applied(
    formulation: Formulation,
    observations: Observations,
    noise: Vector,
    systematic: Vector,
    by_reading: Vector,
) -> _Applied:
    """Apply a formulation to readings, some of them at a time.

    Args:
        formulation: the method's matrix.
        observations: the readings.
        noise: their standard uncertainties, m, shape (n,).
        systematic: what shifts many of them at once, m, shape (n, q).
        by_reading: what the rotations' modes add to them, m/rad, shape (n, k).
    """
    given = np.column_stack([observations.excess, systematic, by_reading])
    ends = np.cumsum([1, systematic.shape[1]])
    covariance, products = np.zeros((1, 1)), np.zeros((1, 1))
    for here in in_parts(len(given)):
        linear = formulation(observations, here)
        told = np.all(np.isfinite(linear.curves), axis=1)
        matrix = np.concatenate([np.where(told[:, None], linear.curves, 0.0), linear.parameters])
        products = products + matrix @ given[here]
        matrix *= noise[here]
        covariance = covariance + matrix @ matrix.T
    values, shifts, modes = np.split(products, ends, axis=1)
    return _Applied(told, linear.names, values[:, 0], covariance, shifts, modes)


def in_parts(count: int) -> Iterator[slice]:
    """Return slices of readings for which a formulation's matrix is made at once."""
    starts = range(0, count, _AT_ONCE)
    return (slice(start, min(start + _AT_ONCE, count)) for start in starts)


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
