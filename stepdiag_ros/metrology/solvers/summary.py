"""From an estimate of the nine curves to the result: what is known, how well, and the figures.

The figures follow Ibaraki & Hata 2010, Table 1 and section 4.1: straightness is the largest
variation of the mean values from their least-squares line; squareness is the sum of the slopes of
least-squares lines of the two curves that turn an axis against another; positioning is the value at
the last node.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    FRAME,
    TRANSLATIONS,
    Vector,
    beam_direction,
    line_signs,
)
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors

_NOTHING = 1e-6
"""A functional is determined if less than this share of it lies in undetermined directions."""


@dataclass(frozen=True)
class CurveEstimate:
    """Estimate of the nine curves, stacked in the order of ``geometry.TRANSLATIONS``.

    Attributes:
        values: one solution, m, shape (9(N+1),); any multiple of ``unseen`` may be added to it.
        covariance: of the values, m², shape (9(N+1), 9(N+1)); NaN where the noise is not known.
        unseen: directions that the readings do not tell, shape (9(N+1), r); r = 0 if all is
            determined.
    """

    values: Vector
    covariance: Vector
    unseen: Vector

    def determined(self, functionals: Vector) -> NDArray[np.bool_]:
        """Say which linear functionals (rows, shape (m, 9(N+1))) of the curves are determined."""
        if self.unseen.shape[1] == 0:
            return np.ones(len(functionals), dtype=bool)
        left = np.linalg.norm(functionals @ self.unseen, axis=1)
        whole = np.linalg.norm(functionals, axis=1)
        return np.asarray(left <= _NOTHING * np.maximum(whole, 1e-300))

    def evaluate(self, functionals: Vector) -> tuple[Vector, Vector]:
        """Return values and standard uncertainties of functionals (rows); NaN: not determined."""
        values = functionals @ self.values
        variance = np.sum((functionals @ self.covariance) * functionals, axis=1)
        known = self.determined(functionals)
        return (
            np.where(known, values, np.nan),
            np.where(known, np.sqrt(np.maximum(variance, 0.0)), np.nan),
        )

    def curves_determined(self) -> NDArray[np.bool_]:
        """Say which single curve values are determined, shape (9(N+1),)."""
        return np.asarray(np.linalg.norm(self.unseen, axis=1) <= _NOTHING)


def deviations_from_line(nodes: Vector) -> Vector:
    """Return the matrix from a curve to its deviations from its least-squares line."""
    centred = nodes - np.mean(nodes)
    projector: Vector = (
        np.eye(len(nodes))
        - 1.0 / len(nodes)
        - np.outer(centred, centred) / np.dot(centred, centred)
    )
    return projector


def slope_weights(nodes: Vector) -> Vector:
    """Return the weights whose product with a curve is the slope of its least-squares line, 1/m."""
    centred = nodes - np.mean(nodes)
    weights: Vector = centred / np.dot(centred, centred)
    return weights


def common_figures(
    volume: Volume, estimate: CurveEstimate, lines: Sequence[str]
) -> tuple[Figure, ...]:
    """Return squareness, positioning, straightness and the measured body diagonals.

    Squareness (rad) is the right-handed rotation, see ``forward.SQUARENESS_DEFINITIONS`` for the
    other sign. The uncertainty of a straightness is that of the difference between the two nodes
    where the deviation is largest and smallest. ``diagonal ppp`` is the error of the displacement
    over the whole body diagonal (ISO 230-6), m, given for the step diagonals among ``lines``.
    """
    size = volume.blocks + 1
    nodes = [volume.nodes(axis) for axis in range(3)]
    place = {name: slice(i * size, (i + 1) * size) for i, name in enumerate(TRANSLATIONS)}
    names: list[str] = []
    units: list[str] = []
    rows: list[Vector] = []

    def add(name: str, unit: str) -> Vector:
        names.append(name)
        units.append(unit)
        rows.append(np.zeros(9 * size))
        return rows[-1]

    for name, (factor, pair) in SQUARENESS_SLOPES.items():
        row = add(name, "rad")
        for curve in pair:
            row[place[curve]] = factor * slope_weights(nodes[AXES.index(curve[3])])
    for letter in AXES:
        add(f"positioning E_{letter}{letter}", "m")[place[f"E_{letter}{letter}"]][-1] = 1.0
    flatten = [deviations_from_line(axis_nodes) for axis_nodes in nodes]
    shapes: dict[str, bool] = {}
    for curve in TRANSLATIONS:
        if curve[2] == curve[3]:
            continue
        matrix = flatten[AXES.index(curve[3])]
        deviation = matrix @ estimate.values[place[curve]]
        row = add(f"straightness {curve}", "m")
        row[place[curve]] = matrix[np.argmax(deviation)] - matrix[np.argmin(deviation)]
        shapes[names[-1]] = shape_determined(estimate, matrix, place[curve])
    for line in BODY_DIAGONALS:
        if line in lines:
            row = add(f"diagonal {line}", "m")
            direction = beam_direction(line, np.asarray(volume.step))
            signs = line_signs(line)
            for curve in TRANSLATIONS:
                axis, error = AXES.index(curve[3]), AXES.index(curve[2])
                part = row[place[curve]]
                part[-1] += signs[axis] * direction[error]
                part[0] -= signs[axis] * direction[error]
    values, uncertainties = estimate.evaluate(np.array(rows))
    made = []
    for name, unit, value, uncertainty in zip(names, units, values, uncertainties, strict=True):
        if not shapes.get(name, True):
            value, uncertainty = np.nan, np.nan
        made.append(Figure(name, float(value), float(uncertainty), unit))
    return tuple(made)


def shape_determined(estimate: CurveEstimate, matrix: Vector, place: slice) -> bool:
    """Say whether all deviations of a curve from its least-squares line are determined."""
    if estimate.unseen.shape[1] == 0:
        return True
    return bool(np.max(np.abs(matrix @ estimate.unseen[place])) <= _NOTHING)


def make_result(
    method: str,
    volume: Volume,
    estimate: CurveEstimate,
    lines: Sequence[str],
    line_count: int,
    setup_figures: Sequence[Figure],
    chi_squared: float = float("nan"),
    degrees_of_freedom: int = 0,
    not_determined: Sequence[str] = (),
    remarks: Sequence[str] = (),
    frame: str = FRAME,
) -> VolumetricErrors:
    """Return the result of a solver: NaN wherever the estimate is not determined.

    Args:
        method: name of the solver.
        volume: the measured box.
        estimate: of the curves.
        lines: names of the lines that were used.
        line_count: number of passes that were used.
        setup_figures: tilts or the like.
        chi_squared: of the fit.
        degrees_of_freedom: of the fit.
        not_determined: in words.
        remarks: in words.
        frame: of the curves, in words.
    """
    size = volume.blocks + 1
    known = estimate.curves_determined()
    values = np.where(known, estimate.values, np.nan)
    covariance = estimate.covariance
    if not np.all(known):
        covariance = np.where(known[:, None] & known[None, :], covariance, np.nan)
    uncertainty = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return VolumetricErrors(
        method=method,
        nodes=(volume.nodes(0), volume.nodes(1), volume.nodes(2)),
        curves=dict(zip(TRANSLATIONS, values.reshape(9, size), strict=True)),
        standard_uncertainty=dict(zip(TRANSLATIONS, uncertainty.reshape(9, size), strict=True)),
        figures=(*common_figures(volume, estimate, lines), *setup_figures),
        lines=line_count,
        chi_squared=chi_squared,
        degrees_of_freedom=degrees_of_freedom,
        not_determined=tuple(not_determined),
        remarks=tuple(remarks),
        covariance=covariance,
        frame=frame,
    )
