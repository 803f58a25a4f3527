"""The order of a plan's lines: what is needed first, and drift apart from what is measured.

Two kinds of drift act at the machine's rate. The zero of the readings drifts within a pass; a pass
in each direction takes that out. The axes grow with time t at a rate g, which adds

    g (t - t_m) x_i n_i

to a reading at the position x_i of axis i along the beam's direction n, as seen from the mean time
t_m of the measurement, for which the result holds. Nothing estimates that. It vanishes where every
line is measured at the same mean time, so lines that need no new alignment are measured in rounds,
every other round the other way round. Then exchanges of lines make smallest

    Σ_k (t_{k+1} - t_k) ln R_k + 10 t_end ln R_end,

with R_k the uncertainty after stage k, drift included, over its limit: a run that is ended early by
its target has then what it needs, and the whole one is free of drift as far as the order can do it.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import inf, log

import numpy as np

from stepdiag_ros.metrology.geometry import Vector, beam_direction
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import Line, Volume
from stepdiag_ros.planning.exchange import Choice, Exchange

_NOTHING = 1e3
"""Stands for the ratio of what is not determined."""
_AT_THE_END = 10.0
"""Weight of the whole run against that of its course."""
_MOST_SWEEPS = 4


@dataclass(frozen=True)
class Ordered:
    """Lines in the order of measurement.

    Attributes:
        lines: all passes.
        drift: what drift at the machine's rate does to each row of the quantities, m or rad, (m,).
    """

    lines: tuple[Line, ...]
    drift: Vector


@dataclass(frozen=True)
class _Drift:
    """What drift does to the rows after some measurements: by itself, and by each line's time."""

    within: Vector
    by_time: dict[int, Vector]


