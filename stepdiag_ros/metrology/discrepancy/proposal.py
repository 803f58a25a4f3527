"""Ask the machine: the shortest extra plan that decides what a run leaves open.

Where several effects close the gap of a run equally well, further lines are sought in which they
differ: other orders of moves, other diagonals, both directions, repeats, linear lines along other
edges of the box, the mirror mounted elsewhere, a slower pace. A set of lines is good enough if the
evidence of all readings together will name the cause alone in 19 of 20 cases (``judging``).
Every alignment that is not needed is left out, then every pass; of what several orders of leaving
out come to, the quickest is proposed.

What belongs to one alignment or one pass (a slip, a cosine error, a tilting mirror) is over when
that is over. Further readings show whether the cause was such a thing or is in the machine
still; they need not show which of several alignments it was.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline
from stepdiag_ros.metrology.discrepancy.contenders import Contenders
from stepdiag_ros.metrology.discrepancy.described import WITHOUT_A_NAME
from stepdiag_ros.metrology.discrepancy.extra_lines import (
    Option,
    alignments,
    mounted_elsewhere,
    parts,
)
from stepdiag_ros.metrology.discrepancy.findings import DESCRIBED, Diagnosis
from stepdiag_ros.metrology.discrepancy.judging import (
    AS_BEFORE,
    SLOWER,
    Judge,
    Judged,
    certainty_of,
)
from stepdiag_ros.metrology.discrepancy.rivals import Contest, Rival
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect
from stepdiag_ros.metrology.effects.learned_shape import fading_time, quantities
from stepdiag_ros.metrology.effects.servo_lag import EFFECT as SERVO_LAG
from stepdiag_ros.metrology.effects.several_angular_errors import EFFECT as SEVERAL_ANGULAR_ERRORS
from stepdiag_ros.metrology.effects.trigger_delay import EFFECT as TRIGGER_DELAY
from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Plan, Volume, axes_at_hand

_SHUFFLES = 2
_FOREMOST = 2
"""Sets of alignments of which passes are taken away."""
_BELOW = 5
_MANY = 6
"""Alignments, beyond which it is tried whether more passes in fewer of them will do."""
_SLOWER = 4.0
"""Factor of the dwell of an extra plan whose lines have to be slower than those of the run."""
_LESS_FEED = 2.0
"""Factor by which such a plan's feed is less."""
_OF_A_KIND = 2
"""Rivals of one effect that belong to one alignment or pass: so many stand for all in the
search."""
_WEATHER = {
    "air_temperature": "air temperature",
    "air_pressure": "air pressure",
    "relative_humidity": "relative humidity",
    "material_temperature": "material temperature",
}


@dataclass(frozen=True)
class RivalPair:
    """Two rivals and how well an extra plan distinguishes them.

    Attributes:
        labels: of the two.
        separation: δ, the expected difference in units of its uncertainty, the lesser of the two.
        chance: that the one that is the cause is named and the other ruled out, 0..1.
    """

    labels: tuple[str, str]
    separation: float
    chance: float


@dataclass(frozen=True)
class LeftOpen:
    """Rivals that the proposed lines do not distinguish.

    Attributes:
        labels: of them.
        why: and what would, in a sentence.
    """

    labels: tuple[str, ...]
    why: str


