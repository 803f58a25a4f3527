"""Evaluation of a seven-line test: the tracker's place, ISO 230-2 and ISO 230-6, squareness.

A length change is turned into a deviation along the line by the tracker's place (ATLI eq. 2):

    x_i = (ΔL_i - ΔL_0) - (|q_i - t| - |q_0 - t|)

over the cosine between beam and line, so that it is a deviation along the line; beam and line are
all but parallel unless the volume did not let them. Its zero is free, as in both standards.

Squareness from a face line and the two lines along its axes: a machine whose axes have the scales
s_i and whose planes have the shears σ_ij (the sums of the slopes that ``forward.SQUARENESS_SLOPES``
names) stretches a line along the unit vector c by

    s = Σ s_i c_i² + Σ_{i<j} σ_ij c_i c_j,   so   σ_ij = (s - s_i c_i² - s_j c_j²) / (c_i c_j)

with C0Y = -σ_XY, B0Z = +σ_XZ, A0Z = -σ_YZ. The xyz line is then known from the six others: what is
left over is the test's own check (``closure``).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.plan import BACKWARD, DIAGONAL, FORWARD, LINEAR
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest, evaluate
from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.joint import JointEstimate, estimate
from stepdiag_ros.metrology.tracker.location import Location, locate
from stepdiag_ros.metrology.tracker.readings import (
    LOCATE,
    SEVEN_LINES,
    TrackerReading,
    changes_of,
    points_of,
    uncertainties_of,
)
from stepdiag_ros.metrology.tracker.separation import Separation, separate

_PLANES = {"C0Y": "xy", "B0Z": "xz", "A0Z": "yz"}
_STEEPEST = np.radians(60.0)
_MOST_OBLIQUE = 0.05
"""Larger tangents between beam and line let more than a twentieth of what is across it in."""
LINES_ALONE = (
    "Slopes of the lines, reckoned from the located tracker, carry what its place is wrong by; the"
    " joint estimate from all readings does not."
)


@dataclass(frozen=True)
class LineSlope:
    """Slope of the deviations along one line.

    Attributes:
        name: of the line.
        direction: unit vector, shape (3,).
        slope: of the least-squares line through all deviations, m/m.
        standard_uncertainty: m/m; NaN if not known.
        oblique: largest tangent of the angle between beam and line: the share with which what
            moves the reflector across the line enters.
    """

    name: str
    direction: Vector
    slope: float
    standard_uncertainty: float
    oblique: float


@dataclass(frozen=True)
class Squareness:
    """One squareness angle.

    Attributes:
        name: C0Y, B0Z or A0Z.
        value: right-handed, rad.
        standard_uncertainty: rad; NaN if not known.
    """

    name: str
    value: float
    standard_uncertainty: float


@dataclass(frozen=True)
class LineEvaluation:
    """The lines, reckoned from one place of the tracker.

    Attributes:
        tests: by ISO 230-2 (x, y, z) and ISO 230-6.
        slopes: of the lines.
        squareness: from face lines and axes.
        closure: what the xyz line departs from what the others make it, m/m; NaN if not known.
        closure_uncertainty: its standard uncertainty.
    """

    tests: tuple[PositioningTest, ...]
    slopes: tuple[LineSlope, ...]
    squareness: tuple[Squareness, ...]
    closure: float
    closure_uncertainty: float


@dataclass(frozen=True)
class SevenLineResult:
    """What a seven-line test says.

    Attributes:
        location: of the tracker, from the places ``locate``.
        joint: scales and squareness together with the tracker's place, from all readings; None if
            the readings do not tell.
        located: the lines with the tracker where ``location`` has it, as ATLI evaluates them.
        corrected: the same with the tracker where ``joint`` has it; None without that.
        separations: line along an axis → positioning and squareness from its readings alone, or in
            words why not.
        remarks: in words.
    """

    location: Location
    joint: JointEstimate | None
    located: LineEvaluation
    corrected: LineEvaluation | None
    separations: dict[str, "Separation | str"]
    remarks: tuple[str, ...]


def evaluate_test(
    readings: Sequence[TrackerReading],
    description: UncertaintyDescription | None = None,
    minimum_range: float = 0.0,
) -> SevenLineResult:
    """Evaluate the readings of a seven-line test of one station.

    Args:
        readings: of one station; ``locate`` and any of the seven lines.
        description: of the measuring conditions, for the uncertainty of ISO 230-2 and -6.
        minimum_range: of the tracker, m.

    Raises:
        PoorGeometry: the tracker cannot be located.
        ValueError: no line was measured, or its runs do not belong together.
    """
    location = locate_from(readings, minimum_range)
    used = [reading for reading in readings if reading.line in (LOCATE, *SEVEN_LINES)]
    by_line = {name: [r for r in used if r.line == name] for name in SEVEN_LINES}
    by_line = {name: found for name, found in by_line.items() if found}
    if not by_line:
        raise ValueError("there is no reading of any of the seven lines")
    remarks = [LINES_ALONE]
    missing = [name for name in SEVEN_LINES if name not in by_line]
    if missing:
        remarks.append(f"Not measured: {', '.join(missing)}.")
    located = _evaluated(by_line, location.position, location, description)
    joint = _joint(used, location, remarks)
    corrected = None
    if joint is not None:
        corrected = _evaluated(by_line, joint.machine_position, location, description)
    oblique = [slope.name for slope in located.slopes if slope.oblique > _MOST_OBLIQUE]
    if oblique:
        remarks.append(
            f"The beam does not run along {', '.join(oblique)}: straightness and squareness across"
            " these lines are in their deviations, and no squareness is made of their slopes."
        )
    return SevenLineResult(
        location=location,
        joint=joint,
        located=located,
        corrected=corrected,
        separations={
            name: _separated(by_line[name], location) for name in "xyz" if name in by_line
        },
        remarks=tuple(remarks),
    )


def locate_from(readings: Sequence[TrackerReading], minimum_range: float = 0.0) -> Location:
    """Locate the tracker from the readings ``locate`` among those of a station.

    Raises:
        PoorGeometry: there are too few, or they do not tell.
    """
    places = [reading for reading in readings if reading.line == LOCATE]
    if not places:
        raise PoorGeometry("there is no reading 'locate' to find the tracker from")
    return locate(
        points_of(places),
        changes_of(places),
        uncertainties_of(places),
        names=[f"place {reading.stop}" for reading in places],
        minimum_range=minimum_range,
    )


def _evaluated(
    by_line: dict[str, list[TrackerReading]],
    station: Vector,
    location: Location,
    description: UncertaintyDescription | None,
) -> LineEvaluation:
    runs = {name: runs_of_line(found, station) for name, found in by_line.items()}
    slopes = tuple(
        _slope(name, runs[name], found, station, _noise(found, location))
        for name, found in by_line.items()
    )
    closure, closure_uncertainty = closure_of(slopes)
    return LineEvaluation(
        tests=tuple(evaluate(run, description) for run in runs.values()),
        slopes=slopes,
        squareness=squareness_of(slopes),
        closure=closure,
        closure_uncertainty=closure_uncertainty,
    )


def runs_of_line(readings: Sequence[TrackerReading], station: Vector) -> BidirectionalRuns:
    """Return the deviations of one line, run by run, as the standards evaluate them.

    Args:
        readings: of one line and station.
        station: where the tracker stands, m, shape (3,).

    Raises:
        ValueError: a run lacks a target, or two runs have different targets, or the tracker is so
            far beside the line that a length says little of what happens along it.
    """
    name = readings[0].line
    groups: dict[tuple[int, str], dict[int, TrackerReading]] = {}
    for reading in readings:
        run = groups.setdefault((reading.run, reading.direction), {})
        if reading.stop in run:
            raise ValueError(f"line {reading} is there twice")
        run[reading.stop] = reading
    stops = sorted({reading.stop for reading in readings})
    targets = np.array([next(r.position for r in readings if r.stop == stop) for stop in stops])
    nominal = np.linalg.norm(targets - station, axis=1)
    way = targets[-1] - targets[0]
    direction = way / np.linalg.norm(way)
    cosine = ((targets - station) @ direction) / nominal
    if np.min(np.abs(cosine)) < np.cos(_STEEPEST) or np.min(cosine) * np.max(cosine) <= 0:
        widest = np.degrees(np.arccos(np.min(np.abs(cosine))))
        raise ValueError(
            f"line {name}: the beam is up to {widest:.0f}° off the line; a length then says"
            " little of the position along it, so ISO 230-2 does not apply"
        )
    found: dict[str, list[Vector]] = {FORWARD: [], BACKWARD: []}
    zero = None
    for (run_number, sense), run in sorted(groups.items()):
        if sorted(run) != stops:
            raise ValueError(f"line {name} {sense}, run {run_number}: a target is missing")
        reached = np.array([run[stop].position for stop in stops])
        if np.max(np.abs(reached - targets)) > 1e-9:
            raise ValueError(
                f"line {name} {sense}, run {run_number}: its targets are not those of the others"
            )
        excess = np.array([run[stop].change for stop in stops]) - nominal
        zero = float(excess[0]) if zero is None else zero
        found[sense].append((excess - zero) / cosine)
    empty = np.empty((0, len(stops)))
    along = (targets - targets[0]) @ direction
    one_axis = len(name) == 1
    if one_axis:
        axis = "xyz".index(name)
        coordinate = targets[:, axis]
        if direction[axis] < 0:
            # The standards count targets upwards along the axis.
            along, found = (
                coordinate[::-1],
                {
                    FORWARD: [-run[::-1] for run in found[BACKWARD]],
                    BACKWARD: [-run[::-1] for run in found[FORWARD]],
                },
            )
        else:
            along = coordinate
    return BidirectionalRuns(
        name=AXES["xyz".index(name)] if one_axis else name,
        kind=LINEAR if one_axis else DIAGONAL,
        target=along,
        forward=np.array(found[FORWARD]) if found[FORWARD] else empty,
        backward=np.array(found[BACKWARD]) if found[BACKWARD] else empty,
        setup=readings[0].station,
    )


def squareness_of(slopes: Sequence[LineSlope]) -> tuple[Squareness, ...]:
    """Return the squareness angles that face lines and the lines along their axes tell.

    Lines along which the beam does not run are left out: squareness across them is in their slopes.
    """
    by_name = {slope.name: slope for slope in slopes if slope.oblique <= _MOST_OBLIQUE}
    made = []
    for name, line in _PLANES.items():
        if not {line, *line} <= set(by_name):
            continue
        shear, variance = _shear(by_name, line)
        factor = SQUARENESS_SLOPES[name][0]
        made.append(Squareness(name, factor * shear, float(np.sqrt(variance))))
    return tuple(made)


def _shear(by_name: dict[str, LineSlope], line: str) -> tuple[float, float]:
    """Return the shear of a plane and its variance from its line and the axes' lines."""
    face = by_name[line]
    cosines = [abs(face.direction["xyz".index(letter)]) for letter in line]
    # Both axes may run backwards along the line, or one of them: then the shear changes its sign.
    signs = np.sign([face.direction["xyz".index(letter)] for letter in line])
    product = float(np.prod(signs)) * cosines[0] * cosines[1]
    shear, variance = face.slope, face.standard_uncertainty**2
    for letter, cosine in zip(line, cosines, strict=True):
        shear -= by_name[letter].slope * cosine**2
        variance += (by_name[letter].standard_uncertainty * cosine**2) ** 2
    return shear / product, variance / product**2


