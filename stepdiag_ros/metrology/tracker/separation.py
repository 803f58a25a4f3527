"""Positioning and squareness of an axis, separated from the lengths along one line.

A line runs from p0 along its nominal unit vector n; the tracker stands at t, a from p0 along n
(seen backwards: t is at -a) and h beside the line, in the direction m. What the machine really does
to first order is to go (1 + g) w instead of w and to lean by τ towards m:

    L(w)² = |p0 - t + (1 + g) w u|²,  u = cos τ n + sin τ m
          = (1 + g)² w² + 2 (1 + g) w (a cos τ - h sin τ) + a² + h²

So lengths along one straight line determine three numbers and no more: the scale g, the product
a cos τ - h sin τ, and a² + h². Three things follow.

- A lean across the plane of line and tracker changes nothing to first order: one line determines
  one of the axis's two squareness angles, the one towards the tracker.
- With the tracker on the line (h = 0) it determines neither: ∂L/∂τ = -h w / L.
- The lean is known no better than the tracker: a tracker rotated about p0 by some angle gives the
  same lengths as a line that leans by it the other way. With e its error across the beam to p0, in
  the plane of line and tracker, u(τ) ≥ u(e)/|p0 - t|, whatever the noise; and a tracker that was
  located by the same erroneous axis carries that axis's errors. ``joint`` estimates both at once.

The parts of g, ∂L/∂g = w (w + a)/L, and of τ differ as the beam swings around; on a short line far
away both grow like w and cannot be separated, which the correlation coefficient shows.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.adjustment import Adjustment, PoorGeometry, Prior, adjust

_ON_THE_LINE = 3.0
"""The tracker counts as on the line if its offset is less than so many times its uncertainty."""
_LEAST_OFFSET_SHARE = 1e-3
"""... or less than this share of the longest length: the first order is then below the second."""
_WEAK_CORRELATION = 0.95
_LEAST_TARGETS = 3


@dataclass(frozen=True)
class AxisSeparation:
    """Positioning and squareness of the axis along one line.

    Attributes:
        scale: positioning error per length g, m/m.
        lean: τ, right-handed turn of the line from n towards ``towards``, rad.
        covariance: of scale and lean, shape (2, 2).
        correlation: coefficient of scale and lean, -1..1.
        towards: unit vector m from the line to the tracker, shape (3,).
        offset: h of the tracker from the line, m.
        along: a, position of the line's start from the tracker's foot on the line, m.
        residuals: what neither explains: lengths less the fit, m, shape (n,).
        adjustment: of scale, lean, the station's x, y, z and the start length.
        remarks: in words.
    """

    scale: float
    lean: float
    covariance: Vector
    correlation: float
    towards: Vector
    offset: float
    along: float
    residuals: Vector
    adjustment: Adjustment
    remarks: tuple[str, ...]

    @property
    def standard_uncertainty(self) -> tuple[float, float]:
        """Return the standard uncertainties of scale and lean, m/m and rad."""
        return float(np.sqrt(self.covariance[0, 0])), float(np.sqrt(self.covariance[1, 1]))


def geometry_of_line(points: Vector, station: Vector) -> tuple[Vector, Vector, float, float]:
    """Return n, m, a and h of a line as a station sees it; see the module.

    Args:
        points: commanded targets on one straight line, in order, m, shape (n, 3).
        station: m, shape (3,).

    Returns:
        direction n, direction m towards the station (0 if it is on the line), a, h.

    Raises:
        ValueError: fewer than three targets, or targets that are not on one line.
    """
    points = np.asarray(points, dtype=np.float64)
    way = points - points[0]
    farthest = int(np.argmax(np.linalg.norm(way, axis=1)))
    if len(np.unique(np.round(points, 9), axis=0)) < _LEAST_TARGETS:
        raise Refusal(f"a line needs {_LEAST_TARGETS} or more different targets", fault="too_few")
    direction = way[farthest] / np.linalg.norm(way[farthest])
    across = way - np.outer(way @ direction, direction)
    if np.max(np.linalg.norm(across, axis=1)) > 1e-6:
        raise Refusal("the targets are not on one straight line", fault="mismatch")
    back = np.asarray(station) - points[0]
    along = -float(back @ direction)
    beside = back + along * direction
    offset = float(np.linalg.norm(beside))
    towards = beside / offset if offset > 0 else np.zeros(3)
    return direction, towards, along, offset


def line_model(
    points: Vector, direction: Vector, towards: Vector, parameters: Vector
) -> tuple[Vector, Vector]:
    """Return the length changes along a line and their derivatives.

    Args:
        points: commanded targets, m, shape (n, 3); the line rotates about the first.
        direction: n.
        towards: m.
        parameters: scale, lean, station x, y, z, start length; shape (6,).
    """
    scale, lean = parameters[:2]
    ways = (points - points[0]) @ direction
    leaning = np.cos(lean) * direction + np.sin(lean) * towards
    turning = -np.sin(lean) * direction + np.cos(lean) * towards
    beam = points[0] + (1.0 + scale) * np.outer(ways, leaning) - parameters[2:5]
    length = np.linalg.norm(beam, axis=1)
    unit = beam / length[:, None]
    derivatives = np.column_stack(
        [
            ways * (unit @ leaning),
            (1.0 + scale) * ways * (unit @ turning),
            -unit,
            -np.ones(len(ways)),
        ]
    )
    return length - parameters[5], derivatives


def separate(
    points: Vector,
    changes: Vector,
    uncertainty: Vector | float,
    station: Vector,
    station_covariance: Vector | None = None,
    start_length: float | None = None,
) -> AxisSeparation:
    """Separate positioning and squareness from the lengths along one line.

    Args:
        points: commanded targets in any order but on one line, the first being where the line
            turns, m, shape (n, 3).
        changes: of the length since the counter was zeroed, m, shape (n,).
        uncertainty: standard uncertainty of each, m; NaN if unknown.
        station: where the tracker stands, m, shape (3,), from somewhere else than this line.
        station_covariance: of the station, m², shape (3, 3), or of station and start length, shape
            (4, 4); None if both are taken as exact.
        start_length: L0 if the counter was not zeroed since the tracker was located; None if this
            line has a zero of its own.

    Raises:
        PoorGeometry: the tracker is on the line, or the line does not separate scale and lean.
        ValueError: the targets are not a line, or shapes do not fit.
    """
    points = np.asarray(points, dtype=np.float64)
    changes = np.asarray(changes, dtype=np.float64)
    station = np.asarray(station, dtype=np.float64)
    direction, towards, along, offset = geometry_of_line(points, station)
    _refuse_on_the_line(points, station, towards, offset, station_covariance)
    known = 3 if start_length is None else 4
    if station_covariance is None:
        covariance = np.zeros((known, known))
    else:
        covariance = np.asarray(station_covariance, dtype=np.float64)[:known, :known]
        if covariance.shape != (known, known):
            raise ValueError(
                f"the covariance of the station must have the shape ({known}, {known})"
            )
    # Nothing is known exactly; a picometre keeps the weights finite.
    covariance = covariance + 1e-24 * np.eye(known)
    begin = float(np.linalg.norm(points[0] - station))
    zero = start_length if start_length is not None else begin - float(changes[0])
    start = np.concatenate([[0.0, 0.0], station, [zero]])
    prior = Prior(tuple(range(2, 2 + known)), start[2 : 2 + known], covariance)
    spread = np.array(np.broadcast_to(np.asarray(uncertainty, dtype=np.float64), changes.shape))
    try:
        fit = adjust(
            lambda at: line_model(points, direction, towards, at), changes, spread, start, prior
        )
    except PoorGeometry:
        raise PoorGeometry(
            "positioning and squareness cannot be separated on this line: the tracker is"
            f" {offset * 1e3:.4g} mm beside it and the beam keeps its direction. Place it beside"
            " the middle of the line, or also measure lines in other directions"
        ) from None
    both = fit.covariance[:2, :2]
    correlation = float(both[0, 1] / np.sqrt(both[0, 0] * both[1, 1]))
    return AxisSeparation(
        scale=float(fit.parameters[0]),
        lean=float(fit.parameters[1]),
        covariance=both,
        correlation=correlation,
        towards=towards,
        offset=offset,
        along=along,
        residuals=fit.residuals,
        adjustment=fit,
        remarks=tuple(_remarks(fit, station_covariance, correlation)),
    )


def expected(
    points: Vector,
    uncertainty: float,
    station: Vector,
    station_covariance: Vector | None = None,
) -> Vector:
    """Return the covariance of scale and lean that a line will have, before it is measured, (2, 2).

    The same adjustment on a perfect machine; for arguments and errors see ``separate``.
    """
    ideal = np.linalg.norm(np.asarray(points) - np.asarray(station), axis=1)
    made = separate(points, ideal - ideal[0], uncertainty, station, station_covariance)
    return made.covariance


def _refuse_on_the_line(
    points: Vector,
    station: Vector,
    towards: Vector,
    offset: float,
    covariance: Vector | None,
) -> None:
    longest = float(np.max(np.linalg.norm(points - station, axis=1)))
    least = _LEAST_OFFSET_SHARE * longest
    if covariance is not None:
        variance = float(towards @ np.asarray(covariance)[:3, :3] @ towards)
        least = max(least, _ON_THE_LINE * float(np.sqrt(max(variance, 0.0))))
    if offset < least:
        raise PoorGeometry(
            f"the tracker is on the line (offset {offset * 1e3:.3g} mm, needed {least * 1e3:.3g} mm"
            " or more): a lean of the line then changes no length to first order, so its"
            " squareness cannot be determined. Move tracker or line sideways",
            fault="out_of_range",
            aspect="offset",
        )


def _remarks(fit: Adjustment, covariance: Vector | None, correlation: float) -> list[str]:
    said = [
        "Of the axis's two squareness angles, this line determines the one towards the tracker;"
        " straightness that bends the line is in both figures."
    ]
    if covariance is None:
        said.append(
            "The tracker's place was taken as exact; an error of it across the beam to the line's"
            " start, over that distance, is an error of the lean."
        )
    if abs(correlation) > _WEAK_CORRELATION:
        said.append(
            f"Scale and lean are hardly separable here (correlation {correlation:+.3f}): only"
            " together are they as certain as the lengths."
        )
    if fit.estimated:
        said.append("The uncertainty of the lengths was taken from the residuals.")
    return said
