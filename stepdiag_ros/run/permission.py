"""What plan, machine and controller allow a command to do: the bridge's check of every move."""

from dataclasses import dataclass
from functools import cached_property
from math import isfinite, isnan

import numpy as np

from stepdiag_ros.devices.cnc import Point, Traits
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import FORWARD, Line, Plan, moved_axes

OFF_LINE = 1e-4
"""m: farther from its line no move of several axes begins or ends, farther from its place no axis
stands that is not to move; far above any in-position window and far below what could hit
anything."""
SAME_PLACE = 1e-9
"""m by which a stop of a command may differ from that of the plan."""
LONGEST_DEAD_MAN = 0.5
"""s after which a machine whose driver is dead should stand."""
ROUNDING = 1e-9
"""Part by which a feed or an acceleration may be above its limit: units are converted."""


@dataclass(frozen=True)
class CommandedMove:
    """One commanded move (fields as in StepCommand.msg), and where it begins.

    Attributes:
        line_index: of the plan.
        at_stop: it ends at a stop of the line; else it only travels.
        stop: of the line.
        axes: that are to move, such as X or XYZ; empty where none does.
        position: actual one at the begin, m; NaN if it is not known. Where targets are corrected,
            the place that it is meant for.
        target: m.
        feed: m/s.
        uncorrected: actual position at the begin where targets are corrected, m.
    """

    line_index: int
    at_stop: bool
    stop: int
    axes: str
    position: Point
    target: Point
    feed: float
    uncorrected: Point | None = None


@dataclass(frozen=True)
class MotionPermission:
    """What may be asked of a machine in a run.

    A move is allowed if all of this holds: its numbers are numbers, and it is known where the
    machine stands; its feed is not above that of the plan, the machine and the controller; it moves
    no axis that it does not name; it ends within the soft limits of both machine file and
    controller; if it ends at a stop, that is the stop that the plan has there, and it begins within
    the plan's box; if it only travels, the axis that moves ends within the plan's box, so that no
    move leads farther away from it than the machine stands already; several axes move at once only
    on lines whose axes move at once (``refusal_of_plan``).

    The plan's box is the hull of all stops and run-ups of its lines; with a tracker, that of the
    plan's volume as well.

    Attributes:
        plan: of the run.
        machine: as its file has it.
        soft_limits: of the controller, m.
        traits: of the controller.
    """

    plan: Plan
    machine: Machine
    soft_limits: tuple[Point, Point]
    traits: Traits

    @cached_property
    def box(self) -> tuple[Vector, Vector]:
        """Lower and upper corner of the plan's box, m, each of shape (3,)."""
        places = []
        for line in self.plan.lines:
            places.append(line.stops(self.plan.volume))
            beyond = self.plan.run_up(line)
            if beyond is not None:
                places.append(beyond[np.newaxis])
        if self.plan.tracker is not None:
            # Ways that keep clear of the tracker lead anywhere in its box.
            places.append(self.plan.corners)
        every = np.vstack(places)
        return every.min(axis=0), every.max(axis=0)

    def refusal(self, move: CommandedMove) -> str:
        """Say why a move is not allowed; empty if it is."""
        if not 0 <= move.line_index < len(self.plan.lines):
            count = len(self.plan.lines)
            return f"it is for line {move.line_index}, but the plan has {count} lines"
        if not all(isfinite(value) for value in move.target):
            return f"its target {move.target} m is not a position"
        if not all(isfinite(value) for value in move.position):
            return "it is not known where the machine stands"
        return (
            self._refusal_of_feed(move.feed)
            or self._refusal_of_axes(move)
            or self.refusal_of_place(move.target)
            or (self._refusal_of_stop(move) if move.at_stop else self._refusal_of_travel(move))
            or refusal_of_plan(self.plan, move.line_index, move.axes, move.position, move.target)
        )

    def refusal_of_place(self, target: Point) -> str:
        """Say which soft limit forbids a place (m); empty if none does."""
        machine, (low, high) = self.machine, self.soft_limits
        for axis, name in enumerate(AXES):
            # The first of two wins over one that is not a number: limits not told by the
            # controller.
            lowest = max(machine.travel_low_m[axis], low[axis])
            highest = min(machine.travel_high_m[axis], high[axis])
            if not lowest <= target[axis] <= highest:
                return (
                    f"{name} = {target[axis]:g} m lies beyond the soft limits {lowest:g} m to "
                    f"{highest:g} m"
                )
        return ""

    def _refusal_of_feed(self, feed: float) -> str:
        if not (isfinite(feed) and feed > 0.0):
            return f"its feed {feed:g} m/s is not a positive number"
        if isnan(self.plan.feed):
            return "the plan has no feed_m_per_s"
        limits = {
            "of the plan": self.plan.feed,
            "limit of the machine": self.machine.feed_limit_m_per_s,
            **{
                f"limit of the controller for {axis}": limit
                for axis, limit in zip(AXES, self.traits.feed_limit, strict=True)
            },
        }
        for whose, limit in limits.items():
            # What the controller does not tell forbids nothing.
            if feed > limit * (1.0 + ROUNDING):
                return f"its feed {feed:g} m/s is above the feed {whose}, {limit:g} m/s"
        return ""

    def _refusal_of_axes(self, move: CommandedMove) -> str:
        # A run that begins or is resumed has an axis stay at its actual place.
        stray = [
            axis
            for axis, place, actual, target in zip(
                AXES, move.position, move.uncorrected or move.position, move.target, strict=True
            )
            if axis not in move.axes and min(abs(target - place), abs(target - actual)) > OFF_LINE
        ]
        if stray:
            asked = " and ".join(move.axes) or "none"
            return (
                f"it would move {' and '.join(stray)} as well, but was asked for as one of {asked}"
            )
        return ""

    def _refusal_of_stop(self, move: CommandedMove) -> str:
        line = self.plan.lines[move.line_index]
        stops = line.stops(self.plan.volume)
        if not 0 <= move.stop < len(stops):
            return f"it is for stop {move.stop}, but line '{line}' has {len(stops)} stops"
        x, y, z = stops[move.stop]
        if max(abs(move.target - stops[move.stop])) > SAME_PLACE:
            return f"stop {move.stop} of line '{line}' is at {x:g}, {y:g}, {z:g} m"
        low, high = self.box
        for axis, name in enumerate(AXES):
            place = move.position[axis]
            if not low[axis] - OFF_LINE <= place <= high[axis] + OFF_LINE:
                return (
                    f"it begins at {name} = {place:g} m, outside the plan's box, which is "
                    f"{low[axis]:g} m to {high[axis]:g} m"
                )
        return ""

    def _refusal_of_travel(self, move: CommandedMove) -> str:
        low, high = self.box
        for axis, name in enumerate(AXES):
            target = move.target[axis]
            inside = low[axis] - OFF_LINE <= target <= high[axis] + OFF_LINE
            if name in move.axes and not inside:
                return (
                    f"it leads to {name} = {target:g} m, outside the plan's box, which is "
                    f"{low[axis]:g} m to {high[axis]:g} m"
                )
        return ""


