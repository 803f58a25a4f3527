"""Which effects close the gap: one after another, exchanged and refitted together, by evidence.

An effect is looked for only as long as some candidate gains more than chance would give any of them
on a run that lacks nothing. Which one it is, is a question of evidence, not of the gain alone: a
candidate with more sizes, or one of many of its kind, would more often fit by luck (Schwarz 1978;
every effect of the catalogue is as likely as any other, and so is each of its settings).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.discrepancy.candidates import Signatures, alike, gains
from stepdiag_ros.metrology.discrepancy.chance import LookElsewhere, tail
from stepdiag_ros.metrology.discrepancy.findings import Finding, RunnerUp
from stepdiag_ros.metrology.geometry import Vector

FALSE_NAME_LEVEL = 0.002
"""Chance of any name on a run that lacks nothing, by its noise model."""
MOST_NAMES = 4
"""A gap that takes more names than that is not understood."""
EVIDENCE_RATIO = 20.0
"""Odds by which a name must be better than any other to be the only one."""
_BETTER = 0.5
_ROUNDS = 3
_RUNNERS_UP = 6
_MARGIN = 2.0
"""Standard uncertainties by which a size may lie beyond its plausible range."""
_FAR = 3.0
"""Factor beyond its plausible range at which a size costs three times the evidence."""
_IMPLAUSIBLE = float(np.log(20.0))
"""Evidence that a size beyond its plausible range costs."""
_NEAR = 15.0
"""Evidence behind the best beyond which nothing else about a candidate matters."""
_MANY_KINDS = 9
_MOST_ALIKE = 2
"""Effects of many places, such as slips, imitate anything if enough of them are taken."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Ranking:
    """All candidates judged on one gap, given what is named already.

    Attributes:
        gain: the best of each candidate's by evidence, shape (candidates,).
        columns: number that it takes.
        chance: least chance of each candidate, not corrected.
        evidence: logarithm of each candidate's share of the probability, but for a constant.
        cost: evidence that sizes beyond their plausible range have cost it.
    """

    gain: Vector
    columns: Vector
    chance: Vector
    evidence: Vector
    cost: Vector


