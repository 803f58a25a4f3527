"""What a gap without a name depends on, and by what formula.

Every family of shapes (``structure``) is weighed by its evidence: its columns get independent
amplitudes of one typical size, and

    ln p(r) = -½ ln|1 + s² S| + ½ s² bᵀ (1 + s² S)⁻¹ b + const,    S = Zᵀ Z,  b = Zᵀ r,

with r the gap and Z the columns, both in units of the noise and beyond all that is free, is
averaged over the size s (compare ``loose``). A family is believed only if the noise of the plan
would hardly give any family such evidence. What it is worth is then written down by few of its fine
shapes, and what these leave is looked at in the same way.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri

from stepdiag_ros.metrology.discrepancy.baseline import AT_ONCE, Whitened
from stepdiag_ros.metrology.discrepancy.chance import tail_of
from stepdiag_ros.metrology.discrepancy.findings import Dependence
from stepdiag_ros.metrology.discrepancy.loose import span_beyond, unit_span
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO, FALSE_NAME_LEVEL
from stepdiag_ros.metrology.discrepancy.structure import (
    Family,
    columns_of,
    factors_of,
    families,
    window,
)
from stepdiag_ros.metrology.discrepancy.windows import best_window
from stepdiag_ros.metrology.effects.learned_shape import factors, is_of_place, over_box
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, Vector

MOST_DEPENDENCES = 3
"""A gap that takes more of them, or of them and named effects, is not understood."""
MOST_SHAPES = 6
"""Shapes by which one dependence is written down."""
_SIZES = np.geomspace(0.01e-6, 30e-6, 14)
"""Typical amplitudes over which the evidence is averaged, m of the largest change of a reading."""
_DRAWS = 300
_WORTH_A_LOOK = 0.2
"""Probability of what a dependence leaves above which it is noise."""
_LEAST_EVIDENCE = 0.0
"""A dependence as likely as no dependence is not looked at closely."""
_HIDDEN = 1e-3
"""Share of a column beyond what is free below which nothing but rounding is left of it."""
_NEW = 1e-2
"""Share of a column beyond chosen ones below which it adds nothing new."""
_FARTHEST = 16.0
"""How much larger a shape of several places may be over the box than what the readings show of it,
beyond what is free in both. The readings say next to nothing of the size of one that acts mostly
where no stop was, and a compensation by it makes the machine worse there."""
_RANK_LIMIT = 1e-6
"""Share of the largest squared length below which rounding decides: what is hidden is taken off."""

_Senses = tuple[int, ...]
"""Axes of whose last move the sense counts."""


@dataclass(frozen=True)
class _Weighed:
    """A family with its evidence; of windows, the best of some that were tried."""

    family: Family
    evidence: float
    tried: int = 1

    @property
    def dependence(self) -> tuple[str, tuple[str, ...]]:
        return self.family.acts_on, self.family.drivers


@dataclass(frozen=True)
class _Written:
    """Shapes by which a family is written, their columns beyond what is free, (rows, k), and that.

    Attributes:
        beside: what is free with the family, orthonormal.
    """

    shapes: tuple[str, ...]
    beside: Vector
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
        self._senseless = [
            span_beyond(problem, stops.before_first_move(axis)) for axis in range(len(AXES))
        ]
        self._freedom = noise_freedom
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
            beside = np.column_stack([how.beside, unit_span(how.columns)])
        if not found:
            return None
        return Shapes(tuple(found), sum(one.worth for one in written))

    def written(
        self, span: Vector, wanted: Iterable[tuple[str, tuple[str, ...]]]
    ) -> list[tuple[tuple[str, ...], float]]:
        """Write the gap by each of some dependences alone, as a rival of the others.

        Args:
            span: what acts beside each, orthonormal columns, (rows, k).
            wanted: ``acts_on`` and ``drivers`` of each.

        Returns:
            of each the shapes, empty if none is worth it, and its evidence.
        """
        gap = self._problem.gap - span @ (span.T @ self._problem.gap)
        besides = self._besides(span)
        weighed = [*self._weigh_all(gap, besides), *self._window(gap, span)]
        made: list[tuple[tuple[str, ...], float]] = []
        for dependence in wanted:
            own = [one for one in weighed if one.dependence == dependence]
            best = max(own, key=lambda one: one.evidence, default=None)
            how = None if best is None else self._write(best, gap, besides[best.family.senses])
            evidence = -np.inf if best is None else best.evidence
            made.append(((), evidence) if how is None else (how.shapes, evidence))
        return made

    def _is_more_than_noise(self, span: Vector) -> bool:
        """Say whether what is beyond a span is worth another look."""
        left = self._problem.gap - span @ (span.T @ self._problem.gap)
        freedom = self._problem.freedom - span.shape[1]
        return bool(chdtrc(freedom, left @ left) < _WORTH_A_LOOK)

    def _dependence(self, gap: Vector, span: Vector) -> tuple[Dependence | None, _Written | None]:
        besides = self._besides(span)
        weighed = [*self._weigh_all(gap, besides), *self._window(gap, span)]
        if not weighed:
            return None, None
        weighed.sort(key=lambda one: -one.evidence)
        best = weighed[0]
        if best.evidence < _LEAST_EVIDENCE:
            return None, None
        p_value = self._chance(weighed, best.evidence, besides)
        if p_value > FALSE_NAME_LEVEL:
            return None, None
        written = self._write(best, gap, besides[best.family.senses])
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

    def _chance(
        self,
        weighed: Sequence[_Weighed],
        evidence: float,
        besides: Mapping[_Senses, Vector],
    ) -> float:
        """Return the probability that noise gives any family such evidence.

        A ratio of likelihoods has the mean 1 under noise, and so has the sum over all families with
        what they cost: noise exceeds e^E in no more than one run in e^E (Markov's inequality), or
        in one in (1 + 2E/ν)^(ν/2) where ν degrees of freedom determine its size. Where half of the
        evidence would do by this bound, it is the answer; else noise is drawn.
        """
        freedom = self._freedom
        bound, half = (
            (1.0 + 2.0 * e / freedom) ** (-0.5 * freedom) for e in (evidence, evidence / 2)
        )
        if half < FALSE_NAME_LEVEL:
            return float(bound)
        luck = np.full(_DRAWS, -np.inf)
        for one in weighed:
            luck = np.maximum(luck, self._luck(one, besides[one.family.senses]))
        return tail_of(luck, evidence)

    def _besides(self, span: Vector) -> Mapping[_Senses, Vector]:
        """Return what is free beside a span with families of each set of senses, orthonormal.

        Before an axis's first move in a setup, what depends on its sense may do anything.
        """
        made = {}
        for senses in {one.senses for one in self._families} | {()}:
            free = np.column_stack([span, *(self._senseless[axis] for axis in senses)])
            made[senses] = unit_span(free)
        return made

    def _columns(self, acts_on: str, shapes: Sequence[str]) -> Vector:
        """Return what shapes add to the readings, (n, k)."""
        return columns_of(acts_on, shapes, self._stops, self._factors)

    def _left(self, columns: Vector, span: Vector) -> tuple[Vector, NDArray[np.bool_]]:
        """Return columns beyond what is free and a span, those that show, and which these are.

        Each has such a size that it changes no reading by more than 1 m: whether a shape is per
        hour, per kelvin or a rotation, its typical amplitudes are then those of the displacements.
        """
        raw = _of_size_one(columns)
        left = self._problem.left_of(raw)
        left -= span @ (span.T @ left)
        before = np.linalg.norm(raw, axis=0) / self._problem.noise
        real = np.linalg.norm(left, axis=0) > _HIDDEN * before
        return left[:, real], real

    def _weigh_all(self, gap: Vector, besides: Mapping[_Senses, Vector]) -> list[_Weighed]:
        """Weigh all families that show in the readings, in their order."""
        alike = defaultdict(list)
        for number, one in enumerate(self._families):
            alike[one.senses, len(one.shapes)].append(number)
        found: dict[int, _Weighed] = {}
        for (senses, shapes), numbers in alike.items():
            most = max(AT_ONCE // shapes, 1)
            for start in range(0, len(numbers), most):
                some = numbers[start : start + most]
                here = [self._families[one] for one in some]
                found |= zip(some, self._weigh(here, gap, besides[senses]), strict=True)
        return [found[number] for number in sorted(found) if found[number].evidence > -np.inf]

    def _weigh(
        self, families: Sequence[Family], gap: Vector, span: Vector, tried: int = 1
    ) -> list[_Weighed]:
        """Weigh families that have as many shapes, by the products of their columns alone.

        The evidence of one that does not show in the readings is minus infinity.
        """
        gap = gap - span @ (span.T @ gap)
        some = [columns_of(one.acts_on, one.shapes, self._stops, self._factors) for one in families]
        columns = self._problem.of(_of_size_one(np.hstack(some))[self._problem.baseline.good])
        free = np.vstack([self._problem.span.T @ columns, span.T @ columns])
        # Families × columns of each × columns of each.
        each = (len(families), -1)
        product = _products_of(columns, *each)
        left = product - _products_of(free, *each)
        real = np.einsum("fkk->fk", left) > _HIDDEN**2 * np.einsum("fkk->fk", product)
        count = np.maximum(np.count_nonzero(real, axis=1), 1)
        left *= (real[:, :, None] & real[:, None, :]) / count[:, None, None]
        values, vectors = np.linalg.eigh(left)
        seen = values > _RANK_LIMIT * values[:, -1:]
        along = np.where(real, (columns.T @ gap).reshape(each), 0.0) / np.sqrt(count)[:, None]
        parts = np.einsum("fki,fk->fi", vectors, along)
        squares = np.where(seen, parts**2 / np.where(seen, values, 1.0), 0.0)
        evidence = _averaged(np.where(seen, values, 0.0), squares)
        evidence[~np.any(real, axis=1)] = -np.inf
        return [
            _Weighed(one, float(of_it) - self._price(one, tried), tried)
            for one, of_it in zip(families, evidence, strict=True)
        ]

    def _window(self, gap: Vector, span: Vector) -> list[_Weighed]:
        """Weigh the window of time that fits best, as one of all that were tried."""
        if not np.all(np.isfinite(self._stops.time)):
            return []
        best = best_window(self._problem, self._stops, gap, span)
        if best is None:
            return []
        weighed = self._weigh([window(best.begin, best.end)], gap, span, best.tried)
        return [one for one in weighed if one.evidence > -np.inf]

    def _luck(self, weighed: _Weighed, span: Vector) -> Vector:
        """Return the evidence that noise gives a family in each draw, shape (draws,)."""
        family = weighed.family
        left, real = self._left(self._columns(family.acts_on, family.shapes), span)
        if not np.any(real):
            return np.full(_DRAWS, -np.inf)
        left /= np.sqrt(left.shape[1])
        values, vectors = _axes(left.T @ left)
        units = left @ (vectors / np.sqrt(values))
        slow = np.maximum(1.0 + np.outer(self._problem.slowness(units), self._memory), 0.0)
        if weighed.tried > 1:
            # As if no two windows shared a stop: chance is overrated rather than underrated.
            chance = -np.expm1(np.log(self._rng.random((1, _DRAWS))) / weighed.tried)
            draws = chdtri(1, chance)
        else:
            draws = self._rng.standard_normal((len(values), _DRAWS)) ** 2
        evidence = _averaged(values, (draws * slow / self._variance).T)
        return evidence - self._price(family, weighed.tried)

    def _price(self, family: Family, tried: int) -> float:
        """Return the evidence that a family costs as one of those with as many quantities."""
        return family.price + self._number[len(family.drivers)] + float(np.log(tried))

    def _are_near(self, shapes: Sequence[str], columns: Vector, left: Vector) -> NDArray[np.bool_]:
        """Say which shapes act where the run went, and not mostly elsewhere in the box, (k,).

        Args:
            shapes: products of factors.
            columns: what they add to the readings, (n, k).
            left: the same of size one, beyond what is free, (rows, k).
        """
        largest = np.max(np.abs(columns), axis=0)
        seen = np.linalg.norm(left, axis=0) * largest * self._problem.noise / np.sqrt(len(left))
        in_box = [over_box(shape) * self._size_of_others(shape) for shape in shapes]
        near: NDArray[np.bool_] = np.asarray(in_box) <= _FARTHEST * seen
        return near

    def _size_of_others(self, shape: str) -> float:
        """Return the rms at the stops of the factors of a shape that are not of places."""
        others = [self._factors[one] for one in factors(shape) if not is_of_place(one)]
        return float(np.sqrt(np.mean(np.prod(others, axis=0) ** 2))) if others else 1.0

    def _write(self, weighed: _Weighed, gap: Vector, span: Vector) -> _Written | None:
        """Write a family by few of its shapes, one after another; None if none is worth it."""
        family = weighed.family
        gap = gap - span @ (span.T @ gap)
        shapes = tuple(dict.fromkeys((*family.shapes, *family.fine)))
        columns = self._columns(family.acts_on, shapes)
        left, real = self._left(columns, span)
        names = [shape for shape, shows in zip(shapes, real, strict=True) if shows]
        near = self._are_near(names, columns[:, real], left)
        names, left = [names[one] for one in np.flatnonzero(near)], left[:, near]
        if not names:
            return None
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
        worth = 0.5 * gain - price * len(chosen) - self._price(family, weighed.tried)
        return _Written(tuple(names[one] for one in chosen), span, left[:, chosen], gain, worth)


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


def _averaged(values: Vector, squares: Vector) -> Vector:
    """Return evidence, averaged over the size of the amplitudes, shape (cases,).

    Args:
        values: squared lengths of independent columns, of all cases or of each, shape (k,) or
            (cases, k).
        squares: what χ² loses by each column in each case, shape (cases, k).
    """
    spread = 1.0 + np.multiply.outer(_SIZES**2, np.atleast_2d(values))
    gain = np.einsum(
        "sck,ck->sc", np.broadcast_to(0.5 - 0.5 / spread, (len(_SIZES), *squares.shape)), squares
    )
    evidence = gain - 0.5 * np.sum(np.log(spread), axis=-1)
    largest = np.max(evidence, axis=0)
    mean: Vector = largest + np.log(np.mean(np.exp(evidence - largest), axis=0))
    return mean


def _of_size_one(raw: Vector) -> Vector:
    """Return columns, each divided by its largest magnitude if it is not zero."""
    largest = np.max(np.abs(raw), axis=0)
    made: Vector = raw / np.where(largest > 0.0, largest, 1.0)
    return made


def _products_of(columns: Vector, families: int, each: int) -> Vector:
    """Return the products of the columns of each family, shape (families, each, each)."""
    cube = columns.reshape(len(columns), families, each).transpose(1, 0, 2)
    made: Vector = cube.transpose(0, 2, 1) @ cube
    return made


def _axes(gram: Vector) -> tuple[Vector, Vector]:
    """Return squared lengths of independent columns, and their directions, from products."""
    values, vectors = np.linalg.eigh(gram)
    seen = values > _RANK_LIMIT * values[-1]
    return values[seen], vectors[:, seen]
