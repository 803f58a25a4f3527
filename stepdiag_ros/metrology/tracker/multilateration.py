"""Points from lengths to several places of a tracker, with the tracker's places among the unknowns.

Each reading is l_ik = |p_i - t_k| - L0_k. Unknown are the points p_i, the stations t_k and their
start lengths L0_k; nothing but lengths is taken from the instrument, and of the machine only where
the points are to within some millimetres, to begin with. n points seen from m stations give n m
readings for 3 n + 4 m - 6 unknowns, so at least four stations and ten points. One tracker may take
the stations one after the other; the machine's repeatability is then part of a reading's
uncertainty.

Lengths leave the frame free. It is fixed by the points as a whole (inner constraints): their
displacements from the commanded places have no mean and no mean rotation,

    Σ (p_i - q_i) = 0,     Σ (q_i - q̄) × (p_i - q_i) = 0,

so no single point is taken as perfect. The points are eliminated station by station (Schur
complement), so the effort grows with the number of points alone.

Uncertainties are those of the lengths, and more where the residuals are larger than these: drift
of the zero and a machine that does not come back to its places add to them. Such an excess is
partly common to places that follow each other, and then the fewer independent readings it leaves
make it count more than once; it is counted twice. The part of a length's uncertainty that grows
with the length is taken as common to all readings, too, as an error of the wavelength is. Where the
lengths come without uncertainty, that of the points is estimated from the residuals and widened so
that 1.96 u is the coverage interval of Student's distribution.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.solvers.noise_factor import widening
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.lengths import proportional_share

LEAST_STATIONS = 4
_FREE = 6
_NOTHING = 1e-9
_MOST_STEPS = 50
_LEAST_PER_POINT = 3
_COUNTED = 2.0
"""How often the variance of the residuals beyond that of the lengths counts; see the module."""
POINT_FRAME = (
    "displacements of all points from their commanded places have no mean and no mean rotation"
)


@dataclass(frozen=True)
class Points:
    """Multilaterated points.

    Attributes:
        commanded: places q_i, machine coordinates, m, shape (n, 3).
        position: p_i, m, shape (n, 3).
        stations: t_k, m, shape (m, 3).
        start_lengths: L0_k, m, shape (m,).
        residuals: m, shape (n, m); NaN where not read.
        uncertainty: standard uncertainty of a length, given or estimated, m, shape (n, m).
        degrees_of_freedom: readings less unknowns that lengths determine.
        chi_squared: NaN if the uncertainty was estimated from the fit.
        remarks: in words.
        frame: in words.
    """

    commanded: Vector
    position: Vector
    stations: Vector
    start_lengths: Vector
    residuals: Vector
    uncertainty: Vector
    degrees_of_freedom: int
    chi_squared: float
    remarks: tuple[str, ...]
    frame: str
    _own: Vector
    _common: Vector

    @property
    def displacement(self) -> Vector:
        """Return p_i - q_i, m, shape (n, 3)."""
        made: Vector = self.position - self.commanded
        return made

    def covariance_of(self, functionals: Vector) -> Vector:
        """Return the covariance of linear functionals of the points, in the frame.

        Args:
            functionals: on x, y, z of all points in turn, shape (r, 3n).

        Returns:
            shape (r, r).
        """
        framed = np.asarray(functionals) - (functionals @ self._turns) @ self._frame_rows
        blocks = framed.reshape(len(framed), -1, 3)
        own = np.einsum("rni,nij,snj->rs", blocks, self._own, blocks, optimize=True)
        common = framed @ self._common
        made: Vector = own + common @ common.T
        return made

    @property
    def standard_uncertainty(self) -> Vector:
        """Return the standard uncertainties of x, y, z of all points, m, shape (n, 3)."""
        # Row by row: the projector into the frame has rank six, so no large matrix is needed.
        turns, rows = self._turns, self._frame_rows
        made = np.empty(3 * len(self.position))
        for start in range(0, len(made), 300):
            part = np.zeros((min(300, len(made) - start), len(made)))
            part[np.arange(len(part)), start + np.arange(len(part))] = 1.0
            framed = part - (part @ turns) @ rows
            blocks = framed.reshape(len(framed), -1, 3)
            own = np.einsum("rni,nij,rnj->r", blocks, self._own, blocks, optimize=True)
            made[start : start + len(part)] = own + np.sum((framed @ self._common) ** 2, axis=1)
        uncertainty: Vector = np.sqrt(made).reshape(-1, 3)
        return uncertainty

    @property
    def _turns(self) -> Vector:
        return rigid_motions(self.commanded)

    @property
    def _frame_rows(self) -> Vector:
        made: Vector = np.asarray(np.linalg.pinv(self._turns), dtype=np.float64)
        return made


def rigid_motions(points: Vector) -> Vector:
    """Return the displacements of points by three shifts and three rotations about their mean.

    Turns are counted in the points' extent, so that all six columns are alike.

    Args:
        points: m, shape (n, 3).

    Returns:
        shape (3n, 6).
    """
    near = points - points.mean(axis=0)
    near = near / max(float(np.max(np.abs(near))), 1e-12)
    columns = [np.tile(axis, len(points)) for axis in np.eye(3)]
    columns += [np.cross(axis, near).ravel() for axis in np.eye(3)]
    made: Vector = np.column_stack(columns)
    return made


def multilaterate(
    commanded: Vector,
    changes: Vector,
    uncertainty: Vector | float,
    stations: Vector,
    start_lengths: Vector,
    names: Sequence[str] = (),
) -> Points:
    """Find points, stations and start lengths from lengths alone.

    Args:
        commanded: places, m, shape (n, 3), all different.
        changes: length changes at point i from station k, m, shape (n, m); NaN where not read.
        uncertainty: standard uncertainties, m, shape (n, m) or one for all; NaN if unknown.
        stations: rough places, m, shape (m, 3), see ``location.locate``.
        start_lengths: rough L0, m, shape (m,).
        names: of the stations, for refusals.

    Raises:
        PoorGeometry: too few stations or points, or stations and points that lengths alone
            do not separate.
        ValueError: shapes that do not fit.
    """
    commanded = np.asarray(commanded, dtype=np.float64)
    changes = np.asarray(changes, dtype=np.float64)
    count, many = changes.shape
    if commanded.shape != (count, 3) or np.shape(stations) != (many, 3):
        raise ValueError("expected one row of lengths for each point and one column a station")
    read = np.isfinite(changes)
    freedom = _check_counts(read, names)
    given = np.array(np.broadcast_to(np.asarray(uncertainty, dtype=np.float64), changes.shape))
    known = bool(np.all(np.isfinite(given[read])))
    if not known and bool(np.any(np.isfinite(given[read]))):
        raise ValueError("some lengths have an uncertainty and some have none; give all or none")
    if known and bool(np.any(given[read] <= 0)):
        raise ValueError("the uncertainty of a length is not more than zero")
    spread = given if known else np.ones(changes.shape)
    weight = np.where(read, 1.0 / spread**2, 0.0)
    points, places = commanded.copy(), np.array(stations, dtype=np.float64)
    starts = np.array(start_lengths, dtype=np.float64)
    for _ in range(_MOST_STEPS):
        residual, unit = _residuals(points, places, starts, changes)
        own, coupling, inverse, right_points = _eliminated(residual, unit, weight)
        step_points, step_stations = _solve(
            own, coupling, inverse, right_points, residual, unit, weight
        )
        points = points + step_points
        places = places + step_stations[:, :3]
        starts = starts + step_stations[:, 3]
        if max(np.max(np.abs(step_points)), np.max(np.abs(step_stations))) < 1e-12:
            break
    else:
        raise PoorGeometry(
            "the points did not converge: the approximate positions of the stations are too far"
            " off, or stations and points hardly determine each other"
        )
    points, places = _into_frame(commanded, points, places)
    residual, unit = _residuals(points, places, starts, changes)
    own, coupling, inverse, _ = _eliminated(residual, unit, weight)
    chi_squared = float(np.sum(weight * residual**2))
    remarks = []
    scale = wide = 1.0
    shared = 0.0
    if known:
        # A zero that wanders and a machine that does not come back show in the residuals.
        excess = max(chi_squared / freedom - 1.0, 0.0) if freedom else 0.0
        scale = float(np.sqrt(1.0 + _COUNTED * excess))
        shared = proportional_share(spread[read], (changes + starts)[read])
        if scale > 1.0:
            remarks.append(
                f"Uncertainties are {scale:.3g} times as large as those of the lengths make them:"
                " the residuals are larger than these let expect."
            )
    else:
        scale = np.sqrt(chi_squared / freedom) if freedom else np.nan
        wide = float(np.sqrt(widening(freedom)))
        remarks.append(
            f"The lengths have no uncertainty: {scale * 1e6:.3g} µm was taken from the residuals"
            f" ({freedom} degrees of freedom)."
            if freedom
            else "The lengths have no uncertainty and no residuals: that of the points is unknown."
        )
    # A⁻¹ Bᵀ of the points' share in the stations, times a root of the stations' covariance.
    share = np.einsum("nij,nkj->nik", inverse, coupling).reshape(3 * count, -1)
    # A wrong wavelength makes everything larger alike, which no residual shows.
    larger = shared * (points - points.mean(axis=0)).reshape(-1, 1)
    return Points(
        commanded=commanded,
        position=points,
        stations=places,
        start_lengths=starts,
        residuals=np.where(read, residual, np.nan),
        uncertainty=np.where(read, spread if known else spread * scale, np.nan),
        degrees_of_freedom=freedom,
        chi_squared=chi_squared if known else float("nan"),
        remarks=tuple(remarks),
        frame=POINT_FRAME,
        _own=inverse * (wide * scale) ** 2,
        _common=np.hstack([wide * scale * share @ _root_of_inverse(own), larger]),
    )


def _check_counts(read: NDArray[np.bool_], names: Sequence[str]) -> int:
    count, many = read.shape
    if many < LEAST_STATIONS:
        raise PoorGeometry(
            f"{many} stations; multilateration with unknown stations needs {LEAST_STATIONS} or"
            " more",
            fault="too_few",
            aspect="stations",
        )
    few = np.flatnonzero(read.sum(axis=1) < _LEAST_PER_POINT)
    if len(few):
        raise PoorGeometry(
            f"point {few[0] + 1} was read from fewer than {_LEAST_PER_POINT} stations",
            fault="too_few",
            aspect="point",
        )
    freedom: int = int(read.sum()) - (3 * count + 4 * many - _FREE)
    if freedom < 0:
        raise PoorGeometry(
            f"{int(read.sum())} lengths for {3 * count + 4 * many - _FREE} unknowns; measure more"
            " points or from more stations",
            fault="too_few",
            aspect="lengths",
        )
    for station, seen in enumerate(read.sum(axis=0)):
        if seen < LEAST_STATIONS:
            name = names[station] if station < len(names) else str(station + 1)
            raise PoorGeometry(f"station {name}: only {seen} points were read from there")
    return freedom


def _residuals(
    points: Vector, places: Vector, starts: Vector, changes: Vector
) -> tuple[Vector, Vector]:
    """Return readings less predictions, 0 where not read, and unit vectors to the points."""
    way = points[:, None, :] - places[None, :, :]
    length = np.linalg.norm(way, axis=2)
    residual = np.nan_to_num(changes - (length - starts[None, :]), nan=0.0)
    return residual, way / length[:, :, None]


def _eliminated(
    residual: Vector, unit: Vector, weight: Vector
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return the stations' normal matrix without the points, and what gives the points back.

    Parameters of a station are (x, y, z, L0) with the derivatives (-u, -1) of a length.

    Returns:
        reduced matrix (4m, 4m), coupling (n, 4m, 3), inverse of the points' blocks (n, 3, 3) and
        their right sides (n, 3).
    """
    count, many = residual.shape
    normal = np.einsum("nk,nki,nkj->nij", weight, unit, unit)
    values = np.linalg.eigvalsh(normal)
    if np.any(values[:, 0] <= 1e-12 * values[:, 2]):
        worst = int(np.argmin(values[:, 0] / values[:, 2]))
        raise PoorGeometry(
            f"the stations that see point {worst + 1} lie in one plane with it; place one of them"
            " higher or lower"
        )
    inverse = np.linalg.inv(normal)
    row = np.concatenate([-unit, -np.ones((count, many, 1))], axis=2)
    coupling = np.einsum("nk,nka,ni->nkai", weight, row, np.ones((count, 3)))
    coupling = (coupling * unit[:, :, None, :]).reshape(count, 4 * many, 3)
    whole = np.zeros((4 * many, 4 * many))
    for station in range(many):
        part = slice(4 * station, 4 * station + 4)
        whole[part, part] = np.einsum(
            "n,na,nb->ab", weight[:, station], row[:, station], row[:, station]
        )
    reduced = whole - np.einsum("nai,nij,nbj->ab", coupling, inverse, coupling, optimize=True)
    right = np.einsum("nk,nk,nki->ni", weight, residual, unit)
    return 0.5 * (reduced + reduced.T), coupling, inverse, right


