"""Where a machine with Grbl is, and which moves it may make."""

from collections.abc import Iterable
from enum import Enum
from math import hypot, isfinite, nan

from stepdiag_ros.devices.cnc import MoveRefused, Point
from stepdiag_ros.devices.cnc.grbl_protocol import StatusReport
from stepdiag_ros.devices.cnc.grbl_setup import GrblSetup
from stepdiag_ros.devices.cnc.move_check import check_target, far_axes
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.units import NANOSECONDS

SLOWEST = 1e-3 / 60.0
"""m/s: Grbl makes no move slower than 1 mm/min, and does not say so."""
AWAY = NANOSECONDS
"""ns in which an idle controller must be seen at the target."""
JUMP = 1e-3
"""m that a position may change by, beside what speed allows; more is a damaged report."""
MOST_JUMPS = 3
"""Impossible positions in sequence that are believed in the end."""


class Doing(Enum):
    """What the driver is about, in words."""

    STARTING = "is asked for its first report"
    ASKING = "is asked for its settings"
    NOTHING = "does nothing"
    MOVING = "moves"
    HOLDING = "brakes"
    RESETTING = "is being reset"
    UNLOCKING = "is being unlocked"
    HOMING = "is homing"


class TakenReport(Enum):
    """What became of a report."""

    NOT_YET = "it reports no position, or an impossible one"
    TAKEN = "its position is the present one"
    JUMPED = "it insists on a position that cannot be reached from the one before"


class ReportedPosition:
    """The position of the axes, out of the reports.

    A serial line has no checksum, so a digit can be lost: a position that cannot be reached from
    the one before is not accepted until it was reported three times.

    Args:
        start: now, ns.

    Attributes:
        position: X Y Z in machine coordinates, m; NaN until it is known.
        changed: time of the last change, ns.
    """

    def __init__(self, start: int) -> None:
        self.position: Point = (nan, nan, nan)
        self.changed = start
        self._sampled = start
        self._offset: Point | None = None
        self._jumps = 0

    def forget_offset(self) -> None:
        """Wait for the work coordinate offset again: the controller was reset."""
        self._offset = None

    def take(
        self, time: int, report: StatusReport, setup: GrblSetup, *, anywhere: bool
    ) -> TakenReport:
        """Take a report of a time (ns); ``anywhere`` while homing sets the position."""
        if report.offset is not None:
            self._offset = report.offset
        raw = report.machine
        if raw is None:
            if report.work is None or self._offset is None:
                return TakenReport.NOT_YET
            raw = _point(a + b for a, b in zip(report.work, self._offset, strict=True))
        position = _point(value * setup.unit for value in raw)
        jumped = False
        if isfinite(self.position[0]) and not anywhere:
            seconds = (time - self._sampled) * 1e-9 + 0.1
            jumped = any(
                abs(new - old) > JUMP + rate * seconds
                for new, old, rate in zip(position, self.position, setup.rate, strict=True)
            )
        self._jumps = self._jumps + 1 if jumped else 0
        if 0 < self._jumps < MOST_JUMPS:
            return TakenReport.NOT_YET
        self._jumps = 0
        if position != self.position:
            self.changed = time
        self.position, self._sampled = position, time
        return TakenReport.JUMPED if jumped else TakenReport.TAKEN


def _near(machine: Machine, resolution: Point) -> list[float]:
    return [machine.position_window_m + step for step in resolution]


class MoveProgress(Enum):
    """How a move goes on."""

    GOING = "it goes on, or has not stood long enough"
    ARRIVED = "the axes have stood at the target for the hold time"
    AWAY = "the controller has ended the move somewhere else"


class Approach:
    """Judges whether a move has ended in position.

    Args:
        machine: its window and hold time.
        resolution: of the reported positions, m; the window is widened by it.
        target: of the move, m.

    Attributes:
        acknowledged: the controller has taken the line; earlier reports belong to another move.
    """

    def __init__(self, machine: Machine, resolution: Point, target: Point) -> None:
        self._machine, self._target = machine, target
        self._near = _near(machine, resolution)
        self._within: int | None = None
        self._away: int | None = None
        self.acknowledged = False

    @property
    def inside(self) -> bool:
        """Say whether the axes stood in the window last."""
        return self._within is not None

    def judge(self, time: int, position: Point, *, moving: bool) -> MoveProgress:
        """Return how a move goes on at a time (ns)."""
        if moving:
            self._within = self._away = None
        elif not far_axes(position, self._target, self._near):
            self._away = None
            if self._within is None:
                self._within = time
            elif time - self._within >= self._machine.position_hold_s * NANOSECONDS:
                return MoveProgress.ARRIVED
        else:
            self._within = None
            self._away = time if self._away is None else self._away
            if time - self._away > AWAY:
                return MoveProgress.AWAY
        return MoveProgress.GOING


def check_move(
    machine: Machine, setup: GrblSetup, position: Point, target: Point, feed: float, axes: str
) -> None:
    """Refuse a move that must not be made, or that the controller would make in another way.

    Args:
        machine: as its file describes it.
        setup: of the controller.
        position: where it is, m.
        target: after the move, m.
        feed: m/s.
        axes: that may move.

    Raises:
        MoveRefused: the text says why.
    """
    far = check_target(
        position,
        target,
        feed,
        axes,
        limits=(setup.low, setup.high),
        feed_limit=machine.feed_limit_m_per_s,
        near=_near(machine, setup.traits.resolution),
    )
    if feed < SLOWEST:
        raise MoveRefused(
            f"the feed {feed:g} m/s is below the {SLOWEST:.2g} m/s that Grbl can do",
            fault="out_of_range",
            aspect="slowest",
        )
    way = [a - b for a, b in zip(target, position, strict=True)]
    for number, (axis, part, rate) in enumerate(zip(AXES, way, setup.rate, strict=True)):
        if axis in far and feed * abs(part) / hypot(*way) > rate * 1.001:
            raise MoveRefused(
                f"{axis} would move faster than the {rate:g} m/s that the controller allows"
                f" ($11{number}): it would be slower than asked for",
                fault="out_of_range",
                aspect="fastest",
            )


def braking_limit(machine: Machine, setup: GrblSetup) -> int:
    """Return the time, ns, after which braking axes stand for sure."""
    braking = machine.feed_limit_m_per_s / min(setup.traits.acceleration)
    return round((min(braking, 10.0) + 1.0) * NANOSECONDS)


def line_of_move(target: Point, feed: float, axes: str) -> str:
    """Return the line for a move: target in m, feed in m/s, only the named axes."""
    words = "".join(
        f"{axis}{_plain(value * 1e3)}"
        for axis, value in zip(AXES, target, strict=True)
        if axis in axes
    )
    return f"G90G94G21G53G1{words}F{_plain(feed * 6e4)}"


def _plain(value: float) -> str:
    """Return a number as Grbl reads it: 8 digits at most, no exponent, no minus before zero."""
    text = f"{value:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _point(values: Iterable[float]) -> Point:
    x, y, z = values
    return x, y, z


def not_yet(words: str, aspect: str) -> MoveRefused:
    """Return the refusal of a reset that will be possible soon."""
    return MoveRefused(f"{words}: reset again in a moment", fault="busy", aspect=aspect)
