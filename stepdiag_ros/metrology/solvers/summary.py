"""From an estimate of the curves to the result: what is known, how well, and the figures.

The figures follow Ibaraki & Hata 2010, Table 1 and section 4.1: straightness is the largest
variation of the mean values from their least-squares line; squareness is the sum of the slopes of
least-squares lines of the two curves that turn an axis against another; positioning is the value at
the last node; an angular error motion is the largest minus the smallest value (ISO 230-1).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES, levers
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    CURVES,
    FRAME,
    ROTATIONS,
    TRANSLATIONS,
    Vector,
    beam_direction,
    cross,
    line_signs,
    moving_axis,
)
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.solvers.ranges import range_excess
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors

_NOTHING = 1e-6
"""A functional is determined if less than this share of it lies in undetermined directions."""


@dataclass(frozen=True)
class CurveEstimate:
    """Estimate of c curves, stacked in the order of their names.

    Attributes:
        values: one solution, m and rad, shape (c(N+1),); any multiple of ``unseen`` may be added.
        covariance: of the first values, shape (k, k), k ≤ c(N+1), without ``factor``; NaN where the
            noise is not known.
        unseen: directions that the readings do not determine, shape (c(N+1), r), rotations times
            ``arm``; r = 0 if all is determined.
        names: of the curves, the nine translations first.
        arm: distance by which a rotation is as large as a translation, m.
        factor: what few further causes, each of standard deviation 1, do to all values, shape
            (c(N+1), q): it adds factor · factorᵀ to their covariance.
    """

    values: Vector
    covariance: Vector
    unseen: Vector
    names: tuple[str, ...] = TRANSLATIONS
    arm: float = 1.0
    factor: Vector = field(default_factory=lambda: np.empty((0, 0)))

    def place(self, name: str) -> slice:
        """Return where a curve is in the stack."""
        size = len(self.values) // len(self.names)
        start = self.names.index(name) * size
        return slice(start, start + size)

    def first(self, names: Sequence[str]) -> "CurveEstimate":
        """Return the estimate of the first curves alone, which these names are."""
        end = self.place(names[-1]).stop
        return CurveEstimate(
            self.values[:end],
            self.covariance[:end, :end],
            self.unseen[:end],
            tuple(names),
            self.arm,
            self.factor[:end],
        )

    def whole_covariance(self) -> Vector:
        """Return the covariance of all values with the factor's part, shape (c(N+1), c(N+1))."""
        count = len(self.values)
        if not self.factor.size and len(self.covariance) == count:
            return self.covariance
        whole: Vector = self.factor @ self.factor.T if self.factor.size else np.zeros((count,) * 2)
        own = len(self.covariance)
        whole[:own, :own] += self.covariance
        return whole

    @property
    def scale(self) -> Vector:
        """Return what turns each stacked value into metres: 1, or the arm of a rotation."""
        size = len(self.values) // len(self.names)
        factors = [self.arm if name in ROTATIONS else 1.0 for name in self.names]
        return np.repeat(np.array(factors), size)

    def determined(self, functionals: Vector) -> NDArray[np.bool_]:
        """Say which linear functionals (rows, shape (m, c(N+1))) of the curves are determined."""
        if self.unseen.shape[1] == 0:
            return np.ones(len(functionals), dtype=bool)
        in_metres = functionals / self.scale
        left = np.linalg.norm(in_metres @ self.unseen, axis=1)
        whole = np.linalg.norm(in_metres, axis=1)
        return np.asarray(left <= _NOTHING * np.maximum(whole, 1e-300))

    def evaluate(self, functionals: Vector) -> tuple[Vector, Vector]:
        """Return values and standard uncertainties of functionals (rows); NaN: not determined."""
        values = functionals @ self.values
        first = functionals[:, : len(self.covariance)]
        variance = np.sum((first @ self.covariance) * first, axis=1)
        if self.factor.size:
            variance += np.sum((functionals @ self.factor) ** 2, axis=1)
        known = self.determined(functionals)
        return (
            np.where(known, values, np.nan),
            np.where(known, np.sqrt(np.maximum(variance, 0.0)), np.nan),
        )

    def curves_determined(self) -> NDArray[np.bool_]:
        """Say which single curve values are determined, shape (c(N+1),)."""
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