def closure_of(slopes: Sequence[LineSlope]) -> tuple[float, float]:
    """Return how far the xyz line departs from what the six others make it, and its u, m/m.

    NaN if a line is missing or the beam does not run along it.
    """
    by_name = {slope.name: slope for slope in slopes if slope.oblique <= _MOST_OBLIQUE}
    if not set(SEVEN_LINES) <= set(by_name):
        return float("nan"), float("nan")
    direction = by_name["xyz"].direction
    rows = np.array([_strain_row(by_name[name].direction) for name in SEVEN_LINES[:6]])
    weights = np.linalg.solve(rows.T, _strain_row(direction))
    values = np.array([by_name[name].slope for name in SEVEN_LINES[:6]])
    spreads = np.array([by_name[name].standard_uncertainty for name in SEVEN_LINES[:6]])
    spread = np.hypot(by_name["xyz"].standard_uncertainty, np.linalg.norm(weights * spreads))
    return by_name["xyz"].slope - float(weights @ values), float(spread)


def _strain_row(direction: Vector) -> Vector:
    x, y, z = direction
    return np.array([x * x, y * y, z * z, x * y, x * z, y * z])


def _direction(readings: Sequence[TrackerReading]) -> Vector:
    first = min(readings, key=lambda reading: reading.stop)
    last = max(readings, key=lambda reading: reading.stop)
    way = np.array(last.position) - np.array(first.position)
    made: Vector = way / np.linalg.norm(way)
    return made


