"""Changes in a history, found by generalised likelihood at a stated level of false alarms.

A change is taken in if its ratio to its standard uncertainty is beyond what the largest of all
ratios that are looked at exceeds by chance, by Bonferroni's inequality. Two steps that undo each
other within some runs are looked for as one, since neither may be seen without the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import stdtr

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.trends.columns import FREE, Design, Place, columns_of, with_changes
from stepdiag_ros.metrology.trends.fitting import Fit, left_over

_BESIDE_STEP = 2
"""Runs that a step must have on both sides; one run alone may be a slip."""
_BESIDE_BEND = 8
_LONGEST = 12
"""Runs between two steps that are looked for as one."""
_RARE = 0.25
"""Part of the level that is for bends and for pairs."""
_ROUNDS = 5
_SIZES = 64
"""Lengths of histories whose candidates are kept at hand."""
_SAME = 3.84
"""95 % point of χ² with one degree of freedom: places within it of the best may be the place."""


@dataclass(frozen=True)
class Candidates:
    """The changes that a history of some length may have.

    Attributes:
        places: of each candidate: one, or two steps.
        usual: number of those that are usual; bends and pairs, which are rare, follow.
        columns: runs × candidates; bends depend on the dates, and are 0 here.
        bends: numbers of the bends.
    """

    places: Sequence[tuple[Place, ...]]
    usual: int
    columns: Vector
    bends: slice


@lru_cache(_SIZES)
def candidates(runs: int) -> Candidates:
    """Return the changes that a history of so many runs may have."""
    steps = range(_BESIDE_STEP, runs - _BESIDE_STEP + 1)
    usual = [(Place(at, "step"),) for at in steps] + [(Place(at, "alone"),) for at in range(runs)]
    bends = [(Place(at, "bend"),) for at in range(_BESIDE_BEND, runs - _BESIDE_BEND + 1)]
    pairs = [
        (Place(at, "step"), Place(end, "step"))
        for at in steps
        for end in range(at + _BESIDE_STEP, min(at + _LONGEST + 1, steps.stop))
    ]
    every: list[tuple[Place, ...]] = [*usual, *bends, *pairs]
    first, last = (columns_of([one[at] for one in every], np.zeros(runs)) for at in (0, -1))
    columns = first - last * np.array([len(one) == 2 for one in every])
    return Candidates(every, len(usual), columns, slice(len(usual), len(usual) + len(bends)))


class Search:
    """Looks for changes in a series.

    Args:
        design: of the series; it may be replaced by one with other variances.
        years: of its runs.
        level: chance that any change is found in a series without change, at most.
    """

    def __init__(self, design: Design, years: Vector, level: float) -> None:
        self.design, self._years = design, years
        known = candidates(len(years))
        self._candidates = known.places
        rare = len(known.places) - known.usual
        each = [(1.0 - _RARE) * level / known.usual, _RARE * level / max(rare, 1)]
        self._chances = 0.5 * np.repeat(each, [known.usual, rare])
        self._columns = np.zeros((len(design.values), len(known.places)))
        self._columns[: len(years)] = known.columns
        bends = [one[0] for one in known.places[known.bends]]
        self._columns[: len(years), known.bends] = columns_of(bends, years)

    def fitted(self, places: Sequence[Place]) -> Fit:
        """Return the fit with some changes."""
        return with_changes(self.design, places, self._years).fitted()

    def changes(self, found: list[Place]) -> list[Place]:
        """Return the changes, in the order of their dates.

        Args:
            found: changes to begin with.
        """
        found = self._beyond_chance(self._refined(found))
        # A quarter of the runs at most: what needs more is not a line with changes.
        while len(found) < len(self._years) // 4:
            more = self._best(self.fitted(found))
            grown = self._beyond_chance(self._refined([*found, *more])) if more else []
            if len(grown) <= len(found):
                break
            found = grown
        return sorted(found)

    def _gains(self, now: Fit) -> Vector:
        """Return by how much each candidate lowers χ²; 0 where it is not determined."""
        columns, determined = left_over(now.root_weights[:, None] * self._columns, now.basis)
        size = np.where(determined, np.sum(columns**2, axis=0), 1.0)
        gain: Vector = np.where(determined, (columns.T @ now.residuals) ** 2 / size, 0.0)
        return gain

    def _ratios(self, now: Fit) -> Vector:
        """Return the ratio of each candidate to its uncertainty, beside what is fitted."""
        gain = self._gains(now)
        rest = np.maximum(now.residuals @ now.residuals - gain, 1e-300)
        ratios: Vector = np.sqrt(gain * max(now.degrees_of_freedom - 1, 1) / rest)
        return ratios

    def _best(self, now: Fit) -> tuple[Place, ...]:
        """Return the candidate that is most beyond chance; none if none is."""
        if now.degrees_of_freedom <= FREE:
            return ()
        chance = stdtr(now.degrees_of_freedom - 1, -self._ratios(now)) / self._chances
        best = int(np.argmin(chance))
        return self._candidates[best] if chance[best] < 1.0 else ()

    def _refined(self, places: list[Place]) -> list[Place]:
        """Return changes, each at its best place beside the others."""
        for _ in range(_ROUNDS):
            before = list(places)
            for number in range(len(places)):
                others = places[:number] + places[number + 1 :]
                ratios = self._ratios(self.fitted(others))
                alone = [len(one) == 1 and one[0] not in others for one in self._candidates]
                best = int(np.argmax(np.where(alone, ratios, -1.0)))
                places[number] = self._candidates[best][0]
            if places == before:
                break
        return places

    def _beyond_chance(self, places: list[Place]) -> list[Place]:
        """Return changes without those that are within chance beside the others."""
        while places:
            now = self.fitted(places)
            size = now.coefficients[-len(places) :]
            spread = np.sqrt(np.diag(now.covariance)[-len(places) :])
            chance = stdtr(now.degrees_of_freedom, -np.abs(size) / spread)
            limits = [self._chances[-1 if one.kind == "bend" else 0] for one in places]
            least = int(np.argmax(chance / limits))
            if chance[least] < limits[least]:
                break
            places = places[:least] + places[least + 1 :]
        return places

    def span(self, place: Place, others: Sequence[Place]) -> tuple[int, int]:
        """Return the first and last place where a change may be, with 95 % confidence."""
        gains = self._gains(self.fitted(others))
        same = {
            one[0].first: float(value)
            for one, value in zip(self._candidates, gains, strict=True)
            if len(one) == 1 and one[0].kind == place.kind
        }
        first = last = place.first
        while same.get(first - 1, -1.0) > same[place.first] - _SAME:
            first -= 1
        while same.get(last + 1, -1.0) > same[place.first] - _SAME:
            last += 1
        return first, last