class Functional(NamedTuple):
    """A figure as weights on the stacked curves.

    Attributes:
        name: of the figure.
        unit: ``m`` or ``rad``.
        weights: whose product with the stacked curves is the figure, shape (c(N+1),).
        curve: whose range it is; empty for other figures.
        matrix: from that curve to the values whose range it is, shape (N+1, N+1).
    """

    name: str
    unit: str
    weights: Vector
    curve: str = ""
    matrix: Vector = np.zeros((0, 0))


def functionals(
    volume: Volume,
    estimate: CurveEstimate,
    lines: Sequence[str],
    chain: str = "",
    shown: Sequence[str] | None = None,
) -> tuple[Functional, ...]:
    """Return the figures of ``common_figures`` as weights on the curves.

    A range is that between the two nodes at which the estimate is largest and smallest.
    """
    nodes = volume.all_nodes
    slopes = [slope_weights(axis_nodes) for axis_nodes in nodes]
    flatten = [deviations_from_line(axis_nodes) for axis_nodes in nodes]
    made: list[Functional] = []

    def add(name: str, unit: str) -> Vector:
        made.append(Functional(name, unit, np.zeros(len(estimate.values))))
        return made[-1].weights

    def add_range(name: str, unit: str, curve: str, matrix: Vector) -> None:
        values = matrix @ estimate.values[estimate.place(curve)]
        row = add(name, unit)
        row[estimate.place(curve)] = matrix[np.argmax(values)] - matrix[np.argmin(values)]
        made[-1] = made[-1]._replace(curve=curve, matrix=matrix)

    for name, (factor, pair) in SQUARENESS_SLOPES.items():
        row = add(name, "rad")
        for curve in pair:
            row[estimate.place(curve)] = factor * slopes[moving_axis(curve)]
    for letter in AXES:
        curve = f"E_{letter}{letter}"
        add(f"positioning {curve}", "m")[estimate.place(curve)][-1] = 1.0
    for curve in TRANSLATIONS:
        if curve[2] != curve[3]:
            add_range(f"straightness {curve}", "m", curve, flatten[moving_axis(curve)])
    for curve in estimate.names:
        if curve in ROTATIONS and (shown is None or curve in shown):
            axis = moving_axis(curve)
            add_range(f"angular {curve}", "rad", curve, np.eye(len(nodes[axis])))
            add_range(f"angular-shape {curve}", "rad", curve, flatten[axis])
    for line in BODY_DIAGONALS:
        if line in lines:
            row = add(f"diagonal {line}", "m").reshape(len(estimate.names), -1)
            row[:, [0, -1]] = _end_weights(estimate.names, line, volume, chain)
    return tuple(made)


def common_figures(
    volume: Volume,
    estimate: CurveEstimate,
    lines: Sequence[str],
    chain: str = "",
    shown: Sequence[str] | None = None,
) -> tuple[Figure, ...]:
    """Return squareness, positioning, straightness and the measured body diagonals.

    Squareness (rad) is the right-handed rotation, see ``forward.SQUARENESS_DEFINITIONS`` for the
    other sign. The uncertainty of a straightness is that of the difference between the two nodes
    where the deviation is largest and smallest, and of the excess that comes with choosing these
    two (``ranges``); the same holds for the ranges below. ``diagonal ppp`` is the error of the
    displacement over the whole body diagonal (ISO 230-6), m, given for the step diagonals among
    ``lines``.

    Where the estimate holds rotations, ``angular E_AX`` and its like are their ranges (rad),
    ``angular-shape E_AX`` and its like those of the deviations from their least-squares lines,
    which are often determined where the slope is not; and a diagonal's displacement has the levers
    of the rotations in it, which need the ``chain``. ``shown`` leaves out the angular figures of
    other curves than these.
    """
    asked = functionals(volume, estimate, lines, chain, shown)
    values, uncertainties = estimate.evaluate(np.array([one.weights for one in asked]))
    made = []
    for one, value, uncertainty in zip(asked, values, uncertainties, strict=True):
        if one.curve:
            here = estimate.place(one.curve)
            if shape_determined(estimate, one.matrix, here):
                covariance = one.matrix @ estimate.covariance[here, here] @ one.matrix.T
                excess = range_excess(one.matrix @ estimate.values[here], covariance)
                uncertainty = np.hypot(uncertainty, excess)
            else:
                value, uncertainty = np.nan, np.nan
        made.append(Figure(one.name, float(value), float(uncertainty), one.unit))
    return tuple(made)


