"""How long a seven-line test takes: with a tracker, and with a laser that is aligned on each line.

A tracker is set up once for all lines and goes to some places more, from which it is located. A
conventional laser is aligned for each line, which takes about three times as long in all by
ATLI, section 1, and twice by its abstract. How long setting up and aligning take is assumed, the
rest is calculated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.readings import SEVEN_LINES, TrackerReading
from stepdiag_ros.planning.duration import Assumptions, MoveTimes
from stepdiag_ros.planning.nc_writing import Move
from stepdiag_ros.planning.tracker_program import tracker_moves

STATION_SETUP = 1200.0
"""To put a tracker up and let it find the reflector, s: as long as one diagonal is aligned."""


@dataclass(frozen=True)
class SevenLineDuration:
    """Time that a seven-line test takes.

    Attributes:
        running: the machine's part with the tracker, s.
        setting_up: of the tracker, s.
        laser_running: the machine's part with a conventional laser, s.
        laser_aligning: of that laser, once a line, s.
        lines: that are measured.
    """

    running: float
    setting_up: float
    laser_running: float
    laser_aligning: float
    lines: int

    @property
    def tracker(self) -> float:
        """Return the whole time with the tracker, s."""
        return self.running + self.setting_up

    @property
    def laser(self) -> float:
        """Return the whole time with a conventional laser, s."""
        return self.laser_running + self.laser_aligning


def seven_line_duration(
    readings: Sequence[TrackerReading],
    station: Vector,
    tracker: Tracker,
    box: Box,
    machine: Machine,
    *,
    feed: float,
    dwell: float,
    overrun: float,
) -> SevenLineDuration:
    """Return how long the places of one station take.

    Args:
        readings: the places in order.
        station: of the tracker, m, shape (3,).
        tracker: its limits.
        box: where the machine may go.
        machine: its acceleration and in-position time.
        feed: m/s.
        dwell: at each place, s.
        overrun: beyond the first target of a run, m.

    Raises:
        ValueError: there is no way in sight of the tracker.
    """
    assumptions = Assumptions()
    clock = MoveTimes(machine, feed, assumptions.settling_s)
    lines = list(dict.fromkeys(one.line for one in readings if one.line in SEVEN_LINES))
    alignments = [
        assumptions.linear_alignment_s if len(line) == 1 else assumptions.diagonal_alignment_s
        for line in lines
    ]
    whole = _running(tracker_moves(readings, station, tracker, box, dwell, overrun), clock)
    kept = [one for one in readings if one.line in SEVEN_LINES]
    # A laser with a mirror is lost by nothing: the ways are those of the tracker all the same.
    alone = _running(tracker_moves(kept, station, tracker, box, dwell, overrun), clock)
    return SevenLineDuration(whole, STATION_SETUP, alone, float(np.sum(alignments)), len(lines))


def _running(moves: Sequence[Move], clock: MoveTimes) -> float:
    total = sum(move.dwell_s for move in moves)
    for before, after in pairwise(moves):
        total += clock.between(before.target_m, after.target_m, after.at_once)
    return total
