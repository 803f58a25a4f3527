"""Which effects close the gap: one after another, exchanged and refitted together, by evidence.

An effect is looked for only as long as some candidate gains more than chance would give any of them
on a run that lacks nothing. Which one it is, is a question of evidence, not of the gain alone: a
candidate with more sizes, or one of many of its kind, would more often fit by luck (Schwarz 1978;
every effect of the catalogue is as likely as any other, and so is each of its settings).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.discrepancy.candidates import Signatures, aliases, alike
from stepdiag_ros.metrology.discrepancy.chance import LookElsewhere, coverage_factor
from stepdiag_ros.metrology.discrepancy.findings import Candidate, Finding, RunnerUp
from stepdiag_ros.metrology.discrepancy.ranking import Ranker, Ranking
from stepdiag_ros.metrology.discrepancy.siblings import not_separated
from stepdiag_ros.metrology.discrepancy.sizes import Sizes
from stepdiag_ros.metrology.discrepancy.start import Progress
from stepdiag_ros.metrology.geometry import Vector

FALSE_NAME_LEVEL = 0.002
"""Chance of any name on a run that lacks nothing, by its noise model."""
MOST_NAMES = 4
"""A gap that takes more names than that is not understood."""
EVIDENCE_RATIO = 20.0
"""Odds by which a name must be better than any other to be the only one."""
_BETTER = 0.5
_TIED = 1e-6
"""Difference of evidence that counts as none: rounding must not choose between look-alikes."""
_AS_WELL = 0.05
"""Difference of χ² that is not worth a word."""
_TOGETHER = "but this run does not show whether it acts as well"
_ROUNDS = 3
_RUNNERS_UP = 6
_MANY_KINDS = 9
_MOST_ALIKE = 2
"""Effects of many places, such as slips, imitate anything if enough of them are taken."""


class Selection:
    """The effects chosen for a gap.

    Args:
        found: the candidates beyond the baseline.
        gap: whitened and projected, shape (rows,).
        luck: what chance does on this plan.
        progress: called with what is being done.
    """

    def __init__(
        self,
        found: Signatures,
        gap: Vector,
        luck: LookElsewhere,
        progress: Progress | None = None,
    ) -> None:
        self._found = found
        self._gap = gap
        self._luck = luck
        self._ranker = Ranker(found, gap, luck)
        self._families = np.array(found.names)
        self._tell = progress or (lambda _: None)
        self.chosen: list[int] = []
        self._select()
        if len(self.chosen) > 1:
            self._try_pairs()

    @property
    def contrived(self) -> str:
        """Say why the choice closes the gap but is not an explanation; empty if it may be one."""
        if len(self.chosen) >= MOST_NAMES:
            return f"it takes {len(self.chosen)} effects at once, which explains nothing"
        names = [self._found.candidates[index].effect.name for index in self.chosen]
        for name in dict.fromkeys(names):
            kinds = {
                kind
                for kind, one in zip(self._found.names, self._found.candidates, strict=True)
                if one.effect.name == name
            }
            if names.count(name) > _MOST_ALIKE and len(kinds) > _MANY_KINDS:
                return f"it takes {names.count(name)} times a {name}, which explains nothing"
        return ""

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Return the chosen candidates."""
        return tuple(self._found.candidates[index] for index in self.chosen)

    @property
    def evidence(self) -> float:
        """Return the evidence of the choice against none, comparable for one noise."""
        return self._evidence(self.chosen)

    @property
    def weighed(self) -> float:
        """Return the evidence less what it costs that each effect is one of all that were tried.

        Of choices with unlike numbers of effects, only this shows which is likelier: the more
        effects are tried together, the better they fit by luck (Scott & Berger 2010, Annals of
        Statistics 38, 2587).
        """
        return self.evidence - len(self.chosen) * self._price

    @property
    def prior(self) -> float:
        """Return ln of the probability of the choice before the run, among all that were tried."""
        shares = self._found.share[self.chosen]
        return float(np.sum(np.log(shares))) - len(self.chosen) * self._price

    @property
    def _price(self) -> float:
        """Return what it costs that each effect is one of all that were tried."""
        tried = len({one.effect.name for one in self._found.candidates})
        return float(np.log(max(tried, 1)))

    def span(self) -> Vector:
        """Return orthonormal columns of the chosen candidates, shape (rows, k)."""
        return self._ranker.span(self.chosen)

    def left(self) -> Vector:
        """Return the gap beyond the chosen candidates, whitened, shape (rows,)."""
        span = self.span()
        left: Vector = self._gap - span @ (span.T @ self._gap)
        return left

    def _try_pairs(self) -> None:
        """Take the best pair for a start if that leads to more evidence than one after another.

        Two effects may hide each other: the first that is chosen for their sum may be neither.
        """
        first = self._ranker.ranking([])
        members = [
            int(here[_first_best(first.gain[here])])
            for here in (np.flatnonzero(self._families == name) for name in set(self._families))
        ]
        members.sort()
        few = Ranker(self._found.subset(members), self._gap, self._luck)
        best, pair = -np.inf, (0, 0)
        for one in range(len(members)):
            if not np.isfinite(first.evidence[members[one]]):
                continue
            second = few.ranking([one])
            other = _first_best(second.evidence)
            total = float(first.evidence[members[one]] + second.evidence[other])
            if total > best + _TIED:
                best, pair = total, (members[one], members[other])
        greedy = self.chosen
        self.chosen = list(pair)
        self._exchange()
        self._select()
        if self._evidence(self.chosen) <= self._evidence(greedy):
            self.chosen = greedy

    def _evidence(self, chosen: list[int]) -> float:
        """Return the evidence of a choice, comparable between choices for one gap."""
        return float(
            sum(self._ranker.ranking(chosen[:n]).evidence[index] for n, index in enumerate(chosen))
        )

    def _select(self) -> None:
        """Add and exchange until nothing is to be gained; keep the best choice on the way.

        A choice may come back to an earlier one where candidates overlap.
        """
        visited: list[list[int]] = []
        while len(self.chosen) < MOST_NAMES and sorted(self.chosen) not in visited:
            visited.append(sorted(self.chosen))
            best = self._best(self.chosen)
            if best is None:
                return
            self.chosen.append(best)
            self._tell(f"may be: {self._found.candidates[best].label}")
            self._exchange()
        if sorted(self.chosen) in visited:
            self.chosen = max([*visited, self.chosen], key=self._evidence)

    def _best(self, given: list[int]) -> int | None:
        """Return the likeliest candidate beside given ones, None if chance does as well."""
        ranking = self._ranker.ranking(given)
        allowed = np.isfinite(ranking.evidence)
        if not np.any(allowed):
            return None
        # Luck is looked for where the sizes are plausible; elsewhere it has to be ruled out better.
        chance = ranking.chance * np.exp(np.where(allowed, ranking.cost, 0.0))
        if self._luck.corrected(float(np.min(chance[allowed]))) > FALSE_NAME_LEVEL:
            return None
        names, odds = self._odds(ranking)
        family = names[_first_best(np.log(np.maximum(odds, 1e-300)))]
        members = np.flatnonzero(self._families == family)
        return int(members[_first_best(ranking.evidence[members])])

    def _exchange(self) -> None:
        """Replace a chosen one that another does better beside the rest, drop what is not needed.

        The first of several effects is chosen while the others are still in the gap.
        """
        start = list(self.chosen)
        self._exchange_rounds()
        if self._evidence(self.chosen) < self._evidence(start):
            self.chosen = start

    def _exchange_rounds(self) -> None:
        for _ in range(_ROUNDS if len(self.chosen) > 1 else 0):
            before = list(self.chosen)
            for old in before:
                rest = [other for other in self.chosen if other != old]
                ranking = self._ranker.ranking(rest)
                better = self._best(rest)
                if better is None:
                    self.chosen = rest
                elif better != old and (
                    ranking.evidence[better] > ranking.evidence[old] + _BETTER
                    or not np.isfinite(ranking.evidence[old])
                ):
                    self.chosen[self.chosen.index(old)] = better
            if self.chosen == before:
                return

    def _odds(self, ranking: Ranking) -> tuple[list[str], Vector]:
        """Return the names and the probability of each."""
        names, place = np.unique(self._families, return_inverse=True)
        top = float(np.max(ranking.evidence))
        if not np.isfinite(top):
            return [str(name) for name in names], np.zeros(len(names))
        share = np.bincount(place.reshape(-1), np.exp(ranking.evidence - top), len(names))
        return [str(name) for name in names], share / np.sum(share)

    def findings(self) -> tuple[Finding, ...]:
        """Return the chosen effects with sizes fitted together, strongest first."""
        sizes = Sizes(self._ranker, self.chosen)
        return tuple(self._finding(index, sizes) for index in self._by_gain())

    def covariance(self) -> Vector:
        """Return the covariance of all sizes of all findings, SI, in their order."""
        return Sizes(self._ranker, self.chosen).in_order(self._by_gain())

    def sizes(self) -> dict[int, tuple[float, ...]]:
        """Return the sizes of each chosen candidate, fitted together, SI, in their order."""
        values = Sizes(self._ranker, self.chosen).values
        return {index: tuple(float(value) for value in own) for index, own in values.items()}

    def _by_gain(self) -> list[int]:
        def gain(index: int) -> float:
            rest = [other for other in self.chosen if other != index]
            return float(self._ranker.ranking(rest).gain[index])

        return sorted(self.chosen, key=gain, reverse=True)

    def _finding(self, index: int, sizes: Sizes) -> Finding:
        factor = coverage_factor(self._luck.freedom)
        rest = [other for other in self.chosen if other != index]
        ranking = self._ranker.ranking(rest)
        names, odds = self._odds(ranking)
        own = names.index(self._families[index])
        candidate = self._found.candidates[index]
        covariance = sizes.of(index)
        told = zip(
            (size.name for size in candidate.effect.sizes),
            (float(value) for value in sizes.values[index]),
            (float(u) for u in np.sqrt(np.diag(covariance))),
            strict=True,
        )
        values = {name: (value, u) for name, value, u in told}
        same = self._same(index)
        beside = not_separated(self._ranker, self.chosen, index, self._luck.freedom, EVIDENCE_RATIO)
        rivals = self._runners_up(index, ranking, names, odds, same)
        rivals = self._with_siblings(rivals, beside, ranking)
        made = Finding(
            candidate=candidate,
            sizes={name: value for name, (value, _) in values.items()},
            standard_uncertainty={name: u for name, (_, u) in values.items()},
            band={
                name: (value - factor * u, value + factor * u)
                for name, (value, u) in values.items()
            },
            gain=float(ranking.gain[index]),
            p_value=self._luck.corrected(float(ranking.chance[index])),
            probability=float(odds[own]),
            group=tuple(self._found.candidates[other].label for other in same),
            runners_up=rivals,
            covariance=covariance,
        )
        return self._over(made)

    def _over(self, finding: Finding) -> Finding:
        """Return a finding that says whether any further measurement shows which name it has."""
        others = [one for one in self._found.candidates if one.label in finding.ambiguous]
        every = (finding.candidate, *others)
        if not others or not all(one.is_bound for one in every):
            return finding
        setups = {one.setting.get("setup") for one in every}
        same = len(setups) == 1 and None not in setups
        return replace(finding, over=True, equivalent=finding.ambiguous if same else ())

    def _same(self, index: int) -> list[int]:
        """Return which others show the same whatever the readings: of other names, and aliases."""
        own = self._families[index]
        others = [int(i) for i in np.flatnonzero(self._families != own) if i not in self.chosen]
        return alike(self._found, index, others) + aliases(self._found, index)

    def _runners_up(
        self,
        index: int,
        ranking: Ranking,
        names: list[str],
        odds: Vector,
        same: list[int],
    ) -> tuple[RunnerUp, ...]:
        own = self._families[index]
        best = float(odds[names.index(own)])
        made: list[RunnerUp] = []
        for place in np.argsort(-odds):
            name = names[place]
            members = np.flatnonzero(self._families == name)
            member = int(members[np.argmax(ranking.evidence[members])])
            if name == own or not np.isfinite(ranking.evidence[member]):
                continue
            rival = float(odds[place])
            close = rival * EVIDENCE_RATIO > best
            if len(made) >= _RUNNERS_UP and not close:
                break
            made.append(
                RunnerUp(
                    self._found.candidates[member].label,
                    float(ranking.gain[member]),
                    rival,
                    self._why(index, member, ranking, best, rival, member in same),
                    close,
                )
            )
        return tuple(made)

    def _with_siblings(
        self, rivals: tuple[RunnerUp, ...], beside: Sequence[int], ranking: Ranking
    ) -> tuple[RunnerUp, ...]:
        """Return the rivals with those not ruled out that may act together with the named one."""
        made = {one.label: one for one in rivals}
        for other in beside:
            label = self._found.candidates[other].label
            # One that lost by far is not among the best.
            lost = RunnerUp(label, float(ranking.gain[other]), 0.0, "fits worse alone")
            one = made.get(label, lost)
            if not one.ambiguous:
                made[label] = replace(one, ambiguous=True, why=f"{one.why}; {_TOGETHER}")
        return tuple(made.values())

    def _why(
        self, index: int, other: int, ranking: Ranking, best: float, rival: float, same: bool
    ) -> str:
        if same:
            return "shows the same in this run, whatever its readings are"
        less = float(ranking.gain[index] - ranking.gain[other])
        more = int(ranking.columns[other] - ranking.columns[index])
        if abs(less) < _AS_WELL:
            words = "fits as well"
        elif less > 0.0:
            words = f"leaves χ² larger by {less:.3g}"
        else:
            words = f"lowers χ² by {-less:.3g} more"
        if more > 0:
            words += f", with {more} more free value{'s' if more > 1 else ''}"
        if rival * EVIDENCE_RATIO > best:
            return f"{words}: odds 1 to {best / rival:.2g}, too close to rule out"
        odds = f"1 to {best / rival:.2g}" if rival > best * 1e-9 else "below 1 to 1e9"
        return f"{words}: odds {odds}"


def _first_best(values: Vector) -> int:
    """Return the place of the largest value, of equal ones the first; NaN counts as least."""
    values = np.where(np.isnan(values), -np.inf, values)
    return int(np.flatnonzero(values >= np.max(values) - _TIED)[0])
