"""Compensation of recorded readings for the air, again: from their count and the recorded weather.

The readings of a run hold the count in vacuum wavelengths beside the displacement that was made of
it on line. With the weather of the same time the latter can be made again: with another dead path
or equation, or where the weather was not used at all.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from stepdiag_ros.metrology.air.compensator import Compensator
from stepdiag_ros.metrology.air.index import DEFAULT_EQUATION, HELIUM_NEON_WAVELENGTH
from stepdiag_ros.metrology.air.known_air import KnownAir
from stepdiag_ros.metrology.measurement import Arrival, Reading, StopCommand
from stepdiag_ros.metrology.plan import FORWARD, Plan


@dataclass(frozen=True)
class AirChoice:
    """How readings are to be compensated.

    Attributes:
        kind: ``own`` or ``off``; see ``compensator.COMPENSATIONS``.
        dead_path: from the interferometer's reference to the mirror at the first stop of a line, m.
        wavelength: of the laser, in vacuum, m.
        equation: for the refractive index, one of ``index.EQUATIONS``.
        longest_age: s after which a value of a sensor is unknown.
    """

    kind: str
    dead_path: float = 0.0
    wavelength: float = HELIUM_NEON_WAVELENGTH
    equation: str = DEFAULT_EQUATION
    longest_age: float = 10.0


class SensorValue(NamedTuple):
    """Value of a weather sensor: time (ns), quantity (field of Environment) and value."""

    time: int
    name: str
    value: float


class SetupBegin(NamedTuple):
    """Where and when the first stop of a setup was reached: the zero is taken there.

    Attributes:
        time: ns.
        line_index: of the plan, from 0.
        position: X Y Z, m.
    """

    time: int
    line_index: int
    position: tuple[float, float, float]


def begins_of_setups(
    commands: Iterable[StopCommand], arrivals: Iterable[Arrival]
) -> list[SetupBegin]:
    """Return where and when the first stop of each setup was reached, in order of time."""
    reached = {arrival.command_id: arrival for arrival in arrivals}
    begins = []
    setup = None
    for command in commands:
        arrival = reached.get(command.command_id)
        if command.setup != setup and arrival is not None:
            setup = command.setup
            begins.append(SetupBegin(arrival.time, command.line_index, arrival.position))
    return begins


def recompensated(
    readings: Iterable[Reading],
    weather: Sequence[SensorValue],
    begins: Sequence[SetupBegin],
    plan: Plan,
    choice: AirChoice,
) -> Iterator[Reading]:
    """Compensate readings again.

    Args:
        readings: in order of time; their raw displacements are used alone.
        weather: values of the sensors, in order of time.
        begins: where the setups begin, in order of time.
        plan: of the run.
        choice: how to compensate.

    Yields:
        the readings with another compensated displacement and environment.
    """
    compensator = Compensator(choice.kind, choice.dead_path, choice.wavelength, choice.equation)
    air = KnownAir(choice.longest_age)
    told = begun = 0
    for reading in readings:
        while told < len(weather) and weather[told].time <= reading.time:
            value = weather[told]
            air.take(value.name, value.value, value.time)
            told += 1
        while begun < len(begins) and begins[begun].time <= reading.time:
            _begin(compensator, begins[begun], plan)
            begun += 1
        yield compensator.reading(reading, air.at(reading.time))


def _begin(compensator: Compensator, begin: SetupBegin, plan: Plan) -> None:
    line, volume = plan.lines[begin.line_index], plan.volume
    start = replace(line, direction=FORWARD).stops(volume)[0]
    compensator.align(begin.time - 1, line.beam(volume), start)
    compensator.move(begin.position)
