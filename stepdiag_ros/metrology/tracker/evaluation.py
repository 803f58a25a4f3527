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
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.plan import BACKWARD, DIAGONAL, FORWARD, LINEAR
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.summary import slope_weights
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest, evaluate
from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.bands import (
    slope_across,
    slope_along,
    standard_uncertainty,
    widened,
    with_the_place,
)
from stepdiag_ros.metrology.tracker.joint import NAMES, JointEstimate, estimate, functionals_of
from stepdiag_ros.metrology.tracker.location import Location, geometry_warnings, locate
from stepdiag_ros.metrology.tracker.readings import (
    LOCATE,
    SEVEN_LINES,
    TrackerReading,
    changes_of,
    points_of,
    uncertainties_of,
)
from stepdiag_ros.metrology.tracker.separation import AxisSeparation, separate

_PLANES = {"C0Y": "xy", "B0Z": "xz", "A0Z": "yz"}
_STEEPEST = np.radians(60.0)
_MOST_OBLIQUE = 0.05
"""Larger tangents between beam and line let more than a twentieth of what is across it in."""
LINES_ALONE = (
    "Slopes of the lines, calculated from the located tracker, contain the error of its place;"
    " the joint estimate from all readings does not. Their U, that of the squareness from them"
    " and that of single lines is as large as they depart from the joint estimate of the same"
    " quantity."
)
NO_BANDS = (
    "Without a joint estimate nothing shows what straightness and angles do to slopes, squareness"
    " and single lines: their U is unknown, and that of the tracker's place is of lengths alone."
)


@dataclass(frozen=True)
class LineSlope:
    """Slope of the deviations along one line.

    Attributes:
        name: of the line.
        targets: m, shape (n, 3).
        slope: of the least-squares line through all deviations, m/m.
        standard_uncertainty: as a figure of what the machine does along the line (``bands``), m/m;
            NaN if not known.
        oblique: largest tangent of the angle between beam and line: the share with which what
            moves the reflector across the line enters.
    """

    name: str
    targets: Vector
    slope: float
    standard_uncertainty: float
    oblique: float

    @property
    def direction(self) -> Vector:
        """Return the unit vector along the line, shape (3,)."""
        way = self.targets[-1] - self.targets[0]
        made: Vector = way / np.linalg.norm(way)
        return made


@dataclass(frozen=True)
class SquarenessAngle:
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
    """The lines, calculated from one place of the tracker.

    Attributes:
        tests: by ISO 230-2 (x, y, z) and ISO 230-6.
        slopes: of the lines.
        squareness: from face lines and axes.
        closure: what the xyz line departs from what the others make it, m/m; NaN if not known.
        closure_uncertainty: its standard uncertainty.
    """

    tests: tuple[PositioningTest, ...]
    slopes: tuple[LineSlope, ...]
    squareness: tuple[SquarenessAngle, ...]
    closure: float
    closure_uncertainty: float


