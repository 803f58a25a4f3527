"""A simulated interferometer: the exact reading of the cell, counted in real air, with noise."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import repeat
from math import isnan, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.grid import SampleGrid
from stepdiag_ros.devices.interferometer import (
    STATUS_BEAM_LOST,
    STATUS_OK,
    STATUS_OVERSPEED,
    Point,
)
from stepdiag_ros.devices.interferometer.course import Course
from stepdiag_ros.metrology.air import (
    DEFAULT_EQUATION,
    EQUATIONS,
    compensated_displacement,
    index_of,
    raw_displacement,
)
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.forward import Alignment
from stepdiag_ros.metrology.geometry import Vector, beam_direction
from stepdiag_ros.metrology.measurement import Environment, Reading, StopCommand
from stepdiag_ros.metrology.plan import Plan

Instants = NDArray[np.int64]

_AIR_KNOT = 1_000_000_000
"""ns: the true air is computed once in this time and taken as linear between."""
_NEVER = 2**63 - 1


@dataclass
class _Beam:
    """Beam and mirror from a time on, with the zero that was set then.

    The zero is that of the first reading with this alignment.
    """

    since: int
    setup: str
    alignment: Alignment
    nominal: Vector
    start: Vector
    zeroed: bool = False
    length_at_zero: float = nan
    index_at_zero: float = nan
    path_at_zero: float = nan
    known_index_at_zero: float = nan
    status: int = STATUS_OK
    last_position: Vector | None = None
    last_length: float = nan
    last_time: int = 0


@dataclass(frozen=True)
class Behaviour:
    """How the simulated instrument behaves.

    Attributes:
        rate: of the readings, Hz.
        seed: of the noise.
        hold_after: without positions for this time the last one is taken to hold, s.
        weather_age: sensor values older than this are no longer used, s.
        believed_dead_path: that the compensation reckons with, m.
        fastest: speed that the counter can follow, m/s.
        weather_begins: the zero of the cell's weather, ns.
        index_equation: that the compensation takes, one of ``air.EQUATIONS``.
    """

    rate: float
    seed: int
    hold_after: float
    weather_age: float
    believed_dead_path: float
    fastest: float
    weather_begins: int
    index_equation: str


class SimulatedInterferometer:
    """An interferometer on a simulated cell (``InterferometerDevice`` and ``FollowsRun``).

    It is fed with actual positions and streams readings on its own grid, up to the last known
    position. The count is made in the cell's true air, the compensation with what the sensors say.
    Before the first alignment there is no beam. Where the cell has effects, these act as the
    course of the run has them (``course.Course``); outside a run they do not.

    Args:
        cell: the truth.
        start: ns; the grid begins here.
        behaviour: rate, noise and limits.
    """

    def __init__(self, cell: SimulatedCell, start: int, behaviour: Behaviour) -> None:
        self._cell = cell
        self._behaviour = behaviour
        self._grid = SampleGrid(start, behaviour.rate)
        self._random = np.random.default_rng(behaviour.seed)
        self._now = start
        self._position_times: list[int] = []
        self._positions: list[Point] = []
        self._weather_times: list[int] = []
        self._weather: list[Environment] = []
        self._weather_indices: list[float] = []
        self._air: dict[int, float] = {}
        self._beam: _Beam | None = None
        self._coming: deque[_Beam] = deque()
        self._breaks: list[tuple[int, int]] = []
        self._course: Course | None = None

    def begin_run(self, plan: Plan, start_ns: int) -> None:
        """Let the effects of the cell act in a run (see ``FollowsRun.begin_run``)."""
        self._course = None
        if self._cell.effects:
            begins = self._behaviour.weather_begins
            self._course = Course(plan, self._cell, start_ns, begins, self._grid)

    def update_command(self, command: StopCommand, ends_at_stop: bool) -> None:
        """Take a command to the machine (see ``FollowsRun.update_command``)."""
        if self._course is not None:
            self._course.command(command, ends_at_stop)

    def update_answer(self, command_id: int, time_ns: int, in_position: bool) -> None:
        """Take the last word on a command (see ``FollowsRun.update_answer``)."""
        if self._course is not None:
            self._course.answer(command_id, time_ns, in_position)

    def align(self, time_ns: int, setup: str, line: str, step: Point, start: Point) -> None:
        """Set up beam and mirror and zero the count (see ``InterferometerDevice.align``)."""
        last = self._coming[-1] if self._coming else self._beam
        if last is not None and last.setup == setup and last.status == STATUS_OK:
            return
        if self._course is not None:
            self._course.interrupt()
        self._coming.append(
            _Beam(
                since=max(time_ns, last.since if last else time_ns),
                setup=setup,
                alignment=self._cell.alignment(setup, line, step, start),
                nominal=beam_direction(line, np.asarray(step)),
                start=np.asarray(start, dtype=np.float64),
            )
        )

    def update_position(self, time_ns: int, position: Point) -> None:
        """Take the actual position of the axes (m) at a time; one that is not later is left out."""
        if not self._position_times or time_ns > self._position_times[-1]:
            self._position_times.append(time_ns)
            self._positions.append(position)

    def update_environment(self, time_ns: int, environment: Environment) -> None:
        """Take what the weather sensors say at a time; one that is not later is left out.

        Values that no air can have leave the air unknown.
        """
        if self._weather_times and time_ns <= self._weather_times[-1]:
            return
        try:
            index = index_of(environment, equation=self._behaviour.index_equation)
        except ValueError:
            index = nan
        self._weather_times.append(time_ns)
        self._weather.append(environment)
        self._weather_indices.append(index)

    def inject_beam_break(self, start_ns: int, end_ns: int) -> None:
        """Interrupt the beam from one time until another, for tests; the zero is lost."""
        self._breaks.append((start_ns, end_ns))

    def poll(self, time_ns: int) -> list[Reading]:
        """Return the readings since the last poll, in order."""
        self._now = max(time_ns, self._now)
        if not self._position_times:
            return []
        known = self._position_times[-1]
        if self._course is not None:
            known = self._course.certain_until(self._now, self._position_times, self._positions)
        if self._now - known > self._behaviour.hold_after * 1e9:
            # The laser goes on streaming when the controller is dead.
            known = self._now
        until = min(known, self._now)
        readings: list[Reading] = []
        while self._grid.next <= until:
            while self._coming and self._coming[0].since <= self._grid.next:
                self._beam = self._coming.popleft()
            change = self._coming[0].since - 1 if self._coming else _NEVER
            first = self._grid.count
            times = np.array(self._grid.take(min(until, change)), dtype=np.int64)
            readings += self._read(first, times)
        self._forget()
        return readings

    def close(self) -> None:
        """Let the instrument go."""

    def _read(self, first: int, times: Instants) -> list[Reading]:
        """Return the readings of some instants, all with the same beam."""
        count = len(times)
        positions = self._positions_at(times)
        added = np.zeros(count) if self._course is None else self._course.added(times, positions)
        # Drawn for every reading, so that the noise does not depend on when the device is polled.
        noise = self._cell.reading_noise * self._random.standard_normal(count)
        known_index, environments = self._known_air(times)
        if self._beam is None:
            raw = compensated = np.full(count, nan)
            statuses = [STATUS_BEAM_LOST] * count
            strengths = [0.0] * count
        else:
            length = self._lengths(self._beam, positions)
            index = self._true_index(times)
            if not self._beam.zeroed:
                self._set_zero(self._beam, length[0] + added[0], index[0], positions[0])
            beam = self._beam
            if isnan(beam.known_index_at_zero):
                # A zero is arbitrary: the first known air after it serves as well as that at it.
                known = known_index[~np.isnan(known_index)]
                beam.known_index_at_zero = float(known[0]) if len(known) else nan
            raw = noise + raw_displacement(
                length + added - beam.length_at_zero, beam.length_at_zero, index, beam.index_at_zero
            )
            compensated = compensated_displacement(
                raw, beam.path_at_zero, known_index, beam.known_index_at_zero
            )
            broken = self._broken(times)
            statuses = self._statuses(beam, times, length, broken)
            strengths = np.where(broken, 0.0, 1.0).tolist()
            if broken.any():
                raw = np.where(broken, nan, raw)
                compensated = np.where(broken, nan, compensated)
        return [
            Reading(*fields)
            for fields in zip(
                times.tolist(),
                range(first, first + count),
                raw.tolist(),
                compensated.tolist(),
                strengths,
                statuses,
                environments,
                strict=True,
            )
        ]

    def _lengths(self, beam: _Beam, positions: Vector) -> Vector:
        """Return the true distances from laser to mirror, m, computed once while the axes stand."""
        if beam.last_position is not None and (positions == beam.last_position).all():
            return np.full(len(positions), beam.last_length)
        beam.last_position = positions[-1]
        return self._cell.displacement(positions, beam.alignment)

    def _set_zero(self, beam: _Beam, length: float, index: float, position: Vector) -> None:
        beam.zeroed = True
        beam.length_at_zero = float(length)
        beam.index_at_zero = float(index)
        # The dead path is given for the first stop; the zero may be set elsewhere on the line.
        way = float(beam.nominal @ (position - beam.start))
        beam.path_at_zero = self._behaviour.believed_dead_path + way

    def _statuses(
        self, beam: _Beam, times: Instants, length: Vector, broken: NDArray[np.bool_]
    ) -> list[int]:
        """Return the status of each reading; a lost zero stays lost until the next alignment."""
        ways = np.empty(len(length))
        ways[0] = 0.0 if isnan(beam.last_length) else length[0] - beam.last_length
        np.subtract(length[1:], length[:-1], out=ways[1:])
        seconds = np.empty(len(times))
        seconds[0] = (int(times[0]) - beam.last_time) * 1e-9
        seconds[1:] = (times[1:] - times[:-1]) * 1e-9
        too_fast = np.abs(ways) > self._behaviour.fastest * seconds
        beam.last_length, beam.last_time = float(length[-1]), int(times[-1])
        if beam.status == STATUS_OK and not broken.any() and not too_fast.any():
            return list(repeat(STATUS_OK, len(times)))
        statuses = []
        for is_broken, is_too_fast in zip(broken.tolist(), too_fast.tolist(), strict=True):
            if beam.status == STATUS_OK and (is_broken or is_too_fast):
                beam.status = STATUS_BEAM_LOST if is_broken else STATUS_OVERSPEED
            statuses.append(beam.status)
        return statuses

    def _broken(self, times: Instants) -> NDArray[np.bool_]:
        broken = np.zeros(len(times), dtype=np.bool_)
        for start, end in self._breaks:
            broken |= (times >= start) & (times < end)
        return broken

    def _positions_at(self, times: Instants) -> Vector:
        known = np.array(self._position_times, dtype=np.int64) - times[0]
        positions = np.array(self._positions)
        moments = (times - times[0]).astype(np.float64)
        return np.stack(
            [np.interp(moments, known, positions[:, axis]) for axis in range(3)], axis=-1
        )

    def _true_index(self, times: Instants) -> Vector:
        """Return the refractive index of the cell's air at some times, linear between knots."""
        since = times - self._behaviour.weather_begins
        first, last = int(since[0]) // _AIR_KNOT, int(since[-1]) // _AIR_KNOT + 1
        for knot in range(first, last + 1):
            if knot not in self._air:
                self._air[knot] = index_of(self._cell.environment(float(knot)))
        knots = np.arange(first, last + 1)
        values = np.array([self._air[knot] for knot in knots.tolist()])
        for old in [knot for knot in self._air if knot < first]:
            del self._air[old]
        index: Vector = np.interp(since / _AIR_KNOT, knots, values)
        return index

    def _known_air(self, times: Instants) -> tuple[Vector, list[Environment]]:
        """Return the index and the environment that the sensors tell at some times."""
        if not self._weather_times:
            return np.full(len(times), nan), [Environment()] * len(times)
        weather_times = np.array(self._weather_times, dtype=np.int64)
        latest = np.searchsorted(weather_times, times, side="right") - 1
        age = times - weather_times[np.maximum(latest, 0)]
        unknown = (latest < 0) | (age > self._behaviour.weather_age * 1e9)
        indices = np.where(unknown, nan, np.array(self._weather_indices)[latest])
        nothing = Environment()
        environments = [
            nothing if is_unknown else self._weather[row]
            for is_unknown, row in zip(unknown.tolist(), latest.tolist(), strict=True)
        ]
        return indices, environments

    def _forget(self) -> None:
        """Drop positions and weather that no later reading needs."""
        for times, values in (
            (self._position_times, (self._positions,)),
            (self._weather_times, (self._weather, self._weather_indices)),
        ):
            spent = int(np.searchsorted(times, self._grid.next, side="right")) - 1
            if spent > 0:
                del times[:spent]
                for column in values:
                    del column[:spent]
        self._breaks = [span for span in self._breaks if span[1] > self._grid.next]


