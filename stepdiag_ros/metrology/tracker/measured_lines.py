"""A tracker's test as lines of a plan, and the readings that a run over these lines gives."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import FORWARD, Line, Plan, Sampling, Volume
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.lengths import lengths
from stepdiag_ros.metrology.tracker.readings import SEVEN_LINES, TrackerReading
from stepdiag_ros.metrology.tracker.tracked_line import (
    TRACKER,
    Point,
    TrackedLine,
    line_name,
    station_of,
    test_line_of,
)


def plan_of(
    readings: Sequence[TrackerReading],
    stations: Mapping[str, Vector],
    tracker: Tracker,
    box: Box,
    *,
    name: str,
    feed: float,
    overrun: float = 0.0,
    sampling: Sampling | None = None,
) -> Plan:
    """Return the plan whose run measures some places in their order.

    Args:
        readings: the places, station after station, pass after pass.
        stations: station → rough place of the tracker, m, shape (3,).
        tracker: its limits.
        box: where the machine may go.
        name: of the plan, in words.
        feed: m/s; NaN if the plan is not to be executed.
        overrun: of passes along the seven lines, m.
        sampling: how stops are read; the default of plans if None.

    Raises:
        ValueError: the places of a pass do not follow each other, or passes of one line differ.
    """
    lines: list[Line] = []
    targets: dict[str, tuple[Point, ...]] = {}
    for (station, line, run, direction), group in groupby(readings, key=pass_of):
        places = list(group)
        straight = line in SEVEN_LINES
        numbers = [one.stop for one in places]
        expected = list(range(len(places)))
        if straight and numbers != (expected if direction == FORWARD else expected[::-1]):
            raise ValueError(
                f"station {station}, line {line}, run {run} {direction}: its stops are"
                f" {', '.join(map(str, numbers))}; a pass goes over all stops from 0, in order"
            )
        points = tuple(one.position for one in places)
        forward = points if direction == FORWARD else points[::-1]
        key = line_name(station, line)
        if targets.setdefault(key, forward) != forward:
            raise ValueError(f"station {station}, line {line}: its passes have different places")
        place = stations[station]
        tracked = TrackedLine(
            (float(place[0]), float(place[1]), float(place[2])),
            forward,
            overrun if straight else 0.0,
            straight,
        )
        lines.append(Line(TRACKER, key, "", run - 1, direction, tracked=tracked))
    side = box.high - box.low
    volume = Volume(
        (float(box.low[0]), float(box.low[1]), float(box.low[2])),
        (float(side[0]), float(side[1]), float(side[2])),
        1,
    )
    return Plan(
        name, volume, tuple(lines), feed, sampling or Sampling(), overrun=0.0, tracker=tracker
    )


def pass_of(reading: TrackerReading) -> tuple[str, str, int, str]:
    """Return which pass a reading belongs to: station, line, run, direction."""
    return reading.station, reading.line, reading.run, reading.direction


def readings_of(plan: Plan, lines: Iterable[MeasuredLine]) -> tuple[TrackerReading, ...]:
    """Return the readings of a tracker's run, in the order of measurement.

    A stop without a value is left out. After a lost zero the counter has another one; its readings
    are those of a station of their own, such as ``1 #2``. The uncertainty of a length is that of
    the instrument (its share of the length included) and of the mean at the stop, root sum of
    squares.

    Args:
        plan: of the run, with a tracker.
        lines: as measured, each with its last attempt.

    Raises:
        ValueError: the plan is not one of a tracker.
    """
    if plan.tracker is None:
        raise ValueError(f"plan '{plan.name}' has no tracker")
    made: list[TrackerReading] = []
    for measured in lines:
        planned = plan.lines[measured.line_index]
        assert planned.tracked is not None
        far = lengths(measured.target, np.array(planned.tracked.station))
        own = np.nan_to_num(measured.standard_uncertainty, nan=0.0)
        spread = np.hypot(plan.tracker.uncertainty(far), own)
        zero = measured.setup.partition(" #")[2]
        station = station_of(planned.name) + (f" #{zero}" if zero else "")
        count = len(measured.target)
        for index in np.flatnonzero(np.isfinite(measured.displacement)).tolist():
            x, y, z = (float(value) for value in measured.target[index])
            stop = index if planned.direction == FORWARD else count - 1 - index
            made.append(
                TrackerReading(
                    station,
                    test_line_of(planned.name),
                    planned.repeat + 1,
                    planned.direction,
                    stop,
                    (x, y, z),
                    float(measured.displacement[index]),
                    float(spread[index]) if spread[index] > 0.0 else float("nan"),
                )
            )
    return tuple(made)