@dataclass(frozen=True)
class ExtraPlan:
    """An extra plan for what a diagnosis left open.

    Attributes:
        rivals: labels of each finding and of what else may be the cause; empty if nothing is open.
        plan: with the run's own box, feed and sampling; None without a plan.
        seconds: that it takes, alignments included; NaN without a plan.
        certainty: chance that the cause will be named alone, by what is known of it now; NaN
            without a plan.
        pairs: that it distinguishes, the least certain first.
        left_open: what it does not.
        conditions: on which the certainty depends, in sentences.
        tried: number of sets of lines that were judged.
    """

    rivals: tuple[tuple[str, ...], ...]
    plan: Plan | None
    seconds: float
    certainty: float
    pairs: tuple[RivalPair, ...]
    left_open: tuple[LeftOpen, ...]
    conditions: tuple[str, ...] = ()
    tried: int = 0

    @property
    def setups(self) -> tuple[str, ...]:
        """Return the alignments of the plan."""
        if self.plan is None:
            return ()
        return tuple(dict.fromkeys(self.plan.setup_of(line) for line in self.plan.lines))

    @property
    def sentence(self) -> str:
        """Say what is proposed."""
        if not self.rivals:
            return "Nothing is open that an extra plan could decide."
        if self.plan is None:
            return f"No extra plan is proposed: {' '.join(one.why for one in self.left_open)}"
        passes, setups = len(self.plan.lines), len(self.setups)
        sure = f"{100.0 * self.certainty:.0f} %" if self.certainty < 0.995 else "more than 99 %"
        but = ", except for what stays open" if self.left_open else ""
        return (
            f"{passes} pass{'es' if passes > 1 else ''} in {setups} alignment"
            f"{'s' if setups > 1 else ''} ({'; '.join(self.setups)}), about"
            f" {self.seconds / 60.0:.0f} min: diagnosed together with them, the run will show"
            f" which of these effects it is, with a probability of {sure}{but}."
        )


def propose(
    measurement: Measurement,
    diagnosis: Diagnosis,
    basis: Plan,
    seconds: Callable[[Plan], float],
    known: Sequence[ActiveEffect] = (),
    catalogue: Iterable[Effect] | None = None,
    fitted: Sequence[ActiveEffect] = (),
    curves: Mapping[str, Sequence[float]] | None = None,
) -> ExtraPlan:
    """Seek the quickest extra plan that decides what a diagnosis left open.

    Args:
        measurement: the runs so far.
        diagnosis: of them.
        basis: feed and sampling of the extra plan; its lines are not used.
        seconds: duration of a plan, s.
        known: as given to ``diagnose``, like the following.
        catalogue: effects that were tried; all that are installed if None.
        fitted: effects of the model whose sizes are free.
        curves: that the model has fixed.

    Raises:
        ValueError: the basis has no feed.
    """
    if not basis.feed > 0.0:
        raise ValueError(
            "the feed of the run is unknown, so the duration of an extra plan is unknown, too"
        )
    if not is_open(diagnosis):
        return ExtraPlan((), None, float("nan"), float("nan"), (), ())
    stops = diagnosis.stops
    baseline = fit_baseline(measurement, stops, known, curves=curves)
    if catalogue is None:
        # Late, since effects of other packages are imported with it.
        from stepdiag_ros.metrology.effects import catalogue as installed

        catalogue = installed().values()
    everyone = Contenders(measurement, diagnosis, known, catalogue, fitted, curves or {})
    asked = [one for one in everyone.questions() if len(one.rivals) > 1]
    groups = [one.rivals for one in asked]
    undecided = _no_line_decides(diagnosis, {one.label for group in groups for one in group})
    if not asked:
        labels = tuple(one.labels for one in undecided)
        return ExtraPlan(labels, None, float("nan"), float("nan"), (), undecided)

    def contests(some: Sequence[Sequence[Rival]]) -> list[Contest]:
        return [
            Contest(rivals, [*fitted, *question.beside], baseline, stops, diagnosis)
            for question, rivals in zip(asked, some, strict=True)
        ]

    whole = contests(groups)
    axes = axes_at_hand(line.line for line in measurement.lines)
    everybody = [one for group in groups for one in group]
    paced = any(map(_of_pace, everybody))
    fades = max(map(_fading_time, everybody))
    judge, lost, everything = _least_lost(
        (Judge(whole, measurement, stops, diagnosis, conditions, curves or {}), lines)
        for conditions, lines in _ways(basis, measurement.volume, axes, paced, fades)
    )
    few = [_few(group) for group in groups]
    some = [[group[place] for place in places] for group, places in zip(groups, few, strict=True)]
    search = _Search(judge, judge.among(few, contests(some)), everything, seconds)
    proposal = search.proposal(lost)
    return replace(proposal, left_open=(*proposal.left_open, *undecided))


