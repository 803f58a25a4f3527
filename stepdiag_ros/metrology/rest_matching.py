"""Which rest of the mirror is which stop of the plan: matching by dynamic programming.

The stops of a plan, in order, are places along the beam; the rests of a recording, in order, are
levels of the reading in an unknown zero. A matching gives rests to stops, both in order, at the
least cost:

- 1 for each stop that no rest is given to, and for each rest within a setup that is not a stop;
- up to ``MISFIT`` for each step, with the square of its deviation; a step that is off
  by more than ``Tolerance`` does not match;
- ``BREAK`` where the level goes on from another zero, so that no step can be checked;
- ``SETUP`` (half a setup's stops at most) for each setup of which anything is found, so that a few
  rests that happen to fit are not a setup;
- ``JUNK`` for each rest between two setups, where the operator moves things about.

No zero, sense or scale is fitted, so nothing can hide a shift: where all steps of a line are equal,
a recording that lacks one stop fits the plan at two places, and both have the same cost. How sure
each assignment is, is therefore computed and not guessed: the cost of the best matching that gives
a rest to another stop, or a stop to another rest, less that of the best of all
(``Match.margin``; forward and backward sums as in the Viterbi and max-marginal algorithms, for
example Durbin et al., Biological sequence analysis, 1998, sections 2.3 and 4.4).

What this cannot see: a recording that lacks the first stop of a line and has a rest one exact step
beyond its last is, in equal steps, the same as a whole one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector, beam_direction
from stepdiag_ros.metrology.plan import FORWARD, Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.stillness import Rest, smallest_step

MISSING = 1.0
EXTRA = 1.0
MISFIT = 0.3
BREAK = 3.0
SETUP = 3.0
JUNK = 0.05
OUTSIDE = 1.5
"""Of each rest before the first match, where it is known that the line begins there, and after the
last, where more are to come: rather was a stop missed."""
SURE = 0.5
"""Least margin of an assignment that counts."""
_LONGEST_GAP = 6
_START = -1
_MOST_CELLS = 30_000_000


@dataclass(frozen=True)
class StopPlace:
    """A place where the machine is to stop.

    Attributes:
        setup: number of the setup in the plan, from 0: a run of lines that share one alignment.
        displacement: along the beam from the first stop of the setup, m.
        stops: line of the plan and stop, both from 0, that are measured here; two where a line ends
            at the first stop of the next: the machine stays there, or leaves it for no longer than
            an overrun takes, which a slow instrument does not see.
    """

    setup: int
    displacement: float
    stops: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Tolerance:
    """By how much a step may differ from that of the plan and still be the same.

    Attributes:
        part: of the step: scale, alignment, uncompensated air.
        least: m: errors of the machine.
        most: m: a smaller part of the smallest step, so that two stops cannot be mixed up.
    """

    part: float
    least: float
    most: float

    @classmethod
    def of_plan(cls, plan: Plan) -> "Tolerance":
        """Return what fits a plan's steps."""
        return cls(part=0.02, least=1e-4, most=0.35 * smallest_step(plan))

    def of(self, step: float | Vector) -> Vector:
        """Return the tolerance of a step, m."""
        allowed: Vector = np.minimum(self.part * np.abs(step) + self.least, self.most)
        return allowed


@dataclass(frozen=True)
class Match:
    """Which place a rest was given.

    Attributes:
        rest: number of the rest, from 0.
        place: number of the place, from 0.
        margin: by how much the best other matching, in which this rest is at another place or
            another rest at this place, costs more.
        instead: place that this rest has in that matching; None if it is another rest that has
            this place.
    """

    rest: int
    place: int
    margin: float
    instead: int | None


def places_of(plan: Plan, lines: Sequence[int]) -> list[StopPlace]:
    """Return the places where the machine stops along some lines of a plan, in order.

    Args:
        plan: the plan.
        lines: indices of its lines, rising.
    """
    places: list[StopPlace] = []
    setup, before = -1, None
    for index in lines:
        line = plan.lines[index]
        beam = beam_direction(line.name, np.asarray(plan.volume.step))
        targets = line.stops(plan.volume)
        same = before is not None and plan.setup_of(plan.lines[before]) == plan.setup_of(line)
        if not same or before != index - 1:
            setup += 1
        first = targets[0] if line.direction == FORWARD else targets[-1]
        along = (targets - first) @ beam
        stays = (
            before == index - 1
            and same
            and np.array_equal(plan.lines[index - 1].stops(plan.volume)[-1], targets[0])
        )
        for stop, displacement in enumerate(along.tolist()):
            if stop == 0 and stays:
                shared = places.pop()
                stops = (*shared.stops, (index, 0))
                places.append(StopPlace(setup, shared.displacement, stops))
            else:
                places.append(StopPlace(setup, displacement, ((index, stop),)))
        before = index
    return places


