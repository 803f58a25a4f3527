"""Whether the count of an interferometer fits the way that the axes have made.

A counter that loses or doubles fringes without noticing it goes on with good readings of a wrong
zero. Actual positions show it in two ways. From one reading to the next the displacement cannot
change by more than the axes can have moved in that time; while they stand, by nothing but
vibration. And from one standstill to the next it must change by the way along the beam, up to what
misalignment and the errors of the machine can make of it; a way of the same axis once more, by
nearly as much as the first. What is smaller is not found here; a repeated line shows it.
"""

from collections import deque
from dataclasses import dataclass
from math import dist, isfinite
from typing import NamedTuple

import numpy as np

from stepdiag_ros.metrology.assembly import FIRST_STATUS_THAT_LOSES_ZERO
from stepdiag_ros.metrology.beam import BeamPath, FixedBeam
from stepdiag_ros.metrology.measurement import Reading

MARGIN = 50_000_000
"""ns before and behind two readings in which the speed of the axes is looked at: clocks of
instrument and controller differ, and drives lag. Where positions are farther apart than this,
nothing is judged."""
FLOOR = 5e-6
"""m by which the displacement may change from reading to reading while the axes stand."""
SLACK = 1.1
"""Times the speed of the axes that the displacement may change with."""
ROUGHNESS = 5e-4
"""Part of a way by which two ways of the same axis may differ: twice the slope of the error motions
of a poor machine."""
LEAST_WAY = 1e-3
"""m: shorter ways do not show the alignment."""
STILL = 1e-6
"""m within which axes stand."""
MOST_PENDING = 5000
COUNT_ERROR = 5
"""STATUS_COUNT_ERROR of InterferometerReading.msg."""


Place = tuple[float, float, float]
"""X, Y, Z, m."""


@dataclass(frozen=True)
class _Standing:
    """A moment at which the axes stood."""

    displacement: float
    position: Place


class _Position(NamedTuple):
    """An actual position at a time (ns); time (ns) and speed (m/s) since the one before."""

    time: int
    place: Place
    since: int
    speed: float