def too_brisk(machine: Machine, traits: Traits) -> str:
    """Say which axis a controller accelerates more than the machine may; empty if none."""
    allowed = machine.acceleration_m_per_s2
    for axis, given in zip(AXES, traits.acceleration, strict=True):
        if given > allowed * 1.01:
            return (
                f"the controller accelerates {axis} with up to {given:g} m/s², but the machine "
                f"file allows {allowed:g} m/s²: lower it in the controller, or correct "
                "acceleration_m_per_s2"
            )
    return ""


def shortcomings(traits: Traits) -> list[str]:
    """Say, a sentence each, what an operator must know of a controller before it moves."""
    said = []
    if isnan(traits.dead_man):
        said.append(
            "the controller is not known to stop by itself when this computer falls silent: see"
            " docs/safety.md"
        )
    elif traits.dead_man > LONGEST_DEAD_MAN:
        said.append(
            f"when this computer falls silent, the machine goes on for {traits.dead_man:g} s"
        )
    if not traits.measured:
        said.append(
            "actual positions are what the controller has commanded: lost steps are not noticed"
        )
    return said


def refusal_of_plan(
    plan: Plan,
    line_index: int,
    axes: str,
    position: tuple[float, float, float],
    target: tuple[float, float, float],
) -> str:
    """Say why a plan does not allow several axes to move at once; empty if it does.

    They do only on lines whose axes move at once, all axes of the line together, and from place to
    place on the line itself, at most its overrun beyond its ends.

    Args:
        plan: of the present run.
        line_index: that the command names.
        axes: that are to move at once, such as X or XYZ.
        position: where the machine stands, m.
        target: where the move ends, m.
    """
    if len(axes) <= 1:
        return ""
    if not 0 <= line_index < len(plan.lines):
        return f"it is for line {line_index}, but the plan has {len(plan.lines)} lines"
    line = plan.lines[line_index]
    at_once = " and ".join(axes)
    if not line.moves_at_once:
        return f"it moves {at_once} at once; on line '{line}' only one axis may move at a time"
    stops = line.stops(plan.volume)
    own = moved_axes(stops[0], stops[-1])
    if axes != own:
        return f"it moves {at_once} at once, but line '{line}' is one of {' and '.join(own)}"
    for words, place in (("begins", position), ("ends", target)):
        if not _on_line(np.asarray(place, dtype=np.float64), line, plan):
            x, y, z = place
            return f"it {words} at {x:g}, {y:g}, {z:g} m, which is not on line '{line}'"
    return ""


def _on_line(place: Vector, line: Line, plan: Plan) -> bool:
    stops = line.stops(plan.volume)
    first, last = (stops[0], stops[-1]) if line.direction == FORWARD else (stops[-1], stops[0])
    direction = (last - first) / np.linalg.norm(last - first)
    along = float(direction @ (place - first))
    beside = float(np.linalg.norm(place - first - along * direction))
    reach = plan.overrun_of(line) + OFF_LINE
    length = float(direction @ (last - first))
    # Written so that a place that is not a number is not on the line.
    return beside <= OFF_LINE and -reach <= along <= length + reach