def from_settings(
    settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], SimulatedInterferometer]:
    """Return what switches a simulated interferometer on at a time, ns.

    Settings: ``rate_hz`` (default: the cell's), ``seed`` of the noise (default 0), ``hold_after_s``
    (default 0.2), ``weather_age_s`` (default 10), ``dead_path_m`` that the compensation reckons
    with (default: the true one), ``fastest_m_per_s`` (default 4), ``weather_begins_ns`` (the same
    for all devices of a cell; default 0: when this one is switched on), ``index_equation`` of the
    compensation, edlen (default) or ciddor.

    Raises:
        ValueError: a setting is wrong, or there is no cell.
    """
    cell = surroundings.cell
    if cell is None:
        raise ValueError("the simulated interferometer needs a simulated cell")
    section = Section(settings, "settings of the simulated interferometer")
    behaviour = Behaviour(
        rate=section.number("rate_hz", low=0.1, high=1e5, default=cell.reading_rate),
        seed=section.integer("seed", low=0, high=2**63 - 1, default=0),
        hold_after=section.number("hold_after_s", low=0.0, high=3600.0, default=0.2),
        weather_age=section.number("weather_age_s", low=0.1, high=86400.0, default=10.0),
        believed_dead_path=section.number(
            "dead_path_m", low=0.0, high=100.0, default=cell.dead_path
        ),
        fastest=section.number("fastest_m_per_s", low=1e-3, high=1e3, default=4.0),
        weather_begins=section.integer("weather_begins_ns", low=0, high=2**63 - 1, default=0),
        index_equation=section.names(
            "index_equation", tuple(EQUATIONS), default=(DEFAULT_EQUATION,)
        )[0],
    )
    section.finish()

    def switch_on(start: int) -> SimulatedInterferometer:
        begins = behaviour.weather_begins or start
        return SimulatedInterferometer(cell, start, replace(behaviour, weather_begins=begins))

    return switch_on
