"""Joints of a robot as the axes X, Y and Z: the mapping, its limits, and straight moves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import dist, inf, nan, sqrt
from typing import NamedTuple
from xml.etree import ElementTree

from stepdiag_ros.devices.cnc import Point
from stepdiag_ros.devices.cnc.joint_controller import TrajectoryPoint
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.refusal import Refusal

MOST_JOINTS = 2
"""That move one axis: those of a gantry."""
SHORTEST_CRUISE = 1e-6
"""s: a part of a move at constant speed that is shorter is left out."""


class JointLimits(NamedTuple):
    """Limits of a joint by the URDF, in its unit; infinite where it has none."""

    low: float = -inf
    high: float = inf
    velocity: float = inf


@dataclass(frozen=True)
class Joint:
    """A joint that moves an axis: axis = factor · joint + offset.

    Attributes:
        name: as in the URDF and on ``joint_states``.
        factor: m of the axis by unit of the joint; negative where they run against each other.
        offset: axis position where the joint is at zero, m.
    """

    name: str
    factor: float = 1.0
    offset: float = 0.0

    def axis(self, position: float) -> float:
        """Return the axis position, m, of a joint position."""
        return self.factor * position + self.offset

    def position(self, axis: float) -> float:
        """Return the joint position of an axis position, m."""
        return (axis - self.offset) / self.factor


@dataclass(frozen=True)
class JointAxes:
    """The joints of X, Y and Z; an axis has one joint, or the two of a gantry."""

    of_axes: tuple[tuple[Joint, ...], tuple[Joint, ...], tuple[Joint, ...]]

    @classmethod
    def from_section(cls, section: Section) -> "JointAxes":
        """Take the mapping from a device file.

        Raises:
            ValueError: a joint is missing, wrong, or there twice.
        """
        x, y, z = (_joints(section, axis) for axis in AXES)
        section.finish()
        made = cls((x, y, z))
        twice = next((name for name in made.names if made.names.count(name) > 1), "")
        if twice:
            raise Refusal(
                f"{section.source}: joint '{twice}' is named twice; a joint moves one axis",
                fault="twice",
                about=twice,
            )
        return made

    @property
    def joints(self) -> tuple[Joint, ...]:
        """All joints, those of X first."""
        return tuple(joint for joints in self.of_axes for joint in joints)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints, those of X first."""
        return tuple(joint.name for joint in self.joints)

    def point(self, positions: Mapping[str, float]) -> Point:
        """Return X, Y and Z, m, of joint positions; of the joints of a gantry it is the mean."""
        x, y, z = (
            sum(joint.axis(positions[joint.name]) for joint in joints) / len(joints)
            for joints in self.of_axes
        )
        return x, y, z

    def apart(self, positions: Mapping[str, float]) -> Point:
        """Return by how much the joints of X, Y and Z disagree, m; 0 for a single joint."""
        ends = [[joint.axis(positions[joint.name]) for joint in joints] for joints in self.of_axes]
        x, y, z = (max(places) - min(places) for places in ends)
        return x, y, z

    def positions(self, point: Sequence[float]) -> tuple[float, ...]:
        """Return the joint positions, in the order of ``names``, of X, Y and Z (m)."""
        return tuple(
            joint.position(place)
            for joints, place in zip(self.of_axes, point, strict=True)
            for joint in joints
        )

    def rates(self, velocity: Sequence[float]) -> tuple[float, ...]:
        """Return the joint velocities, in the order of ``names``, of those of the axes (m/s)."""
        return tuple(
            speed / joint.factor
            for joints, speed in zip(self.of_axes, velocity, strict=True)
            for joint in joints
        )

    def tolerances(self, metres: float) -> tuple[float, ...]:
        """Return a tolerance of an axis, m, in the units of the joints."""
        return tuple(metres / abs(joint.factor) for joint in self.joints)

    def travel(self, limits: Mapping[str, JointLimits]) -> tuple[Point, Point]:
        """Return the lower and upper limits of X, Y and Z, m; infinite without limits."""
        lows, highs = [], []
        for joints in self.of_axes:
            ends = [
                sorted((joint.axis(limits[joint.name].low), joint.axis(limits[joint.name].high)))
                for joint in joints
            ]
            lows.append(max(low for low, _ in ends))
            highs.append(min(high for _, high in ends))
        return (lows[0], lows[1], lows[2]), (highs[0], highs[1], highs[2])

    def speeds(self, limits: Mapping[str, JointLimits]) -> Point:
        """Return the largest speeds of X, Y and Z, m/s; NaN where there is no limit."""
        fastest = (
            min(limits[joint.name].velocity * abs(joint.factor) for joint in joints)
            for joints in self.of_axes
        )
        x, y, z = (nan if speed == inf else speed for speed in fastest)
        return x, y, z