class Order:
    """The search for the order of a choice.

    Args:
        exchange: with the offers and limits.
        choice: of these.
        volume: the measured box.
        machine: its rates of drift.
        paused: lines of one alignment stay together, since it is made again for others.
    """

    def __init__(
        self,
        exchange: Exchange,
        choice: Choice,
        volume: Volume,
        machine: Machine,
        paused: bool,
    ) -> None:
        self._exchange, self._offers = exchange, exchange.information.offers
        self._counts, self._machine = choice.counts, machine
        self._step = np.asarray(volume.step)
        self._origin = np.asarray(volume.origin)
        self._volume = volume
        self._drifts: dict[tuple[int, ...], _Drift] = {}
        self._paused = paused

    def by_need(self) -> Ordered:
        """Return the passes with those first that the others cannot replace."""
        return self._made([unit for stage in self._stages()[0] for unit in stage])

    def best(self) -> Ordered:
        """Return the passes in the order that exchanges lead to."""
        return self._made([unit for stage in self._exchanged(*self._stages()) for unit in stage])

    def _stages(self) -> tuple[list[list[int]], list[range]]:
        """Return measurements that stay together, in order, and the places that may be exchanged.

        After the last of such places a run may end.
        """
        needed = self._needed()
        if self._paused:
            stages = [[unit for one in self._rounds(own) for unit in one] for own in needed]
            return stages, [range(len(stages))]
        stages, places = [], []
        for one in self._rounds([index for own in needed for index in own]):
            places.append(range(len(stages), len(stages) + len(one)))
            stages += [[unit] for unit in one]
        return stages, places

    def _made(self, units: Sequence[int]) -> Ordered:
        done: dict[int, int] = {}
        lines: list[Line] = []
        for unit in units:
            lines += self._offers[unit].passes(1, done.get(unit, 0))
            done[unit] = done.get(unit, 0) + 1
        return Ordered(tuple(lines), self._by_drift(units))

    def _needed(self) -> list[list[int]]:
        """Return the measured offers by alignment, those first that the others cannot replace."""
        groups: dict[str, list[int]] = {}
        for index, count in enumerate(self._counts):
            if count:
                key = self._offers[index].setup if self._paused else str(index)
                groups.setdefault(key, []).append(index)
        left, last = list(groups.values()), []
        while len(left) > 1:
            least = min(left, key=lambda own: self._without(left, own))
            left.remove(least)
            last.append(least)
        return left + last[::-1]

    def _without(self, groups: Sequence[list[int]], own: list[int]) -> tuple[float, float]:
        """Return what is uncertain without a group: the ratio, and how much is open."""
        counts = [0] * len(self._counts)
        for group in groups:
            for index in group:
                counts[index] = 0 if group is own else self._counts[index]
        return self._exchange.openness(counts), self._exchange.choice(counts).ratio

    def _rounds(self, own: Sequence[int]) -> list[list[int]]:
        most = max(self._counts[index] for index in own)
        rounds = [[index for index in own if self._counts[index] > k] for k in range(most)]
        return [one[::-1] if number % 2 else one for number, one in enumerate(rounds)]

    def _exchanged(self, stages: list[list[int]], places: Sequence[range]) -> list[list[int]]:
        """Swap stages, at places that may be exchanged, as long as that makes the order better."""
        ends = set(range(len(stages)) if self._paused else [own[-1] for own in places])
        best = self._cost(stages, ends)
        for _ in range(_MOST_SWEEPS):
            before = best
            for one, other in (pair for own in places for pair in combinations(own, 2)):
                swapped = list(stages)
                swapped[one], swapped[other] = stages[other], stages[one]
                cost = self._cost(swapped, ends)
                if cost < best - 1e-9 * abs(best):
                    stages, best = swapped, cost
            if best == before:
                break
        return stages

    def _cost(self, stages: Sequence[list[int]], ends: Collection[int]) -> float:
        total, ratio, since = 0.0, _NOTHING, 0.0
        units: list[int] = []
        for number, stage in enumerate(stages):
            units += stage
            if number in ends:
                now = self._times(units)[1]
                total += (now - since) * log(ratio)
                ratio, since = self._ratio(units), now
        return total + _AT_THE_END * since * log(ratio)

    def _ratio(self, units: Sequence[int]) -> float:
        counts = self._of(units)
        choice = self._exchange.choice([int(count) for count in counts])
        if choice.ratio == inf:
            return _NOTHING
        return self._exchange.ratio_with(counts, self._by_drift(units))[0]

    def _of(self, units: Sequence[int]) -> Vector:
        return np.bincount(units, minlength=len(self._counts)).astype(np.float64)

    def _times(self, units: Sequence[int]) -> tuple[dict[int, float], float]:
        """Return the mean time at which the measurements of each line begin, and the end, s."""
        now, aligned, begun = 0.0, "", dict[int, list[float]]()
        for unit in units:
            offer = self._offers[unit]
            if offer.setup != aligned:
                now += offer.alignment
            aligned = offer.setup
            begun.setdefault(unit, []).append(now)
            now += offer.seconds
        return {unit: float(np.mean(times)) for unit, times in begun.items()}, now

    def _by_drift(self, units: Sequence[int]) -> Vector:
        counts = self._of(units)
        key = tuple(counts.tolist())
        if key not in self._drifts:
            self._drifts[key] = self._drift(counts)
        drift, (begun, _) = self._drifts[key], self._times(units)
        middle = {i: begun[i] + float(np.mean(self._offers[i].lateness)) for i in begun}
        mean = sum(counts[i] * middle[i] for i in middle) / len(units)
        moved = drift.within + sum(
            (middle[index] - mean) * by_time for index, by_time in drift.by_time.items()
        )
        made: Vector = np.sqrt(np.sum(moved**2, axis=1))
        return made

    def _drift(self, counts: Vector) -> _Drift:
        within, by_time = 0.0, {}
        for index, gain in self._exchange.information.gain(counts).items():
            offer = self._offers[index]
            late = offer.lateness - np.mean(offer.lateness)
            stops = offer.line.stops(self._volume) - self._origin
            longer = stops * beam_direction(offer.line.name, self._step)
            longer *= self._machine.growth_per_s
            zero = self._machine.zero_drift_m_per_s * late
            within = within + gain @ np.column_stack([zero, longer * late[:, None]])
            by_time[index] = gain @ np.column_stack([np.zeros(len(late)), longer])
        return _Drift(np.asarray(within), by_time)
