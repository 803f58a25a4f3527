"""The lines that a planner may choose: how long each takes and how uncertain its readings are.

This is the one place where a way of measuring has a price. A line measured at stops takes its moves
and dwells, and its readings are independent. A line measured on the fly takes its moves alone, and
its nodes have the covariance of its regression. The search depends on nothing else.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from math import hypot, sqrt

import numpy as np

from stepdiag_ros.metrology.geometry import (
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    LINEAR_LINES,
    Vector,
    beam_direction,
    move_orders,
)
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.on_the_fly.expected import Pace, Streams, expected_covariance
from stepdiag_ros.metrology.plan import (
    DIAGONAL,
    FORWARD,
    LINEAR,
    STEP_DIAGONAL,
    Line,
    Plan,
    Volume,
)
from stepdiag_ros.planning.duration import Assumptions, duration
from stepdiag_ros.planning.expectation import Noise

_LAGS = 8.0
"""Time constants of a drive in the time that it takes to settle: to a part in 3000 of its lag."""


@dataclass(frozen=True)
class StopNoise:
    """How uncertain a single stop is.

    Attributes:
        place: standard uncertainty that no longer stay improves, m: repeatability of the machine,
            resolution and periodic error of the laser.
        reading: standard uncertainty of the mean of one second of readings, m √s.
    """

    place: float
    reading: float = 0.0

    def of(self, window: float) -> float:
        """Return the standard uncertainty of a stop, m.

        Args:
            window: that is averaged, s.
        """
        return hypot(self.place, self.reading / sqrt(window))


@dataclass(frozen=True)
class Offer:
    """A line that may be measured, any number of times.

    Attributes:
        line: its first forward pass.
        directions: of the passes that are measured together, one after the other.
        setup: the alignment that it needs.
        alignment: time for that, s.
        seconds: of machine time for one measurement, all its directions.
        covariance: of the mean readings of one measurement beside their zero, in the order of the
            forward pass, m², shape (stops, stops).
        lateness: mean time of these readings after the measurement began, s, shape (stops,).
        times: how often the line is run in one measurement.
    """

    line: Line
    directions: tuple[str, ...]
    setup: str
    alignment: float
    seconds: float
    covariance: Vector
    lateness: Vector
    times: int = 1

    def passes(self, count: int, first: int = 0) -> list[Line]:
        """Return the passes of further measurements.

        Args:
            count: of measurements.
            first: number of measurements before them.
        """
        return [
            replace(self.line, repeat=repeat, direction=direction)
            for repeat in range(self.times * first, self.times * (first + count))
            for direction in self.directions
        ]


def offers_of(
    lines: Iterable[Line],
    conditions: Plan,
    machine: Machine,
    noise: Noise,
    directions: tuple[str, ...],
    assumptions: Assumptions,
    times: int = 1,
) -> tuple[Offer, ...]:
    """Return lines as they are measured under some conditions, at stops or on the fly.

    Args:
        lines: forward, repeat 0.
        conditions: plan with the volume, the feed and the sampling; its own lines do not matter.
        machine: that moves.
        noise: of a stop, or of the nodes of each line; see ``noise_of_stops``.
        directions: in which each line is measured.
        assumptions: for the duration.
        times: how often each line is run in one measurement.

    Raises:
        ValueError: readings or positions come too seldom for moves on the fly.
    """
    made = []
    for line in lines:
        both = tuple(replace(line, direction=direction) for direction in directions)
        plan = replace(conditions, lines=both)
        taken = duration(plan, machine, assumptions).lines
        stops = taken[0].stops
        uncertainty = np.full(stops, noise(line) if callable(noise) else noise)
        late, begun = np.zeros(stops), 0.0
        for one, time in zip(both, taken, strict=True):
            own = np.arange(stops) * (time.moves + time.dwells) / stops
            late += begun + time.positioning + (own if one.direction == FORWARD else own[::-1])
            begun += time.total - time.alignment
        aligning = assumptions.alignment_s(line.kind) if plan.pause_for_setup else 0.0
        made.append(
            Offer(
                line=line,
                directions=directions,
                setup=plan.setup_of(line),
                alignment=aligning,
                seconds=begun * times,
                covariance=np.diag(uncertainty**2) / (len(both) * times),
                lateness=late / len(both) + 0.5 * (times - 1) * begun,
                times=times,
            )
        )
    return tuple(made)


def noise_of_stops(
    plan: Plan,
    machine: Machine,
    noise: StopNoise,
    streams: Streams | None,
    assumptions: Assumptions,
) -> Noise:
    """Return the standard uncertainty of the stops of a plan, or of its nodes on the fly.

    Args:
        plan: what is measured.
        machine: that moves.
        noise: of a stop; of a node, its part that no reading improves.
        streams: of laser and controller; needed of a plan on the fly.
        assumptions: for the duration.

    Raises:
        ValueError: on use: readings or positions come too seldom for the moves of a line.
    """
    if streams is None or not plan.on_the_fly:
        return noise.of(plan.sampling.window)
    return lambda line: _on_the_fly(plan, line, machine, noise.place, streams, assumptions)


def _on_the_fly(
    plan: Plan,
    line: Line,
    machine: Machine,
    place: float,
    streams: Streams,
    assumptions: Assumptions,
) -> Vector:
    """Return the expected standard uncertainty of a line's nodes, m, shape (stops,).

    The solvers take the nodes of a line as independent and equally uncertain, and so does this.
    """
    pace = Pace(
        feed=plan.feed,
        acceleration=machine.acceleration_m_per_s2,
        corner_time=machine.position_hold_s + assumptions.settling_s,
        lag=assumptions.settling_s / _LAGS,
    )
    beam = beam_direction(line.name, np.asarray(plan.volume.step))
    found = expected_covariance(line.stops(plan.volume), beam, pace, streams)
    return np.full(len(found), hypot(sqrt(float(np.mean(np.diagonal(found)))), place))


@lru_cache(maxsize=32)
def lines_in(volume: Volume, kinds: tuple[str, ...]) -> tuple[Line, ...]:
    """Return all lines of some kinds over a box, each once and forward.

    Linear lines run along any edge of the box, step diagonals in any order of the moves, along the
    body diagonals; direct diagonals are those of the body and of the faces.

    Args:
        volume: the measured box.
        kinds: of ``Line``.
    """
    found = []
    far = np.round(np.asarray(volume.step) * volume.blocks, 9)
    if LINEAR in kinds:
        for number, name in enumerate(LINEAR_LINES):
            one, other = (axis for axis in range(3) if axis != number)
            for corner in ((), (one,), (other,), (one, other)):
                at = [float(far[axis]) if axis in corner else 0.0 for axis in range(3)]
                found.append(Line(LINEAR, name, "", 0, FORWARD, (at[0], at[1], at[2])))
    if STEP_DIAGONAL in kinds:
        found += [
            Line(STEP_DIAGONAL, name, order, 0, FORWARD)
            for name in BODY_DIAGONALS
            for order in move_orders(name)
        ]
    if DIAGONAL in kinds:
        found += [
            Line(DIAGONAL, name, "", 0, FORWARD) for name in (*BODY_DIAGONALS, *FACE_DIAGONALS)
        ]
    return tuple(found)


def words_of(lines: Iterable[Line]) -> str:
    """Say which lines some passes are, such as ``3 linear lines, 4 step diagonals in 5 orders``."""
    once = {(line.kind, line.name, line.order, line.offset) for line in lines}
    parts = []
    for kind, words in _WORDS.items():
        own = [one for one in once if one[0] == kind]
        names = {name for _, name, _, _ in own}
        if kind == STEP_DIAGONAL and len(own) > len(names):
            parts.append(f"{len(names)} {words} with {len(own)} orders in all")
        elif own:
            parts.append(f"{len(own)} {words}".removesuffix("s" if len(own) == 1 else ""))
    return ", ".join(parts)


_WORDS = {LINEAR: "linear lines", STEP_DIAGONAL: "step diagonals", DIAGONAL: "direct diagonals"}
