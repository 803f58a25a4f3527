"""NC program of a measurement with a tracker: the places of one station, in sight all the way."""

from collections.abc import Sequence

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.readings import SEVEN_LINES, TrackerReading, points_of
from stepdiag_ros.metrology.tracker.route import TrackerRoute
from stepdiag_ros.planning.nc_writing import Dialect, Move, nc_program


def tracker_moves(
    readings: Sequence[TrackerReading],
    station: Vector,
    tracker: Tracker,
    box: Box,
    dwell_s: float,
    overrun: float,
) -> list[Move]:
    """Return the moves of one station.

    Runs along a line begin beyond its first target by the overrun, so that every target is
    approached from the same side. Between runs one axis moves at a time, in an order and if need be
    by a detour that keeps clear of the tracker and in its sight.

    Args:
        readings: the places in order, all of one station.
        station: of the tracker, m, shape (3,).
        tracker: its limits.
        box: where the machine may go.
        dwell_s: at each place, s.
        overrun: m.

    Raises:
        ValueError: a place is out of reach or there is no way to it.
    """
    route = TrackerRoute(box, station, tracker)
    moves: list[Move] = []
    here: Vector | None = None
    before: tuple[str, int, str] | None = None
    places = points_of(readings)
    for index, (reading, place) in enumerate(zip(readings, places, strict=True)):
        _check_inside(reading, place, box)
        run = (reading.line, reading.run, reading.direction)
        on_a_line = reading.line in SEVEN_LINES
        begins = run != before
        start = place
        if begins and on_a_line and overrun:
            ahead = places[index + 1] - place
            start = place - overrun * ahead / np.linalg.norm(ahead)
            _check_inside(reading, start, box)
        comment = f"line {reading.line}, run {reading.run} {reading.direction}" if begins else ""
        if here is not None and (begins or not on_a_line):
            for corner in route.way(here, start):
                moves.append(Move(_triple(corner), 0.0, comment))
                comment = ""
        elif here is None:
            moves.append(Move(_triple(start), 0.0, comment))
            comment = ""
        # The end of the way to a place is the place itself: stay there.
        if moves and moves[-1].target_m == _triple(place):
            moves[-1] = Move(moves[-1].target_m, dwell_s, moves[-1].comment or comment)
        else:
            several = bool(np.count_nonzero(np.abs(place - start) > 1e-9) > 1) or on_a_line
            moves.append(Move(_triple(place), dwell_s, comment, at_once=several))
        here, before = place, run
    return moves


def tracker_program(
    readings: Sequence[TrackerReading],
    station: Vector,
    tracker: Tracker,
    box: Box,
    *,
    feed_m_per_s: float,
    name: str,
    dwell_s: float = 3.0,
    overrun: float = 2e-3,
    dialect: Dialect | None = None,
) -> str:
    """Return the NC program of one station; for arguments see ``tracker_moves``.

    Raises:
        ValueError: a place is out of reach, there is no way to it, or it cannot be written.
    """
    moves = tracker_moves(readings, station, tracker, box, dwell_s, overrun)
    where = ", ".join(
        f"{axis} {value * 1e3:.1f}" for axis, value in zip("XYZ", station, strict=True)
    )
    stops = sum(move.dwell_s > 0 for move in moves)
    return nc_program(
        moves,
        feed_m_per_s=feed_m_per_s,
        name=name,
        remarks=(
            f"Tracker: {tracker.name}, on the {tracker.held_by}, at {where} mm",
            f"{stops} stops of {dwell_s:g} s; the length is read during each",
            "Begin in sight of the tracker, with the reflector locked on",
        ),
        dialect=dialect,
    )


def _check_inside(reading: TrackerReading, place: Vector, box: Box) -> None:
    if np.any(place < box.low - 1e-9) or np.any(place > box.high + 1e-9):
        raise Refusal(f"{reading}: {_words(place)} is outside of the volume", fault="out_of_range")


def _words(place: Vector) -> str:
    return "(" + ", ".join(f"{value * 1e3:.3f}" for value in place) + ") mm"


def _triple(place: Vector) -> tuple[float, float, float]:
    return float(place[0]), float(place[1]), float(place[2])