def _end_weights(names: Sequence[str], line: str, volume: Volume, chain: str) -> Vector:
    """Return the weights of curves at their first and last node in a body diagonal's displacement.

    A translation counts by its direction cosine. A rotation moves the mirror by its lever, the way
    of the axes after its own in the chain from the first corner: n·(ε × A) = ε·(A × n). The
    mirror's own turn has no lever left, since the laser's reference lies on the line.

    Returns:
        shape (curves, 2), -weight where the line starts and weight where it ends.
    """
    step = np.asarray(volume.step)
    direction = beam_direction(line, step)
    signs = line_signs(line)
    weights = np.outer(np.tile(direction, 3), np.ones(2))
    if len(names) > len(TRANSLATIONS):
        corners = np.array([signs < 0, signs > 0]) * step * volume.blocks
        turning = cross(np.array(levers(corners, chain)), direction)
        by_name = dict(zip(ROTATIONS, np.swapaxes(turning, 1, 2).reshape(-1, 2), strict=True))
        weights = np.concatenate([weights, [by_name[name] for name in names[len(weights) :]]])
    weights[:, 0] *= -1.0
    backwards = np.array([signs[moving_axis(name)] < 0 for name in names])
    weights[backwards] = weights[backwards, ::-1]
    return weights


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
    chain: str = "",
    shown: Sequence[str] | None = None,
    by_readings: Vector | None = None,
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
        chain: of the machine; needed where the estimate holds rotations.
        shown: the first curves of the estimate, which are given; all if None.
        by_readings: covariance of these curves by the readings' noise alone; all of it if None.
    """
    figures = common_figures(volume, estimate, lines, chain, shown)
    left_out = np.empty((0, 0))
    if shown is not None:
        left_out = _what_is_not_shown(estimate, shown)
        estimate = estimate.first(shown)
    known = estimate.curves_determined()
    values = np.where(known, estimate.values, np.nan)
    covariance = estimate.whole_covariance()
    if not np.all(known):
        covariance = np.where(known[:, None] & known[None, :], covariance, np.nan)
    uncertainty = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    place = {name: estimate.place(name) for name in estimate.names}
    return VolumetricErrors(
        method=method,
        nodes=volume.all_nodes,
        curves={name: values[place[name]] for name in place},
        standard_uncertainty={name: uncertainty[place[name]] for name in place},
        figures=(*figures, *setup_figures),
        lines=line_count,
        chi_squared=chi_squared,
        degrees_of_freedom=degrees_of_freedom,
        not_determined=tuple(not_determined),
        remarks=tuple(remarks),
        covariance=covariance,
        frame=frame,
        readings_covariance=covariance if by_readings is None else by_readings,
        turned_factor=left_out,
    )


def _what_is_not_shown(estimate: CurveEstimate, shown: Sequence[str]) -> Vector:
    """Return what rotations that are not shown, being given as zero, do to all curves' errors."""
    if estimate.names != CURVES or len(shown) == len(CURVES):
        return np.empty((0, 0))
    start = estimate.place(shown[-1]).stop
    given = np.where(np.arange(len(estimate.values)) < start, 0.0, estimate.values)
    return np.column_stack([estimate.factor, given])
