"""The data on its way: readings → settled stops → block displacements → lines → measurement.

The same classes serve a live run, a bag and a run table. Times are whole nanoseconds, so that a
replay
gives the same numbers bit for bit.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from stepdiag_ros.metrology.direct import DirectMeasurement
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.on_the_fly.record import Moved
from stepdiag_ros.metrology.plan import Line, Volume
from stepdiag_ros.metrology.plausible import ORDINARY, Plausible
from stepdiag_ros.metrology.refusal import Refusal

Metres = Annotated[float, "m"]
"""A length; tables name its unit."""
Nanoseconds = Annotated[int, "ns"]
"""A time; messages have it as a stamp."""


class Environment(NamedTuple):
    """Air and material at a time; NaN where unknown.

    Attributes:
        air_temperature: degC.
        air_pressure: Pa.
        relative_humidity: 0..1.
        material_temperature: degC.
    """

    air_temperature: float = float("nan")
    air_pressure: float = float("nan")
    relative_humidity: float = float("nan")
    material_temperature: float = float("nan")


class Reading(NamedTuple):
    """One reading of the interferometer.

    Attributes:
        time: of measurement, ns.
        sequence: counts readings by one.
        raw_displacement: m, in vacuum wavelengths.
        compensated_displacement: m; NaN if the air is not known.
        signal_strength: 0..1.
        status: STATUS_* of InterferometerReading.msg, 0 is good.
        environment: that the compensation used.
        trigger: number of the hardware trigger that it was taken at, from 1; 0: not triggered.
    """

    time: Nanoseconds
    sequence: int
    raw_displacement: Metres
    compensated_displacement: Metres
    signal_strength: float
    status: int
    environment: Environment
    trigger: int = 0


class StopCommand(NamedTuple):
    """A commanded stop of a line, as the assembler needs it.

    Attributes:
        command_id: rises by one with each command of a run.
        line_index: line of the plan, from 0.
        attempt: at this line, from 1.
        setup: identity of alignment and zero.
        stop: from 0 along the line's direction.
        axis: that moves, or all that move at once; empty where none does.
        target: m, X Y Z.
        time: of sending, ns; never before the window of the stop that it leaves has ended.
    """

    command_id: int
    line_index: int
    attempt: int
    setup: str
    stop: int
    axis: str
    target: tuple[float, float, float]
    time: Nanoseconds


class Arrival(NamedTuple):
    """The bridge's word that a command has ended in position: identity, time (ns), place (m)."""

    command_id: int
    time: int
    position: tuple[float, float, float]


@dataclass(frozen=True)
class SettledStop:
    """Mean of a window of readings at a stop, and its sources (fields as in SettledStop.msg)."""

    command: StopCommand
    line: Line
    position: tuple[float, float, float]
    settled: bool
    reason: str
    time: Nanoseconds
    displacement: Metres
    raw_displacement: Metres
    standard_uncertainty: Metres
    standard_deviation: Metres
    readings: int
    first_sequence: int
    last_sequence: int
    in_position_time: Nanoseconds
    window_start: Nanoseconds
    window_end: Nanoseconds
    environment: Environment


@dataclass(frozen=True)
class BlockDisplacement:
    """Displacement of one move, m: R_x,ppp(k) (Ibaraki & Hata 2010, eq. 1), or along a diagonal."""

    line_index: int
    attempt: int
    line: Line
    time: Nanoseconds
    block: int
    axis: str
    from_stop: int
    to_stop: int
    nominal_displacement: Metres
    displacement: Metres
    standard_uncertainty: Metres


@dataclass(frozen=True)
class MeasuredLine:
    """A finished line: one value a stop, in the order of measurement.

    Attributes:
        line: which pass.
        line_index: of the plan, from 0.
        attempt: from 1.
        setup: lines of the same setup share alignment and zero.
        time: s since the start of the run, shape (stops,).
        end_time: of the last stop, ns.
        target: commanded positions, m, shape (stops, 3).
        displacement: readings in the zero of the setup, m, shape (stops,); NaN where a stop was
            rejected.
        standard_uncertainty: of each stop's own mean before zeroing, m, shape (stops,); NaN if
            unknown.
        environment: shape (stops, 4), columns as in Environment.
        overrun: how far beyond its first stop the line was begun, so that this is approached in the
            sense of the line too (``Plan.run_up``), m; 0 if it was not, NaN if that is not known.
        moved: delays and vibration of a line measured on the fly; None of one measured at stops.

    Raises:
        ValueError: a time, a place or a reading is infinite.
    """

    line: Line
    line_index: int
    attempt: int
    setup: str
    time: Vector
    end_time: int
    target: Vector
    displacement: Vector
    standard_uncertainty: Vector
    environment: Vector
    overrun: float = 0.0
    moved: Moved | None = None

    def __post_init__(self) -> None:
        for name in ("time", "target", "displacement", "standard_uncertainty"):
            if np.any(np.isinf(getattr(self, name))):
                raise Refusal(f"{self.line}: '{name}' of a stop is infinite", fault="out_of_range")

    @property
    def complete(self) -> bool:
        """Say whether every stop has a value."""
        return bool(np.all(np.isfinite(self.displacement)))


@dataclass(frozen=True)
class Measurement:
    """All finished lines of a run over one volume.

    A line that was measured again counts once, with its last attempt; see ``latest_attempts``.

    Attributes:
        volume: the measured box.
        lines: in the order of the plan.
        chain: order of the machine's axes from workpiece to tool, one of ``geometry.CHAINS``; empty
            if not known. Only angular errors need it.
        plausible: what may act although no reading shows it.
        direct: error curves and squareness that were measured directly, for the least-squares
            methods to weigh in; None if there are none.
    """

    volume: Volume
    lines: tuple[MeasuredLine, ...]
    chain: str = ""
    plausible: Plausible = ORDINARY
    direct: DirectMeasurement | None = None

    @property
    def stop_count(self) -> int:
        """Return the number of stops of all lines."""
        return sum(len(line.displacement) for line in self.lines)


def latest_attempts(lines: tuple[MeasuredLine, ...]) -> tuple[MeasuredLine, ...]:
    """Return the last attempt at each line of the plan, in the order of the plan."""
    latest: dict[int, MeasuredLine] = {}
    for line in lines:
        if line.line_index not in latest or line.attempt >= latest[line.line_index].attempt:
            latest[line.line_index] = line
    return tuple(latest[index] for index in sorted(latest))
