"""What an instrument that is not connected sees while an NC program runs on a simulated machine.

The moves of the program are driven as a controller would drive them, dwell by dwell, on the true
machine and the true air of a simulated cell, and the readings come at the instrument's own rate.
Between two setups the operator works: the readings jump about until the beam is set up anew and
zeroed. Nobody tells the instrument what the machine does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.air import compensated_displacement, index_of, raw_displacement
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.drive import AxisMotion, StraightMove
from stepdiag_ros.metrology.forward import Alignment
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Reading
from stepdiag_ros.metrology.plan import FORWARD, Line, Plan
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.planning.moves import Point, passes_of
from stepdiag_ros.planning.nc_writing import Move

_REST = 30.0
"""Multiples of the lag and the settling time after which a drive has come to rest."""


@dataclass(frozen=True)
class Instrument:
    """How the readings are taken.

    Attributes:
        rate: Hz.
        quantum: smallest step of the display, m; 0 for none.
        seed: of the noise and of what the operator does between setups.
        work: time of the operator at each program stop, s.
        first_time: of the first reading, ns.
        feed: of the moves, m/s; NaN for that of the plan (another if the override is turned).
    """

    rate: float = 100.0
    quantum: float = 0.0
    seed: int = 0
    work: float = 20.0
    first_time: int = 0
    feed: float = float("nan")


@dataclass(frozen=True)
class Seen:
    """What was recorded, and what really happened.

    Attributes:
        readings: of the instrument, in order.
        arrivals: when the command of each move of the program came to its end, ns.
        places: of the moves, m.
    """

    readings: tuple[Reading, ...]
    arrivals: tuple[int, ...]
    places: tuple[Point, ...]


def run_program(
    plan: Plan,
    moves: Sequence[Move],
    cell: SimulatedCell,
    acceleration: float,
    instrument: Instrument,
) -> Seen:
    """Run a program and record it.

    A setup begins with a move before which the program stops to align; the setups of the plan
    follow one another. Effects of the cell act at the places of the plan's stops.

    Args:
        plan: whose setups and stops these are.
        moves: of the program, as ``moves.moves_of`` makes them, perhaps changed.
        cell: the truth.
        acceleration: of an axis, m/s².
        instrument: that records.
    """
    return _Run(plan, cell, acceleration, instrument).of(moves)


class _Run:
    def __init__(
        self, plan: Plan, cell: SimulatedCell, acceleration: float, instrument: Instrument
    ) -> None:
        self._plan, self._cell = plan, cell
        self._acceleration, self._instrument = acceleration, instrument
        self._random = np.random.default_rng(instrument.seed)
        self._now = 0.0
        self._count = 0
        self._values: list[Vector] = []
        self._setups = [one.line for one in passes_of(plan) if one.new_setup]
        self._alignment: Alignment | None = None
        self._zero = 0.0
        self._index_at_zero = self._index = 1.0
        self._added = _effects_at_stops(plan, cell)
        self._last_added = 0.0

    def of(self, moves: Sequence[Move]) -> Seen:
        place = moves[0].target_m
        arrivals, places = [], []
        aligned = 0
        for move in moves:
            if move.program_stop:
                self._stay(place, self._instrument.work)
            for target, axes in self._legs(place, move):
                self._travel(place, target, axes)
                place = target
            arrivals.append(round(self._now * 1e9) + self._instrument.first_time)
            places.append(place)
            if move.program_stop.startswith("Align"):
                self._align(self._setups[aligned], place)
                aligned += 1
            if move.dwell_s > 0.0:
                self._last_added = self._added.pop(0) if self._added else self._last_added
                self._stay(place, move.dwell_s)
        values = np.concatenate(self._values)
        if self._instrument.quantum:
            values = np.round(values / self._instrument.quantum) * self._instrument.quantum
        readings = tuple(
            Reading(
                self._instrument.first_time + round(number * 1e9 / self._instrument.rate),
                number,
                float("nan"),
                value,
                float("nan"),
                0,
                self._cell.environment(number / self._instrument.rate),
            )
            for number, value in enumerate(values.tolist())
        )
        return Seen(readings, tuple(arrivals), tuple(places))

    def _legs(self, place: Point, move: Move) -> list[tuple[Point, list[int]]]:
        moved = [axis for axis in range(3) if move.target_m[axis] != place[axis]]
        if move.at_once and moved:
            return [(move.target_m, moved)]
        legs = []
        for axis in moved:
            x, y, z = (move.target_m[i] if i == axis else place[i] for i in range(3))
            place = (x, y, z)
            legs.append((place, [axis]))
        return legs

    def _times(self, until: float) -> Vector:
        """Return the times of the readings up to a time, s."""
        last = int(np.ceil(until * self._instrument.rate - 1e-9))
        times = np.arange(self._count, last) / self._instrument.rate
        self._count = max(last, self._count)
        return times

    def _travel(self, start: Point, target: Point, axes: list[int]) -> None:
        feed = self._instrument.feed
        feed = feed if np.isfinite(feed) else self._plan.feed
        a, b = np.asarray(start), np.asarray(target)
        straight = StraightMove.between(a[axes], b[axes], feed, self._acceleration)
        motions = {
            axes[n]: AxisMotion(path, self._cell.drive) for n, path in straight.trajectories.items()
        }
        took = max((path.duration for path in straight.trajectories.values()), default=0.0)
        self._read(self._now + took, target, motions)
        self._motions = motions
        self._moved_at = self._now
        self._now += took

    _motions: dict[int, AxisMotion] = {}  # noqa: RUF012
    _moved_at = 0.0

    def _stay(self, place: Point, seconds: float) -> None:
        # The drive is still on its way when the program says that the move has ended.
        drive = self._cell.drive
        rest = min(seconds, _REST * max(drive.lag_s, drive.settling_time_s))
        began = self._moved_at
        self._read(self._now + rest, place, self._motions, began)
        self._now += rest
        self._read(self._now + seconds - rest, place, {})
        self._now += seconds - rest

    def _align(self, line: Line, place: Point) -> None:
        """Let the operator fumble and zero the count at the place."""
        times = self._times(self._now + self._instrument.work)
        if len(times):
            spots = self._random.normal(0.0, 2e-3, 6)
            part = np.minimum((times - self._now) * 6 / self._instrument.work, 5).astype(int)
            self._values.append(spots[part] + self._noise(len(times)))
        self._now += self._instrument.work
        first = replace(line, direction=FORWARD).stops(self._plan.volume)[0]
        x, y, z = (float(value) for value in first)
        self._alignment = self._cell.alignment(
            self._plan.setup_of(line), line.name, self._plan.volume.step, (x, y, z)
        )
        self._zero = float(self._cell.displacement(np.array([place]), self._alignment)[0])
        self._index_at_zero = index_of(self._cell.environment(self._now))
        self._last_added = self._added[0] if self._added else 0.0
        self._added_at_zero = self._last_added
        self._stay(place, self._instrument.work)

    _added_at_zero = 0.0

    def _read(
        self, until: float, place: Point, motions: dict[int, AxisMotion], began: float | None = None
    ) -> None:
        times = self._times(until)
        if not len(times):
            return
        positions = np.tile(np.asarray(place), (len(times), 1))
        for axis, motion in motions.items():
            positions[:, axis] = motion.position(times - (self._now if began is None else began))
        if self._alignment is None:
            self._values.append(self._noise(len(times)))
            return
        length = self._cell.displacement(positions, self._alignment) - self._zero
        length = length + self._last_added - self._added_at_zero
        index = np.array([index_of(self._cell.environment(float(t))) for t in times[[0, -1]]])
        index = np.interp(times, times[[0, -1]], index) if len(times) > 1 else index[:1]
        # The operator has typed the air in when the count was zeroed.
        path = self._cell.dead_path
        raw = raw_displacement(length, path, index, self._index_at_zero)
        known = np.full(len(times), self._index_at_zero)
        value = compensated_displacement(raw, path, known, self._index_at_zero)
        self._values.append(value + self._noise(len(times)))

    def _noise(self, count: int) -> Vector:
        noise: Vector = self._cell.reading_noise * self._random.standard_normal(count)
        return noise


def _effects_at_stops(plan: Plan, cell: SimulatedCell) -> list[float]:
    """Return what the effects of a cell add at each stop of a plan, m."""
    if not cell.effects:
        return []
    quiet = replace(cell, reading_noise=0.0)
    with_effects = simulate(plan, quiet).lines
    without = simulate(plan, replace(quiet, effects=())).lines
    return [
        float(value)
        for one, other in zip(with_effects, without, strict=True)
        for value in one.displacement - other.displacement
    ]