def match(
    places: Sequence[StopPlace],
    rests: Sequence[Rest],
    tolerance: Tolerance,
    *,
    begins_here: bool = False,
    goes_on: bool = False,
) -> list[Match]:
    """Return which rests are which places, in order.

    Args:
        places: where the machine is to stop, in order.
        rests: that were found, in order of time.
        tolerance: of a step.
        begins_here: the recording begins with the first place (somebody said so).
        goes_on: more rests are to come, so nothing is missing at the end.

    Raises:
        ValueError: there are too many of both.
    """
    if not places or not rests:
        return []
    if len(places) * len(rests) > _MOST_CELLS:
        raise Refusal(
            f"{len(rests)} rests and {len(places)} stops are too many for one recording: record "
            "each setup in a file of its own, and say which lines it holds",
            fault="too_many",
        )
    first, last = (OUTSIDE if begins_here else JUNK, MISSING), (JUNK, MISSING)
    if goes_on:
        last = (OUTSIDE, 0.0)
    ahead = _Sums(places, rests, tolerance, first)
    back = _Sums(places[::-1], rests[::-1], tolerance, last, backward=True)
    ahead.run()
    back.run()
    total = ahead.cost + back.cost[::-1, ::-1]
    # Where a whole matching ends, nothing but what is left over is added.
    end = int(np.argmin(ahead.cost + ahead.half + _left_over(ahead.cost.shape, last)))
    best = float(np.min(total))
    if not np.isfinite(best):
        return []
    found = ahead.trace(end)
    bounds = [-1, *(rest for rest, _ in found), len(rests)]
    return [
        _judged(pair, range(bounds[n] + 1, bounds[n + 2]), total, best, rests, tolerance)
        for n, pair in enumerate(found)
    ]


def _left_over(shape: tuple[int, ...], costs: tuple[float, float]) -> Vector:
    """Return the cost of the rests and places after each match."""
    rests, places = (np.arange(count - 1, -1, -1, dtype=np.float64) for count in shape)
    left: Vector = costs[0] * rests[:, None] + costs[1] * places[None, :]
    return left


def _judged(
    pair: tuple[int, int],
    around: range,
    total: Vector,
    best: float,
    rests: Sequence[Rest],
    tolerance: Tolerance,
) -> Match:
    rest, place = pair
    other_places = total[rest].copy()
    other_places[place] = np.inf
    instead = int(np.argmin(other_places))
    other_rests = total[:, place].copy()
    for other in around:
        # Standing twice at a stop, before the next one comes, does not make it another stop.
        if same_level(rests[rest], rests[other], tolerance):
            other_rests[other] = np.inf
    margins = float(other_places[instead]) - best, float(np.min(other_rests)) - best
    return Match(rest, place, min(margins), instead if margins[0] <= margins[1] else None)


def same_level(one: Rest, other: Rest, tolerance: Tolerance) -> bool:
    """Say whether the mirror stood at the same place in two rests, as far as that can be known."""
    return one.zero == other.zero and abs(other.arrived - one.arrived) <= min(
        tolerance.least, tolerance.most
    )