def _ways(
    basis: Plan, box: Volume, axes: str, paced: bool, fades: float
) -> Iterator[tuple[Plan, tuple[Option, ...]]]:
    """Yield conditions and all lines under them, those that are the least trouble first.

    Args:
        basis: feed and sampling of the run.
        box: of the run.
        axes: that move.
        paced: a rival depends on how fast moves and stops follow one another.
        fades: time constant of a rival that fades after a reversal, s: in the slow passes it
            fades to a twentieth.
    """
    dwell = max(_SLOWER * basis.sampling.dwell, 3.0 * fades / box.blocks)
    slow = replace(
        basis, feed=basis.feed / _LESS_FEED, sampling=replace(basis.sampling, dwell=dwell)
    )
    once, often = (alignments(box, several, axes) for several in (False, True))
    mounted = (*once, *mounted_elsewhere(axes))
    if paced:
        yield slow, once
    yield basis, once
    yield basis, often
    yield basis, mounted
    yield slow, mounted


def _of_pace(rival: Rival) -> bool:
    """Say whether an effect depends on how fast moves and stops follow one another."""
    named = rival.candidate.effect.name in (SERVO_LAG.name, TRIGGER_DELAY.name)
    return named or _fading_time(rival) > 0.0


def _fading_time(rival: Rival) -> float:
    """Return the time constant of what fades after a reversal, s; 0 if the rival does not fade."""
    shapes = [str(one.setting["shape"]) for one in rival.acting if one.effect.learned]
    return max(map(fading_time, shapes), default=0.0)


def is_open(diagnosis: Diagnosis) -> bool:
    """Say whether a finding, or a dependence of a formula, has rivals."""
    described = diagnosis.description if diagnosis.verdict == DESCRIBED else None
    formulas = described.dependences if described else ()
    return any(one.ambiguous for one in diagnosis.findings) or any(one.rivals for one in formulas)


def _no_line_decides(diagnosis: Diagnosis, asked: set[str]) -> tuple[LeftOpen, ...]:
    """Return which rivals no further line is sought for, and what to do.

    Args:
        diagnosis: of the runs so far.
        asked: labels of the rivals for which lines are sought.
    """
    turning = SEVERAL_ANGULAR_ERRORS.name
    advice = "measure the angular errors, or step diagonals in several orders of the axes"
    made = []
    for labels in [(one.label, *one.ambiguous) for one in diagnosis.findings if one.ambiguous]:
        if turning in labels:
            others = ", ".join(sorted({*labels} - {turning}))
            made.append(LeftOpen(labels, f"{others} or axes that turn: {advice}."))
        nameless = [one for one in labels if one.startswith(WITHOUT_A_NAME) and one not in asked]
        if nameless:
            named = ", ".join(one for one in labels if one not in nameless)
            again = f"{named} or {WITHOUT_A_NAME}: measure the same lines again."
            made.append(LeftOpen(labels, again))
    return tuple(made)


def _least_lost(
    judges: Iterable[tuple[Judge, tuple[Option, ...]]],
) -> tuple[Judge, list[tuple[Rival, Rival]], tuple[Option, ...]]:
    """Return the first judge with whom no pair has to be given up, else the one with the fewest."""
    tried = []
    for judge, lines in judges:
        lost = judge.give_up(lines)
        tried.append((judge, lost, lines))
        if not lost:
            break
    return min(tried, key=lambda one: len(one[1]))


def _few(rivals: Sequence[Rival]) -> list[int]:
    """Return the places of rivals that stand for all: of bound effects the likeliest of a kind."""
    seen: dict[str, int] = {}
    places = []
    for place in sorted(range(len(rivals)), key=lambda one: -rivals[one].probability):
        candidate = rivals[place].candidate
        if candidate.is_bound:
            seen[candidate.effect.name] = seen.get(candidate.effect.name, 0) + 1
            if seen[candidate.effect.name] > _OF_A_KIND:
                continue
        places.append(place)
    return sorted(places)


