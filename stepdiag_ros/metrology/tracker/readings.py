"""Readings of a tracker, and which of them belong together."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.geometry import Vector

LOCATE = "locate"
"""Name of the places from which the tracker is located."""
GRID = "grid"
"""Name of the places that are multilaterated."""
SEVEN_LINES = ("x", "y", "z", "xy", "xz", "yz", "xyz")
"""The lines of the seven-line test in its order (ATLI, section 1)."""
NAMES = (LOCATE, GRID, *SEVEN_LINES)


@dataclass(frozen=True)
class TrackerReading:
    """One length change at one place.

    Attributes:
        station: name of the tracker's place; all readings of a station share one zero.
        line: ``locate``, ``grid`` or one of ``SEVEN_LINES``.
        run: from 1.
        direction: ``forward`` or ``backward`` along the line.
        stop: number of the place along the line, from 0 at the forward start.
        position: commanded X Y Z, machine coordinates, m.
        change: of the length since the station's counter was zeroed, m; NaN if not yet measured.
        uncertainty: standard uncertainty of the length, m; NaN if unknown.
    """

    station: str
    line: str
    run: int
    direction: str
    stop: int
    position: tuple[float, float, float]
    change: float = float("nan")
    uncertainty: float = float("nan")

    def __str__(self) -> str:
        """Say which reading this is, for example ``xy forward, run 2, stop 3``."""
        return f"{self.line} {self.direction}, run {self.run}, stop {self.stop}"


def stations_of(readings: Iterable[TrackerReading]) -> dict[str, tuple[TrackerReading, ...]]:
    """Return the readings by station, in their order."""
    found: dict[str, list[TrackerReading]] = {}
    for reading in readings:
        found.setdefault(reading.station, []).append(reading)
    return {name: tuple(group) for name, group in found.items()}


def points_of(readings: Iterable[TrackerReading]) -> Vector:
    """Return the commanded places, m, shape (n, 3)."""
    made: Vector = np.array([reading.position for reading in readings], dtype=np.float64)
    return made.reshape(-1, 3)


def changes_of(readings: Iterable[TrackerReading]) -> Vector:
    """Return the length changes, m, shape (n,)."""
    return np.array([reading.change for reading in readings], dtype=np.float64)


def uncertainties_of(readings: Iterable[TrackerReading]) -> Vector:
    """Return the standard uncertainties, m, shape (n,)."""
    return np.array([reading.uncertainty for reading in readings], dtype=np.float64)


def measured(
    readings: Iterable[TrackerReading], changes: Vector, uncertainty: Vector
) -> tuple[TrackerReading, ...]:
    """Return the same readings with these length changes and standard uncertainties, m."""
    return tuple(
        replace(reading, change=float(change), uncertainty=float(spread))
        for reading, change, spread in zip(readings, changes, uncertainty, strict=True)
    )