@dataclass(frozen=True)
class SevenLineResult:
    """What a seven-line test says.

    Attributes:
        location: of the tracker, from the places ``locate``; with a joint estimate, its covariance
            has in it what the machine's errors do to it (``bands``).
        joint: scales and squareness together with the tracker's place, from all readings; None
            if the readings do not determine them.
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
    separations: dict[str, "AxisSeparation | str"]
    remarks: tuple[str, ...]


def evaluate_test(
    readings: Sequence[TrackerReading],
    description: UncertaintyDescription | None = None,
    minimum_range: float = 0.0,
    chain: str = "",
) -> SevenLineResult:
    """Evaluate the readings of a seven-line test of one station.

    Args:
        readings: of one station; ``locate`` and any of the seven lines.
        description: of the measuring conditions, for the uncertainty of ISO 230-2 and -6.
        minimum_range: of the tracker, m.
        chain: order of the axes from workpiece to tool; empty if not known, and then neither is
            any uncertainty, because it depends on the levers of the angular errors.

    Raises:
        PoorGeometry: the tracker cannot be located.
        ValueError: no line was measured, or its runs do not belong together.
    """
    location = locate_from(readings, minimum_range)
    used = [reading for reading in readings if reading.line in (LOCATE, *SEVEN_LINES)]
    by_line = {name: [r for r in used if r.line == name] for name in SEVEN_LINES}
    by_line = {name: found for name, found in by_line.items() if found}
    if not by_line:
        raise Refusal(
            "there is no reading of any of the seven lines", fault="too_few", aspect="lines"
        )
    remarks = [LINES_ALONE]
    missing = [name for name in SEVEN_LINES if name not in by_line]
    if missing:
        remarks.append(f"Not measured: {', '.join(missing)}.")
    joint = _joint(used, location, chain, remarks)
    located = _evaluated(by_line, location.position, joint, description)
    corrected = None
    if joint is None:
        remarks.append(NO_BANDS)
    else:
        corrected = _evaluated(by_line, joint.machine_position, joint, description)
    oblique = [slope.name for slope in located.slopes if slope.oblique > _MOST_OBLIQUE]
    if oblique:
        remarks.append(
            f"The beam does not run along {', '.join(oblique)}: straightness and squareness across"
            " these lines are in their deviations, and no squareness is made of their slopes."
        )
    return SevenLineResult(
        location=location if joint is None else _with_the_machine(location, joint),
        joint=joint,
        located=located,
        corrected=corrected,
        separations={
            name: _separated(by_line[name], location, joint) for name in "xyz" if name in by_line
        },
        remarks=tuple(remarks),
    )


def locate_from(readings: Sequence[TrackerReading], minimum_range: float = 0.0) -> Location:
    """Locate the tracker from the readings ``locate`` among those of a station.

    Raises:
        PoorGeometry: there are too few, or they do not determine the result.
    """
    places = [reading for reading in readings if reading.line == LOCATE]
    if not places:
        raise PoorGeometry(
            "there is no reading 'locate' to find the tracker from",
            fault="missing",
            aspect="location",
        )
    return locate(
        points_of(places),
        changes_of(places),
        uncertainties_of(places),
        names=[f"place {reading.stop}" for reading in places],
        minimum_range=minimum_range,
    )


def _with_the_machine(location: Location, joint: JointEstimate) -> Location:
    """Return a location whose covariance knows how wrong the machine's errors make it.

    What it said of residuals is left out: they are the machine's, and the joint estimate says which
    readings neither machine nor noise explains.
    """
    found = np.append(location.position, location.start_length)
    away = found - np.append(joint.position, joint.start_length)
    return replace(
        location,
        covariance=joint.place_covariance + np.outer(away, away),
        warnings=tuple(geometry_warnings(location.points, location.position)),
        remarks=(
            "The places are those commanded. What the machine does otherwise is in the uncertainty"
            " of the tracker's place, by the joint estimate.",
        ),
    )


def _evaluated(
    by_line: dict[str, list[TrackerReading]],
    station: Vector,
    joint: JointEstimate | None,
    description: UncertaintyDescription | None,
) -> LineEvaluation:
    runs = {name: runs_of_line(found, station) for name, found in by_line.items()}
    slopes = tuple(
        _slope(name, runs[name], found, station, joint) for name, found in by_line.items()
    )
    closure, closure_uncertainty = closure_of(slopes, joint)
    return LineEvaluation(
        tests=tuple(
            with_the_place(evaluate(runs[slope.name], description), slope.targets, joint)
            for slope in slopes
        ),
        slopes=slopes,
        squareness=squareness_of(slopes, joint),
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
            raise Refusal(f"line {reading} appears twice", fault="twice")
        run[reading.stop] = reading
    stops = sorted({reading.stop for reading in readings})
    targets = np.array([next(r.position for r in readings if r.stop == stop) for stop in stops])
    nominal = np.linalg.norm(targets - station, axis=1)
    way = targets[-1] - targets[0]
    direction = way / np.linalg.norm(way)
    cosine = ((targets - station) @ direction) / nominal
    if np.min(np.abs(cosine)) < np.cos(_STEEPEST) or np.min(cosine) * np.max(cosine) <= 0:
        widest = np.degrees(np.arccos(np.min(np.abs(cosine))))
        raise Refusal(
            f"line {name}: the beam is up to {widest:.0f}° off the line; a length then says"
            " little of the position along it, so ISO 230-2 does not apply",
            fault="out_of_range",
            aspect="beam",
        )
    found: dict[str, list[Vector]] = {FORWARD: [], BACKWARD: []}
    zero = None
    for (run_number, sense), run in sorted(groups.items()):
        if sorted(run) != stops:
            raise Refusal(
                f"line {name} {sense}, run {run_number}: a target is missing",
                fault="missing",
                aspect="target",
            )
        reached = np.array([run[stop].position for stop in stops])
        if np.max(np.abs(reached - targets)) > 1e-9:
            raise Refusal(
                f"line {name} {sense}, run {run_number}: its targets are not those of the others",
                fault="mismatch",
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


def squareness_of(
    slopes: Sequence[LineSlope], joint: JointEstimate | None
) -> tuple[SquarenessAngle, ...]:
    """Return the squareness angles from face lines and the lines along their axes.

    Lines along which the beam does not run are left out: squareness across them is in their slopes.

    Args:
        slopes: of the lines.
        joint: the same from all readings, which gives the uncertainty; None: it is unknown.
    """
    by_name = {slope.name: slope for slope in slopes if slope.oblique <= _MOST_OBLIQUE}
    made = []
    for name, line in _PLANES.items():
        if not {line, *line} <= set(by_name):
            continue
        value = SQUARENESS_SLOPES[name][0] * _shear(by_name, line)
        spread = float("nan")
        if joint is not None:
            functional = functionals_of(joint.machine)[NAMES.index(name)]
            spread = standard_uncertainty(value, functional, joint)
        made.append(SquarenessAngle(name, value, spread))
    return tuple(made)


def _shear(by_name: dict[str, LineSlope], line: str) -> float:
    """Return the shear of a plane from its line and the axes' lines."""
    face = by_name[line]
    cosines = [abs(float(face.direction["xyz".index(letter)])) for letter in line]
    # Both axes may run backwards along the line, or one of them: then the shear changes its sign.
    signs = np.sign([face.direction["xyz".index(letter)] for letter in line])
    product = float(np.prod(signs)) * cosines[0] * cosines[1]
    shear = face.slope
    for letter, cosine in zip(line, cosines, strict=True):
        shear -= by_name[letter].slope * float(cosine) ** 2
    return shear / product


