"""A simulated interferometer: the exact reading of the cell, counted in real air, with noise."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import isnan, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.grid import SampleGrid
from stepdiag_ros.devices.interferometer import STATUS_BEAM_LOST, STATUS_OK, STATUS_OVERSPEED, Point
from stepdiag_ros.devices.interferometer.behaviour import Behaviour
from stepdiag_ros.devices.interferometer.course import FollowedCourse
from stepdiag_ros.metrology.air import compensated_displacement, index_of, raw_displacement
from stepdiag_ros.metrology.beam import BeamPath, FixedBeam, TrackingBeam
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import Vector, beam_direction
from stepdiag_ros.metrology.measurement import Environment, Reading, StopCommand
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.samples import MOST_IN_BLOCK, Bytes, SampleBlock
from stepdiag_ros.metrology.tracker.tracked_line import TrackedLine

Instants = NDArray[np.int64]

_AIR_KNOT = 1_000_000_000
"""ns: the true air is computed once in this time and taken as linear between."""
_NEVER = 2**63 - 1
_MOST_IN_TURN = 100_000
"""Samples in one turn, about."""


@dataclass
class _Beam:
    """Beam and mirror from a time on, with the zero that was set then.

    The zero is that of the first reading with this alignment.
    """

    since: int
    setup: str
    lengths: Callable[[Vector], Vector]
    nominal: BeamPath
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


class SimulatedInterferometer:
    """An interferometer on a simulated cell.

    Protocols: ``InterferometerDevice``, ``FollowsRun``, ``StreamsSamples``.

    It is fed with actual positions and streams readings on its own grid, up to the last known
    position. The count is made in the cell's true air, the compensation with what the sensors say.
    Before the first alignment there is no beam. Where the cell has effects, these act as the
    course of the run has them (``course.Course``); outside a run they do not.

    Args:
        cell: the true errors.
        start: ns; the grid begins here.
        behaviour: rate, noise and limits.
    """

    def __init__(self, cell: SimulatedCell, start: int, behaviour: Behaviour) -> None:
        self._cell = cell
        self._behaviour = behaviour
        self._start = start
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
        self._zeros = 0
        self._breaks: list[tuple[int, int]] = []
        self._course: FollowedCourse | None = None
        self._tracked: dict[str, TrackedLine] = {}
        self._mounts: dict[str, Point] = {}

    def begin_run(self, plan: Plan, start_ns: int) -> None:
        """Let the effects of the cell act in a run (see ``FollowsRun.begin_run``).

        Raises:
            ValueError: an effect cannot act in this plan, or a stop is where the cell's errors are
                not given.
        """
        self._course = None
        self._cell.require_stops(plan)
        self._tracked = {line.name: line.tracked for line in plan.lines if line.tracked is not None}
        self._mounts = {plan.setup_of(line): line.mirror_offset for line in plan.lines}
        if self._cell.effects:
            begins = self._behaviour.weather_begins
            self._course = FollowedCourse(plan, self._cell, start_ns, begins, self._grid)

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
                lengths=self._lengths_of(setup, line, step, start),
                nominal=self._nominal(line, step),
                start=np.asarray(start, dtype=np.float64),
            )
        )

    def _lengths_of(
        self, setup: str, line: str, step: Point, start: Point
    ) -> Callable[[Vector], Vector]:
        """Return what gives the true lengths (m) at some positions of the axes in a setup."""
        if line in self._tracked:
            station = self._cell.station(setup, self._tracked[line].station)
            return partial(self._cell.length, station=station)
        # A new zero (`` #2``) leaves the mirror where it is.
        mount = self._mounts.get(setup.partition(" #")[0], (0.0, 0.0, 0.0))
        alignment = self._cell.alignment(setup, line, step, start, mount)
        return partial(self._cell.displacement, alignment=alignment, mount=mount)

    def _nominal(self, line: str, step: Point) -> BeamPath:
        if line in self._tracked:
            return TrackingBeam(np.array(self._tracked[line].station))
        return FixedBeam(beam_direction(line, np.asarray(step)))

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

    @property
    def sample_rate(self) -> float:
        """Samples in a second, Hz (see ``StreamsSamples``)."""
        return self._behaviour.rate

    def poll(self, time_ns: int) -> list[Reading]:
        """Return the readings since the last poll, in order."""
        until = self._readable_until(time_ns)
        readings: list[Reading] = []
        while self._grid.next <= until:
            change = self._take_beam()
            first = self._grid.count
            times = np.array(self._grid.take(min(until, change)), dtype=np.int64)
            readings += self._read(first, times)
        self._forget()
        return readings

    def poll_samples(self, time_ns: int) -> list[SampleBlock]:
        """Return the samples since the last poll, in order (see ``StreamsSamples``)."""
        until = self._readable_until(time_ns)
        blocks: list[SampleBlock] = []
        # Whoever is behind comes after in several turns, none of which takes long.
        most = self._grid.count + _MOST_IN_TURN
        while self._grid.next <= until and self._grid.count < most:
            change = min(self._take_beam(), self._air_holds_until(self._grid.next))
            first = self._grid.count
            times = self._grid.take_array(min(until, change), MOST_IN_BLOCK)
            blocks.append(self._block(first, times))
        self._forget()
        return blocks

    def close(self) -> None:
        """Let the instrument go."""

    def _readable_until(self, time_ns: int) -> int:
        """Return the time (ns) up to which data can be read at a time."""
        self._now = max(time_ns, self._now)
        if not self._position_times:
            return -_NEVER
        known = self._position_times[-1]
        if self._course is not None:
            known = self._course.certain_until(self._now, self._position_times, self._positions)
        if self._now - known > self._behaviour.hold_after * 1e9:
            # The laser goes on streaming when the controller is dead.
            known = self._now
        return min(known, self._now - round(self._behaviour.transport_delay * 1e9))

    def _take_beam(self) -> int:
        """Come to the beam of the next instant; return the last instant (ns) that has it."""
        while self._coming and self._coming[0].since <= self._grid.next:
            self._beam = self._coming.popleft()
            self._zeros += 1
        return self._coming[0].since - 1 if self._coming else _NEVER

    def _stamps(self, times: Instants) -> Instants:
        """Return what stamps readings bear that were taken at some times, ns."""
        behaviour = self._behaviour
        late = round((behaviour.transport_delay + behaviour.clock_offset) * 1e9)
        gained = np.rint((times - self._start) * behaviour.clock_drift).astype(np.int64)
        stamps: Instants = times + late + gained
        return stamps

    def _read(self, first: int, times: Instants) -> list[Reading]:
        """Return the readings of some instants, all with the same beam."""
        count = len(times)
        raw, statuses = self._count(times)
        known, environments = self._known_air(times)
        compensated = raw
        if self._beam is not None:
            known_at_zero = self._known_at_zero(self._beam, known)
            compensated = compensated_displacement(
                raw, self._beam.path_at_zero, known, known_at_zero
            )
        return [
            Reading(*fields)
            for fields in zip(
                self._stamps(times).tolist(),
                range(first, first + count),
                raw.tolist(),
                compensated.tolist(),
                np.where(np.isnan(raw), 0.0, 1.0).tolist(),
                statuses.tolist(),
                environments,
                strict=True,
            )
        ]

    def _block(self, first: int, times: Instants) -> SampleBlock:
        """Return the samples of some instants, all with the same beam and known air."""
        raw, statuses = self._count(times)
        known, environments = self._known_air(times[:1])
        scale = offset = nan
        if self._beam is not None:
            path, known_at_zero = self._beam.path_at_zero, self._known_at_zero(self._beam, known)
            scale = 1.0 / float(known[0])
            offset = compensated_displacement(0.0, path, float(known[0]), known_at_zero)
        lost = np.isnan(raw)
        return SampleBlock(
            time=int(self._stamps(times[:1])[0]),
            sequence=first,
            period=(1.0 + self._behaviour.clock_drift) / self._behaviour.rate,
            zero=self._zeros,
            scale=scale,
            offset=offset,
            environment=environments[0],
            raw_displacement=raw,
            signal_strength=_shortened(np.where(lost, 0.0, 1.0).astype(np.float32)),
            status=_shortened(statuses),
        )

    def _count(self, times: Instants) -> tuple[Vector, Bytes]:
        """Return raw displacement and status at some instants, all with the same beam."""
        count = len(times)
        positions = self._positions_at(self._taken(times))
        added = np.zeros(count) if self._course is None else self._course.added(times, positions)
        # Drawn for every reading, so that the noise does not depend on when the device is polled.
        noise = self._cell.reading_noise * self._random.standard_normal(count)
        beam = self._beam
        if beam is None:
            return np.full(count, nan), np.full(count, STATUS_BEAM_LOST, dtype=np.uint8)
        length = self._lengths(beam, positions)
        index = self._true_index(times)
        if not beam.zeroed:
            self._set_zero(beam, length[0] + added[0], index[0], positions[0])
        raw = noise + raw_displacement(
            length + added + self._vibration(times) - beam.length_at_zero,
            beam.length_at_zero,
            index,
            beam.index_at_zero,
        )
        broken = self._broken(times)
        statuses = self._statuses(beam, times, length, broken)
        return (np.where(broken, nan, raw) if broken.any() else raw), statuses

    def _taken(self, times: Instants) -> Instants:
        """Return when readings are really taken, ns."""
        if not self._cell.stamp_jitter:
            return times
        jitter = self._cell.stamp_jitter * self._random.standard_normal(len(times))
        taken: Instants = times + np.rint(jitter * 1e9).astype(np.int64)
        return taken

    def _vibration(self, times: Instants) -> Vector:
        """Return where the mirror is in its vibration, m."""
        if not self._cell.vibration:
            return np.zeros(len(times))
        turns = (times - self._start) * 1e-9 * self._cell.vibration_frequency
        vibration: Vector = self._cell.vibration * np.sin(2.0 * np.pi * turns)
        return vibration

    def _known_at_zero(self, beam: _Beam, known: Vector) -> float:
        """Return the index by the sensors when the zero was set.

        A zero is arbitrary: the first known air after it serves as well as that at it.
        """
        if isnan(beam.known_index_at_zero):
            told = known[~np.isnan(known)]
            beam.known_index_at_zero = float(told[0]) if len(told) else nan
        return beam.known_index_at_zero

    def _lengths(self, beam: _Beam, positions: Vector) -> Vector:
        """Return the true distances from laser to mirror, m, computed once while the axes stand."""
        if beam.last_position is not None and (positions == beam.last_position).all():
            return np.full(len(positions), beam.last_length)
        beam.last_position = positions[-1]
        return beam.lengths(positions)

    def _set_zero(self, beam: _Beam, length: float, index: float, position: Vector) -> None:
        beam.zeroed = True
        beam.length_at_zero = float(length)
        beam.index_at_zero = float(index)
        # The dead path is given for the first stop; the zero may be set elsewhere on the line.
        dead_path = self._behaviour.believed_dead_path
        beam.path_at_zero = beam.nominal.path(position, beam.start, dead_path)

    def _statuses(
        self, beam: _Beam, times: Instants, length: Vector, broken: NDArray[np.bool_]
    ) -> Bytes:
        """Return the status of each reading; a lost zero stays lost until the next alignment."""
        ways = np.empty(len(length))
        ways[0] = 0.0 if isnan(beam.last_length) else length[0] - beam.last_length
        np.subtract(length[1:], length[:-1], out=ways[1:])
        seconds = np.empty(len(times))
        seconds[0] = (int(times[0]) - beam.last_time) * 1e-9
        seconds[1:] = (times[1:] - times[:-1]) * 1e-9
        too_fast = np.abs(ways) > self._behaviour.fastest * seconds
        beam.last_length, beam.last_time = float(length[-1]), int(times[-1])
        statuses = np.full(len(times), beam.status, dtype=np.uint8)
        bad = broken | too_fast
        if beam.status == STATUS_OK and bad.any():
            first = int(np.argmax(bad))
            beam.status = STATUS_BEAM_LOST if broken[first] else STATUS_OVERSPEED
            statuses[first:] = beam.status
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

    def _air_holds_until(self, time: int) -> int:
        """Return the last time (ns) up to which the sensors report the same as at a time."""
        later = int(np.searchsorted(self._weather_times, time, side="right"))
        ends = self._weather_times[later : later + 1]
        if later:
            expires = self._weather_times[later - 1] + int(self._behaviour.weather_age * 1e9)
            ends += [expires + 1] if expires >= time else []
        return min(ends, default=_NEVER) - 1

    def _known_air(self, times: Instants) -> tuple[Vector, list[Environment]]:
        """Return the index and the environment by the sensors at some times."""
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


def _shortened(values: NDArray[Any]) -> NDArray[Any]:
    """Return one value for all where all are the same."""
    return values[:1] if (values == values[0]).all() else values


def from_settings(
    settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], SimulatedInterferometer]:
    """Return what switches a simulated interferometer on at a time, ns.

    Settings: ``rate_hz`` (default: the cell's), ``seed`` of the noise (default 0), ``hold_after_s``
    (default 0.2), ``weather_age_s`` (default 10), ``dead_path_m`` that the compensation calculates
    with (default: the true one), ``fastest_m_per_s`` (default 4), ``weather_begins_ns`` (the same
    for all devices of a cell; default 0: when this one is switched on), ``index_equation`` of the
    compensation, edlen (default) or ciddor. ``transport_delay_s``, ``clock_offset_s`` and
    ``clock_drift`` (s/s) put the stamps of the readings out of step with those of the positions
    (default 0).

    Raises:
        ValueError: a setting is wrong, or there is no cell.
    """
    cell = surroundings.cell
    if cell is None:
        raise Refusal("the simulated interferometer needs a simulated cell", fault="missing")
    section = Section(settings, "settings of the simulated interferometer")
    behaviour = Behaviour.from_section(section, cell)
    section.finish()

    def switch_on(start: int) -> SimulatedInterferometer:
        begins = behaviour.weather_begins or start
        return SimulatedInterferometer(cell, start, replace(behaviour, weather_begins=begins))

    return switch_on
