"""How late the readings of a recorded run are stamped against its positions (from the moves)."""

from array import array
from dataclasses import dataclass, field
from math import isnan

import numpy as np

from stepdiag_ros import topics
from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.bags.runs import messages_of
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.metrology.measurement import SettledStop
from stepdiag_ros.metrology.time_alignment import (
    SEARCH_LIMIT,
    LineRecord,
    RunTiming,
    TimeOffset,
    line_offset,
    run_timing,
)

_LOST = "the zero was lost on the way"


@dataclass
class _Streams:
    """Positions and readings of a run, in order of time."""

    position_times: "array[int]" = field(default_factory=lambda: array("q"))
    positions: "array[float]" = field(default_factory=lambda: array("d"))
    reading_times: "array[int]" = field(default_factory=lambda: array("q"))
    raw: "array[float]" = field(default_factory=lambda: array("d"))
    bad: "array[int]" = field(default_factory=lambda: array("B"))


def timing_of(run: RecordedRun) -> RunTiming:
    """Return how late the readings of a run are stamped, by all its lines.

    Every attempt at a line counts. What the run has taken off the stamps already (parameter
    ``stamps_late`` of the interferometer) is not in it: it is what is left.

    Raises:
        BagError: the bag has changed or gone since it was loaded.
    """
    spans: dict[tuple[int, int], list[SettledStop]] = {}
    for stop in run.stops:
        spans.setdefault((stop.command.line_index, stop.command.attempt), []).append(stop)
    if not spans:
        return run_timing([])
    streams = _read(run)
    at = np.frombuffer(streams.position_times, dtype=np.int64)
    places = np.frombuffer(streams.positions).reshape(-1, 3)
    times = np.frombuffer(streams.reading_times, dtype=np.int64)
    raw, bad = np.frombuffer(streams.raw), np.frombuffer(streams.bad, dtype=np.uint8)
    margin = round(SEARCH_LIMIT * 1e9)
    found = []
    for stops in spans.values():
        begin, end = stops[0].in_position_time, stops[-1].window_end
        part = slice(*np.searchsorted(times, [begin, end]).tolist())
        if bad[part].any():
            found.append(TimeOffset(reason=_LOST))
            continue
        around = slice(*np.searchsorted(at, [begin - margin, end + margin]).tolist())
        beam = run.plan.lines[stops[0].command.line_index].beam(run.volume)
        ways = beam.between(np.asarray(stops[0].command.target), places[around])
        record = LineRecord(at[around], ways, times[part], raw[part])
        found.append(line_offset(record))
    return run_timing(found)


def _read(run: RecordedRun) -> _Streams:
    streams = _Streams()
    reading, joints = (
        topics.absolute(topic, run.namespace) for topic in (topics.READING, topics.JOINT_STATES)
    )
    for record, message in messages_of(run.bag, run.found, (reading, joints)):
        time = to_nanoseconds(message.header.stamp)
        if record.topic == joints:
            position = conversion.axis_positions(message)
            if position is not None and time > (streams.position_times or [time - 1])[-1]:
                streams.position_times.append(time)
                streams.positions.extend(position)
        elif time > (streams.reading_times or [time - 1])[-1]:
            value = float(message.raw_displacement)
            streams.reading_times.append(time)
            streams.raw.append(value)
            streams.bad.append(int(message.status) > 1 or isnan(value))
    return streams
