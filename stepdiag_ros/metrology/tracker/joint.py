"""Scales and squareness of all three axes together with the tracker's place, from all readings.

A tracker that is located by an erroneous machine stands in the wrong place, and every line that is
then evaluated from there is bent (ATLI Fig. 5). The cure is to estimate both from the same lengths:

    ΔL = |A (q - c) + c - t| - L0

with A the machine's errors that are constant along its axes, in the frame of the results (mean
slopes of E_YX, E_ZX, E_YZ zero) and c any fixed point:

            1 + s_X    -C0Y       B0Z
    A   =      0      1 + s_Y      0
               0      -A0Z      1 + s_Z

Ten unknowns: three scales, three squareness angles (right-handed), t and L0. The three directions
of the frame are no unknowns: turning machine and tracker together changes no length.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import FRAME, Vector
from stepdiag_ros.metrology.tracker.adjustment import Adjustment, PoorGeometry, adjust
from stepdiag_ros.metrology.tracker.location import fit_warnings, misfit_of, station_model

NAMES = ("scale X", "scale Y", "scale Z", "C0Y", "B0Z", "A0Z")
"""In the order of the parameters; scales in m/m, squareness in rad."""
_PLACES = ((0, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0), (0, 1, -1.0), (0, 2, 1.0), (2, 1, -1.0))
"""Row, column and sign in A of each of ``NAMES``."""


@dataclass(frozen=True)
class JointEstimate:
    """Errors that are constant along the axes, with the tracker's place.

    Attributes:
        values: of ``NAMES``, shape (6,).
        covariance: of them, shape (6, 6); widened by the Birge ratio where the residuals are larger
            than chance allows, as those of straightness and angular errors are.
        position: of the station in the frame of the results, m, shape (3,).
        machine_position: the machine coordinates at which the reflector would meet the tracker, m,
            shape (3,): A⁻¹ of ``position``. Lines are reckoned from there.
        start_length: L0, m.
        adjustment: of all ten unknowns: ``NAMES``, x, y, z, L0.
        frame: of the results, in words.
        warnings: what is wrong with the readings, in words.
    """

    values: Vector
    covariance: Vector
    position: Vector
    machine_position: Vector
    start_length: float
    adjustment: Adjustment
    frame: str
    warnings: tuple[str, ...]

    @property
    def standard_uncertainty(self) -> Vector:
        """Return the standard uncertainties of ``NAMES``, shape (6,)."""
        made: Vector = np.sqrt(np.diag(self.covariance))
        return made


def error_matrix(values: Vector) -> Vector:
    """Return A of these scales and squareness angles (``NAMES``), shape (3, 3)."""
    matrix = np.eye(3)
    for value, (row, column, sign) in zip(values, _PLACES, strict=True):
        matrix[row, column] += sign * value
    return matrix


def affine_points(points: Vector, values: Vector, centre: Vector) -> Vector:
    """Return where a machine with these scales and squareness angles arrives, m, shape (n, 3).

    Args:
        points: commanded, m, shape (n, 3).
        values: of ``NAMES``, shape (6,).
        centre: where there is no error, m, shape (3,).
    """
    made: Vector = (np.asarray(points) - centre) @ error_matrix(values).T + centre
    return made


def estimate(
    points: Vector,
    changes: Vector,
    uncertainty: Vector | float,
    station: Vector,
    start_length: float,
    names: tuple[str, ...] = (),
) -> JointEstimate:
    """Estimate scales, squareness and the tracker's place together; see the module.

    Args:
        points: commanded places of all readings with one zero of the counter, m, shape (n, 3).
        changes: of the length since then, m, shape (n,).
        uncertainty: standard uncertainty of each, m; NaN if unknown.
        station: rough place of the tracker, m, shape (3,), see ``location.locate``.
        start_length: rough L0, m.
        names: of the readings, for warnings.

    Raises:
        PoorGeometry: the places do not tell all ten unknowns.
    """
    points = np.asarray(points, dtype=np.float64)
    centre = points.mean(axis=0)
    near = points - centre

    def model(at: Vector) -> tuple[Vector, Vector]:
        length, by_station = station_model(affine_points(points, at[:6], centre), at[6:])
        unit = -by_station[:, :3]
        by_errors = [sign * unit[:, row] * near[:, column] for row, column, sign in _PLACES]
        return length, np.column_stack([*by_errors, by_station])

    start = np.concatenate([np.zeros(6), station, [start_length]])
    spread = np.array(np.broadcast_to(np.asarray(uncertainty, dtype=np.float64), len(points)))
    try:
        fit = adjust(model, np.asarray(changes, dtype=np.float64), spread, start)
    except PoorGeometry:
        raise PoorGeometry(
            "scales, squareness and the tracker's place cannot be told from these places together;"
            " measure all seven lines, and places on other sides of the tracker"
        ) from None
    return JointEstimate(
        values=fit.parameters[:6],
        covariance=fit.covariance[:6, :6] * misfit_of(fit) ** 2,
        position=fit.parameters[6:9],
        machine_position=np.linalg.solve(
            error_matrix(fit.parameters[:6]), fit.parameters[6:9] - centre
        )
        + centre,
        start_length=float(fit.parameters[9]),
        adjustment=fit,
        frame=FRAME,
        warnings=tuple(fit_warnings(fit, names)),
    )