class _Sums:
    """Least costs of matching the first rests with the first places.

    Args:
        places: in order, or backwards.
        rests: in the same sense.
        tolerance: of a step.
        before: cost of each rest, and of each place, before the first match.
        backward: both are given backwards.

    Attributes:
        cost: least cost with each rest (row) at each place (column) as the last match so far.
        half: what is added for each place when its setup ends with it.
    """

    def __init__(
        self,
        places: Sequence[StopPlace],
        rests: Sequence[Rest],
        tolerance: Tolerance,
        before: tuple[float, float],
        backward: bool = False,
    ) -> None:
        self._rests = rests
        self._tolerance = tolerance
        self._before = before
        self._backward = backward
        size = len(places)
        displacement = np.array([place.displacement for place in places])
        setup = np.array([place.setup for place in places])
        bounds = (np.flatnonzero(np.diff(setup)) + 1).tolist()
        self._spans = list(zip([0, *bounds], [*bounds, size], strict=True))
        # For each number of places gone on, at most the longest gap: from where, and by how much.
        ways = np.arange(1, _LONGEST_GAP + 1)[:, None]
        self._source = np.maximum(np.arange(size) - ways, 0)
        self._nominal = displacement - displacement[self._source]
        allowed = tolerance.of(self._nominal)
        within = (np.arange(size) >= ways) & (setup == setup[self._source])
        self._allowed = np.where(within, allowed, -1.0)
        self._skipped = np.broadcast_to(MISSING * (ways - 1.0), self._source.shape)
        # What a setup costs, half of it where it begins and half where it ends.
        sizes = np.array([last - first for first, last in self._spans])
        halves = 0.5 * np.minimum(SETUP, 0.5 * sizes)
        self.half = np.repeat(halves, sizes)
        self.cost = np.full((len(rests), size), np.inf)
        self._pointer = np.full((len(rests), size), _START, dtype=np.int64)
        # Least cost of having come beyond a match with nothing after it, and from which match.
        self._gap = np.full(size, np.inf)
        self._gap_from = np.full(size, _START, dtype=np.int64)
        self._passed = [np.inf] * (len(self._spans) + 1)
        self._passed_from = [_START] * (len(self._spans) + 1)

    def run(self) -> None:
        """Work out all costs."""
        for row in range(len(self._rests)):
            for back in range(1, min(row, _LONGEST_GAP) + 1):
                self._go_on(row, back)
            self._begin(row)
            self._leave(row)

    def trace(self, end: int) -> list[tuple[int, int]]:
        """Return the matches (rest, place) that lead to one of them, in order."""
        found = []
        while end != _START:
            row, column = divmod(end, self.cost.shape[1])
            found.append((row, column))
            end = int(self._pointer[row, column])
        return found[::-1]

    def _take(self, row: int, reached: Vector, sources: NDArray[np.int64], first: int = 0) -> None:
        here = slice(first, first + len(reached))
        better = reached < self.cost[row, here]
        self.cost[row, here][better] = reached[better]
        self._pointer[row, here][better] = sources[better]

    def _go_on(self, row: int, back: int) -> None:
        """Go on from a match some rests before, by a step that can be checked."""
        one, other = self._rests[row - back], self._rests[row]
        if one.zero != other.zero:
            return
        step = other.left - one.arrived if self._backward else other.arrived - one.left
        off = np.abs(step - self._nominal)
        fits = off <= self._allowed
        if not fits.any():
            return
        misfit = MISFIT * (off / np.abs(self._allowed)) ** 2
        before = self.cost[row - back][self._source]
        extras = self._extras(row - back, row)
        reached = np.where(fits, before + misfit + self._skipped + extras, np.inf)
        way = np.argmin(reached, axis=0)
        columns = np.arange(reached.shape[1])
        sources = (row - back) * reached.shape[1] + self._source[way, columns]
        self._take(row, reached[way, columns], sources)

    def _extras(self, first: int, last: int) -> float:
        """Return the cost of the rests between two matches; standing there twice is not another."""
        ends = self._rests[first], self._rests[last]
        return sum(
            JUNK if any(same_level(end, rest, self._tolerance) for end in ends) else EXTRA
            for rest in self._rests[first + 1 : last]
        )

    def _begin(self, row: int) -> None:
        """Begin a setup, or go on in it from another zero."""
        size = self.cost.shape[1]
        of_rest, of_place = self._before
        start = of_rest * row + of_place * np.arange(size) + self.half
        self._take(row, start, np.full(size, _START))
        for number, (first, last) in enumerate(self._spans):
            passed = self._passed[number] + MISSING * np.arange(last - first)
            passed = passed + self.half[first:last]
            self._take(row, passed, np.full(last - first, self._passed_from[number]), first)
            gap = self._gap[first : last - 1] + BREAK
            self._take(row, gap, self._gap_from[first : last - 1], first + 1)

    def _leave(self, row: int) -> None:
        """Work out what it costs to leave places and setups behind after this rest."""
        size = self.cost.shape[1]
        for number, (first, last) in enumerate(self._spans):
            count = last - first
            here = self.cost[row, first:last]
            ramp = MISSING * np.arange(count)
            stay = self._gap[first:last] + EXTRA
            left = np.where(here <= stay, here, stay)
            sources = np.where(
                here <= stay, row * size + np.arange(first, last), self._gap_from[first:last]
            )
            lowest = np.minimum.accumulate(left - ramp)
            origin = np.maximum.accumulate(np.where(left - ramp <= lowest, np.arange(count), 0))
            self._gap[first:last] = lowest + ramp
            self._gap_from[first:last] = sources[origin]
            over = here + ramp[::-1] + self.half[first:last]
            best = int(np.argmin(over))
            ways = (
                (float(over[best]), row * size + first + best),
                (self._passed[number + 1] + JUNK, self._passed_from[number + 1]),
            )
            self._passed[number + 1], self._passed_from[number + 1] = min(ways)
        for number, (first, last) in enumerate(self._spans):
            skipped = self._passed[number] + MISSING * (last - first)
            if skipped < self._passed[number + 1]:
                self._passed[number + 1] = skipped
                self._passed_from[number + 1] = self._passed_from[number]
