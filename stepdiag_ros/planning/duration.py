"""How long a plan takes: moves, dwells, and the alignments of laser and mirror."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stepdiag_ros.metrology.drive import StraightMove
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import DIAGONAL, LINEAR, Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.planning.moves import DrivenLine, Point, dwell_of, passes_of


@dataclass(frozen=True)
class Assumptions:
    """What a plan does not say and its duration depends on.

    Attributes:
        linear_alignment_s: to align laser and mirror for a linear line, s.
        diagonal_alignment_s: to do so for a diagonal, where the beam lies askew in the volume, s.
        settling_s: from the end of the commanded motion until the controller says in position,
            beyond the machine's own hold time, s: lag and vibration of the drives.
    """

    linear_alignment_s: float = 600.0
    diagonal_alignment_s: float = 1200.0
    settling_s: float = 0.1

    def __post_init__(self) -> None:
        """Refuse negative times.

        Raises:
            ValueError: names the assumption.
        """
        for name in ("linear_alignment_s", "diagonal_alignment_s", "settling_s"):
            if not 0.0 <= getattr(self, name) < 1e6:
                raise Refusal(
                    f"{name} is {getattr(self, name):g} s; expected 0 or more", fault="out_of_range"
                )

    def alignment_s(self, kind: str) -> float:
        """Return the time to align laser and mirror for a line of a kind, s."""
        return self.linear_alignment_s if kind == LINEAR else self.diagonal_alignment_s


@dataclass(frozen=True)
class LineDuration:
    """Time that one line takes.

    Attributes:
        setup: its alignment.
        stops: number of its stops.
        aligned: the operator aligns laser and mirror before it.
        alignment: time for that, s; 0 if the alignment stands already.
        positioning: from the end of the line before to the first stop, s.
        moves: between its stops, s.
        dwells: at its stops, s.
    """

    setup: str
    stops: int
    aligned: bool
    alignment: float
    positioning: float
    moves: float
    dwells: float

    @property
    def total(self) -> float:
        """Return all of it, s."""
        return self.alignment + self.positioning + self.moves + self.dwells


@dataclass(frozen=True)
class PlanDuration:
    """Time that a plan takes, in the order of its lines.

    Attributes:
        lines: one entry a line.
        assumptions: that it rests on.
    """

    lines: tuple[LineDuration, ...]
    assumptions: Assumptions

    @property
    def total(self) -> float:
        """Return the whole duration, alignments included, s."""
        return sum(line.total for line in self.lines)

    @property
    def alignment(self) -> float:
        """Return the part in which the operator aligns, s."""
        return sum(line.alignment for line in self.lines)

    @property
    def running(self) -> float:
        """Return the part in which the machine runs by itself, s."""
        return self.total - self.alignment

    @property
    def stops(self) -> int:
        """Return the number of stops."""
        return sum(line.stops for line in self.lines)

    @property
    def alignments(self) -> int:
        """Return how often laser and mirror are aligned."""
        return sum(line.aligned for line in self.lines)


class MoveTimes:
    """Times of single moves of a machine at a feed; each distance is worked out once.

    Args:
        machine: its acceleration and in-position time.
        feed: of every move, m/s.
        settling: beyond the machine's hold time, s.
    """

    def __init__(self, machine: Machine, feed: float, settling: float) -> None:
        self._machine = machine
        self._feed = feed
        self._in_position = machine.position_hold_s + settling
        self._known: dict[tuple[float, ...], float] = {}

    def move(self, *ways: float) -> float:
        """Return the time from the command to in position of one straight move, s.

        A trapezoid of velocity within the feed along the path and the acceleration of every axis; a
        move of no length still has to be found in position.

        Args:
            ways: of the axes, m.
        """
        key = tuple(round(abs(way), 12) for way in ways)
        if key not in self._known:
            end = np.array(key)
            straight = StraightMove.between(
                np.zeros(len(key)), end, self._feed, self._machine.acceleration_m_per_s2
            )
            moving = max((one.duration for one in straight.trajectories.values()), default=0.0)
            self._known[key] = moving + self._in_position
        return self._known[key]

    def between(self, before: Point, after: Point, at_once: bool) -> float:
        """Return the time between two places: axes one after the other, or all at once, s."""
        ways = [b - a for a, b in zip(before, after, strict=True)]
        if at_once:
            return self.move(*ways)
        moved = [way for way in ways if way != 0.0]
        return sum(self.move(way) for way in moved) if moved else self.move(0.0)


def duration(
    plan: Plan,
    machine: Machine,
    assumptions: Assumptions | None = None,
    start: Point | None = None,
) -> PlanDuration:
    """Return how long a plan takes on a machine.

    Lines measured again because a stop did not settle are not counted.

    Args:
        plan: with a feed.
        machine: its acceleration and in-position window.
        assumptions: the default ones if None.
        start: where the machine stands at first, m; at the first stop if None.

    Raises:
        ValueError: the plan has no feed.
    """
    assumptions = assumptions or Assumptions()
    if not plan.feed > 0.0:
        raise Refusal("the plan has no feed_m_per_s, so its duration is not known", fault="missing")
    clock = MoveTimes(machine, plan.feed, assumptions.settling_s)
    dwell = dwell_of(plan)
    place = start
    known: dict[tuple[Point, ...], tuple[float, float]] = {}
    lines = []
    for one in passes_of(plan):
        # Without pauses the cell is aligned already, and nobody is waited for.
        aligned = one.new_setup and plan.pause_for_setup
        alignment = 0.0
        if aligned:
            alignment = assumptions.alignment_s(one.line.kind)
        if one.targets not in known:
            known[one.targets] = _pass_times(one, clock)
        run_up, moves = known[one.targets]
        first = one.targets[0]
        in_beam = one.line.kind == DIAGONAL and one.back > 0
        lines.append(
            LineDuration(
                setup=one.setup,
                stops=one.stops,
                aligned=aligned,
                alignment=alignment,
                positioning=clock.between(place or first, first, at_once=in_beam) + run_up,
                moves=moves,
                dwells=dwell * (2 if plan.on_the_fly else one.stops),
            )
        )
        place = one.targets[-1]
    return PlanDuration(tuple(lines), assumptions)


def _pass_times(one: DrivenLine, clock: MoveTimes) -> tuple[float, float]:
    """Return the times of a pass from its first target to its first stop, and from there on, s."""
    at_once = one.line.kind == DIAGONAL
    ways = [clock.between(a, b, at_once) for a, b in pairwise(one.targets)]
    before = len(one.targets) - one.stops
    return sum(ways[:before]), sum(ways[before:])
