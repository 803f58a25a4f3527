"""The tracker itself: which lengths it can measure, in which directions, and how well."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal

TABLE = "table"
CARRIAGE = "carriage"
_NEARLY = 1e-9


@dataclass(frozen=True)
class Tracker:
    """An autotracking laser interferometer and its reflector.

    Attributes:
        name: in words.
        held_by: ``table`` (workpiece side) or ``carriage`` (tool side); the reflector is on the
            other. Only the direction of the beam in the tracker's own coordinates depends on it.
        minimum_range: shortest length between the centres of tracker and reflector, m.
        maximum_range: longest length, m.
        lowest_elevation: of the beam above the plane square to ``upright``, rad.
        highest_elevation: rad.
        upright: the tracker's vertical axis in machine coordinates, unit vector.
        length_noise: standard uncertainty of a length that does not grow with it, m.
        length_proportional: standard uncertainty in proportion to the length, m/m.
    """

    name: str = "tracker without limits"
    held_by: str = TABLE
    minimum_range: float = 0.05
    maximum_range: float = 100.0
    lowest_elevation: float = -0.5 * np.pi
    highest_elevation: float = 0.5 * np.pi
    upright: tuple[float, float, float] = (0.0, 0.0, 1.0)
    length_noise: float = 0.2e-6
    length_proportional: float = 0.3e-6

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], source: str) -> "Tracker":
        """Make a tracker from the parsed YAML of a tracker file (layout in ``config/trackers``).

        Raises:
            ValueError: names the source, the key, what is wrong and what is expected.
        """
        section = Section(mapping, source)
        degree = np.pi / 180.0
        upright = np.array(section.vector("upright", default=cls.upright))
        made = cls(
            name=section.text("name", default="unnamed"),
            held_by=section.names("held_by", (TABLE, CARRIAGE), default=TABLE)[0],
            minimum_range=section.number(
                "minimum_range_m", low=1e-3, high=100.0, default=cls.minimum_range
            ),
            maximum_range=section.number(
                "maximum_range_m", low=1e-3, high=1000.0, default=cls.maximum_range
            ),
            lowest_elevation=degree
            * section.number("lowest_elevation_deg", low=-90.0, high=90.0, default=-90.0),
            highest_elevation=degree
            * section.number("highest_elevation_deg", low=-90.0, high=90.0, default=90.0),
            upright=_unit(upright, f"{source}: 'upright'"),
            length_noise=section.number(
                "length_noise_m", low=0.0, high=1e-3, default=cls.length_noise
            ),
            length_proportional=section.number(
                "length_proportional", low=0.0, high=1e-3, default=cls.length_proportional
            ),
        )
        section.finish()
        if made.minimum_range >= made.maximum_range:
            raise Refusal(
                f"{source}: minimum_range_m is not below maximum_range_m", fault="mismatch"
            )
        if made.lowest_elevation >= made.highest_elevation:
            raise Refusal(
                f"{source}: lowest_elevation_deg is not below highest_elevation_deg",
                fault="mismatch",
            )
        return made

    def to_mapping(self) -> dict[str, Any]:
        """Return what ``from_mapping`` makes this tracker from."""
        return {
            "name": self.name,
            "held_by": self.held_by,
            "minimum_range_m": self.minimum_range,
            "maximum_range_m": self.maximum_range,
            "lowest_elevation_deg": round(float(np.degrees(self.lowest_elevation)), 9),
            "highest_elevation_deg": round(float(np.degrees(self.highest_elevation)), 9),
            "upright": list(self.upright),
            "length_noise_m": self.length_noise,
            "length_proportional": self.length_proportional,
        }

    def uncertainty(self, lengths: Vector) -> Vector:
        """Return the standard uncertainties of lengths (m), m: √(a² + (b L)²), same shape."""
        made: Vector = np.hypot(self.length_noise, self.length_proportional * np.asarray(lengths))
        return made

    def unseen(self, point: Vector, station: Vector) -> str:
        """Say why the tracker cannot see the reflector at a point; empty if it can.

        Args:
            point: machine coordinates, m, shape (3,).
            station: of the tracker, see ``metrology.tracker``, m, shape (3,).
        """
        way = np.asarray(point, dtype=np.float64) - station
        length = float(np.linalg.norm(way))
        if length < self.minimum_range - _NEARLY:
            return f"{length * 1e3:.1f} mm away, nearer than {self.minimum_range * 1e3:g} mm"
        if length > self.maximum_range + _NEARLY:
            return f"{length:.3f} m away, farther than {self.maximum_range:g} m"
        # From tracker to reflector; on the carriage it is the tracker that the axes move.
        outward = way if self.held_by == TABLE else -way
        sine = float(np.dot(outward, self.upright)) / length
        elevation = float(np.arcsin(np.clip(sine, -1.0, 1.0)))
        if not self.lowest_elevation - _NEARLY <= elevation <= self.highest_elevation + _NEARLY:
            low, high = np.degrees([self.lowest_elevation, self.highest_elevation])
            return (
                f"at an elevation of {np.degrees(elevation):.1f}°, outside of {low:g}° to {high:g}°"
            )
        return ""

    def unseen_on_the_way(self, start: Vector, end: Vector, station: Vector) -> str:
        """Say why the tracker loses the reflector on the straight way to a point; empty if not.

        The elevation is extreme at the ends, where the way is nearest to the tracker, or where it
        passes highest or lowest as seen from it; the way is looked at every few millimetres.
        """
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        length = float(np.linalg.norm(end - start))
        count = max(2, min(2000, int(np.ceil(length / min(5e-3, 0.25 * self.minimum_range))) + 1))
        shares = np.linspace(0.0, 1.0, count)
        if length > 0:
            nearest = float(np.dot(station - start, end - start)) / length**2
            shares = np.append(shares, np.clip(nearest, 0.0, 1.0))
        for share in shares:
            reason = self.unseen(start + share * (end - start), station)
            if reason:
                return reason
        return ""


def _unit(vector: Vector, what: str) -> tuple[float, float, float]:
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise Refusal(f"{what} is not a direction: all three numbers are zero", fault="malformed")
    x, y, z = (float(value) for value in vector / length)
    return x, y, z
