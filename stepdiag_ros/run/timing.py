"""How late readings are stamped against positions, found line by line while a run goes on."""

from collections import deque
from math import floor, isfinite, isnan, log10

import numpy as np

from stepdiag_ros.metrology.measurement import MeasuredLine, Reading
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.time_alignment import (
    SEARCH_LIMIT,
    LineRecord,
    RunTiming,
    TimeOffset,
    line_offset,
    run_timing,
)
from stepdiag_ros.run.health import HealthFinding, Level, figure

_MARGIN = round(SEARCH_LIMIT * 1e9)
_SPACING = 2_000_000
"""ns between two readings that are looked at, at least."""
_MOST = 40_000
"""Readings and positions of a line that are kept; of a longer one every second, every fourth …"""
WORRYING = 0.5
"""Part of the time to settle; readings that are late by more may show the machine on the way."""
FIRST_BAD = 2


def effect_on_stops(offset: TimeOffset, settle: float) -> str:
    """Say what an offset does to the windows in which stops are read.

    Args:
        offset: how late readings are stamped.
        settle: s from in position to the begin of the window.
    """
    if offset.reason:
        return f"not known: {offset.reason}"
    begin = settle - offset.offset
    if begin < 0.0:
        return (
            f"windows begin {-begin:.3g} s before the machine is in position: the stops are wrong"
        )
    shown, asked = f"{begin:.4g}", f"{settle:.4g}"
    return f"windows begin {shown} s after in position" + (
        f" instead of {asked} s" if shown != asked else ""
    )


def worrying(offset: TimeOffset, settle: float) -> bool:
    """Say whether an offset takes more of the time to settle than it may."""
    return not offset.reason and offset.offset > WORRYING * settle


def in_words(timing: RunTiming) -> str:
    """Say how late readings are stamped, with the expanded uncertainty (95 %)."""
    offset = timing.offset
    if offset.reason:
        return f"not known: {offset.reason}"
    # Two digits of the uncertainty, and no more of the value.
    wide = max(offset.expanded_uncertainty * 1e6, 1e-3)
    digits = min(max(1 - floor(log10(wide)), 0), 3)
    side = "early" if offset.offset < 0.0 else "late"
    told = (
        f"readings are stamped {abs(offset.offset) * 1e6:.{digits}f} µs {side}"
        f" ± {wide:.{digits}f} µs (95 %, {offset.moves} moves)"
    )
    if not isnan(timing.drift) and abs(timing.drift) > 2.0 * timing.drift_uncertainty:
        told += (
            f", {timing.drift * 3600e6:+.0f} µs/h ± {2.0 * timing.drift_uncertainty * 3600e6:.0f}"
        )
    if offset.others:
        others = ", ".join(f"{other:.3g} s" for other in offset.others)
        told += f"; {others} fits about as well"
    return told


class LiveTiming:
    """Finds how late readings are stamped, after each line of a run.

    Args:
        plan: of the run.
        start: of the run, ns; times of finished lines count from it.
    """

    def __init__(self, plan: Plan, start: int) -> None:
        self._plan = plan
        self._start = start
        self._positions: list[tuple[int, tuple[float, float, float]]] = []
        self._readings: list[tuple[int, float, bool]] = []
        self._spacing = _SPACING
        self._pending: deque[MeasuredLine] = deque()
        self._found: list[TimeOffset] = []
        self.timing = run_timing([])

    def take_position(self, time: int, position: tuple[float, float, float]) -> None:
        """Take where the axes are (m) at a time (ns)."""
        if self._positions and time <= self._positions[-1][0]:
            return
        self._positions.append((time, position))
        if len(self._positions) > _MOST:
            del self._positions[1:-1:2]
        # Positions behind the line tell what the last of its readings have seen.
        if self._pending and time > self._pending[0].end_time + _MARGIN:
            self._finish(self._pending.popleft())

    def take_reading(self, reading: Reading) -> None:
        """Take the next reading."""
        value = reading.raw_displacement
        if not isfinite(value):
            # Some instruments tell only what they have compensated themselves.
            value = reading.compensated_displacement
        bad = reading.status >= FIRST_BAD or not isfinite(value)
        if self._readings:
            last, _, was_bad = self._readings[-1]
            # The first bad one of several tells as much as all of them.
            if bad <= was_bad and reading.time < last + self._spacing:
                return
        self._readings.append((reading.time, value, bad))
        if len(self._readings) > _MOST:
            self._spacing *= 2
            self._readings = [
                one
                for number, one in enumerate(self._readings)
                if number % 2 or (one[2] and not self._readings[number - 1][2])
            ][-_MOST:]

    def take_line(self, line: MeasuredLine) -> None:
        """Take note that a line is finished."""
        self._pending.append(line)

    def judge(self) -> HealthFinding:
        """Return how late readings are stamped, and what that does to the stops."""
        timing, settle = self.timing, self._plan.sampling.settle
        offset = timing.offset
        values = {
            "readings stamped late by (µs)": figure(offset.offset * 1e6),
            "expanded uncertainty (µs)": figure(offset.expanded_uncertainty * 1e6),
            "drift (µs/h)": figure(timing.drift * 3600e6),
            "lines": str(len(timing.lines)),
            "windows of stops": effect_on_stops(offset, settle),
        }
        if offset.reason:
            return HealthFinding(Level.OK, "the offset of the clocks is not known yet", values)
        if worrying(offset, settle):
            return HealthFinding(
                Level.WARN, "readings are stamped so late that stops are read too early", values
            )
        if offset.others:
            return HealthFinding(Level.WARN, "more than one offset of the clocks fits", values)
        return HealthFinding(Level.OK, "readings and positions fit in time", values)

    def _finish(self, line: MeasuredLine) -> None:
        begin, end = self._start + round(float(np.nanmin(line.time)) * 1e9), line.end_time
        part = [one for one in self._readings if begin <= one[0] < end]
        if any(bad for _, _, bad in part):
            found = TimeOffset(reason="the zero was lost on the way")
        else:
            beam = self._plan.lines[line.line_index].beam(self._plan.volume)
            record = LineRecord(
                np.array([time for time, _ in self._positions], dtype=np.int64),
                beam.between(line.target[0], np.array([place for _, place in self._positions])),
                np.array([time for time, _, _ in part], dtype=np.int64),
                np.array([value for _, value, _ in part]),
            )
            found = line_offset(record)
        self._found.append(found)
        self.timing = run_timing(self._found)
        self._positions = [one for one in self._positions if one[0] >= end - _MARGIN]
        self._readings = [one for one in self._readings if one[0] >= end]
        self._spacing = _SPACING