class CountCheck:
    """Judges readings by actual positions; both come in order of time, each in itself."""

    def __init__(self) -> None:
        self._beam: BeamPath | None = None
        self._positions: deque[_Position] = deque(maxlen=MOST_PENDING)
        self._readings: deque[tuple[int, float]] = deque(maxlen=MOST_PENDING)
        self._last: tuple[int, float] | None = None
        self._standing: _Standing | None = None
        # Axis → by how much the displacement differs from its way along the beam, m/m, and the
        # length of the way that shows it, m.
        self._slopes: dict[int, tuple[float, float]] = {}
        self._since = 0
        self.trouble = ""

    def end(self) -> None:
        """Judge no reading until the next zero."""
        self._beam = None
        self._readings.clear()
        self.trouble = ""

    def begin(self, beam: BeamPath, time: int) -> None:
        """Take a new zero; what was before a time (ns) no longer counts.

        Args:
            beam: of the line that is measured.
            time: from which readings have the new zero, ns.
        """
        self._beam = beam
        self._readings.clear()
        self._last = self._standing = None
        self._slopes = {}
        self._since = time
        self.trouble = ""

    def add_position(self, time: int, position: Place) -> None:
        """Take an actual position, m, of a time, ns."""
        if not self._positions:
            self._positions.append(_Position(time, position, 0, 0.0))
            return
        last = self._positions[-1]
        if time > last.time:
            since = time - last.time
            speed = dist(position, last.place) / (since * 1e-9)
            self._positions.append(_Position(time, position, since, speed))

    def add_reading(self, time: int, displacement: float, counts: bool) -> None:
        """Take a reading, m, of a time, ns.

        Args:
            time: of measurement.
            displacement: as counted.
            counts: the instrument itself says that it has counted all the way.
        """
        if self._beam is None or time <= self._since:
            return
        if not (counts and isfinite(displacement)):
            self._readings.clear()
            self._last = self._standing = None
        else:
            self._readings.append((time, displacement))

    def judged(self, readings: list[Reading]) -> list[Reading]:
        """Take readings; return them, with ``COUNT_ERROR`` as status once they have no zero."""
        for reading in readings:
            raw = reading.raw_displacement
            value = raw if isfinite(raw) else reading.compensated_displacement
            self.add_reading(reading.time, value, reading.status < FIRST_STATUS_THAT_LOSES_ZERO)
        if not self.check():
            return readings
        return [
            reading._replace(status=COUNT_ERROR)
            if reading.status < FIRST_STATUS_THAT_LOSES_ZERO
            else reading
            for reading in readings
        ]

    def check(self) -> str:
        """Judge what can be judged by now; return what is wrong, which holds until ``begin``."""
        if not self._positions:
            return self.trouble
        known = self._positions[-1].time - MARGIN
        while self._readings and self._readings[0][0] <= known and not self.trouble:
            self._judge(*self._readings.popleft())
        return self.trouble

    def _judge(self, time: int, displacement: float) -> None:
        last, self._last = self._last, (time, displacement)
        if last is None:
            return
        around = self._around(last[0] - MARGIN, time + MARGIN)
        steps = around[1:]
        # What the axes have done between positions that are far apart, nobody knows.
        if not steps or max(step.since for step in steps) > MARGIN:
            return
        speed = max(step.speed for step in steps)
        change = abs(displacement - last[1])
        possible = FLOOR + SLACK * speed * (time - last[0]) * 1e-9
        if change > possible:
            self.trouble = (
                f"the count jumped by {change * 1e6:.4g} µm from one reading to the next, but the "
                f"axes can have moved {possible * 1e6:.4g} µm at most"
            )
        elif all(
            max(places) - min(places) <= STILL
            for places in zip(*(position.place for position in around), strict=True)
        ):
            self._judge_standing(_Standing(displacement, around[-1].place))

    def _judge_standing(self, now: _Standing) -> None:
        before, self._standing = self._standing, now
        if before is None or self._beam is None:
            return
        found = now.displacement - before.displacement
        expected, allowed = 0.0, FLOOR
        # Most readings are of the place of the one before.
        if now.position != before.position:
            expected, allowed = self._expected(before.position, now.position, found)
        if abs(found - expected) > allowed:
            self.trouble = (
                f"the displacement changed by {found * 1e3:.4f} mm where the way of the axes makes "
                f"{expected * 1e3:.4f} mm of it, with {allowed * 1e3:.4f} mm more or less at most"
            )

    def _expected(self, start: Place, end: Place, found: float) -> tuple[float, float]:
        """Return what a way of the axes makes of the displacement, and how far it may be off, m."""
        assert self._beam is not None
        begun, ended = np.array(start), np.array(end)
        way = ended - begun
        expected = float(self._beam.between(begun, ended))
        length = float(np.linalg.norm(way))
        allowed = FLOOR + self._beam.misdirection(begun, ended) * length
        axis = int(np.argmax(np.abs(way)))
        along_axis = length > LEAST_WAY and length - abs(way[axis]) <= STILL
        if along_axis and isinstance(self._beam, FixedBeam):
            slope, shown_by = self._slopes.get(axis, (0.0, 0.0))
            if length > shown_by:
                self._slopes[axis] = (found - expected) / float(way[axis]), length
            # A short way, such as an overrun, shows the slope of a long one badly.
            known = FLOOR + FLOOR * max(length / shown_by, 1.0) if shown_by else np.inf
            if known + ROUGHNESS * length < allowed:
                return expected + slope * float(way[axis]), known + ROUGHNESS * length
        return expected, allowed

    def _around(self, start: int, end: int) -> list[_Position]:
        """Return the positions from the last up to a time to the first from another on.

        They may be far apart when a computer is busy. Empty if they do not reach that far back.
        """
        positions = self._positions
        while len(positions) > 2 and positions[1].time <= start:
            positions.popleft()
        if positions[0].time > start:
            return []
        found = []
        for position in positions:
            found.append(position)
            if position.time >= end:
                break
        return found
