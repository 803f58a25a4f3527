"""All stops of a run at once, with whatever an effect may depend on."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.forward import levers
from stepdiag_ros.metrology.geometry import AXES, Vector, beam_direction, line_signs
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import FORWARD, STEP_DIAGONAL, Line
from stepdiag_ros.metrology.refusal import Refusal

_MOVED = 1e-9


@dataclass(frozen=True)
class Stops:
    """The stops of a run in the order of measurement, one row each.

    Positions are commanded ones, counted from the first corner of the measured box: that is the
    reference point of all error curves (``geometry.REFERENCE_POINT``).

    Attributes:
        chain: order of the axes from workpiece to tool; empty if not known.
        corner: first corner of the box, machine coordinates, m, shape (3,).
        travel: of the box along X, Y, Z, m, shape (3,).
        position: m, shape (n, 3).
        direction: nominal unit vector of the beam, shape (n, 3).
        start: first stop of the line's forward direction, on the beam, m, shape (n, 3).
        mirror_offset: of the mirror and the beam that meets it from their usual place on the tool,
            m, shape (n, 3).
        way: the move that led to each stop, m, shape (n, 3); zeros at the first stop of a pass,
            whose approach the data do not contain, unless the pass was begun beyond it.
        approach_told: the run shows how the machine came to the stop; False at the stops
            before an axis's first move in a pass whose overrun is not known, shape (n,).
        moved: sense (-1, 0, +1) of each axis in that move, shape (n, 3).
        last_sense: sense of each axis's last move since its setup was begun, shape (n, 3); 0
            before its first move there, because what the machine does while the laser is aligned
            is not recorded.
        time: s since the start of the stop's own run, shape (n,).
        air_temperature: degC, shape (n,); NaN if unknown, as in the following.
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
    corner: Vector
    travel: Vector
    position: Vector
    direction: Vector
    start: Vector
    mirror_offset: Vector
    way: Vector
    approach_told: NDArray[np.bool_]
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
    def moving_axes(self) -> tuple[str, ...]:
        """Return the letters of the axes that are not at one place throughout, in X, Y, Z order."""
        return tuple(
            letter for axis, letter in enumerate(AXES) if np.ptp(self.position[:, axis]) > 0.0
        )

    @property
    def run(self) -> NDArray[np.int64]:
        """Return the number of each stop's run, from 1, shape (n,)."""
        runs: NDArray[np.int64] = np.array([line.run for line in self.lines])[self.pass_index]
        return runs

    def before_first_move(self, axis: int) -> Vector:
        """Return a column for the stops of each setup before an axis's first move there, (n, k).

        From where the axis came to them is not known. Setups without such a stop have no column.
        """
        before = self.last_sense[:, axis] == 0.0
        columns = before[:, None] & (self.setup[:, None] == np.arange(len(self.setups)))
        free: Vector = columns[:, np.any(columns, axis=0)].astype(np.float64)
        return free

    @property
    def duration(self) -> float:
        """Return the time from the first stop to the last, s; of the longest of several runs."""
        return float(np.max(self.time) - np.min(self.time))

    @property
    def arms(self) -> tuple[Vector, Vector, Vector]:
        """Return the arms v_i of X, Y, Z by which a rotation ε_i moves the reading, m, (n, 3) each.

        A rotation ε_i adds (ε_i × n)·v_i, v_i = position - lever_i - start - mirror offset (see
        ``solvers.design``).

        Raises:
            Refusal: the chain is not known.
        """
        if not self.chain:
            raise Refusal(
                "the machine's kinematic chain is not known; angular errors need it",
                fault="missing",
                about="chain",
            )
        away = self.position - self.start - self.mirror_offset
        one, two, three = (away - lever for lever in levers(self.position, self.chain))
        return one, two, three


def stops_of(measurement: Measurement) -> Stops:
    """Return the stops of a measurement, rejected ones too.

    Raises:
        ValueError: the measurement has no line.
    """
    if not measurement.lines:
        raise ValueError("there is no measured line")
    setups = tuple(dict.fromkeys(line.setup for line in measurement.lines))
    corner = np.asarray(measurement.volume.origin, dtype=np.float64)
    targets = [line.target - corner for line in measurement.lines]
    lengths = [len(target) for target in targets]
    environment = np.concatenate([line.environment for line in measurement.lines])
    way = np.concatenate([_way(line, measurement) for line in measurement.lines])
    return Stops(
        chain=measurement.chain,
        corner=corner,
        travel=np.asarray(measurement.volume.step) * measurement.volume.blocks,
        position=np.concatenate(targets),
        direction=_repeat([_direction(line, measurement) for line in measurement.lines], lengths),
        start=_repeat([_start(line, measurement) for line in measurement.lines], lengths),
        mirror_offset=_repeat(
            [np.array(line.line.mirror_offset) for line in measurement.lines], lengths
        ),
        way=way,
        approach_told=np.concatenate([_approach_told(line) for line in measurement.lines]),
        moved=_senses(way),
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


def _way(line: MeasuredLine, measurement: Measurement) -> Vector:
    """Return the move that led to each stop of a line, m, shape (stops, 3).

    A pass with an overrun is begun beyond its first stop in all axes that it moves, so that each
    comes to this stop in the sense of the pass.
    """
    way: Vector = np.diff(line.target, axis=0, prepend=line.target[:1])
    if line.overrun > 0.0 and len(way) > 1:
        along = way[1] / np.linalg.norm(way[1])
        if line.line.kind == STEP_DIAGONAL:
            along = line.line.sense * _direction(line, measurement)
        way[0] = line.overrun * along
    return way


def _approach_told(line: MeasuredLine) -> NDArray[np.bool_]:
    """Say of each stop whether it is known in which sense every axis of the line has come there."""
    told = np.ones(len(line.target), dtype=np.bool_)
    if np.isfinite(line.overrun):
        return told
    told[0] = False
    if line.line.kind == STEP_DIAGONAL:
        moves = np.abs(np.diff(line.target, axis=0, prepend=line.target[:1])) > _MOVED
        moving = line_signs(line.line.name) != 0
        told = np.all(np.logical_or.accumulate(moves, axis=0)[:, moving], axis=1)
    return told


def _senses(way: Vector) -> Vector:
    senses: Vector = np.where(np.abs(way) > _MOVED, np.sign(way), 0.0)
    return senses


def _last_senses(measurement: Measurement) -> Vector:
    """Return the sense of each axis's last move in its setup.

    The ways from one pass to the next of the same setup count: the machine makes them, the beam
    following or not. A pass that was measured again comes later than its place in the plan.
    """
    senses: list[Vector] = [np.zeros_like(line.target) for line in measurement.lines]
    latest: dict[str, tuple[Vector, Vector]] = {}
    for index in sorted(range(len(senses)), key=lambda one: measurement.lines[one].end_time):
        line = measurement.lines[index]
        begun = line.target[0] - _way(line, measurement)[0]
        place, sense = latest.get(line.setup, (begun, np.zeros(len(AXES))))
        moves = np.diff(np.vstack([place, begun, line.target]), axis=0)
        senses[index] = _last_before(np.vstack([sense, _senses(moves)]))[2:]
        latest[line.setup] = (line.target[-1], senses[index][-1])
    return np.concatenate(senses)


def _last_before(senses: Vector) -> Vector:
    """Return the senses with each 0 replaced by the last other one above it, shape (n, axes)."""
    row = np.where(senses == 0.0, 0, np.arange(len(senses))[:, None])
    last: Vector = np.take_along_axis(senses, np.maximum.accumulate(row, axis=0), axis=0)
    return last