def _solve(
    reduced: Vector,
    coupling: Vector,
    inverse: Vector,
    right_points: Vector,
    residual: Vector,
    unit: Vector,
    weight: Vector,
) -> tuple[Vector, Vector]:
    """Return the steps of points (n, 3) and stations (m, 4), the frame left where it is."""
    many = residual.shape[1]
    row = np.concatenate([-unit, -np.ones((*residual.shape, 1))], axis=2)
    right = np.einsum("nk,nk,nka->ka", weight, residual, row).ravel()
    right = right - np.einsum("nai,nij,nj->a", coupling, inverse, right_points, optimize=True)
    root = _root_of_inverse(reduced)
    stations = root @ (root.T @ right)
    points = np.einsum(
        "nij,nj->ni", inverse, right_points - np.einsum("nai,a->ni", coupling, stations)
    )
    return points, stations.reshape(many, 4)


def _root_of_inverse(reduced: Vector) -> Vector:
    """Return a root of the pseudo-inverse of the stations' matrix without its six free directions.

    Raises:
        PoorGeometry: more than these six are free.
    """
    values, vectors = np.linalg.eigh(reduced)
    limit = _NOTHING * values[-1]
    if values[_FREE] <= limit:
        raise PoorGeometry(
            "lengths alone do not determine stations and points. The stations must not lie in one"
            " plane, nor the points in one plane or on a few lines: place one station higher",
            fault="undetermined",
        )
    made: Vector = vectors[:, _FREE:] / np.sqrt(values[_FREE:])
    return made


def _into_frame(commanded: Vector, points: Vector, places: Vector) -> tuple[Vector, Vector]:
    """Shift and turn points and stations as rigid bodies until the inner constraints hold."""
    from stepdiag_ros.metrology.forward import rotation_matrices

    centre = commanded.mean(axis=0)
    turns = rigid_motions(commanded)
    extent = float(np.max(np.abs(commanded - centre)))
    for _ in range(10):
        motion = np.asarray(np.linalg.pinv(turns) @ (points - commanded).ravel(), dtype=np.float64)
        turn = rotation_matrices(-motion[None, 3:] / extent)[0]
        points = (points - centre - motion[:3]) @ turn.T + centre
        places = (places - centre - motion[:3]) @ turn.T + centre
        if np.max(np.abs(motion)) < 1e-15:
            break
    return points, places
