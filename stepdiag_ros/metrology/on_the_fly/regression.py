"""The regression of a pass: nodes, curves between them, delays and vibration in one fit.

With P = p(t - τ) the position at the time of a reading, n the beam, and ξ the part of the present
move, each reading of the move to node j is

    s(t) - n·(P - q₀) = (1 - ξ) r_(j-1) + ξ r_j + ξ(1-ξ) Σ_k b_jk L_k(1-2ξ)
                        - (n·v) δτ_a + (n·a) κ_a + A_j cos ωt + B_j sin ωt + noise.

r are the errors of the nodes, b bend the curve between them (L_k: Legendre's polynomials), τ_a is
the delay of the axes a that move, κ_a how the mirror gives way when they gain or lose speed (a
structure that bends, or a filter), ω the strongest vibration, whose phase is free in every move.
The speed distinguishes τ from the errors: it is constant in most of the move, changes in its ramps,
and is zero in the corners, where each node is read while the axes stand.

The noise is not the same everywhere: jitter of the time stamps counts with the speed. Its variance
is σ₀² in the corners and σ₀² + (n·v)² σ_t² elsewhere, with a σ_t at constant feed and one in the
ramps. All three come from means over ``_BATCH`` readings, times their number, so that noise that is
not white counts for what it is.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import nan, pi, sqrt

import numpy as np

from stepdiag_ros.metrology.geometry import Vector, inner
from stepdiag_ros.metrology.on_the_fly.motion import Motion
from stepdiag_ros.metrology.on_the_fly.record import (
    BENDS,
    AxisDelay,
    Finding,
    Instants,
    MoveCurve,
    PassFault,
    PassRecord,
    Places,
    Vibration,
    shapes,
)

CORNER, CONSTANT, RAMP = range(3)
_TURNS = 5
_DELAY = 2 + BENDS
"""Column of the delay among those of a move."""
_BATCH = 10
_FEWEST_BATCHES = 8
"""Degrees of freedom without which a class has no variance of its own."""
_SMALLEST = 1e-10
"""m: no reading is better than this."""
_FASTEST_VIBRATION = 450.0
"""Hz."""
_EXCESS = 8.0
"""Power of a vibration over the usual, in standard deviations of the latter for one move."""
_RIDGE = 1e-13
"""Added to the scaled normal equations."""
_FEWEST_READINGS = 8
"""In a move."""


@dataclass(frozen=True)
class Intervals:
    """Number of the move that each reading belongs to (0: before the first); moves left out."""

    number: Instants
    bad: frozenset[int]


@dataclass(frozen=True)
class Solution:
    """What the regression found; displacements and covariance of all nodes, m and m².

    Jitter is that of the time stamps, s; noise is that of a reading, m. The step is the largest
    difference of the errors of two neighbouring nodes, as a part of the move. The jump is that of
    the move whose own delay differs most: its number, by how much, and with which standard
    uncertainty, s.
    """

    nodes: Vector
    covariance: Vector
    delays: tuple[AxisDelay, ...]
    delay: float
    vibration: Vibration
    common: float
    noise: float
    jitter: float
    rest_noise: float
    step: float
    curves: tuple[MoveCurve, ...]
    delay_jump: tuple[int, float, float]


@dataclass(frozen=True)
class _Part:
    """The readings of one move that are used.

    Attributes:
        move: from 1; 0: before the first.
        times: s since the first position.
        values: readings, m.
    """

    move: int
    times: Vector
    values: Vector


@dataclass(frozen=True)
class _Rows:
    """The equations of one move: columns by their place among the unknowns, and classes."""

    move: int
    places: Places
    design: Vector
    values: Vector
    classes: Places
    speeds: Vector
    times: Vector


def solve(
    record: PassRecord, motion: Motion, intervals: Intervals, delay: float
) -> Solution | Finding:
    """Return what the readings of a pass say.

    Args:
        record: of the pass.
        motion: of the pass.
        intervals: which reading belongs to which move.
        delay: a first value, s.
    """
    return _Fit(record, motion, intervals, delay).solution()


def covariance_of_nodes(
    record: PassRecord, motion: Motion, intervals: Intervals, noise: float, jitter: float
) -> Vector:
    """Return the covariance of the nodes of a pass whose noise is known and that nothing shakes.

    Args:
        record: of the pass; what is read does not matter.
        motion: of the pass.
        intervals: which reading belongs to which move.
        noise: standard deviation of a reading, m.
        jitter: standard deviation of a time stamp, s.

    Returns:
        m², shape (nodes, nodes).
    """
    return _Fit(record, motion, intervals, 0.0).covariance_with(noise, jitter)


class _Fit:
    def __init__(
        self, record: PassRecord, motion: Motion, intervals: Intervals, delay: float
    ) -> None:
        self._record, self._motion = record, motion
        self._zero = float(record.displacements[0])
        self._groups = sorted(set(motion.axes))
        self._delays = dict.fromkeys(self._groups, delay)
        self._frequency = nan
        # Variance at rest, m², and of the time stamps at constant feed and in the ramps, s².
        self._variances = np.array([1.0, 0.0, 0.0])
        self._noise = nan
        self._parts = list(self._cut(intervals))
        from scipy.interpolate import PchipInterpolator

        # Stands where the axes stand, and does not overshoot where they begin to move.
        self._path = PchipInterpolator(motion.at, record.positions, axis=0)

    def _cut(self, intervals: Intervals) -> Iterator[_Part]:
        record = self._record
        for move in range(record.moves + 1):
            if move in intervals.bad:
                continue
            first, last = np.searchsorted(intervals.number, (move, move + 1))
            part = slice(int(first), int(last))
            times: Vector = (record.reading_times[part] - self._motion.origin) * np.float64(1e-9)
            known = self._motion.known(times - self._delays[self._groups[0]])
            yield _Part(move, times[known], record.displacements[part][known])

    @property
    def _nodes(self) -> int:
        return self._record.moves + 1

    @property
    def _unknowns(self) -> int:
        """Nodes, bends of each move, delay and giving way of each group, two of each vibration."""
        moves = self._record.moves
        return self._nodes + BENDS * moves + 2 * len(self._groups) + 2 * (moves + 1)

    def _rows(self, part: _Part) -> _Rows:
        move, motion, record = part.move, self._motion, self._record
        index = max(move - 1, 0)
        group = motion.axes[index]
        times = part.times - self._delays[group]
        inside = np.clip(times, motion.at[0], motion.at[-1])
        places = self._path(inside)
        values = part.values - self._zero - inner(places - record.targets[0], record.direction)
        moves, nodes = record.moves, self._nodes
        first_delay = nodes + BENDS * moves
        first_wave = first_delay + 2 * len(self._groups)
        waves = self._waves(part.times)
        wave_places = [first_wave + 2 * move, first_wave + 2 * move + 1][: waves.shape[1]]
        if move == 0:
            design = np.column_stack((np.ones(len(times)), waves))
            classes = np.full(len(times), CORNER)
            still = np.zeros(len(times))
            return _Rows(0, np.array([0, *wave_places]), design, values, classes, still, part.times)
        speed = np.interp(inside, motion.at, motion.speed)
        gain = np.interp(inside, motion.at, motion.acceleration)
        along = float(inner(motion.units[index], record.direction))
        part_of_move = (
            inner(places - record.targets[index], motion.units[index]) / motion.lengths[index]
        )
        design = np.column_stack((shapes(part_of_move), -along * speed, along * gain, waves))
        at_group = first_delay + 2 * self._groups.index(group)
        first_bend = nodes + BENDS * index
        bends = range(first_bend, first_bend + BENDS)
        columns = [index, move, *bends, at_group, at_group + 1, *wave_places]
        classes = np.full(len(times), RAMP)
        classes[motion.steady(index, speed)] = CONSTANT
        guard = 2.0 * motion.period
        classes[times >= motion.ends[index] + guard] = CORNER
        at = np.array(columns)
        return _Rows(move, at, design, values, classes, along * speed, part.times)

    def _variance(self, rows: _Rows) -> Vector:
        """Return the variance of each reading, m²."""
        jitter = np.where(rows.classes == CORNER, 0.0, self._variances[rows.classes])
        variance: Vector = self._variances[CORNER] + jitter * rows.speeds**2
        return variance

    def _waves(self, times: Vector) -> Vector:
        if np.isnan(self._frequency):
            return np.empty((len(times), 0))
        angle = 2.0 * pi * self._frequency * times
        return np.column_stack((np.cos(angle), np.sin(angle)))

    def solution(self) -> Solution | Finding:
        """Return the solution: the fit, repeated with better delays, weights and frequency."""
        if any(part.move and len(part.times) < _FEWEST_READINGS for part in self._parts):
            text = f"a move has fewer than {_FEWEST_READINGS} readings: move slower or read faster"
            return Finding(PassFault.READINGS_MISSING, text)
        for turn in range(_TURNS):
            rows = [self._rows(part) for part in self._parts]
            estimate, inverse = self._least_squares(rows)
            left = [row.values - row.design @ estimate[row.places] for row in rows]
            self._weigh(rows, left, inverse)
            for number, group in enumerate(self._groups):
                self._delays[group] += float(estimate[self._delay_place(number)])
            if 0 < turn < 3 and np.isnan(self._frequency):
                self._frequency = self._strongest(rows, left)
        return self._told(rows, left, estimate, inverse)

    def covariance_with(self, noise: float, jitter: float) -> Vector:
        """Return the covariance of the nodes with this noise, m, and jitter of time stamps, s."""
        self._variances = np.array([max(noise, _SMALLEST), jitter, jitter]) ** 2
        _, inverse = self._least_squares([self._rows(part) for part in self._parts])
        return inverse[: self._nodes, : self._nodes]

    def _delay_place(self, number: int) -> int:
        return self._nodes + BENDS * self._record.moves + 2 * number

    def _least_squares(self, rows: list[_Rows]) -> tuple[Vector, Vector]:
        """Return the unknowns and their covariance; what no reading determines is 0."""
        from scipy.linalg import cho_factor, cho_solve

        normal, right = np.zeros((self._unknowns, self._unknowns)), np.zeros(self._unknowns)
        for row in rows:
            weighted = row.design / self._variance(row)[:, np.newaxis]
            normal[np.ix_(row.places, row.places)] += row.design.T @ weighted
            right[row.places] += weighted.T @ row.values
        known = np.flatnonzero(np.diagonal(normal) > 0.0)
        scale = 1.0 / np.sqrt(np.diagonal(normal)[known])
        scaled = normal[np.ix_(known, known)] * np.outer(scale, scale)
        # What the readings hardly determine gets a wide uncertainty, not an error.
        factor = cho_factor(scaled + _RIDGE * np.eye(len(known)))
        inverse = np.zeros_like(normal)
        inverse[np.ix_(known, known)] = cho_solve(factor, np.eye(len(known))) * np.outer(
            scale, scale
        )
        return inverse @ right, inverse

    def _weigh(self, rows: list[_Rows], left: list[Vector], inverse: Vector) -> None:
        """Take the variances from what the fit has left."""
        power, freedom, speeds = np.zeros(3), np.zeros(3), np.zeros(3)
        steady = []
        for row, rest in zip(rows, left, strict=True):
            local = inverse[np.ix_(row.places, row.places)]
            leverage = np.sum((row.design @ local) * row.design, axis=1) / self._variance(row)
            steady.append(rest[row.classes == CONSTANT])
            for kind in (CORNER, CONSTANT, RAMP):
                chosen = row.classes == kind
                batches = int(np.count_nonzero(chosen)) // _BATCH
                if not batches:
                    continue
                means = rest[chosen][: batches * _BATCH].reshape(batches, _BATCH).mean(axis=1)
                left_free = batches - float(np.sum(leverage[chosen]))
                power[kind] += _BATCH * float(np.sum(means**2))
                freedom[kind] += left_free
                speeds[kind] += left_free * float(np.mean(row.speeds[chosen] ** 2))
        self._noise = float(np.std(np.concatenate(steady)))
        enough = freedom >= _FEWEST_BATCHES
        at_rest = power[CORNER] / freedom[CORNER] if enough[CORNER] else _SMALLEST**2
        jitter = (power - at_rest * freedom) / np.where(enough, speeds, np.inf)
        jitter = np.where(enough, np.maximum(jitter, 0.0), np.max(jitter[CONSTANT:]))
        self._variances = np.array([max(at_rest, _SMALLEST**2), jitter[CONSTANT], jitter[RAMP]])

    def _strongest(self, rows: list[_Rows], left: list[Vector]) -> float:
        """Return the frequency of the strongest vibration, Hz; NaN if none stands out."""
        longest = max(len(row.times) for row in rows)
        period = float(np.median(np.concatenate([np.diff(row.times) for row in rows])))
        size = 1 << int(np.ceil(np.log2(4 * longest)))
        power = np.zeros(size // 2 + 1)
        for row, rest in zip(rows, left, strict=True):
            weights = 1.0 / self._variance(row)
            waves = np.abs(np.fft.rfft((rest * weights)[:longest], size)) ** 2
            power += waves / float(np.sum(weights))
        frequencies = np.fft.rfftfreq(size, period)
        least = 2.0 / (longest * period)
        searched = (frequencies >= least) & (frequencies <= min(_FASTEST_VIBRATION, 0.45 / period))
        if not searched.any():
            return nan
        usual = float(np.median(power[searched]))
        best = int(np.argmax(np.where(searched, power, 0.0)))
        if power[best] < usual * (1.0 + _EXCESS / sqrt(len(rows))):
            return nan
        before, top, behind = (float(power[best + shift]) for shift in (-1, 0, 1))
        bend = before - 2.0 * top + behind
        shift = 0.5 * (before - behind) / bend if bend < 0.0 else 0.0
        return float((best + shift) * (frequencies[1] - frequencies[0]))

    def _told(
        self,
        rows: list[_Rows],
        left: list[Vector],
        estimate: Vector,
        inverse: Vector,
    ) -> Solution:
        nodes, record = self._nodes, self._record
        delay_places = [self._delay_place(number) for number in range(len(self._groups))]
        of_delays = inverse[np.ix_(delay_places, delay_places)]
        to_delays = inverse[np.ix_(range(nodes), delay_places)]
        by_delays = np.sum((to_delays @ np.linalg.pinv(of_delays)) * to_delays, axis=1)
        nominal = inner(record.targets - record.targets[0], record.direction)
        delays = tuple(
            AxisDelay(group, self._delays[group], sqrt(float(of_delays[i, i])))
            for i, group in enumerate(self._groups)
        )
        steps = np.abs(np.diff(estimate[:nodes])) / self._motion.lengths
        used = [row.move - 1 for row in rows if row.move]
        curves = []
        for row in (row for row in rows if row.move):
            places = row.places[: 2 + BENDS]
            curves.append(MoveCurve(row.move, estimate[places], inverse[np.ix_(places, places)]))
        return Solution(
            nodes=self._zero + nominal + estimate[:nodes],
            covariance=inverse[:nodes, :nodes],
            delays=delays,
            delay=float(np.mean(list(self._delays.values()))),
            vibration=self._vibration(rows, estimate, inverse),
            common=sqrt(max(0.0, float(np.max(by_delays)))),
            noise=self._noise,
            jitter=sqrt(float(np.max(self._variances[CONSTANT:]))),
            rest_noise=sqrt(float(self._variances[CORNER])),
            curves=tuple(curves),
            step=float(np.max(steps[used], initial=0.0)),
            delay_jump=self._jump(rows, left),
        )

    def _vibration(self, rows: list[_Rows], estimate: Vector, inverse: Vector) -> Vibration:
        if np.isnan(self._frequency):
            return Vibration()
        power, variance = [], []
        for row in rows:
            places = row.places[-2:]
            power.append(float(np.sum(estimate[places] ** 2)))
            variance.append(float(np.trace(inverse[np.ix_(places, places)])))
        mean = max(0.0, float(np.mean(power) - np.mean(variance)))
        amplitude = sqrt(mean)
        spread = sqrt(float(np.mean(variance)) / len(rows))
        return Vibration(self._frequency, amplitude, spread)

    def _jump(self, rows: list[_Rows], left: list[Vector]) -> tuple[int, float, float]:
        """Return the move whose own delay differs most from the pass's: number, s, uncertainty."""
        worst = (0, 0.0, 1.0)
        for row, rest in zip(rows, left, strict=True):
            if not row.move:
                continue
            local = np.delete(row.design, _DELAY, axis=1)
            weights = 1.0 / np.sqrt(self._variance(row))
            column = row.design[:, _DELAY] * weights
            others = local * weights[:, np.newaxis]
            own = column - others @ np.linalg.lstsq(others, column, rcond=None)[0]
            information = float(own @ own)
            change = float(own @ (rest * weights)) / information
            uncertainty = 1.0 / sqrt(information)
            if abs(change) / uncertainty > abs(worst[1]) / worst[2]:
                worst = (row.move, change, uncertainty)
        return worst
