"""Rests that are not stops, and what they say of the lines beside them.

Each rest of a recording must be explained, for one that is not may be a stop of another plan's
program, of which this plan's line is a part. While a setup is measured, the machine may stand

- at a stop, once or more often;
- anywhere between the ends of the setup's lines: it was held there, or an overrun ends there;

and nowhere else. Before the first stop and after the last the operator moves things about; there
a rest counts against a line if it is one step of the line away from its end, and the machine went
there and stood there as in the line. And a whole pass among the rests that are not
stops counts against every line that it could be.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from stepdiag_ros.metrology.expected_stop import ExpectedStops
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.rest_matching import Match, StopPlace, Tolerance, match, places_of
from stepdiag_ros.metrology.stillness import Rest
from stepdiag_ros.metrology.window import FEWEST_READINGS

LEAST_PART = 0.8
"""Part of a line's stops that must be found for it to count."""
_TWO_INTERVALS = 2
"""A time between two rests, or of one, is known to a reading interval at either end."""


class Surplus:
    """Returns the evidence of rests that are not stops against lines.

    Args:
        plan: of the measurement.
        places: its stops that were looked for.
        rests: that were found.
        matches: of rests to places.
        tolerance: of a step.
        begin: time of the recording's first reading, ns.
    """

    def __init__(
        self,
        plan: Plan,
        places: Sequence[StopPlace],
        rests: Sequence[Rest],
        matches: Sequence[Match],
        tolerance: Tolerance,
        begin: int,
    ) -> None:
        self._plan, self._places, self._rests = plan, places, rests
        self._matches, self._tolerance, self._begin = matches, tolerance, begin
        self._matched = {one.rest for one in matches}
        between = [rest.duration / (rest.readings - 1) for rest in rests if rest.readings > 1]
        self._resolution = _TWO_INTERVALS * float(np.median(between or [0.0]))
        self._beyond = self._beyond_setups()
        self._spare = self._spare_passes()

    def of_line(self, index: int, found: Sequence[Match]) -> str:
        """Say why a line may not be the one of the plan; empty if nothing is left unexplained.

        Args:
            index: of the line in the plan.
            found: matches of its stops, in order.
        """
        return self._goes_on(index, found) or self._outside(found) or self._twice(index)

    def _goes_on(self, index: int, found: Sequence[Match]) -> str:
        """Say if the sequence goes on before or after a line as if it were longer."""
        for one, way, words in (
            (found[0], -1, "before its first"),
            (found[-1], 1, "after its last"),
        ):
            number = one.rest + way
            if not 0 <= number < len(self._rests) or number in self._matched:
                continue
            first, second = sorted((number, one.rest))
            before, after = self._rests[first], self._rests[second]
            if before.zero != after.zero:
                continue
            step = after.arrived - before.left
            if self._moved_alike(index, step, first, number, found):
                return (
                    f"the sequence goes on {words} stop: a rest {step * 1e3:+.4f} mm away at "
                    f"{self._at(self._rests[number])}; it was made with another plan, or stops are "
                    "missing at its other end"
                )
        return ""

    def _moved_alike(
        self, index: int, step: float, first: int, number: int, found: Sequence[Match]
    ) -> bool:
        """Say whether a step beyond a line is one of its steps, and was made and ended like them.

        Args:
            index: of the line.
            step: of the reading, m.
            first: the rest before it; it leads to the next one.
            number: that one of the two that is not a stop.
            found: matches of the line.
        """
        line = self._plan.lines[index]
        beam = beam_direction(line.name, np.asarray(self._plan.volume.step))
        steps = np.unique(np.round(np.diff(line.stops(self._plan.volume), axis=0) @ beam, 9))
        near = steps[np.abs(step - steps) <= self._tolerance.of(steps)]
        if not near.size:
            return False
        # Only moves of the same length take the same time.
        took = [
            (self._rests[b.rest].start - self._rests[a.rest].end) * 1e-9
            for a, b in pairwise(found)
            if b.rest == a.rest + 1
            and np.min(np.abs(self._step(a, b) - near)) <= self._tolerance.of(step)
        ]
        between = (self._rests[first + 1].start - self._rests[first].end) * 1e-9
        usual = float(np.median(took or [between]))
        if not 0.5 * usual - self._resolution <= between <= 3.0 * usual + self._resolution:
            return False
        if number == len(self._rests) - 1:
            # The recording may end while the machine stands there.
            return True
        lasted = float(np.median([self._rests[one.rest].duration for one in found]))
        return self._rests[number].duration >= 0.6 * lasted - self._resolution

    def _step(self, one: Match, other: Match) -> float:
        return self._rests[other.rest].arrived - self._rests[one.rest].left

    def _outside(self, found: Sequence[Match]) -> str:
        """Say if the machine stood beyond the ends of a line while its setup was measured."""
        setup = self._places[found[0].place].setup
        for number, way in self._beyond.get(setup, ()):
            rest = self._rests[number]
            if rest.zero in {self._rests[one.rest].zero for one in found}:
                return (
                    f"the machine stood {way * 1e3:.4f} mm beyond the ends of the setup's lines at "
                    f"{self._at(rest)}, where the plan has no stop: it was made with another plan, "
                    "or moved by hand; give the plan whose program ran, or measure the setup again"
                )
        return ""

    def _beyond_setups(self) -> dict[int, list[tuple[int, float]]]:
        """Return for each setup the rests while it was measured that are beyond its ends.

        Returns:
            setup → number of the rest, and how far beyond it is, m.
        """
        found: dict[int, list[tuple[int, float]]] = {}
        for before, after in pairwise(self._matches):
            place = self._places[before.place]
            if self._places[after.place].setup != place.setup:
                continue
            index, stop = place.stops[-1]
            along = [one.displacement for one in self._places if one.setup == place.setup]
            expected = ExpectedStops(self._plan, index, self._tolerance)
            last = len(self._plan.lines[index].stops(self._plan.volume)) - 1
            room = self._plan.overrun_of(self._plan.lines[index])
            room += max(expected.explained(end, stop) for end in (0, last))
            for number in range(before.rest + 1, after.rest):
                rest = self._rests[number]
                if rest.zero == self._rests[before.rest].zero:
                    level = place.displacement + rest.arrived - self._rests[before.rest].left
                elif rest.zero == self._rests[after.rest].zero:
                    level = self._places[after.place].displacement
                    level -= self._rests[after.rest].arrived - rest.left
                else:
                    continue
                beyond = max(min(along) - level, level - max(along))
                if beyond > room:
                    found.setdefault(place.setup, []).append((number, beyond))
        return found

    def _twice(self, index: int) -> str:
        """Say if a whole pass is left over that could be this line."""
        line = self._plan.lines[index]
        for number, kinds in self._spare:
            if (line.name, line.order, line.offset) in kinds:
                return (
                    f"there is one pass more than planned that could be this line, at "
                    f"{self._at(self._rests[number])}: record each setup in a file of its own, "
                    "or cut that pass out"
                )
        return ""

    def _spare_passes(self) -> list[tuple[int, frozenset[tuple[object, ...]]]]:
        """Return where rests that are not stops hold a whole pass of some lines, and of which."""
        lines = sorted({line for place in self._places for line, _ in place.stops})
        kinds: dict[tuple[float, ...], set[tuple[object, ...]]] = {}
        for index in lines:
            line = self._plan.lines[index]
            steps = np.diff([p.displacement for p in places_of(self._plan, [index])])
            both = (tuple(np.round(steps, 6).tolist()), tuple(np.round(-steps[::-1], 6).tolist()))
            kinds.setdefault(max(both), set()).add((line.name, line.order, line.offset))
        found = []
        for run in self._unmatched_runs():
            rests = self._rests[run.start : run.stop]
            for steps_of_kind, names in kinds.items():
                for sense in (steps_of_kind, tuple(-step for step in steps_of_kind[::-1])):
                    levels = np.concatenate(([0.0], np.cumsum(sense)))
                    places = [StopPlace(0, float(level), ((0, 0),)) for level in levels]
                    there = match(places, rests, self._tolerance)
                    if len(there) >= LEAST_PART * len(places):
                        found.append((run.start + there[0].rest, frozenset(names)))
        return found

    def _unmatched_runs(self) -> list[range]:
        bounds = [-1, *sorted(self._matched), len(self._rests)]
        runs = (range(a + 1, b) for a, b in pairwise(bounds))
        return [run for run in runs if len(run) >= FEWEST_READINGS]

    def _at(self, rest: Rest) -> str:
        return f"{(rest.start - self._begin) * 1e-9:.2f} s"