class _Search:
    """Seeks the quickest set of options that is good enough.

    Args:
        judge: of all rivals.
        quick: of those that stand for all.
        everything: all lines, which are good enough.
        seconds: duration of a plan, s.
    """

    def __init__(
        self,
        judge: Judge,
        quick: Judge,
        everything: tuple[Option, ...],
        seconds: Callable[[Plan], float],
    ) -> None:
        self._judge = judge
        self._quick = quick
        self._everything = everything
        self._seconds = seconds
        self._known: dict[frozenset[Option], bool] = {}

    def _good(self, chosen: tuple[Option, ...]) -> bool:
        key = frozenset(chosen)
        if key not in self._known:
            self._known[key] = self._quick.good(chosen)
        return self._known[key]

    def proposal(self, lost: Sequence[tuple[Rival, Rival]]) -> ExtraPlan:
        """Return the quickest plan that is good enough.

        Args:
            lost: pairs that no lines distinguish.
        """
        judge = self._judge
        names = tuple(tuple(rival.label for rival in contest.rivals) for contest in judge.contests)
        left_open = (*_lost_words(lost), *_bound_words(judge))
        if not judge.asks:
            unknown = float("nan")
            return ExtraPlan(names, None, unknown, unknown, (), left_open, (), judge.tried)
        chosen = self._quickest()
        if not judge.good(chosen):
            self._quick, self._known = judge, {}
            chosen = self._quickest()
        judged = judge(chosen)
        plan = judge.plan(chosen)
        return ExtraPlan(
            rivals=names,
            plan=plan,
            seconds=self._seconds(plan),
            certainty=certainty_of(judged, judge.contests),
            pairs=_pairs(judged, judge.contests),
            left_open=left_open,
            conditions=_conditions(judged, judge),
            tried=judge.tried + self._quick.tried,
        )

    def _quickest(self) -> tuple[Option, ...]:
        """Take away from all alignments what is not needed, in several orders."""
        made = self._found_in(self._everything)
        axes = axes_at_hand(line for option in self._everything for line in option.lines)
        often = alignments(self._judge.basis.volume, True, axes)
        if min(len(one) for one in made) > _MANY and self._good(often):
            # More passes in fewer alignments may be quicker.
            made += self._found_in(often)
        return min(made, key=self._duration)

    def _found_in(self, everything: tuple[Option, ...]) -> list[tuple[Option, ...]]:
        """Return the quickest sets that are left of all alignments."""
        random = np.random.default_rng(0)
        long_first = sorted(everything, key=lambda one: -len(one.lines))
        orders = [long_first, long_first[::-1]]
        orders += [
            [everything[place] for place in random.permutation(len(everything))]
            for _ in range(_SHUFFLES)
        ]
        found = {frozenset(self._needed(tuple(order))) for order in orders}
        in_order = [tuple(one for one in everything if one in chosen) for chosen in found]
        ranked = sorted(in_order, key=self._duration)
        return [self._smaller(one) for one in ranked[:_FOREMOST]]

    def _duration(self, chosen: tuple[Option, ...]) -> float:
        return self._seconds(self._judge.plan(chosen))

    def _needed(self, order: tuple[Option, ...]) -> tuple[Option, ...]:
        """Return what is left of alignments when each, in this order, is left out if it may be."""
        chosen = order
        # Halves first: few are needed of many.
        size = len(order) // 2
        while size >= 1:
            place = 0
            while place < len(chosen):
                rest = (*chosen[:place], *chosen[place + size :])
                if rest and self._good(rest):
                    chosen = rest
                else:
                    place += size
            size //= 2
        return chosen

    def _smaller(self, chosen: tuple[Option, ...]) -> tuple[Option, ...]:
        """Measure in each alignment as few passes as will do."""
        for place in range(len(chosen)):
            fewer = (*parts(chosen[place]), chosen[place])

            def with_part(number: int, place: int = place) -> tuple[Option, ...]:
                return (*chosen[:place], fewer[number], *chosen[place + 1 :])  # noqa: B023

            # More passes tell more, but for the order of moves; so the fewest are looked for by
            # halves, and then a little below.
            low, high = 0, len(fewer) - 1
            while low < high:
                middle = (low + high) // 2
                if self._good(with_part(middle)):
                    high = middle
                else:
                    low = middle + 1
            least = next(
                (one for one in range(max(high - _BELOW, 0), high) if self._good(with_part(one))),
                high,
            )
            chosen = with_part(least)
        return chosen


