"""What a gap without a name depends on, and by what formula.

Every family of shapes (``structure``) is weighed by its evidence: its columns get independent
amplitudes of one typical size, and

    ln p(r) = -½ ln|1 + s² S| + ½ s² bᵀ (1 + s² S)⁻¹ b + const,    S = Zᵀ Z,  b = Zᵀ r,

with r the gap and Z the columns, both in units of the noise and beyond all that is free, is
averaged over the size s (compare ``loose``). A family is believed only if the noise of the plan
would hardly give any family such evidence. What it is worth is then written down by few of its fine
shapes, and what these leave is looked at in the same way.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.chance import tail_of
from stepdiag_ros.metrology.discrepancy.findings import Dependence
from stepdiag_ros.metrology.discrepancy.loose import unit_span
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO, FALSE_NAME_LEVEL
from stepdiag_ros.metrology.discrepancy.structure import (
    Family,
    columns_of,
    factors_of,
    families,
    window,
)
from stepdiag_ros.metrology.discrepancy.windows import best_window
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector

MOST_DEPENDENCES = 3
"""A gap that takes more of them is not understood."""
MOST_SHAPES = 6
"""Shapes by which one dependence is written down."""
_SIZES = np.geomspace(0.01e-6, 30e-6, 14)
"""Typical amplitudes over which the evidence is averaged, m of the largest change of a reading."""
_DRAWS = 300
_HIDDEN = 1e-3
"""Share of a column beyond what is free below which nothing but rounding is left of it."""
_NEW = 1e-2
"""Share of a column beyond chosen ones below which it adds nothing new."""
_RANK_LIMIT = 1e-9


@dataclass(frozen=True)
class _Weighed:
    """A family with its evidence, and that which noise gives it in each draw."""

    family: Family
    evidence: float
    luck: Vector

    @property
    def dependence(self) -> tuple[str, tuple[str, ...]]:
        return self.family.acts_on, self.family.drivers


@dataclass(frozen=True)
class _Written:
    """Shapes by which a family is written, and their columns beyond what is free, (rows, k)."""

    shapes: tuple[str, ...]
    columns: Vector
    gain: float
    worth: float


@dataclass(frozen=True)
class Shapes:
    """What a gap depends on, and the shapes by which it is written.

    Attributes:
        dependences: clearest first.
        evidence: of the shapes against none, by Schwarz's criterion.
    """

    dependences: tuple[Dependence, ...]
    evidence: float

    @property
    def gain(self) -> float:
        """Return what χ² loses by the shapes."""
        return sum(one.gain for one in self.dependences)


class Describer:
    """Looks for what a gap depends on.

    Args:
        problem: whitened, the baseline projected out.
        stops: of the run.
        noise_freedom: degrees of freedom of the noise.
        seed: of the draws that show the influence of chance.
    """

    def __init__(self, problem: Whitened, stops: Stops, noise_freedom: float, seed: int) -> None:
        self._problem = problem
        self._stops = stops
        self._factors = factors_of(stops)
        self._families = list(families(stops))
        counts = Counter(len(one.drivers) for one in self._families)
        self._number = {number: float(np.log(count)) for number, count in counts.items()}
        # Size and memory of every draw's noise are estimated as those of the run.
        self._rng = np.random.default_rng(seed)
        self._variance = self._rng.chisquare(noise_freedom, _DRAWS) / noise_freedom
        self._memory = self._rng.standard_normal(_DRAWS) / np.sqrt(noise_freedom)

    def __call__(self, span: Vector) -> Shapes | None:
        """Describe what is beyond orthonormal columns, (rows, k); None if no structure is clear."""
        found: list[Dependence] = []
        written: list[_Written] = []
        beside = span
        while len(found) < MOST_DEPENDENCES and (not found or self._is_more_than_noise(beside)):
            gap = self._problem.gap - beside @ (beside.T @ self._problem.gap)
            dependence, how = self._dependence(gap, beside)
            if dependence is None or how is None:
                break
            found.append(dependence)
            written.append(how)
            beside = np.column_stack([beside, unit_span(how.columns)])
        if not found:
            return None
        return Shapes(tuple(found), sum(one.worth for one in written))

    def _is_more_than_noise(self, span: Vector) -> bool:
        """Say whether what is beyond a span is worth another look."""
        left = self._problem.gap - span @ (span.T @ self._problem.gap)
        freedom = self._problem.freedom - span.shape[1]
        return bool(left @ left > freedom)

    def _dependence(self, gap: Vector, span: Vector) -> tuple[Dependence | None, _Written | None]:
        weighed = [one for one in (self._weigh(each, gap, span) for each in self._families) if one]
        weighed += self._window(gap, span)
        if not weighed:
            return None, None
        weighed.sort(key=lambda one: -one.evidence)
        best = weighed[0]
        p_value = tail_of(np.max([one.luck for one in weighed], axis=0), best.evidence)
        if p_value > FALSE_NAME_LEVEL:
            return None, None
        written = self._write(best.family, gap, span)
        if written is None:
            return None, None
        close = [
            one.dependence
            for one in weighed
            if one.evidence > best.evidence - np.log(EVIDENCE_RATIO)
        ]
        rivals = tuple(one for one in dict.fromkeys(close) if one != best.dependence)
        likelihood = np.exp([one.evidence - best.evidence for one in weighed])
        own = [one.dependence == best.dependence for one in weighed]
        probability = float(np.sum(likelihood[own]) / np.sum(likelihood))
        dependence = Dependence(
            *best.dependence, written.shapes, written.gain, p_value, probability, rivals
        )
        return dependence, written

    def _left(
        self, acts_on: str, shapes: Sequence[str], span: Vector
    ) -> tuple[Vector, NDArray[np.bool_]]:
        """Return columns beyond what is free and a span, those that show, and which these are.

        Each is of such a size that it changes no reading by more than 1 m: whether a shape is per
        hour, per kelvin or a rotation, its typical amplitudes are those of the displacements.
        """
        raw = columns_of(acts_on, shapes, self._stops, self._factors)
        largest = np.max(np.abs(raw), axis=0)
        raw /= np.where(largest > 0.0, largest, 1.0)
        left = self._problem.left_of(raw)
        left -= span @ (span.T @ left)
        before = np.linalg.norm(raw, axis=0) / self._problem.noise
        real = np.linalg.norm(left, axis=0) > _HIDDEN * before
        return left[:, real], real

    def _weigh(self, family: Family, gap: Vector, span: Vector) -> _Weighed | None:
        left, real = self._left(family.acts_on, family.shapes, span)
        if not np.any(real):
            return None
        left /= np.sqrt(left.shape[1])
        values, vectors = np.linalg.eigh(left.T @ left)
        seen = values > _RANK_LIMIT * values[-1]
        values = values[seen]
        units = left @ (vectors[:, seen] / np.sqrt(values))
        slow = np.maximum(1.0 + np.outer(self._memory, self._problem.slowness(units)), 0.0)
        draws = self._rng.standard_normal((_DRAWS, len(values))) ** 2 * slow
        return self._judged(family, values, (units.T @ gap) ** 2, draws, 0.0)

    def _window(self, gap: Vector, span: Vector) -> list[_Weighed]:
        """Weigh the window of time that fits best, as one of all that were tried."""
        if not np.all(np.isfinite(self._stops.time)):
            return []
        best = best_window(self._problem, self._stops, gap, span)
        if best is None:
            return []
        family = window(best.begin, best.end)
        left, real = self._left(family.acts_on, family.shapes, span)
        if not np.any(real):
            return []
        value = np.sum(left**2, axis=0)
        # Of as many windows, as if none shared a stop: chance is overrated rather than underrated.
        chance = -np.expm1(np.log(self._rng.random(_DRAWS)) / best.tried)
        draws = chi2.isf(chance, 1)[:, None]
        return [self._judged(family, value, (left.T @ gap) ** 2 / value, draws, np.log(best.tried))]

    def _judged(
        self, family: Family, values: Vector, squares: Vector, draws: Vector, price: float
    ) -> _Weighed:
        """Return the evidence of a family and of noise.

        Args:
            family: to judge.
            values: squared lengths of its independent columns, shape (k,).
            squares: what χ² loses by each, shape (k,).
            draws: the same for unit noise, shape (draws, k).
            price: evidence that it costs beside the price of the family.
        """
        spread = 1.0 + _SIZES[:, None] ** 2 * values
        share = 0.5 - 0.5 / spread
        cost = 0.5 * np.sum(np.log(spread), axis=1)
        prior = -price - family.price - self._number[len(family.drivers)]
        evidence = _averaged(share @ squares[:, None] - cost[:, None])
        luck = _averaged(share @ (draws / self._variance[:, None]).T - cost[:, None])
        return _Weighed(family, float(evidence[0]) + prior, luck + prior)

    def _write(self, family: Family, gap: Vector, span: Vector) -> _Written | None:
        """Write a family by few of its shapes, one after another; None if none is worth it."""
        shapes = tuple(dict.fromkeys((*family.shapes, *family.fine)))
        left, real = self._left(family.acts_on, shapes, span)
        names = [shape for shape, shows in zip(shapes, real, strict=True) if shows]
        price = 0.5 * float(np.log(len(gap)) + np.log(len(names)))
        chosen: list[int] = []
        while len(chosen) < MOST_SHAPES:
            gains = _gains(left, gap, chosen)
            best = int(np.argmax(gains))
            if 0.5 * gains[best] < price:
                break
            chosen = _exchanged(left, gap, [*chosen, best])
        if not chosen:
            return None
        gain = float(np.sum((unit_span(left[:, chosen]).T @ gap) ** 2))
        worth = 0.5 * gain - price * len(chosen) - float(np.log(len(self._families)))
        return _Written(tuple(names[one] for one in chosen), left[:, chosen], gain, worth)


def _gains(left: Vector, gap: Vector, chosen: Sequence[int]) -> Vector:
    """Return what χ² loses by each column beside chosen ones, shape (k,)."""
    span = unit_span(left[:, list(chosen)])
    lengths = np.sum(left**2, axis=0)
    rest = lengths - np.sum((span.T @ left) ** 2, axis=0)
    new = rest > _NEW**2 * lengths
    parts = left.T @ (gap - span @ (span.T @ gap))
    return np.where(new, parts**2 / np.where(new, rest, 1.0), 0.0)


def _exchanged(left: Vector, gap: Vector, chosen: list[int]) -> list[int]:
    """Return chosen columns, each but the last replaced once by the best beside the others."""
    for place in range(len(chosen) - 1):
        others = [one for number, one in enumerate(chosen) if number != place]
        chosen[place] = int(np.argmax(_gains(left, gap, others)))
    return chosen


def _averaged(evidence: Vector) -> Vector:
    """Return the evidence averaged over the sizes, which are the first axis."""
    largest = np.max(evidence, axis=0)
    mean: Vector = largest + np.log(np.mean(np.exp(evidence - largest), axis=0))
    return mean
