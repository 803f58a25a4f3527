"""The seven-line test: its lines, targets and places, for a volume and a tracker (ATLI 2.1).

The lines begin at the place of the volume that is nearest to the tracker and run away from it: x, y
and z along one axis, xy, xz, yz and xyz along the diagonals of what is left of the volume from
there. So the beam runs along the line as nearly as the volume allows; how nearly is stated
for each line, because whatever moves the reflector across the beam enters the length by the sine of
the angle between them; a line begins where that angle is 45° at most. No line passes the tracker
nearer than its shortest length.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.location import LEAST_POINTS
from stepdiag_ros.metrology.tracker.readings import LOCATE, SEVEN_LINES, TrackerReading

_LEAST_TARGETS = 5
_MOST_TARGETS = 1000
_START_STEPS = 2000
_OBLIQUE = np.radians(30.0)
_MOST_OBLIQUE = np.radians(45.0)
_LATEST_START = 0.6


@dataclass(frozen=True)
class TestLine:
    """One line of the test.

    Attributes:
        name: one of ``SEVEN_LINES``.
        targets: in the forward sense, m, shape (n, 3).
        overrun: how far a run begins beyond its first target, m.
        offset: of the tracker from the line, m.
        obliqueness: largest angle between beam and line at a target, rad.
    """

    name: str
    targets: Vector
    overrun: float
    offset: float
    obliqueness: float

    @property
    def direction(self) -> Vector:
        """Return the unit vector along the line, shape (3,)."""
        way = self.targets[-1] - self.targets[0]
        made: Vector = way / np.linalg.norm(way)
        return made

    @property
    def length(self) -> float:
        """Return the length of the line, m."""
        return float(np.linalg.norm(self.targets[-1] - self.targets[0]))


@dataclass(frozen=True)
class SevenLineTest:
    """All places of the test of one station.

    Attributes:
        station: of the tracker, roughly, m, shape (3,).
        locating: places from which it is located, m, shape (n, 3).
        lines: that the tracker can see.
        left_out: line → why it cannot be measured.
        runs: in each direction.
        remarks: in words.
    """

    station: Vector
    locating: Vector
    lines: tuple[TestLine, ...]
    left_out: dict[str, str]
    runs: int
    remarks: tuple[str, ...]

    def readings(self, station_name: str = "1") -> tuple[TrackerReading, ...]:
        """Return the places in the order of measurement, not yet measured."""
        made = [
            TrackerReading(station_name, LOCATE, 1, FORWARD, stop, _triple(place))
            for stop, place in enumerate(self.locating)
        ]
        for line in self.lines:
            for run in range(1, self.runs + 1):
                for direction in (FORWARD, BACKWARD):
                    order = range(len(line.targets))
                    for stop in order if direction == FORWARD else reversed(order):
                        place = _triple(line.targets[stop])
                        made.append(
                            TrackerReading(station_name, line.name, run, direction, stop, place)
                        )
        return tuple(made)


def make_test(
    box: Box,
    station: Vector,
    tracker: Tracker,
    *,
    targets: int = 11,
    runs: int = 5,
    overrun: float = 2e-3,
    locating: int = 10,
) -> SevenLineTest:
    """Make the seven-line test for a volume and a tracker's rough place.

    Args:
        box: where the machine may go; the overrun stays within it.
        station: rough place of the tracker, m, shape (3,).
        tracker: its limits.
        targets: on each line, at least 5 (ISO 230-2).
        runs: in each direction.
        overrun: beyond the first and last target, so that all are approached from one side, m.
        locating: number of places from which the tracker is located, at least 6.

    Raises:
        PoorGeometry: the tracker can see no line, or too few places to be located.
        ValueError: a number that makes no sense.
    """
    station = np.asarray(station, dtype=np.float64)
    if not _LEAST_TARGETS <= targets <= _MOST_TARGETS:
        raise Refusal(
            f"{targets} targets on a line; expected {_LEAST_TARGETS} to {_MOST_TARGETS}",
            fault="too_few",
            aspect="targets",
        )
    if runs < 1:
        raise Refusal(f"{runs} runs; expected 1 or more", fault="too_few", aspect="runs")
    if not 0.0 <= overrun < 0.1 * float(np.min(box.high - box.low)):
        raise Refusal(
            f"an overrun of {overrun:g} m; expected 0 to a tenth of the shortest side",
            fault="out_of_range",
            aspect="overrun",
        )
    lines: list[TestLine] = []
    left_out: dict[str, str] = {}
    for name in SEVEN_LINES:
        made = _line(name, box, station, tracker, targets, overrun)
        if isinstance(made, str):
            left_out[name] = made
        else:
            lines.append(made)
    if not lines:
        raise PoorGeometry(
            "the tracker can see none of the seven lines: " + _sentence(left_out) + "; place it"
            " elsewhere",
            fault="out_of_range",
            aspect="sight",
        )
    remarks = []
    oblique = [line for line in lines if line.obliqueness > _OBLIQUE]
    if oblique:
        worst = max(line.obliqueness for line in oblique)
        remarks.append(
            f"The beam is up to {np.degrees(worst):.0f}° off the lines"
            f" {', '.join(line.name for line in oblique)}, where they begin: straightness across a"
            f" line enters by up to {np.tan(worst):.1f} of itself there."
        )
    places = locating_places(box, station, tracker, locating)
    return SevenLineTest(station, places, tuple(lines), left_out, runs, tuple(remarks))


def locating_places(box: Box, station: Vector, tracker: Tracker, count: int = 10) -> Vector:
    """Return places from which the tracker is located best, m, shape (count, 3).

    Out of a grid of 27 places of the volume that the tracker can see, one after the other the one
    that makes u(position) smallest (see ``location``), beginning with nothing known but a metre.

    Raises:
        PoorGeometry: fewer places can be seen than are needed.
        ValueError: fewer than six are asked for.
    """
    if count < LEAST_POINTS:
        raise Refusal(
            f"{count} places; the tracker is located from {LEAST_POINTS} or more",
            fault="too_few",
            aspect="places",
        )
    sides = [
        np.array([low, 0.5 * (low + high), high]) for low, high in zip(*_limits(box), strict=True)
    ]
    grid = np.array(list(product(*sides)))
    seen = np.array([place for place in grid if not tracker.unseen(place, station)])
    if len(seen) < count:
        raise PoorGeometry(
            f"the tracker can see {len(seen)} of 27 places of the volume, {count} are needed to"
            " locate it; place it elsewhere or ask for fewer"
        )
    way = seen - station
    rows = np.column_stack([way / np.linalg.norm(way, axis=1)[:, None], np.ones(len(seen))])
    information = 1e-3 * np.eye(4)
    chosen: list[int] = []
    for _ in range(count):
        left = [index for index in range(len(seen)) if index not in chosen]
        spreads = [
            float(np.trace(np.linalg.inv(information + np.outer(rows[i], rows[i]))[:3, :3]))
            for i in left
        ]
        best = left[int(np.argmin(spreads))]
        chosen.append(best)
        information = information + np.outer(rows[best], rows[best])
    made: Vector = seen[chosen]
    return made


def _line(
    name: str, box: Box, station: Vector, tracker: Tracker, count: int, overrun: float
) -> TestLine | str:
    """Return a line of the test, or in words why the tracker cannot follow it."""
    low, high = box.low + overrun, box.high - overrun
    moving = np.array([letter.lower() in name for letter in AXES])
    nearest = np.clip(station, np.where(moving, low, box.low), np.where(moving, high, box.high))
    # Away from the tracker, to the side on which there is more room.
    far = np.where(high - nearest >= nearest - low, high, low)
    way = np.where(moving, far - nearest, 0.0)
    length = float(np.linalg.norm(way))
    direction = way / length
    end = nearest + way
    if reason := tracker.unseen(end + overrun * direction, station):
        return f"its end is {reason}"
    start = None
    reason = ""
    for share in np.linspace(0.0, _LATEST_START, _START_STEPS):
        begin = nearest + share * way
        if _angle(begin - station, direction) > _MOST_OBLIQUE:
            reason = f"more than {np.degrees(_MOST_OBLIQUE):.0f}° off the beam"
            continue
        reason = tracker.unseen_on_the_way(begin - overrun * direction, begin + 0.01 * way, station)
        if not reason:
            start = begin
            break
    if start is None:
        return f"its beginning is {reason}"
    if reason := tracker.unseen_on_the_way(start - overrun * direction, end, station):
        return f"the reflector is lost on the way: {reason}"
    # Whole micrometres, so that an NC program says the same places.
    targets = np.round(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start), 6)
    beam = targets - station
    across = beam - np.outer(beam @ direction, direction)
    offset = float(np.linalg.norm(across[0]))
    obliqueness = max(_angle(one, direction) for one in beam)
    return TestLine(name, targets, overrun, offset, obliqueness)


def _angle(beam: Vector, direction: Vector) -> float:
    """Return the angle between a beam and a line, 0..π; a right angle where the beam is nothing."""
    length = float(np.linalg.norm(beam))
    cosine = float(beam @ direction) / length if length > 0 else 0.0
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _limits(box: Box) -> tuple[list[float], list[float]]:
    return [float(value) for value in box.low], [float(value) for value in box.high]


def _triple(place: Vector) -> tuple[float, float, float]:
    return float(place[0]), float(place[1]), float(place[2])


def _sentence(reasons: dict[str, str]) -> str:
    return ", ".join(f"{name}: {reason}" for name, reason in reasons.items())
