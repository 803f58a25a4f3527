"""All stops of a run at once, with whatever an effect may depend on."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.forward import levers
from stepdiag_ros.metrology.geometry import AXES, Vector, beam_direction
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import FORWARD, Line

_MOVED = 1e-9


@dataclass(frozen=True)
class Stops:
    """The stops of a run in the order of measurement, one row each.

    Positions are commanded ones, counted from the first corner of the measured box: that is the
    reference point of all error curves (``geometry.REFERENCE_POINT``).

    Attributes:
        chain: order of the axes from workpiece to tool; empty if not known.
        travel: of the box along X, Y, Z, m, shape (3,).
        position: m, shape (n, 3).
        direction: nominal unit vector of the beam, shape (n, 3).
        start: first stop of the line's forward direction, on the beam, m, shape (n, 3).
        moved: sense (-1, 0, +1) of each axis in the move that led to the stop, shape (n, 3); zeros
            at the first stop of a pass, whose approach the data do not tell.
        last_sense: sense of each axis's last move since its setup was begun, shape (n, 3); 0
            before its first move there, because what the machine does while the laser is aligned
            is not recorded.
        time: s since the start of the run, shape (n,).
        air_temperature: degC, shape (n,); NaN if unknown, likewise the following.
        air_pressure: Pa, shape (n,).
        relative_humidity: 0..1, shape (n,).
        material_temperature: degC, shape (n,).
        number: of the stop in its pass, from 0, shape (n,).
        pass_index: index into ``lines``, shape (n,).
        setup: index into ``setups``, shape (n,).
        lines: the passes.
        setups: names of the alignments.
        displacement: reading as measured, in the zero of the setup, m, shape (n,); NaN where a stop
            was rejected. Only what depends on the phase of the light may use it.
    """

    chain: str
    travel: Vector
    position: Vector
    direction: Vector
    start: Vector
    moved: Vector
    last_sense: Vector
    time: Vector
    air_temperature: Vector
    air_pressure: Vector
    relative_humidity: Vector
    material_temperature: Vector
    number: NDArray[np.int64]
    pass_index: NDArray[np.int64]
    setup: NDArray[np.int64]
    lines: tuple[Line, ...]
    setups: tuple[str, ...]
    displacement: Vector

    @property
    def along(self) -> Vector:
        """Return the commanded displacement along the beam from the line's start, m, shape (n,)."""
        way: Vector = np.sum(self.direction * (self.position - self.start), axis=1)
        return way

    @property
    def sideways(self) -> Vector:
        """Return the commanded way across the beam from the line's start, m, shape (n, 3)."""
        across: Vector = self.position - self.start - self.along[:, None] * self.direction
        return across

    @property
    def share(self) -> Vector:
        """Return position over travel of each axis, 0..1 within the box, shape (n, 3)."""
        share: Vector = self.position / self.travel
        return share

    @property
    def way(self) -> Vector:
        """Return the move that led to each stop, m, shape (n, 3); zeros at a pass's first stop."""
        change = np.diff(self.position, axis=0, prepend=self.position[:1])
        made: Vector = np.where((self.number > 0)[:, None], change, 0.0)
        return made

    @property
    def duration(self) -> float:
        """Return the time from the first stop to the last, s."""
        return float(np.max(self.time) - np.min(self.time))

    @property
    def arms(self) -> tuple[Vector, Vector, Vector]:
        """Return the arms v_i of X, Y, Z by which a rotation ε_i moves the reading, m, (n, 3) each.

        A rotation ε_i adds (ε_i × n)·v_i, v_i = position - lever_i - start (see
        ``solvers.design``).

        Raises:
            ValueError: the chain is not known.
        """
        if not self.chain:
            raise ValueError("the machine's kinematic chain is not known; angular errors need it")
        one, two, three = (
            self.position - lever - self.start for lever in levers(self.position, self.chain)
        )
        return one, two, three


def stops_of(measurement: Measurement) -> Stops:
    """Return the stops of a measurement, rejected ones too.

    Raises:
        ValueError: the measurement has no line.
    """
    if not measurement.lines:
        raise ValueError("there is no measured line")
    setups = tuple(dict.fromkeys(line.setup for line in measurement.lines))
    corner = np.asarray(measurement.volume.origin)
    targets = [line.target - corner for line in measurement.lines]
    lengths = [len(target) for target in targets]
    environment = np.concatenate([line.environment for line in measurement.lines])
    moved = np.concatenate([_moves(target) for target in targets])
    return Stops(
        chain=measurement.chain,
        travel=np.asarray(measurement.volume.step) * measurement.volume.blocks,
        position=np.concatenate(targets),
        direction=_repeat([_direction(line, measurement) for line in measurement.lines], lengths),
        start=_repeat([_start(line, measurement) for line in measurement.lines], lengths),
        moved=moved,
        last_sense=_last_senses(measurement),
        time=np.concatenate([line.time for line in measurement.lines]),
        air_temperature=environment[:, 0],
        air_pressure=environment[:, 1],
        relative_humidity=environment[:, 2],
        material_temperature=environment[:, 3],
        number=np.concatenate([np.arange(length) for length in lengths]),
        pass_index=np.repeat(np.arange(len(lengths)), lengths),
        setup=np.repeat([setups.index(line.setup) for line in measurement.lines], lengths),
        lines=tuple(line.line for line in measurement.lines),
        setups=setups,
        displacement=np.concatenate([line.displacement for line in measurement.lines]),
    )


def _repeat(rows: list[Vector], lengths: list[int]) -> Vector:
    return np.repeat(np.array(rows), lengths, axis=0)


def _direction(line: MeasuredLine, measurement: Measurement) -> Vector:
    return beam_direction(line.line.name, np.asarray(measurement.volume.step))


def _start(line: MeasuredLine, measurement: Measurement) -> Vector:
    forward = replace(line.line, direction=FORWARD).stops(measurement.volume)
    start: Vector = forward[0] - np.asarray(measurement.volume.origin)
    return start


def _moves(target: Vector) -> Vector:
    change = np.diff(target, axis=0, prepend=target[:1])
    moves: Vector = np.where(np.abs(change) > _MOVED, np.sign(change), 0.0)
    return moves


def _last_senses(measurement: Measurement) -> Vector:
    """Return the sense of each axis's last move in its setup.

    The ways from one pass to the next of the same setup count: the machine makes them, the beam
    following or not. A pass that was measured again comes later than its place in the plan.
    """
    senses: list[Vector] = [np.zeros_like(line.target) for line in measurement.lines]
    latest: dict[str, tuple[Vector, Vector]] = {}
    for index in sorted(range(len(senses)), key=lambda one: measurement.lines[one].end_time):
        line = measurement.lines[index]
        place, sense = latest.get(line.setup, (line.target[0], np.zeros(len(AXES))))
        for stop, target in enumerate(line.target):
            change = target - place
            sense = np.where(np.abs(change) > _MOVED, np.sign(change), sense)
            senses[index][stop] = sense
            place = target
        latest[line.setup] = (place, sense)
    return np.concatenate(senses)