class Selection:
    """The effects chosen for a gap.

    Args:
        found: the candidates beyond the baseline.
        gap: whitened and projected, shape (rows,).
        luck: what chance does on this plan.
        progress: told what is being done.
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
        self._families = np.array(found.names)
        self._tell = progress or (lambda _: None)
        self.chosen: list[int] = []
        self._select()
        if len(self.chosen) > 1:
            self._try_pairs()

    @property
    def contrived(self) -> str:
        """Say why the choice closes the gap but is no explanation; empty if it may be one."""
        if len(self.chosen) >= MOST_NAMES:
            return f"it takes {len(self.chosen)} effects at once"
        names = [self._found.candidates[index].effect.name for index in self.chosen]
        for name in dict.fromkeys(names):
            kinds = {
                kind
                for kind, one in zip(self._found.names, self._found.candidates, strict=True)
                if one.effect.name == name
            }
            if names.count(name) > _MOST_ALIKE and len(kinds) > _MANY_KINDS:
                return f"it takes {names.count(name)} times a {name}"
        return ""

    def span(self, chosen: list[int] | None = None) -> Vector:
        """Return orthonormal columns of chosen candidates (all if None), shape (rows, k)."""
        chosen = self.chosen if chosen is None else chosen
        if not chosen:
            return np.zeros((len(self._gap), 0))
        parts = [self._found.units[:, self._found.of(i)] for i in chosen]
        return _orthonormal([*parts, *self._unknown(chosen)])

    def _unknown(self, chosen: list[int]) -> list[Vector]:
        """Return what the run does not tell of chosen candidates, in columns of unit length."""
        parts = []
        for index in chosen:
            columns = self._found.unknown.get(index)
            if columns is not None:
                lengths = np.linalg.norm(columns, axis=0)
                parts.append(columns[:, lengths > 1e-6] / lengths[lengths > 1e-6])
        return parts

    def left(self) -> Vector:
        """Return the gap beyond the chosen candidates, whitened, shape (rows,)."""
        span = self.span()
        left: Vector = self._gap - span @ (span.T @ self._gap)
        return left

    def _try_pairs(self) -> None:
        """Take the best pair for a start if that leads to more evidence than one after another.

        Two effects may hide each other: the first that is chosen for their sum may be neither.
        """
        first = self.ranking([])
        members = [
            int(here[np.argmax(first.gain[here])])
            for here in (np.flatnonzero(self._families == name) for name in set(self._families))
        ]
        members.sort()
        few = Selection.__new__(Selection)
        few._found, few._gap, few._luck = self._found.subset(members), self._gap, self._luck
        best, pair = -np.inf, (0, 0)
        for one in range(len(members)):
            if not np.isfinite(first.evidence[members[one]]):
                continue
            second = few.ranking([one])
            other = int(np.argmax(second.evidence))
            total = float(first.evidence[members[one]] + second.evidence[other])
            if total > best:
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
            sum(self.ranking(chosen[:n]).evidence[index] for n, index in enumerate(chosen))
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
        ranking = self.ranking(given)
        allowed = np.isfinite(ranking.evidence)
        if not np.any(allowed):
            return None
        # Luck is looked for where the sizes are plausible; elsewhere it has to be ruled out better.
        chance = ranking.chance * np.exp(np.where(allowed, ranking.cost, 0.0))
        if self._luck.corrected(float(np.min(chance[allowed]))) > FALSE_NAME_LEVEL:
            return None
        names, odds = self._odds(ranking)
        family = names[int(np.argmax(odds))]
        members = np.flatnonzero(self._families == family)
        return int(members[np.argmax(ranking.evidence[members])])

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
                ranking = self.ranking(rest)
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

    def ranking(self, given: list[int]) -> Ranking:
        """Judge all candidates beside given ones."""
        span = self.span(given)
        found = self._found.beyond(span) if given else self._found
        gap = self._gap - span @ (span.T @ self._gap)
        gain, number = gains(found, gap)
        # Schwarz's penalty for each size, and equal shares for a candidate's first 1, 2 … sizes.
        score = (
            0.5 * gain
            - 0.5 * number * np.log(len(gap))
            + np.log(found.share)[:, None]
            - np.log(found.count)[:, None]
        )
        score[~np.isfinite(score)] = -np.inf
        chance = np.ones_like(gain)
        real = np.isfinite(gain)
        chance[real] = tail(gain[real], number[real], self._luck.freedom)
        which = np.argmax(score, axis=1)
        rows = np.arange(len(score))
        top = np.max(score, axis=1, initial=-np.inf)
        safe = np.where(np.isfinite(top), top, 0.0)
        evidence = safe + np.log(np.maximum(np.sum(np.exp(score - safe[:, None]), axis=1), 1e-300))
        cost = self._implausibility(found, gap, top)
        evidence -= cost
        evidence[~np.isfinite(top)] = -np.inf
        evidence[given] = -np.inf
        return Ranking(
            gain[rows, which],
            number[rows, which],
            np.min(chance, axis=1, initial=1.0),
            evidence,
            cost,
        )

    def _implausibility(self, found: Signatures, gap: Vector, top: Vector) -> Vector:
        """Return what sizes beyond their plausible range cost, shape (candidates,)."""
        cost = np.zeros(len(found.candidates))
        best = -np.inf
        for index in np.argsort(-top):
            # Only who comes near the best plausible one can be chosen.
            if top[index] < best - _NEAR or not np.isfinite(top[index]):
                break
            place = found.of(int(index))
            real = np.flatnonzero(np.any(found.units[:, place] != 0.0, axis=0))
            values, spread = _solved(found.columns[:, place][:, real], gap)
            for number, value, u in zip(real, values, spread, strict=True):
                size = found.candidates[index].effect.sizes[number]
                beyond = max(value - size.high, size.low - value) - _MARGIN * u
                if beyond > (_FAR - 1.0) * max(abs(size.low), abs(size.high)):
                    cost[index] += 3.0 * _IMPLAUSIBLE
                elif beyond > 0.0:
                    cost[index] += _IMPLAUSIBLE
            best = max(best, float(top[index] - cost[index]))
        return cost

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
        sizes = self._sizes()
        made = [self._finding(index, sizes[index]) for index in self.chosen]
        return tuple(sorted(made, key=lambda finding: -finding.gain))

    def _sizes(self) -> dict[int, tuple[dict[str, float], dict[str, float]]]:
        """Return sizes and their standard uncertainties of each chosen one."""
        places: list[tuple[int, int]] = []
        for index in self.chosen:
            units = self._found.units[:, self._found.of(index)]
            places += [(index, int(n)) for n in np.flatnonzero(np.any(units != 0.0, axis=0))]
        if not places:
            return {}
        columns = np.column_stack(
            [self._found.columns[:, self._found.first[i] + n] for i, n in places]
        )
        unknown = self._unknown(self.chosen)
        if unknown:
            span = _orthonormal(unknown)
            columns = columns - span @ (span.T @ columns)
        values, spread = _solved(columns, self._gap)
        sizes: dict[int, tuple[dict[str, float], dict[str, float]]] = {}
        for index in self.chosen:
            names = [size.name for size in self._found.candidates[index].effect.sizes]
            # A size that the run does not tell stays zero, its uncertainty unknown.
            sizes[index] = (dict.fromkeys(names, 0.0), dict.fromkeys(names, float("nan")))
        for (index, number), value, u in zip(places, values, spread, strict=True):
            name = self._found.candidates[index].effect.sizes[number].name
            sizes[index][0][name], sizes[index][1][name] = float(value), float(u)
        return sizes

    def _finding(self, index: int, sizes: tuple[dict[str, float], dict[str, float]]) -> Finding:
        from scipy.special import stdtrit

        factor = float(stdtrit(self._luck.freedom, 0.975))
        rest = [other for other in self.chosen if other != index]
        ranking = self.ranking(rest)
        names, odds = self._odds(ranking)
        own = names.index(self._families[index])
        values, uncertainty = sizes
        uncertainty = self._with_setting(index, rest, ranking, uncertainty)
        same = self._same(index)
        return Finding(
            candidate=self._found.candidates[index],
            sizes=values,
            standard_uncertainty=uncertainty,
            band={
                name: (value - factor * uncertainty[name], value + factor * uncertainty[name])
                for name, value in values.items()
            },
            gain=float(ranking.gain[index]),
            p_value=self._luck.corrected(float(ranking.chance[index])),
            probability=float(odds[own]),
            group=tuple(self._found.candidates[other].label for other in same),
            runners_up=self._runners_up(index, ranking, names, odds, same),
        )

    def _with_setting(
        self,
        index: int,
        rest: list[int],
        ranking: Ranking,
        uncertainty: Mapping[str, float],
    ) -> dict[str, float]:
        """Add to the uncertainties that the numbers of the setting may be others."""
        own = self._found.candidates[index].effect
        near = [
            int(other)
            for other in np.flatnonzero(self._families == self._families[index])
            if self._found.candidates[int(other)].effect is own
            and ranking.evidence[other] > ranking.evidence[index] - _NEAR
        ]
        if len(near) < 2:
            return dict(uncertainty)
        span = self.span(rest)
        gap = self._gap - span @ (span.T @ self._gap)
        weights = np.exp(ranking.evidence[near] - np.max(ranking.evidence[near]))
        weights = weights / np.sum(weights)
        names = [size.name for size in own.sizes]
        variance = np.zeros(len(names))
        solved = {}
        for other in {index, *near}:
            columns = self._found.columns[:, self._found.of(other)]
            solved[other], _ = _solved(columns - span @ (span.T @ columns), gap)
        for other, weight in zip(near, weights, strict=True):
            variance += weight * (solved[other] - solved[index]) ** 2
        return {
            name: float(np.sqrt(uncertainty[name] ** 2 + extra))
            for name, extra in zip(names, variance, strict=True)
        }

    def _same(self, index: int) -> list[int]:
        """Return the best settings of other names that show the same whatever the readings."""
        own = self._families[index]
        others = [int(i) for i in np.flatnonzero(self._families != own) if i not in self.chosen]
        return alike(self._found, index, others)

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

    def _why(
        self, index: int, other: int, ranking: Ranking, best: float, rival: float, same: bool
    ) -> str:
        if same:
            return "shows the same in this run, whatever its readings are"
        less = float(ranking.gain[index] - ranking.gain[other])
        more = int(ranking.columns[other] - ranking.columns[index])
        words = (
            f"leaves χ² larger by {less:.3g}" if less > 0.0 else f"lowers χ² by {-less:.3g} more"
        )
        if more > 0:
            words += f", with {more} more free value{'s' if more > 1 else ''}"
        if rival * EVIDENCE_RATIO > best:
            return f"{words}: odds 1 to {best / rival:.2g}, too close to rule out"
        odds = f"1 to {best / rival:.2g}" if rival > best * 1e-9 else "none to speak of"
        return f"{words}: odds {odds}"


def _solved(columns: Vector, gap: Vector) -> tuple[Vector, Vector]:
    """Return the sizes by which columns fit a gap with unit noise, and their uncertainties."""
    lengths = np.linalg.norm(columns, axis=0)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    inverse = np.linalg.pinv((columns / scale).T @ (columns / scale))
    values: Vector = inverse @ ((columns / scale).T @ gap) / scale
    return values, np.sqrt(np.diag(inverse)) / scale


def _orthonormal(parts: list[Vector]) -> Vector:
    """Return orthonormal columns that span what some columns of unit length do, shape (rows, k)."""
    left, values, _ = np.linalg.svd(np.column_stack(parts), full_matrices=False)
    span: Vector = left[:, values > 1e-4]
    return span
