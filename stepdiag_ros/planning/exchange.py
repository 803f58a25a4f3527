"""Exchange of lines by expected information per machine second.

A choice is a number of measurements of each offer. From all lines once the search takes away what
contributes least for its time, down to what just determines the quantities. From there it adds what
contributes most, one measurement or several where it takes an alignment, and exchanges lines at the
same time (Fedorov 1972; Mitchell 1974, Technometrics 16, 203). Every choice on the way may be a
point of the frontier of uncertainty against time.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, log

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.planning.information import OPEN, Information

_BUNDLES = (1, 3)
"""Measurements of a line that are tried together where it needs an alignment of its own."""
_WORTH = 0.005
"""Relative gain below which an addition is not worth a line of a plan."""
_SHARE = 0.2
"""Of the lines that are taken away in one step."""
_LONGEST = 2.0
"""Multiple of the time of all lines once at which the search ends."""
_SHARP = 8.0
"""Exponent of the mean that stands for the largest ratio."""
_TOLD = 6
"""Lines that come in for others in an exchange: those that would contribute most."""
_MOST_LOOKED_AT = 900
"""Choices after which the frontier goes no further."""
_FEW_ROUNDS = 6
_ROUNDS = 40
"""Of exchange at most; each makes the choice better."""


@dataclass(frozen=True)
class Choice:
    """Lines to measure, and what they cost and yield.

    Attributes:
        counts: measurements of each offer.
        seconds: with alignments.
        ratio: of the uncertainty to its limit, the largest of all quantities; inf: open.
        smooth: the same as a mean that is close to the largest, by which lines are compared.
    """

    counts: tuple[int, ...]
    seconds: float
    ratio: float
    smooth: float


class Exchange:
    """The search over the offers of one way of measuring.

    Args:
        information: of the offers.
        limits: standard uncertainty that each quantity is to reach; those that only have to be
            determined are not in it.
        most: measurements of an offer.
    """

    def __init__(self, information: Information, limits: Mapping[str, float], most: int) -> None:
        self.information = information
        self._names = information.quantities.names
        self._limited = np.array([name in limits for name in self._names])
        self._limits = np.array([limits[name] for name in self._names if name in limits])
        self._most = most
        self._known: dict[tuple[int, ...], Choice] = {}

    def choice(self, counts: Sequence[int]) -> Choice:
        """Return what a choice costs and yields."""
        key = tuple(int(count) for count in counts)
        if key not in self._known:
            nothing = np.zeros(len(self._names))
            ratio, smooth = self.ratio_with(np.array(key), nothing) if any(key) else (inf, inf)
            self._known[key] = Choice(key, self.seconds(key), ratio, smooth)
        return self._known[key]

    @property
    def looked_at(self) -> int:
        """Return the number of choices that were looked at."""
        return len(self._known)

    def seconds(self, counts: Sequence[int]) -> float:
        """Return the time of a choice with its alignments, s."""
        offers = self.information.offers
        aligned = {
            offer.setup: offer.alignment
            for offer, count in zip(offers, counts, strict=True)
            if count
        }
        running = sum(n * offer.seconds for n, offer in zip(counts, offers, strict=True))
        return sum(aligned.values()) + running

    def ratio_with(self, counts: Vector, beside: Vector) -> tuple[float, float]:
        """Return the ratio and its smooth mean with further uncertainties of the rows, (m,)."""
        told = self.information.standing(counts).uncertainty
        if np.any(told > OPEN):
            return inf, inf
        share = np.hypot(told, beside)[self._limited] / self._limits
        largest = float(np.max(share))
        return largest, largest * float(np.mean((share / largest) ** _SHARP)) ** (1.0 / _SHARP)

    def openness(self, counts: Sequence[int]) -> float:
        """Return how many rows some measurements leave open."""
        key = np.array(counts)
        if not np.any(key):
            return inf
        return float(np.count_nonzero(self.information.standing(key).uncertainty > OPEN))

    def frontier(self) -> list[Choice]:
        """Return the choices that no other one beats in both time and uncertainty, by time."""
        everything = self.choice([1] * len(self.information.offers))
        if everything.ratio == inf:
            return []
        self._added(self._taken_away(everything))
        for one in pareto(self._known.values()):
            for times in range(2, self._most // max(one.counts) + 1):
                self.choice([times * count for count in one.counts])
        return pareto(self._known.values())

    def _taken_away(self, start: Choice) -> Choice:
        """Take lines away, those first that contribute least for their time; many at first."""
        now = start
        while True:
            each = [
                (log(one.smooth / now.smooth) / (now.seconds - one.seconds), index)
                for index, one in self._one_less(now)
                if one.ratio < inf
            ]
            if not each:
                return now
            idle = [index for _, index in sorted(each)]
            several = idle[: max(1, int(_SHARE * len(idle)))]
            fewer = self._changed(now, *((index, -1) for index in several))
            now = fewer if fewer.ratio < inf else self._changed(now, (idle[0], -1))

    def _one_less(self, now: Choice) -> Iterator[tuple[int, Choice]]:
        for index, count in enumerate(now.counts):
            if count:
                yield index, self._changed(now, (index, -1))

    def _added(self, start: Choice) -> Choice:
        now, limit = start, _LONGEST * self.seconds([1] * len(start.counts))
        most = 0
        while now.seconds < limit and self.looked_at < _MOST_LOOKED_AT:
            more = [one for one in self._with(now) if one.smooth < now.smooth * (1.0 - _WORTH)]
            if not more:
                return now
            now = max(
                more, key=lambda one: log(now.smooth / one.smooth) / (one.seconds - now.seconds)
            )
            lines = int(np.count_nonzero(now.counts))
            if lines > most:
                # The lines that are there already were chosen beside fewer.
                most, now = lines, self.best_within(now, now.seconds)
        return now

    def _with(self, now: Choice) -> Iterator[Choice]:
        offers = self.information.offers
        aligned = {offer.setup for offer, n in zip(offers, now.counts, strict=True) if n}
        for index, count in enumerate(now.counts):
            for more in (1,) if offers[index].setup in aligned else _BUNDLES:
                if count + more <= self._most:
                    yield self._changed(now, (index, more))

    def _without(self, now: Choice) -> Iterator[Choice]:
        for index, one in self._one_less(now):
            yield one
            if now.counts[index] > 1:
                yield self._changed(now, (index, -now.counts[index]))

    def _changed(self, now: Choice, *changes: tuple[int, int]) -> Choice:
        counts = list(now.counts)
        for index, change in changes:
            counts[index] += change
        return self.choice(counts)

    def shortest(self, start: Choice) -> Choice:
        """Return a choice within the limits that is as short as exchanges make it."""

        def better(one: Choice, now: Choice) -> bool:
            return one.ratio <= 1.0 and one.seconds < now.seconds - 1e-9

        return self._exchanged(start, better, key=lambda one: one.seconds, rounds=_ROUNDS)

    def best_within(self, start: Choice, seconds: float) -> Choice:
        """Return a choice within a time whose uncertainty is as small as exchanges make it."""

        def better(one: Choice, now: Choice) -> bool:
            return one.seconds <= seconds and one.ratio < now.ratio * (1.0 - _WORTH)

        return self._exchanged(start, better, key=lambda one: one.ratio, rounds=_FEW_ROUNDS)

    def _exchanged(
        self,
        start: Choice,
        better: Callable[[Choice, Choice], bool],
        key: Callable[[Choice], float],
        rounds: int,
    ) -> Choice:
        now = start
        for _ in range(rounds):
            for neighbours in (self._without, self._with, self._swapped):
                found = [one for one in neighbours(now) if better(one, now)]
                if found:
                    now = min(found, key=key)
                    break
            else:
                break
        return now

    def _swapped(self, now: Choice) -> Iterator[Choice]:
        """Go over exchanges of a line that is there for one of those that would contribute most."""
        added = [
            (self._changed(now, (index, 1)).smooth, index)
            for index, count in enumerate(now.counts)
            if count < self._most
        ]
        for _, index in sorted(added)[:_TOLD]:
            for taken, count in enumerate(now.counts):
                if taken != index:
                    for away in {1, count} if count else ():
                        yield self._changed(now, (taken, -away), (index, 1))


def pareto(choices: Iterable[Choice]) -> list[Choice]:
    """Return the choices that none is both quicker and better than, by time."""
    front: list[Choice] = []
    for one in sorted(choices, key=lambda one: (one.seconds, one.ratio)):
        if one.ratio < (front[-1].ratio if front else inf):
            front.append(one)
    return front
