"""The beam of a line: what a move of the machine does to the reading of a perfect setup."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stepdiag_ros.metrology.geometry import Vector, inner

MISALIGNMENT = 5e-3
"""Part of a way by which a reading may differ from it: twice the tilt of beam or mirror, in rad,
with which a signal still comes back."""
STATION_UNKNOWN = 20e-3
"""m by which a tracker may stand elsewhere than its plan says before it has been located."""


class BeamPath(Protocol):
    """Where the light of an interferometer runs while one line is measured."""

    def between(self, start: Vector, end: Vector) -> Vector:
        """Return by how much the reading grows from some places to others, m, shape (...).

        Args:
            start: machine coordinates, m, shape (..., 3).
            end: the same.
        """
        ...

    def path(self, place: Vector, start: Vector, dead_path: float) -> float:
        """Return the length of the measuring path at a place, m.

        Args:
            place: machine coordinates, m, shape (3,).
            start: first stop of the line, m, shape (3,).
            dead_path: to the mirror at that stop, m.
        """
        ...

    def span(self, start: Vector, end: Vector) -> float:
        """Return the largest change of the reading that this move could make, m."""
        ...

    def misdirection(self, start: Vector, end: Vector) -> float:
        """Return the part of a way by which the reading may differ from ``between``."""
        ...


@dataclass(frozen=True)
class FixedBeam:
    """A beam that stands still.

    Attributes:
        direction: away from the laser, unit vector, shape (3,).
    """

    direction: Vector

    def between(self, start: Vector, end: Vector) -> Vector:
        """Return the way along the beam, m; see ``BeamPath``."""
        return inner(self.direction, np.asarray(end) - np.asarray(start))

    def path(self, place: Vector, start: Vector, dead_path: float) -> float:
        """Return the dead path and the way from the first stop, m; see ``BeamPath``."""
        return dead_path + float(self.between(start, place))

    def span(self, start: Vector, end: Vector) -> float:
        """Return the way along the beam without its sign, m; see ``BeamPath``."""
        return abs(float(self.between(start, end)))

    def misdirection(self, start: Vector, end: Vector) -> float:  # noqa: ARG002
        """Return what a misalignment makes possible; see ``BeamPath``."""
        return MISALIGNMENT


@dataclass(frozen=True)
class TrackingBeam:
    """The beam of a tracker, which follows the reflector; the reading is a length (ATLI eq. 2).

    Attributes:
        station: place of the tracker in machine coordinates, m, shape (3,).
    """

    station: Vector

    def _length(self, place: Vector) -> Vector:
        way = np.asarray(place, dtype=np.float64) - self.station
        length: Vector = np.sqrt(inner(way, way))
        return length

    def between(self, start: Vector, end: Vector) -> Vector:
        """Return the change of the length, m; see ``BeamPath``."""
        return self._length(end) - self._length(start)

    def path(self, place: Vector, start: Vector, dead_path: float) -> float:  # noqa: ARG002
        """Return the length itself, m; see ``BeamPath``."""
        return float(self._length(place))

    def span(self, start: Vector, end: Vector) -> float:
        """Return the whole way, m: how much of it lies along the beam, the station decides."""
        return float(np.linalg.norm(np.asarray(end) - np.asarray(start)))

    def misdirection(self, start: Vector, end: Vector) -> float:
        """Return what a tracker makes possible that stands elsewhere; see ``BeamPath``."""
        nearest = float(min(self._length(start), self._length(end)))
        return min(1.0, MISALIGNMENT + STATION_UNKNOWN / max(nearest, 1e-6))