def closure_of(slopes: Sequence[LineSlope], joint: JointEstimate | None) -> tuple[float, float]:
    """Return how far the xyz line departs from what the six others make it, and its u, m/m.

    On a machine with curves its true value is not zero. NaN if a line is missing or the beam does
    not run along it; its u is NaN without a joint estimate.
    """
    by_name = {slope.name: slope for slope in slopes if slope.oblique <= _MOST_OBLIQUE}
    if not set(SEVEN_LINES) <= set(by_name):
        return float("nan"), float("nan")
    rows = np.array([_strain_row(by_name[name].direction) for name in SEVEN_LINES[:6]])
    made = np.linalg.solve(rows.T, _strain_row(by_name["xyz"].direction))
    weights = np.append(-made, 1.0)
    value = float(weights @ [by_name[name].slope for name in SEVEN_LINES])
    if joint is None:
        return value, float("nan")
    along = np.array([slope_along(joint, by_name[name].targets) for name in SEVEN_LINES])
    return value, standard_uncertainty(value, weights @ along, joint)


def _strain_row(direction: Vector) -> Vector:
    x, y, z = direction
    return np.array([x * x, y * y, z * z, x * y, x * z, y * z])


def _slope(
    name: str,
    runs: BidirectionalRuns,
    readings: Sequence[TrackerReading],
    station: Vector,
    joint: JointEstimate | None,
) -> LineSlope:
    values = np.concatenate([runs.forward, runs.backward]) @ slope_weights(runs.target)
    slope = float(values.mean())
    targets = np.array(
        [one.position for one in sorted({r.stop: r for r in readings}.values(), key=_stop)]
    )
    along, across = _beam_and_line(targets, station)
    spread = float("nan")
    if joint is not None:
        spread = standard_uncertainty(slope, slope_along(joint, targets), joint)
    return LineSlope(name, targets, slope, spread, float(np.max(across / np.abs(along))))


def _stop(reading: TrackerReading) -> int:
    return reading.stop


def _beam_and_line(targets: Vector, station: Vector) -> tuple[Vector, Vector]:
    """Return how far targets are from a station along their line and across it, m, (n,) each."""
    way = targets[-1] - targets[0]
    direction = way / np.linalg.norm(way)
    beam = targets - station
    along = beam @ direction
    return along, np.linalg.norm(beam - np.outer(along, direction), axis=1)


def _joint(
    used: Sequence[TrackerReading], location: Location, chain: str, remarks: list[str]
) -> JointEstimate | None:
    try:
        made = estimate(used, location.position, location.start_length, chain)
    except PoorGeometry as error:
        remarks.append(f"No joint estimate: {error}.")
        return None
    return made if chain else made.without_bands()


def _separated(
    readings: Sequence[TrackerReading], location: Location, joint: JointEstimate | None
) -> "AxisSeparation | str":
    ordered = sorted(readings, key=_stop)
    try:
        made = separate(
            points_of(ordered),
            changes_of(ordered),
            uncertainties_of(ordered),
            location.position,
            location.covariance if np.all(np.isfinite(location.covariance)) else None,
            location.start_length,
        )
    except PoorGeometry as error:
        return str(error)
    if joint is None:
        return replace(made, covariance=np.full((2, 2), np.nan))
    targets = np.array([one.position for one in {r.stop: r for r in ordered}.values()])
    functionals = np.array(
        [slope_along(joint, targets), slope_across(joint, targets, made.towards)]
    )
    return replace(made, covariance=widened([made.scale, made.lean], functionals, joint))