def _noise(readings: Sequence[TrackerReading], location: Location) -> float:
    known = uncertainties_of(readings)
    if np.all(np.isfinite(known)):
        return float(np.sqrt(np.mean(known**2)))
    return float(np.max(location.adjustment.uncertainty))


def _slope(
    name: str,
    runs: BidirectionalRuns,
    readings: Sequence[TrackerReading],
    station: Vector,
    noise: float,
) -> LineSlope:
    """Return the least-squares slope; its uncertainty from the lengths, or the runs if larger."""
    centred = runs.target - runs.target.mean()
    weights = centred / float(centred @ centred)
    values = np.concatenate([runs.forward, runs.backward]) @ weights
    count = len(values)
    spread = noise * float(np.linalg.norm(weights)) / np.sqrt(count)
    if count > 1:
        scatter = float(np.std(values, ddof=1)) / np.sqrt(count)
        spread = scatter if not np.isfinite(spread) else max(spread, scatter)
    direction = _direction(readings)
    beam = points_of(readings) - station
    along = beam @ direction
    across = np.linalg.norm(beam - np.outer(along, direction), axis=1)
    oblique = float(np.max(across / np.abs(along)))
    return LineSlope(name, direction, float(values.mean()), spread, oblique)


def _joint(
    used: Sequence[TrackerReading], location: Location, remarks: list[str]
) -> JointEstimate | None:
    try:
        return estimate(
            points_of(used),
            changes_of(used),
            uncertainties_of(used),
            location.position,
            location.start_length,
            tuple(map(str, used)),
        )
    except PoorGeometry as error:
        remarks.append(f"No joint estimate: {error}.")
        return None


def _separated(readings: Sequence[TrackerReading], location: Location) -> "Separation | str":
    ordered = sorted(readings, key=lambda reading: reading.stop)
    try:
        return separate(
            points_of(ordered),
            changes_of(ordered),
            uncertainties_of(ordered),
            location.position,
            location.covariance if np.all(np.isfinite(location.covariance)) else None,
            location.start_length,
        )
    except PoorGeometry as error:
        return str(error)
