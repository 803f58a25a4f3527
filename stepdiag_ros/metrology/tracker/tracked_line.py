"""A line that a tracking interferometer measures, as a plan has it."""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.readings import GRID, LOCATE, NAMES

TRACKER = "tracker"
"""Kind of such a line."""
_MARK = ":"
_LEAST_DISTANCE = 1e-6

Point = tuple[float, float, float]


@dataclass(frozen=True)
class TrackedLine:
    """Where a line runs, and where the tracker stands.

    Attributes:
        station: rough place of the tracker, machine coordinates, m.
        targets: in the forward sense, m.
        overrun: how far beyond its first target a pass begins, m.
        straight: the targets lie along one line, in order; else they are single places.
    """

    station: Point
    targets: tuple[Point, ...]
    overrun: float
    straight: bool

    def stops(self, forward: bool) -> Vector:
        """Return the targets in the order of a pass, m, shape (n, 3)."""
        targets = np.array(self.targets, dtype=np.float64)
        return targets if forward else targets[::-1].copy()

    def run_up(self, forward: bool) -> Vector | None:
        """Return the place beyond a pass's first target, m, shape (3,); None without overrun."""
        if not self.overrun:
            return None
        stops = self.stops(forward)
        way = stops[-1] - stops[0]
        place: Vector = stops[0] - self.overrun * way / np.linalg.norm(way)
        return place


def line_name(station: str, line: str) -> str:
    """Return the name of a line in a plan, for example ``1:xyz``."""
    return f"{station}{_MARK}{line}"


def is_tracked(name: str) -> bool:
    """Say whether a line of this name is measured with a tracker."""
    return _MARK in name


def station_of(name: str) -> str:
    """Return the name of the tracker's place from the name of a line."""
    return name.rpartition(_MARK)[0]


def test_line_of(name: str) -> str:
    """Return ``locate``, ``grid`` or one of the seven lines from the name of a line."""
    return name.rpartition(_MARK)[2]


def lines_of_group(group: Section) -> Iterator[tuple[str, TrackedLine]]:
    """Return names and lines of one entry of a plan file.

    Raises:
        ValueError: names the entry, the key and what is expected.
    """
    station = group.text("station")
    if not station.strip() or _MARK in station:
        raise Refusal(f"{group.source}: 'station' is a name without '{_MARK}'", fault="malformed")
    place = group.vector("station_m", low=-100.0, high=100.0)
    names = group.names("names", NAMES)
    targets = group.vectors("targets_m", low=-100.0, high=100.0)
    overrun = group.number("overrun_m", low=0.0, high=1.0, default=0.0)
    for name in names:
        straight = name not in (LOCATE, GRID)
        if straight:
            _check_straight(np.array(targets), group.source)
        elif overrun:
            raise Refusal(
                f"{group.source}: overrun_m is for the seven lines; places have no direction",
                fault="too_many",
            )
        yield line_name(station, name), TrackedLine(place, targets, overrun, straight)


def check_lines(
    passes: Sequence[tuple[Hashable, str, TrackedLine | None]], has_tracker: bool, source: str
) -> None:
    """Refuse a plan whose tracker's lines do not belong together.

    Args:
        passes: identity, name and, on a tracker's line, the places of each pass of the plan.
        has_tracker: the plan describes the instrument.
        source: what the user calls the plan.

    Raises:
        ValueError: names the source and what is wrong.
    """
    tracked = [line is not None for _, _, line in passes]
    if any(tracked) and not all(tracked):
        raise Refusal(
            f"{source}: lines of kind tracker cannot share a plan with others; make two plans",
            fault="mismatch",
            aspect="lines",
        )
    if any(tracked) != has_tracker:
        raise Refusal(
            f"{source}: 'tracker' describes the instrument of lines of kind tracker; "
            + ("it is missing" if any(tracked) else "there are no such lines"),
            fault="mismatch",
            aspect="tracker",
        )
    places: dict[str, TrackedLine] = {}
    seen: set[Hashable] = set()
    for identity, name, line in passes:
        if line is None:
            return
        if identity in seen:
            raise Refusal(
                f"{source}: {identity} is there twice; put its passes into one entry", fault="twice"
            )
        seen.add(identity)
        if places.setdefault(station_of(name), line).station != line.station:
            raise Refusal(
                f"{source}: station {station_of(name)} has two places (station_m)", fault="twice"
            )


def _check_straight(targets: Vector, source: str) -> None:
    if len(targets) < 2:
        raise ValueError(f"{source}: targets_m has one place; a line needs two or more")
    way = targets[-1] - targets[0]
    along = (targets - targets[0]) @ way / max(float(np.linalg.norm(way)), _LEAST_DISTANCE)
    beside = np.linalg.norm(
        targets - targets[0] - np.outer(along, way / max(float(np.linalg.norm(way)), 1e-12)), axis=1
    )
    if np.any(np.diff(along) < _LEAST_DISTANCE) or np.max(beside) > _LEAST_DISTANCE:
        raise Refusal(
            f"{source}: targets_m do not follow each other along one straight line",
            fault="mismatch",
            aspect="targets",
        )
