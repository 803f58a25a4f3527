"""Are these lines enough? What is asked of an extra plan, pair by pair, and what it gives.

Of two rivals i and j the extra plan must rule out j if i is the cause, and the other way round. By
the evidence of the run so far, ln p_i/p_j, and that of the further readings, δ²/2 ± δ (``rivals``),
the odds come beyond ``EVIDENCE_RATIO`` with a certain chance. Over all rivals of i together, and
over all causes i by their probability now, it is asked to be 95 %.

What the weather will be when the extra plan is measured is not known. A pair that depends on it is
asked for the weather of the run so far, the worst case: drift and dead path look the same as long
as the temperature goes with time. Where no lines distinguish a pair in that weather, it is asked
for in one that changes half as fast, or in one whose parts change in other proportions, and that is
a condition.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.discrepancy.extra_lines import Option, Weather, blank, plan_of
from stepdiag_ros.metrology.discrepancy.findings import Diagnosis
from stepdiag_ros.metrology.discrepancy.rivals import Contest, FurtherReadings, Rival
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Plan

Booleans = NDArray[np.bool_]

CERTAINTY = 0.95
"""Chance of a unique and right name that a plan must give, by what is known of the cause now."""
AS_BEFORE, SLOWER, OTHERWISE = range(3)
"""Weathers: places in ``Judge.asked``."""
_NEGLIGIBLE = 0.01
"""Share of the probability of all rivals below which one need not be considered as the cause."""
_LARGEST_OVERLAP = 0.99
"""Squared cosine of two signatures at which they are still distinguished whatever their sizes."""
_LUCK = 0.002
"""Chance, at most, that a rival that is ruled out comes back: then it is not considered."""
_SLACK = 0.005


def asked_of(contest: Contest) -> Booleans:
    """Return which cause i must be distinguished from which rival j, shape (rivals, rivals).

    Not asked: causes that are all but ruled out, pairs that both belong to one alignment or pass,
    and rivals that the runs so far rule out and no luck brings back.
    """
    chances = np.array([rival.probability for rival in contest.rivals])
    bound = np.array([rival.candidate.is_bound for rival in contest.rivals])
    asked: Booleans = np.tile((chances >= _NEGLIGIBLE * np.sum(chances))[:, None], len(chances))
    asked &= ~(bound[:, None] & bound) & ~np.eye(len(chances), dtype=bool)
    # The least chance of ruling out j, over all distances, is that at the one of worst luck.
    ahead = np.maximum(np.log(chances[:, None] / chances) - np.log(EVIDENCE_RATIO), 0.0)
    ruled_out = chances_of(contest, 2.0 * ahead) > 1.0 - _LUCK
    return asked & ~(ruled_out & (contest.overlap() <= _LARGEST_OVERLAP))


def chances_of(contest: Contest, distance: Vector) -> Vector:
    """Return the chance of ruling out rival j if i is the cause, shape (rivals, rivals)."""
    from scipy.special import ndtr

    chances = np.array([rival.probability for rival in contest.rivals])
    beyond = np.log(chances[:, None] / chances) + 0.5 * distance - np.log(EVIDENCE_RATIO)
    made: Vector = ndtr(beyond / np.sqrt(np.maximum(distance, 1e-12)))
    return made


@dataclass(frozen=True)
class Judged:
    """Lines as judged for one contest in one weather; shapes (rivals, rivals).

    Attributes:
        contest: index of it.
        weather: ``AS_BEFORE``, ``SLOWER`` or ``OTHERWISE``.
        asked: which cause must be distinguished from which rival.
        distance: δ² that the lines give.
        chance: that the rival is ruled out if the cause is the cause.
        overlap: of the signatures.
    """

    contest: int
    weather: int
    asked: Booleans
    distance: Vector
    chance: Vector
    overlap: Vector

    @property
    def short(self) -> Booleans:
        """Return which requested pairs are not distinguished."""
        missed: Booleans = self.asked & (
            (self.chance < CERTAINTY) | (self.overlap > _LARGEST_OVERLAP)
        )
        return missed


class Judge:
    """Judges lines by what they add to the runs so far.

    Args:
        contests: causes to distinguish.
        measurement: the runs so far.
        stops: of them.
        diagnosis: of them.
        basis: conditions of the extra plan.
        curves: that the model has fixed.

    Attributes:
        asked: of each weather and contest, which cause must be distinguished from which rival.
        target: certainty that is enough.
        tried: number of sets of lines judged so far.
    """

    def __init__(
        self,
        contests: Sequence[Contest],
        measurement: Measurement,
        stops: Stops,
        diagnosis: Diagnosis,
        basis: Plan,
        curves: Mapping[str, Sequence[float]],
    ) -> None:
        self.contests = tuple(contests)
        self.basis = replace(basis, volume=measurement.volume)
        self.tried = 0
        self._chain = measurement.chain
        self._stops = stops
        self._diagnosis = diagnosis
        self._curves = curves
        weather = Weather.of(stops)
        self._weathers = (weather, weather.slower(), weather.otherwise())
        self._run = int(np.max(stops.run)) + 1
        self.target = CERTAINTY
        self.asked: list[list[Booleans]] = [
            [np.zeros((len(one.rivals), len(one.rivals)), dtype=bool) for one in contests]
            for _ in self._weathers
        ]
        self.asked[AS_BEFORE] = [asked_of(contest) for contest in contests]

    def among(self, chosen: Sequence[Sequence[int]], contests: Sequence[Contest]) -> "Judge":
        """Return a judge of some rivals of each contest only, who asks the same of them.

        Args:
            chosen: indices of the rivals, one sequence a contest.
            contests: with these rivals.
        """
        few = Judge.__new__(Judge)
        few.__dict__.update(self.__dict__)
        few.contests = tuple(contests)
        few.asked = [
            [asked[np.ix_(rows, rows)] for asked, rows in zip(ones, chosen, strict=True)]
            for ones in self.asked
        ]
        return few

    @property
    def asks(self) -> bool:
        """Say whether anything is asked at all."""
        return any(bool(np.any(one)) for ones in self.asked for one in ones)

    def plan(self, chosen: tuple[Option, ...]) -> Plan:
        """Return the plan of a set of options."""
        return plan_of(chosen, self.basis, "decides what a diagnosis left open")

    def __call__(self, chosen: tuple[Option, ...], weather: int | None = None) -> list[Judged]:
        """Judge a set of options in one weather, or in each that something is asked for."""
        self.tried += 1
        made = []
        for place, air in enumerate(self._weathers):
            asked = any(np.any(one) for one in self.asked[place])
            if place != weather if weather is not None else not asked:
                continue
            lines = blank(self.plan(chosen), self._chain, air, self._run)
            further = FurtherReadings(lines, self._stops, self._diagnosis, self._curves)
            for number, contest in enumerate(self.contests):
                told = contest.separation(further)
                made.append(
                    Judged(
                        number,
                        place,
                        self.asked[place][number],
                        told.distance,
                        chances_of(contest, told.distance),
                        told.overlap,
                    )
                )
        return made

    def good(self, chosen: tuple[Option, ...]) -> bool:
        """Return whether a set of options distinguishes all requested pairs."""
        judged = self(chosen)
        alike = any(bool(np.any(one.asked & (one.overlap > _LARGEST_OVERLAP))) for one in judged)
        return not alike and certainty_of(judged, self.contests) >= self.target

    def give_up(self, everything: tuple[Option, ...]) -> list[tuple[Rival, Rival]]:
        """Drop requests for pairs that not even all lines together distinguish; return these.

        Pairs that they distinguish in another weather are requested in that weather.

        Args:
            everything: all lines.
        """
        lost: list[tuple[Rival, Rival]] = []
        for weather, after in ((AS_BEFORE, SLOWER), (SLOWER, OTHERWISE), (OTHERWISE, None)):
            if not any(np.any(one) for one in self.asked[weather]):
                continue
            for one in self(everything, weather):
                pairs = one.short | one.short.T
                rivals = self.contests[one.contest].rivals
                if after is not None:
                    self.asked[after][one.contest] |= one.asked & pairs
                else:
                    lost += [
                        (rivals[i], rivals[j])
                        for i, j in combinations(range(len(rivals)), 2)
                        if pairs[i, j]
                    ]
                self.asked[weather][one.contest] = one.asked & ~pairs
        # Many pairs, each told well enough, may together come to less.
        self.target = min(CERTAINTY, certainty_of(self(everything), self.contests) - _SLACK)
        return lost


def certainty_of(judged: Sequence[Judged], contests: Sequence[Contest]) -> float:
    """Return the chance that the cause will be named alone, weighted by what is known of it now.

    Of each cause that is asked for it is one minus the chances of not ruling out each rival; of
    several contests the least counts.
    """
    least = 1.0
    for number, contest in enumerate(contests):
        chances = np.array([rival.probability for rival in contest.rivals])
        missed, causes = np.zeros(len(chances)), np.zeros(len(chances), dtype=bool)
        for one in judged:
            if one.contest == number:
                missed += np.sum(np.where(one.asked, 1.0 - one.chance, 0.0), axis=1)
                causes |= np.any(one.asked, axis=1)
        if np.any(causes):
            told = np.maximum(1.0 - missed, 0.0)
            least = min(least, float(np.average(told[causes], weights=chances[causes])))
    return least
