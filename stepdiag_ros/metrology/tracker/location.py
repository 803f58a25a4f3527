"""Where the tracker stands: from the length changes at six or more places of the reflector.

ATLI eq. 1. With |p_i - t| = L0 + ΔL_i squared,

    2 p_i·t + 2 ΔL_i L0 - ζ = |p_i|² - ΔL_i²,      ζ = |t|² - L0²

is linear in t, L0, ζ: five unknowns, solved by the pseudo-inverse (what is printed as exponent T).
It takes ζ for free, so it wastes a reading and needs points that are not in one plane. From there
the lengths themselves are adjusted for t and L0 alone:

    ΔL_i = |p_i - t| - L0,       ∂ΔL_i/∂t = -u_i,   ∂ΔL_i/∂L0 = -1

with u_i the unit vector from the tracker to the point. So the geometry is as good as the directions
are different: it fails where all u_i lie on one circle of the sphere of directions, which is one
plane through the tracker or one cone around it, and it is poor where they come near to that or fill
a small part of the sphere only. Equal lengths (points on a sphere about the tracker) do no harm by
themselves: eq. 1 then leaves L0 open, but not ζ, and L0 = √(|t|² - ζ).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal, fields_of
from stepdiag_ros.metrology.tracker.adjustment import Adjustment, PoorGeometry, adjust

LEAST_POINTS = 6
_FLAT = 1e-4
"""Points are in one plane if they leave it by less than this share of their extent."""
_POOR_DILUTION = 10.0
_NARROW = np.radians(25.0)
_SHORT_SHARE = 1e-3
_CHANCE = 0.01
_MACHINE_REMARK = (
    "The places are those commanded. What the machine does otherwise moves the tracker's estimated"
    " position beyond the uncertainty given here, which knows of the lengths alone."
)


@dataclass(frozen=True)
class Location:
    """Where the tracker stands.

    Attributes:
        position: of the station, machine coordinates, m, shape (3,).
        start_length: L0, the length where the counter was zeroed, m.
        covariance: of position and L0, m², shape (4, 4); NaN if not known. Widened by the Birge
            ratio where the residuals are larger than chance allows.
        linear: position and L0 by ATLI eq. 1 alone, m, shape (4,); NaN where undetermined.
        adjustment: residuals, fit and condition number.
        dilution: u(position) per unit of a length's standard uncertainty, root sum of squares.
        points: that were used, m, shape (n, 3).
        warnings: what is wrong with geometry or readings, in words; empty if nothing is.
        remarks: what the reader must know, in words.
    """

    position: Vector
    start_length: float
    covariance: Vector
    linear: Vector
    adjustment: Adjustment
    dilution: float
    points: Vector
    warnings: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def standard_uncertainty(self) -> Vector:
        """Return the standard uncertainties of x, y, z and L0, m, shape (4,)."""
        made: Vector = np.sqrt(np.diag(self.covariance))
        return made


def linear_location(points: Vector, changes: Vector) -> Vector:
    """Return x, y, z of the station and L0 by ATLI eq. 1, m, shape (4,).

    Points are taken from their mean and in units of their extent, so that no large number hides a
    small one.

    Args:
        points: commanded places, m, shape (n, 3), n ≥ 6.
        changes: of the length since the counter was zeroed, m, shape (n,).

    Raises:
        PoorGeometry: the points are in one plane, or L0 comes out imaginary.
    """
    centre = points.mean(axis=0)
    extent = float(np.max(np.linalg.norm(points - centre, axis=1)))
    if extent == 0.0:
        raise PoorGeometry("all points are the same; go to places in all three directions")
    near, length = (points - centre) / extent, changes / extent
    design = np.column_stack([2.0 * near, 2.0 * length, -np.ones(len(near))])
    right = np.sum(near**2, axis=1) - length**2
    u, s, vt = np.linalg.svd(design, full_matrices=False)
    seen = s > 1e-12 * s[0]
    solution = vt[seen].T @ ((u[:, seen].T @ right) / s[seen])
    place, start, zeta = solution[:3], solution[3], solution[4]
    # Equal lengths leave L0 open; ζ is known then.
    if np.linalg.norm(length - length.mean()) < 1e-9:
        squared = float(place @ place - zeta)
        if squared <= 0:
            raise PoorGeometry("no place of the tracker fits these lengths")
        start = np.sqrt(squared) - length.mean()
    return np.append(centre + extent * place, extent * start)


def station_model(points: Vector, parameters: Vector) -> tuple[Vector, Vector]:
    """Return the length changes at points and their derivatives by x, y, z of the station and L0.

    Args:
        points: m, shape (n, 3).
        parameters: station and L0, m, shape (4,).
    """
    way = points - parameters[:3]
    length = np.linalg.norm(way, axis=1)
    derivatives = np.column_stack([-way / length[:, None], -np.ones(len(way))])
    return length - parameters[3], derivatives


def locate(
    points: Vector,
    changes: Vector,
    uncertainty: Vector | float = np.nan,
    *,
    names: Sequence[str] = (),
    near: Vector | None = None,
    minimum_range: float = 0.0,
) -> Location:
    """Find the tracker from length changes at six or more places (ATLI eq. 1, then refined).

    Args:
        points: commanded places of the reflector, machine coordinates, m, shape (n, 3).
        changes: of the length since the counter was zeroed, m, shape (n,).
        uncertainty: standard uncertainty of each length, m; NaN if unknown, then estimated from the
            residuals. How well the machine reaches its places belongs to it where it is known.
        names: of the points, for warnings.
        near: rough place of the tracker, m, shape (3,); needed where all points are in one plane,
            because two places mirrored in that plane then fit alike.
        minimum_range: of the tracker, m: points nearer than that are warned of.

    Raises:
        PoorGeometry: fewer than six places, places that do not determine where the tracker is, or
            places in one plane without ``near``.
        ValueError: shapes that do not fit, or values that are not finite.
    """
    points = np.asarray(points, dtype=np.float64)
    changes = np.asarray(changes, dtype=np.float64)
    if points.ndim != 2 or points.shape[1:] != (3,) or changes.shape != (len(points),):
        raise Refusal(
            "expected one length change and three coordinates for each place",
            fault="mismatch",
            aspect="shape",
        )
    if not (np.all(np.isfinite(points)) and np.all(np.isfinite(changes))):
        raise Refusal(
            "a place or a length of the tracker's location is not finite",
            fault="out_of_range",
            aspect="value",
        )
    different = len(np.unique(np.round(points, 9), axis=0))
    if different < LEAST_POINTS:
        raise PoorGeometry(
            f"{different} different places; the tracker is located from {LEAST_POINTS} or more",
            fault="too_few",
            aspect="places",
        )
    spread = np.broadcast_to(np.asarray(uncertainty, dtype=np.float64), changes.shape)
    flat, normal = _flatness(points)
    warnings: list[str] = []
    try:
        linear = np.full(4, np.nan) if flat else linear_location(points, changes)
        start = linear
        if near is not None:
            place = np.asarray(near, dtype=np.float64)
            length = np.linalg.norm(points - place, axis=1)
            start = np.append(place, np.mean(length - changes))
        elif flat:
            raise PoorGeometry(
                "all places are in one plane, and two places of the tracker mirrored in it fit"
                " alike; go to a place outside of the plane, or state roughly where it stands",
                fault="ambiguous",
            )
        fit = adjust(lambda at: station_model(points, at), changes, np.array(spread), start)
    except PoorGeometry as error:
        raise PoorGeometry(f"the tracker cannot be located: {error}", **fields_of(error)) from None
    if flat:
        side = "above" if float(normal @ (fit.parameters[:3] - points[0])) > 0 else "below"
        warnings.append(
            "All places are in one plane: which side of it the tracker is on was taken from its"
            f" rough place ({side}, as seen along {_words(normal)})."
        )
    found = fit.parameters
    lengths = np.linalg.norm(points - found[:3], axis=1)
    dilution = dilution_of(points, found[:3])
    warnings += geometry_warnings(points, found[:3])
    if minimum_range and lengths.min() < minimum_range:
        warnings.append(
            f"{_name(names, int(lengths.argmin()))} is {lengths.min() * 1e3:.1f} mm from the"
            f" tracker, nearer than its shortest length of {minimum_range * 1e3:g} mm."
        )
    misfit = misfit_of(fit)
    covariance = fit.covariance * misfit**2
    position_uncertainty = float(np.sqrt(np.trace(covariance[:3, :3])))
    if position_uncertainty > _SHORT_SHARE * lengths.min():
        warnings.append(
            f"The position is known to {position_uncertainty * 1e6:.3g} µm only and the shortest"
            f" length is {lengths.min() * 1e3:.1f} mm: the length is no longer linear over that,"
            " and the uncertainty is a rough one."
        )
    warnings += fit_warnings(fit, names)
    remarks = [_MACHINE_REMARK]
    if fit.estimated:
        remarks.append(_noise_remark(fit))
    if misfit > 1.0:
        remarks.append(
            f"The uncertainty of the position is widened by {misfit:.3g}, the size of the residuals"
            " against what was expected of them (Birge ratio)."
        )
    return Location(
        position=found[:3],
        start_length=float(found[3]),
        covariance=covariance,
        linear=linear,
        adjustment=fit,
        dilution=dilution,
        points=points,
        warnings=tuple(warnings),
        remarks=tuple(remarks),
    )


def dilution_of(points: Vector, station: Vector) -> float:
    """Return u(position)/u(length) of places seen from a station; infinite if not determined."""
    _, rows = station_model(np.asarray(points), np.append(station, 0.0))
    _, s, vt = np.linalg.svd(rows, full_matrices=False)
    if len(s) < 4 or s[-1] < 1e-12 * s[0]:
        return float("inf")
    return float(np.sqrt(np.sum((vt[:, :3] / s[:, None]) ** 2)))


def geometry_warnings(points: Vector, station: Vector) -> list[str]:
    """Say in words what is poor about the places as seen from the tracker; nothing if all is well.

    The weakest combination of the unknowns is (n, c) with n·u_i + c nearly zero: all directions
    lie near the circle of the unit sphere that the plane n·u = -c cuts out of it.
    """
    dilution = dilution_of(points, station)
    if dilution <= _POOR_DILUTION:
        return []
    way = np.asarray(points) - station
    unit = way / np.linalg.norm(way, axis=1)[:, None]
    mean = unit.mean(axis=0)
    axis = mean / max(float(np.linalg.norm(mean)), 1e-12)
    widest = float(np.max(np.arccos(np.clip(unit @ axis, -1.0, 1.0))))
    vt = np.linalg.svd(np.column_stack([unit, np.ones(len(unit))]), full_matrices=False)[2]
    normal, constant = vt[-1, :3], vt[-1, 3]
    size = max(float(np.linalg.norm(normal)), 1e-12)
    cosine = float(np.clip(-constant / size, -1.0, 1.0))
    if widest < _NARROW:
        why = (
            f"all places are seen within {np.degrees(widest):.0f}° of one direction; go to places"
            " on more sides of the tracker"
        )
    elif abs(cosine) < 0.1:
        why = (
            f"places and tracker are nearly in one plane, square to {_words(normal / size)}; go to"
            " places out of it"
        )
    else:
        if cosine < 0:
            cosine, normal = -cosine, -normal
        why = (
            f"all places are seen nearly at the same angle of {np.degrees(np.arccos(cosine)):.0f}°"
            f" to {_words(normal / size)}; go to a place nearer to that direction"
        )
    worse = f"{dilution:.0f}" if np.isfinite(dilution) else "infinitely many"
    return [f"Poor geometry: the position is {worse} times less certain than a length: {why}."]


def misfit_of(fit: Adjustment) -> float:
    """Return √(χ²/ν) where it is larger than chance allows (1 in 100), else 1."""
    freedom = fit.degrees_of_freedom
    if freedom <= 0 or not np.isfinite(fit.chi_squared):
        return 1.0
    from scipy.special import chdtrc

    if float(chdtrc(freedom, fit.chi_squared)) >= _CHANCE:
        return 1.0
    return max(1.0, float(np.sqrt(fit.chi_squared / freedom)))


def fit_warnings(fit: Adjustment, names: Sequence[str]) -> list[str]:
    """Say in words whether the residuals are too large, and which reading is the worst."""
    said = []
    misfit = misfit_of(fit)
    if misfit > 1.0:
        said.append(
            f"The residuals are {misfit:.3g} times as large as the uncertainty of the lengths lets"
            f" expect (χ² = {fit.chi_squared:.3g} with {fit.degrees_of_freedom} degrees of"
            " freedom): the machine did not reach its places as well as that, or a reading is"
            " wrong."
        )
    # A residual is weighed against noise that is known; noise made of the residuals hides outliers.
    suspicious = [] if fit.estimated else fit.suspicious()
    if suspicious:
        worst = suspicious[0]
        said.append(
            f"{_name(names, worst)}: the residual of {fit.residuals[worst] * 1e6:.3g} µm is"
            f" {abs(fit.standardised[worst]):.3g} times its standard uncertainty, the largest of"
            " all; look at this reading first."
        )
    return said


def _noise_remark(fit: Adjustment) -> str:
    if not np.isfinite(fit.uncertainty[0]):
        return (
            "The lengths have no uncertainty, and no residual is left to estimate one from:"
            " the uncertainty of the position is unknown."
        )
    return (
        f"The lengths have no uncertainty: {fit.uncertainty[0] * 1e6:.3g} µm was taken from the"
        f" residuals ({fit.degrees_of_freedom} degrees of freedom)."
    )


def _flatness(points: Vector) -> tuple[bool, Vector]:
    """Say whether points are in one plane, and give the plane's normal."""
    _, s, vt = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    return bool(s[-1] < _FLAT * s[0]), vt[-1]


def _name(names: Sequence[str], index: int) -> str:
    return names[index] if index < len(names) else f"place {index + 1}"


def _words(direction: Vector) -> str:
    """Write a direction, up to its sign, as numbers or as the axis that it is along."""
    largest = int(np.argmax(np.abs(direction)))
    if abs(direction[largest]) > 0.999:
        return "XYZ"[largest]
    return "({:.2f}, {:.2f}, {:.2f})".format(*(direction * np.sign(direction[largest])))