def _joints(section: Section, axis: str) -> tuple[Joint, ...]:
    joints = []
    for entry in section.sections(axis):
        name = entry.text("name")
        factor = entry.number("factor", low=-1e3, high=1e3, default=1.0)
        if abs(factor) < 1e-9:
            raise Refusal(f"{entry.source}: 'factor' is {factor:g}", fault="out_of_range")
        joints.append(Joint(name, factor, entry.number("offset_m", -1e3, 1e3, default=0.0)))
        entry.finish()
    if len(joints) > MOST_JOINTS:
        raise Refusal(
            f"{section.source}: '{axis}' has {len(joints)} joints; expected one, or the two of a"
            " gantry",
            fault="too_many",
        )
    return tuple(joints)


def limits_from_urdf(text: str, names: Sequence[str]) -> dict[str, JointLimits]:
    """Return the limits of the named joints.

    Args:
        text: the URDF (XML).
        names: of the joints.

    Raises:
        ValueError: the text is not a URDF, or a joint is not in it, is fixed or has wrong limits.
    """
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise Refusal(f"the robot description is not XML: {error}", fault="malformed") from None
    known = {joint.get("name", ""): joint for joint in root.findall("joint")}
    limits = {}
    for name in names:
        if name not in known:
            there = ", ".join(sorted(known)) or "none"
            raise Refusal(
                f"the robot description has no joint '{name}'; it has: {there}", fault="unknown"
            )
        limits[name] = _limits(name, known[name])
    return limits


def _limits(name: str, joint: ElementTree.Element) -> JointLimits:
    kind, limit = joint.get("type", ""), joint.find("limit")
    if kind not in ("prismatic", "revolute", "continuous"):
        raise Refusal(
            f"the joint '{name}' of the robot description is {kind or 'of no type'}; expected"
            " prismatic, revolute or continuous",
            fault="mismatch",
        )
    if limit is None:
        return JointLimits()
    try:
        velocity = float(limit.get("velocity", "inf"))
        if kind == "continuous":
            return JointLimits(velocity=velocity)
        # By the URDF's own rule both are 0 where they are left out.
        low, high = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
    except ValueError as error:
        raise Refusal(
            f"the limits of the joint '{name}' of the robot description are not numbers: {error}",
            fault="malformed",
        ) from None
    if not (low < high and velocity > 0.0):
        raise Refusal(
            f"the joint '{name}' of the robot description may move from {low:g} to {high:g} at"
            f" up to {velocity:g}/s, which is not a range of motion",
            fault="out_of_range",
        )
    return JointLimits(low, high, velocity)


def straight_move(
    axes: JointAxes, start: Point, target: Point, feed: float, acceleration: Point
) -> tuple[TrajectoryPoint, ...]:
    """Return the points of a straight move from rest to rest, without its start.

    The speed along the path is a trapezoid, or a triangle where the move is too short for the
    feed. Position and velocity at its corners define it exactly, since a controller interpolates
    them by cubic polynomials.

    Args:
        axes: the joints.
        start: X, Y and Z, m.
        target: X, Y and Z, m; not the start.
        feed: along the path, m/s.
        acceleration: largest of X, Y and Z, m/s².
    """
    length = dist(start, target)
    way = [(b - a) / length for a, b in zip(start, target, strict=True)]
    along = min(a / abs(w) for a, w in zip(acceleration, way, strict=True) if w)
    speed = min(feed, sqrt(along * length))
    ramp = speed / along
    cruise = length / speed - ramp
    corners = [(ramp, speed * ramp / 2.0, speed)]
    if cruise > SHORTEST_CRUISE:
        corners.append((ramp + cruise, length - speed * ramp / 2.0, speed))
    else:
        cruise = 0.0
    corners.append((2.0 * ramp + cruise, length, 0.0))
    points = [
        TrajectoryPoint(
            time,
            axes.positions([a + w * far for a, w in zip(start, way, strict=True)]),
            axes.rates([w * rate for w in way]),
        )
        for time, far, rate in corners
    ]
    # The end is the target itself, not what is left of it after rounding.
    points[-1] = points[-1]._replace(positions=axes.positions(target))
    return tuple(points)
