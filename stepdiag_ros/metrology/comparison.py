"""A result beside directly measured errors: differences, and whether they can be chance.

Curves are compared in what both measurements determine: positioning and angles from their first
common position, straightness as deviations from its least-squares line over the common positions,
since its slope depends on how the straightedge lay. Squareness is compared as such. The normalised
error

    E_n = (identified - direct) / (U_identified² + U_direct²)^½,  U = 2 u  (ISO 13528:2022, 9.7)

lies within ±1 where the two agree.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.direct import DirectCurve, DirectMeasurement
from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import TRANSLATIONS, Vector, curve_unit, moving_axis
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.solvers.summary import deviations_from_line, slope_weights

COVERAGE = 2.0
"""k of the expanded uncertainties in E_n."""
_FIXED = 1e-15
"""Below this standard uncertainty a point is fixed by the comparison itself (its first one)."""
_SLOPE_OF = {"E_XY": ("C0Y", "E_YX"), "E_XZ": ("B0Z", "E_ZX"), "E_ZY": ("A0Z", "E_YZ")}
"""Curve whose slope is not fixed by the frame → the squareness and the other curve that
determine it.
"""


@dataclass(frozen=True)
class CurveComparison:
    """One curve by both methods, at the positions of the direct measurement.

    Attributes:
        name: ISO 230-1 name.
        unit: ``m`` or ``rad``.
        reference: what the values are counted from, in words.
        positions: machine coordinates, m, shape (n,).
        identified: by the solver, shape (n,).
        identified_uncertainty: standard uncertainties, shape (n,); NaN where unknown.
        direct: mean of the direct measurement, shape (n,).
        direct_uncertainty: standard uncertainties, shape (n,); NaN where unknown.
    """

    name: str
    unit: str
    reference: str
    positions: Vector
    identified: Vector
    identified_uncertainty: Vector
    direct: Vector
    direct_uncertainty: Vector

    @property
    def difference(self) -> Vector:
        """Return identified minus direct, shape (n,)."""
        return self.identified - self.direct

    @property
    def normalised_error(self) -> Vector:
        """Return E_n, shape (n,); NaN where an uncertainty is unknown or the point is fixed."""
        return normalised_error(
            self.difference, np.hypot(self.identified_uncertainty, self.direct_uncertainty)
        )

    @property
    def range_identified(self) -> float:
        """Return the largest minus the smallest value: the straightness, where it is one."""
        return float(np.ptp(self.identified))

    @property
    def range_direct(self) -> float:
        """Return the same of the direct measurement."""
        return float(np.ptp(self.direct))


@dataclass(frozen=True)
class SquarenessComparison:
    """One squareness by both methods, as right-handed rotation, rad.

    Attributes:
        name: C0Y, B0Z or A0Z.
        identified: by the solver.
        identified_uncertainty: standard uncertainty; NaN if unknown.
        direct: mean of the direct measurement.
        direct_uncertainty: standard uncertainty; NaN if unknown.
    """

    name: str
    identified: float
    identified_uncertainty: float
    direct: float
    direct_uncertainty: float

    @property
    def difference(self) -> float:
        """Return identified minus direct, rad."""
        return self.identified - self.direct

    @property
    def normalised_error(self) -> float:
        """Return E_n; NaN where an uncertainty is unknown."""
        combined = np.hypot(self.identified_uncertainty, self.direct_uncertainty)
        return float(normalised_error(np.array([self.difference]), np.array([combined]))[0])


@dataclass(frozen=True)
class DirectComparison:
    """A result beside a direct measurement.

    Attributes:
        method: of the result.
        curves: those that both have.
        squareness: those that both have.
        not_compared: name → why not, for what was measured directly all the same.
    """

    method: str
    curves: tuple[CurveComparison, ...]
    squareness: tuple[SquarenessComparison, ...]
    not_compared: dict[str, str]


def normalised_error(difference: Vector, standard_uncertainty: Vector) -> Vector:
    """Return E_n of differences with their combined standard uncertainty; NaN where not defined."""
    expanded = COVERAGE * np.where(standard_uncertainty > _FIXED, standard_uncertainty, np.nan)
    found: Vector = difference / expanded
    return found


def compare_directly(result: VolumetricErrors, direct: DirectMeasurement) -> DirectComparison:
    """Compare a result with what was measured directly.

    Between nodes the identified curve is taken as straight lines.

    Raises:
        ValueError: a direct curve reaches beyond the measured travel; names it.
    """
    curves, squareness = [], []
    reasons: dict[str, str] = {}
    for name, curve in direct.curves.items():
        if name not in result.curves:
            reasons[name] = "which it does not estimate"
            continue
        compared = _compare_curve(result, curve)
        if np.any(np.isnan(compared.identified)):
            reasons[name] = "which these lines do not determine"
            continue
        curves.append(compared)
    known = {figure.name: figure for figure in result.figures}
    for name, angle in direct.squareness.items():
        if name not in known or np.isnan(known[name].value):
            reasons[name] = "which these lines do not determine"
            continue
        squareness.append(
            SquarenessComparison(
                name,
                known[name].value,
                known[name].standard_uncertainty,
                angle.mean,
                angle.standard_uncertainty,
            )
        )
    return DirectComparison(result.method, tuple(curves), tuple(squareness), reasons)


def _compare_curve(result: VolumetricErrors, curve: DirectCurve) -> CurveComparison:
    axis = moving_axis(curve.name)
    at = curve.interpolation(result.nodes[axis])
    straightness = curve.name in TRANSLATIONS and curve.name[2] != curve.name[3]
    if straightness:
        reduce = deviations_from_line(curve.positions)
        reference = "deviation from the least-squares line"
    else:
        reduce = np.eye(len(curve.positions))
        reduce[:, 0] -= 1.0
        reference = "from the first position"
    identified = reduce @ at
    place = list(result.curves).index(curve.name) * len(result.nodes[axis])
    covariance = np.full((at.shape[1], at.shape[1]), np.nan)
    if result.covariance.size:
        covariance = result.covariance[place : place + at.shape[1], place : place + at.shape[1]]
    variance = np.sum((identified @ covariance) * identified, axis=1)
    direct, direct_uncertainty = curve.evaluate(reduce)
    return CurveComparison(
        name=curve.name,
        unit=curve_unit(curve.name),
        reference=reference,
        positions=curve.positions,
        identified=identified @ result.curves[curve.name],
        identified_uncertainty=np.sqrt(np.maximum(variance, 0.0)),
        direct=direct,
        direct_uncertainty=direct_uncertainty,
    )


def in_result_frame(direct: DirectMeasurement) -> dict[str, Vector]:
    """Return the repeats of direct curves as a result in the frame of IH eq. (17) would have them.

    Ibaraki & Hata combine measured straightness with measured squareness for the normal errors in
    Figs. 7 to 9 (section 4.1): E_YX, E_ZX and E_YZ end at zero; E_XY, E_XZ and E_ZY get the slope
    that the squareness and the other curve of its pair leave. All begin at zero. Repeats of a
    curve are combined with the mean squareness.

    Returns:
        name → m or rad, shape (repeats, n), for the curves whose slope is known.
    """
    found: dict[str, Vector] = {}
    for name, curve in direct.curves.items():
        from_start = curve.values - curve.values[:, :1]
        way = curve.positions - curve.positions[0]
        if name in ("E_YX", "E_ZX", "E_YZ"):
            found[name] = from_start - np.outer(from_start[:, -1], way / way[-1])
        elif name not in _SLOPE_OF:
            found[name] = from_start
    for name, (angle, other) in _SLOPE_OF.items():
        if name not in direct.curves or angle not in direct.squareness or other not in found:
            continue
        curve = direct.curves[name]
        partner = float(np.mean(found[other] @ slope_weights(direct.curves[other].positions)))
        wanted = SQUARENESS_SLOPES[angle][0] * direct.squareness[angle].mean - partner
        own = curve.values @ slope_weights(curve.positions)
        way = curve.positions - curve.positions[0]
        turned = curve.values + np.outer(wanted - own, way)
        found[name] = turned - turned[:, :1]
    return found
