"""Straight and circular moves of three axes, as places along the way from 0 to 1."""

from dataclasses import dataclass
from math import atan2, hypot, pi

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal

RAPID, LINE, ARC = "rapid", "line", "arc"
RADIUS_TOLERANCE = 5e-6
RADIUS_SHARE = 1e-3
"""m, and part of the radius, by which an arc's radius at its ends may differ."""


@dataclass(frozen=True)
class Arc:
    """The circular part of a move.

    Attributes:
        plane: places of the two axes that turn and of the one along the axis of rotation; turning
            from the first to the second is counter-clockwise (G3).
        center: coordinates of the center on the two axes, m.
        sweep: angle from start to end, rad, counter-clockwise positive.
    """

    plane: tuple[int, int, int]
    center: tuple[float, float]
    sweep: float


@dataclass(frozen=True)
class Motion:
    """One move.

    Attributes:
        kind: ``RAPID``, ``LINE`` or ``ARC``.
        start: machine coordinates of the axes, m, shape (3,); NaN where not known.
        end: the same.
        arc: of a circular move.
    """

    kind: str
    start: Vector
    end: Vector
    arc: Arc | None = None

    @property
    def known(self) -> bool:
        """Say whether all axes are known at the end, and those of feed moves at the start, too."""
        ends = bool(np.all(np.isfinite(self.end)))
        return ends and (self.kind == RAPID or bool(np.all(np.isfinite(self.start))))

    @property
    def length(self) -> float:
        """Return the length of the way, m."""
        if self.arc is None:
            return float(np.linalg.norm(self.end - self.start))
        first, second, along = self.arc.plane
        radius = hypot(
            self.start[first] - self.arc.center[0], self.start[second] - self.arc.center[1]
        )
        return hypot(radius * self.arc.sweep, float(self.end[along] - self.start[along]))

    def at(self, part: Vector) -> Vector:
        """Return places on the way, m, shape (n, 3).

        An arc whose radius differs at its ends within the tolerance changes it evenly.

        Args:
            part: of the way, 0..1, shape (n,).
        """
        part = np.asarray(part, dtype=np.float64)
        straight: Vector = self.start + part[:, None] * (self.end - self.start)
        if self.arc is None:
            return straight
        first, second, _ = self.arc.plane
        center = np.array(self.arc.center)
        begin = self.start[[first, second]] - center
        finish = self.end[[first, second]] - center
        radius = hypot(*begin) + part * (hypot(*finish) - hypot(*begin))
        angle = atan2(begin[1], begin[0]) + part * self.arc.sweep
        straight[:, first] = center[0] + radius * np.cos(angle)
        straight[:, second] = center[1] + radius * np.sin(angle)
        return straight


def arc_by_center(
    start: Vector, end: Vector, plane: tuple[int, int, int], center: Vector, clockwise: bool
) -> Arc:
    """Return the arc around a center; a whole turn where start and end are the same.

    Raises:
        ValueError: the radius differs at start and end.
    """
    first, second, _ = plane
    begin = start[[first, second]] - center
    finish = end[[first, second]] - center
    radii = hypot(*begin), hypot(*finish)
    if min(radii) <= 0.0:
        raise Refusal(
            "the center of the arc is its start or its end", fault="mismatch", aspect="centre"
        )
    if abs(radii[1] - radii[0]) > max(RADIUS_TOLERANCE, RADIUS_SHARE * radii[0]):
        raise Refusal(
            f"the arc's radius is {1e3 * radii[0]:.4f} mm at its start and"
            f" {1e3 * radii[1]:.4f} mm at its end",
            fault="mismatch",
            aspect="radius",
        )
    sweep = atan2(finish[1], finish[0]) - atan2(begin[1], begin[0])
    whole = bool(np.allclose(begin, finish, rtol=0.0, atol=1e-9))
    return Arc(plane, (float(center[0]), float(center[1])), _turned(sweep, whole, clockwise))


def _turned(sweep: float, whole: bool, clockwise: bool) -> float:
    if whole:
        return -2.0 * pi if clockwise else 2.0 * pi
    turn = sweep % (2.0 * pi)
    return turn - 2.0 * pi if clockwise else turn


def arc_by_radius(
    start: Vector, end: Vector, plane: tuple[int, int, int], radius: float, clockwise: bool
) -> Arc:
    """Return the arc of a radius (the shorter one; the longer one if the radius is negative).

    Raises:
        ValueError: start and end are the same, or too far apart for the radius.
    """
    first, second, _ = plane
    begin, finish = start[[first, second]], end[[first, second]]
    chord = finish - begin
    half = hypot(*chord) / 2.0
    if half <= 0.0:
        raise Refusal(
            "an arc by radius needs an end that is not its start; use I, J, K",
            fault="mismatch",
            aspect="end",
        )
    beyond = half - abs(radius)
    if beyond > max(RADIUS_TOLERANCE, RADIUS_SHARE * abs(radius)):
        raise Refusal(
            "the arc's radius is too small to reach from its start to its end",
            fault="out_of_range",
            aspect="radius",
        )
    height = np.sqrt(max(radius * radius - half * half, 0.0))
    normal = np.array([-chord[1], chord[0]]) / (2.0 * half)
    # The center of a shorter counter-clockwise arc lies to the left of its chord.
    side = (1.0 if radius > 0.0 else -1.0) * (-1.0 if clockwise else 1.0)
    center = (begin + finish) / 2.0 + side * height * normal
    return arc_by_center(start, end, plane, center, clockwise)