def _pairs(judged: Sequence[Judged], contests: Sequence[Contest]) -> tuple[RivalPair, ...]:
    found = []
    for one in judged:
        rivals = contests[one.contest].rivals
        for i, j in combinations(range(len(rivals)), 2):
            asked = [place for place in ((i, j), (j, i)) if one.asked[place]]
            if asked:
                found.append(
                    RivalPair(
                        (rivals[i].label, rivals[j].label),
                        float(np.sqrt(min(one.distance[place] for place in asked))),
                        float(min(one.chance[place] for place in asked)),
                    )
                )
    return tuple(sorted(found, key=lambda pair: pair.chance))


def _conditions(judged: Sequence[Judged], judge: Judge) -> tuple[str, ...]:
    """Say in which weather the plan must be measured, if that matters."""
    words = []
    for one in judged:
        if one.weather == AS_BEFORE:
            continue
        rivals = judge.contests[one.contest].rivals
        involved = [
            rivals[place] for place in np.flatnonzero(np.any(one.asked | one.asked.T, axis=1))
        ]
        if not involved:
            continue
        what = [
            word for name, word in _WEATHER.items() if any(_takes(name, one) for one in involved)
        ] or list(_WEATHER.values())
        labels = ", ".join(rival.label for rival in involved)
        how = (
            "changes at most half as fast as in the run, or in the other sense"
            if one.weather == SLOWER
            else "changes as much as in the run, but in another proportion to the rest of the"
            " weather (at least by a factor of 2)"
        )
        words.append(
            f"To distinguish {labels}, measure again when the {' or the '.join(what)} {how}: on"
            f" another day or at another time of the day{_warming(what)}."
        )
    return tuple(words)


def _takes(name: str, rival: Rival) -> bool:
    """Say whether an effect, or a formula, depends on a quantity of the weather."""
    shapes = [str(one.setting["shape"]) for one in rival.acting if one.effect.learned]
    return name in rival.candidate.effect.needs or any(
        one.startswith(name) for shape in shapes for one in quantities(shape)
    )


def _warming(what: Sequence[str]) -> str:
    """Say how to come to another temperature of the machine without waiting for a day."""
    if _WEATHER["material_temperature"] not in what:
        return ""
    return ", or after the axes were run to and fro for an hour, which warms the machine alone"


def _bound_words(judge: Judge) -> list[LeftOpen]:
    found = []
    for contest in judge.contests:
        bound = [one.label for one in contest.rivals if one.candidate.is_bound]
        if len(bound) > 1:
            found.append(
                LeftOpen(
                    tuple(bound),
                    f"If it was one alignment or pass ({len(bound)} are possible), it is over and"
                    " need not be identified: align and measure that line again.",
                )
            )
    return found


def _lost_words(lost: Sequence[tuple[Rival, Rival]]) -> list[LeftOpen]:
    """State what would distinguish pairs that no lines distinguish."""
    found = []
    for one, other in lost:
        words = (
            "No linear lines along the edges of the box and no step diagonals, however often"
            " repeated and wherever the mirror is mounted, distinguish"
            f" {one.label} from {other.label}"
        )
        turning = [
            rival.candidate.setting["error"]
            for rival in (one, other)
            if rival.candidate.setting.get("error") in ROTATIONS
        ]
        if turning:
            words += (
                f"; measure {' or '.join(turning)} directly, with an autocollimator, a level or an"
                " angular interferometer"
            )
        found.append(LeftOpen((one.label, other.label), f"{words}."))
    return found
