"""The lines that an extra plan may have, and their stops before anything is measured.

Each option is one alignment of laser and mirror: a step diagonal in one or several orders of its
moves, or a linear line along an edge of the box, in one or both directions, once or several times.

A rotation of the tool that is the same wherever a beam meets it is nothing but another alignment:
a plane mirror that turns shows no more. Only a beam that meets the tool elsewhere shows by how much
it turns on the way, so lines are there too with the mirror mounted elsewhere.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    Vector,
    beam_direction,
    move_orders,
)
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, LINEAR, STEP_DIAGONAL, Line, Plan, Volume
from stepdiag_ros.metrology.simulation import stop_times

_BOTH = (FORWARD, BACKWARD)
_USUAL = (0.0, 0.0, 0.0)
_LINEAR_REPEATS, _DIAGONAL_REPEATS = 4, 2
_PASSES = (((FORWARD,), 1), (_BOTH, 1), (_BOTH, 2), (_BOTH, 4))
"""Directions and repeats of an option."""
_THREE = (("XYZ", "YZX", "ZXY"), ("XZY", "YXZ", "ZYX"))
"""Orders that are measured in one alignment, the first as in Ibaraki & Hata 2010, section 4.2."""
_MOUNT = 0.1
"""m: as far as a bracket holds a mirror from its usual place."""
_SLOWER = 0.5
_OTHERWISE = (-1.0, 1.0, 0.5, -0.5)
"""Air temperature falls where it rose, pressure rises as it did, and so on."""


@dataclass(frozen=True)
class Option:
    """Passes of one alignment.

    Attributes:
        lines: in the order of measurement.
    """

    lines: tuple[Line, ...]

    @property
    def orders(self) -> int:
        """Return how many orders of moves it has."""
        return len({line.order for line in self.lines})


def alignments(volume: Volume, often: bool, axes: str = "XYZ") -> tuple[Option, ...]:
    """Return every alignment for a box with all that can be measured in it, in both directions.

    Args:
        volume: the box.
        often: linear lines four times, diagonals, which are long, twice in each order; else once.
        axes: that the lines may move; see ``plan.axes_at_hand``.
    """
    made = []
    for name in (*BODY_DIAGONALS, *FACE_DIAGONALS):
        repeats = _DIAGONAL_REPEATS if often else 1
        orders = move_orders(name)
        if axes in orders:
            made.append(Option(tuple(_passes(STEP_DIAGONAL, name, orders, _BOTH, repeats))))
    for name in axes.lower():
        repeats = _LINEAR_REPEATS if often else 1
        for offset in _edges(name, volume, axes):
            made.append(Option(tuple(_passes(LINEAR, name, ("",), _BOTH, repeats, offset))))
    return tuple(made)


def mounted_elsewhere(axes: str = "XYZ") -> tuple[Option, ...]:
    """Return lines with the mirror mounted elsewhere on the tool, in both directions, twice.

    Each is a step diagonal in its first order, or a linear line along an edge, with the mirror away
    along X, Y or Z.

    Args:
        axes: that the lines may move; see ``plan.axes_at_hand``.
    """
    made = []
    for mount in np.diag([_MOUNT] * len(AXES)):
        away = (float(mount[0]), float(mount[1]), float(mount[2]))
        for name in (*BODY_DIAGONALS, *FACE_DIAGONALS):
            order = move_orders(name)[0]
            if len(order) == len(axes) and set(order) == set(axes):
                passes = _passes(STEP_DIAGONAL, name, (order,), _BOTH, _DIAGONAL_REPEATS, _USUAL)
                made.append(Option(tuple(replace(line, mirror_offset=away) for line in passes)))
        for name in axes.lower():
            if not away["xyz".index(name)]:
                passes = _passes(LINEAR, name, ("",), _BOTH, _LINEAR_REPEATS, _USUAL)
                made.append(Option(tuple(replace(line, mirror_offset=away) for line in passes)))
    return tuple(made)


def parts(option: Option) -> tuple[Option, ...]:
    """Return what may be measured of an alignment instead of all of it, the fewest passes first."""
    lines = set(option.lines)
    first = option.lines[0]
    whole = move_orders(first.name)
    every = (*((one,) for one in whole), *(_THREE if len(whole) > 2 else ()), whole)
    found = []
    for directions, repeats in _PASSES:
        for orders in every if first.kind == STEP_DIAGONAL else (("",),):
            passes = _passes(first.kind, first.name, orders, directions, repeats, first.offset)
            made = tuple(replace(line, mirror_offset=first.mirror_offset) for line in passes)
            if set(made) < lines:
                found.append(Option(made))
    return tuple(sorted(found, key=lambda one: len(one.lines)))


def _passes(
    kind: str,
    name: str,
    orders: tuple[str, ...],
    directions: tuple[str, ...],
    repeats: int,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Iterator[Line]:
    for order, repeat, direction in product(orders, range(repeats), directions):
        yield Line(kind, name, order, repeat, direction, offset)


def _edges(name: str, volume: Volume, axes: str) -> Iterator[tuple[float, float, float]]:
    """Yield the places of the edges of the box along a linear line, as far as axes can be moved."""
    x, y, z = [
        (0.0,) if letter.lower() == name or letter not in axes else (0.0, volume.blocks * step)
        for letter, step in zip(AXES, volume.step, strict=True)
    ]
    yield from product(x, y, z)


def plan_of(chosen: tuple[Option, ...], basis: Plan, name: str) -> Plan:
    """Return the plan that measures options under the conditions of another."""
    return replace(
        basis,
        name=name,
        lines=tuple(line for option in chosen for line in option.lines),
        one_alignment_per_diagonal=any(option.orders > 1 for option in chosen),
    )


@dataclass(frozen=True)
class Weather:
    """Air and material over the time of a run.

    Attributes:
        time: s since the start of the run, rising, shape (n,).
        environment: columns as in ``Environment``, shape (n, 4).
    """

    time: Vector
    environment: Vector

    @classmethod
    def of(cls, stops: Stops) -> "Weather":
        """Return the weather of the last run."""
        last = stops.run == np.max(stops.run)
        columns = (
            stops.air_temperature,
            stops.air_pressure,
            stops.relative_humidity,
            stops.material_temperature,
        )
        order = np.argsort(stops.time[last], kind="stable")
        return cls(stops.time[last][order], np.column_stack(columns)[last][order])

    def slower(self) -> "Weather":
        """Return one that changes half as much."""
        mean = np.mean(self.environment, axis=0)
        return Weather(self.time, mean + _SLOWER * (self.environment - mean))

    def otherwise(self) -> "Weather":
        """Return one whose parts change as much, but in other proportions to each other."""
        mean = np.mean(self.environment, axis=0)
        return Weather(self.time, mean + (self.environment - mean) * np.array(_OTHERWISE))

    def at(self, time: Vector) -> Vector:
        """Return the weather at times as it was then, and after the end going on so, (n, 4)."""
        columns = [np.interp(time, self.time, column) for column in self.environment.T]
        length = float(self.time[-1] - self.time[0])
        if length > 0.0:
            speed = (self.environment[-1] - self.environment[0]) / length
            beyond = np.maximum(time - self.time[-1], 0.0)
            columns = [column + rate * beyond for column, rate in zip(columns, speed, strict=True)]
        made: Vector = np.column_stack(columns)
        return made


def blank(plan: Plan, chain: str, weather: Weather, run: int) -> Measurement:
    """Return a plan as if a perfect machine had measured it.

    Args:
        plan: with a feed.
        chain: of the machine.
        weather: at its stops.
        run: its number.
    """
    lines = []
    time = 0.0
    zeros: dict[str, float] = {}
    for index, planned in enumerate(plan.lines):
        line = replace(planned, run=run)
        targets = line.stops(plan.volume)
        times = stop_times(planned, plan, time)
        time = float(times[-1]) + plan.sampling.dwell
        beam = targets @ beam_direction(line.name, np.asarray(plan.volume.step))
        setup = plan.setup_of(line)
        lines.append(
            MeasuredLine(
                line=line,
                line_index=index,
                attempt=1,
                setup=setup,
                time=times,
                end_time=round(float(times[-1]) * 1e9),
                target=targets,
                displacement=beam - zeros.setdefault(setup, float(beam[0])),
                standard_uncertainty=np.full(len(targets), np.nan),
                environment=weather.at(times),
                overrun=plan.overrun_of(line),
            )
        )
    return Measurement(plan.volume, tuple(lines), chain)
