"""The lines of a run on the fly: corners and positions on their way to a line's stops."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import (
    Arrival,
    Environment,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.on_the_fly.evaluate import evaluate_pass
from stepdiag_ros.metrology.on_the_fly.record import (
    Finding,
    MovingPass,
    PassFault,
    PassRecord,
    refused,
)
from stepdiag_ros.metrology.plan import Line, Sampling
from stepdiag_ros.metrology.window import mean_environment

Point = tuple[float, float, float]

_MOST_POSITIONS = 500_000
_BEFORE = 1_000_000_000
"""ns before the first stop of a line from which positions are kept."""


def needs_corner_stops(reason: str) -> bool:
    """Say whether a line was refused because the controller gives too few positions.

    Args:
        reason: of the rejection, as a ``SettledStop`` has it.
    """
    return reason.startswith(PassFault.NO_POSITIONS.value)


@dataclass(frozen=True)
class FlownLine:
    """An attempt at a line on the fly.

    Attributes:
        line: that was measured.
        attempt: from 1.
        seconds: from the first stop to the end of the last window.
        found: what the pass says.
    """

    line: Line
    attempt: int
    seconds: float
    found: MovingPass


class Flight:
    """Collects what belongs to a line that is measured on the fly.

    Args:
        sampling: of the plan; its limit of the standard deviation holds in the corners.
    """

    def __init__(self, sampling: Sampling) -> None:
        self._limit = sampling.standard_deviation_limit
        self._corners: list[tuple[StopCommand, Arrival]] = []
        self._times: list[int] = []
        self._positions: list[Point] = []

    def add_position(self, time: int, position: Point) -> None:
        """Take the actual position of the axes, m, at a time, ns."""
        if self._times and time == self._times[-1]:
            return
        self._times.append(time)
        self._positions.append(position)
        if len(self._times) > _MOST_POSITIONS:
            self._forget(self._times[-_MOST_POSITIONS // 2])

    def knows_until(self, time: int) -> bool:
        """Say whether positions have come up to a time, ns."""
        return bool(self._times) and self._times[-1] >= time

    def pass_corner(self, command: StopCommand, arrival: Arrival) -> None:
        """Take a stop that the machine does not stay at, or the first of a line."""
        if command.stop == 0:
            self._corners.clear()
            self._forget(arrival.time - _BEFORE)
        self._corners.append((command, arrival))

    def land(
        self,
        line: Line,
        targets: Vector,
        direction: Vector,
        readings: Sequence[Reading],
        end: int,
    ) -> tuple[FlownLine, list[SettledStop]]:
        """Return what the pass says, and the stops of the line that ends with the last corner.

        Args:
            line: that was measured.
            targets: of its stops, m, shape (n, 3).
            direction: of the beam, shape (3,).
            readings: from its first stop to its last.
            end: of the last window, ns.
        """
        count = len(targets)
        numbers = [command.stop for command, _ in self._corners]
        if numbers != list(range(count)):
            text = "the first stops of the line are missing; measure the line again"
            found = refused(count, Finding(PassFault.READINGS_MISSING, text))
        elif not readings:
            text = "there are no readings of the line, or they are no longer kept"
            found = refused(count, Finding(PassFault.READINGS_MISSING, text))
        else:
            record = self._record(targets, direction, readings, end)
            found = evaluate_pass(record)
        stops = [
            _stop(command, arrival, line, found, readings) for command, arrival in self._corners
        ]
        command, arrival = self._corners[0]
        self._corners.clear()
        return FlownLine(line, command.attempt, (end - arrival.time) * 1e-9, found), stops

    def _record(
        self, targets: Vector, direction: Vector, readings: Sequence[Reading], end: int
    ) -> PassRecord:
        times = np.array(self._times, dtype=np.int64)
        begin = self._corners[0][1].time
        inside = (times >= begin) & (times <= end)
        positions = np.array(self._positions, dtype=np.float64).reshape(-1, 3)
        return PassRecord(
            targets=targets,
            direction=direction,
            position_times=times[inside],
            positions=positions[inside],
            reading_times=np.array([reading.time for reading in readings], dtype=np.int64),
            sequences=np.array([reading.sequence for reading in readings], dtype=np.int64),
            displacements=np.array([reading.compensated_displacement for reading in readings]),
            statuses=np.array([reading.status for reading in readings], dtype=np.uint8),
            noise_limit=self._limit,
        )

    def _forget(self, before: int) -> None:
        kept = next((i for i, time in enumerate(self._times) if time >= before), len(self._times))
        del self._times[:kept]
        del self._positions[:kept]


def _stop(
    command: StopCommand,
    arrival: Arrival,
    line: Line,
    found: MovingPass,
    readings: Sequence[Reading],
) -> SettledStop:
    node = command.stop
    source = found.sources[node] if found.sources else None
    own = (
        [reading for reading in readings if source.start <= reading.time <= source.end]
        if source
        else []
    )
    displacement = float(found.displacement[node])
    added = [reading.raw_displacement - reading.compensated_displacement for reading in own]
    return SettledStop(
        command=command,
        line=line,
        position=arrival.position,
        settled=not found.reasons[node],
        reason=found.reasons[node],
        time=source.time if source else arrival.time,
        displacement=displacement,
        raw_displacement=displacement + float(np.mean(added)) if added else nan,
        standard_uncertainty=float(found.standard_uncertainty[node]),
        standard_deviation=found.noise,
        readings=source.readings if source else 0,
        first_sequence=source.first_sequence if source else 0,
        last_sequence=source.last_sequence if source else 0,
        in_position_time=arrival.time,
        window_start=source.start if source else arrival.time,
        window_end=source.end if source else arrival.time,
        environment=mean_environment(own) if own else Environment(),
    )
