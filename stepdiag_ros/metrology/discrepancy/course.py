"""What becomes of an effect from run to run: is it in all of them, does it grow, come and go?

Each run i shows the sizes b of an effect with an information matrix N (the inverse of their
covariance, 0 where it shows nothing). Three models of the sizes are fitted to all runs by weighted
least squares:

- one size in all runs,
- a size that changes in proportion to the date,
- one size in some of the runs and nothing in the others.

What a model leaves, Σ (bᵢ - b̂ᵢ)ᵀ Nᵢ (bᵢ - b̂ᵢ), is compared with chance (F test; Cochran 1954,
Biometrics 10, 101, for one size in all runs). Every run has its own noise; the degrees of freedom
are those of the run that has the fewest, which makes chance larger than it is. A change is stated
only if one size in all runs is refuted; what kind of change, only if the other kind is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stepdiag_ros.metrology.discrepancy.chance import coverage_factor, tail
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO
from stepdiag_ros.metrology.geometry import Vector

IN_ALL = "in all runs"
"""One size explains all runs."""
GROWS = "grows"
"""One size is refuted, and a change in proportion to the date is not."""
COMES_AND_GOES = "comes and goes"
"""Some runs have it and others, which would show it, do not."""
CHANGES = "changes"
"""One size is refuted, but the runs do not show what kind of change it is."""
UNDETERMINED = "undetermined"
"""The runs show neither that it stays nor that it changes."""

CHANGE_LEVEL = 0.04
"""Chance that any effect of a machine without change is called a change, all effects together."""
NEARLY = 0.05
"""Probability below which one size in all runs is not confirmed, even if it is not refuted."""
_KIND_LEVEL = 0.01
"""Probability below which a kind of change is refuted."""
_RUN_LEVEL = 0.05
"""Chance that any run without the effect seems to have it, all runs together."""
_MISSED = 0.05
"""Chance that a run that has the effect does not show it, up to which it could show it."""
_FEWEST = 2
"""Runs that must be able to show an effect before a statement on all runs."""
_RANK = 1e-9
_HARDLY = 1e-6


@dataclass(frozen=True)
class SizesInRun:
    """What one run shows of an effect.

    Attributes:
        information: inverse of the covariance of the sizes, shape (k, k); 0 where it shows nothing.
        score: information times sizes, shape (k,).
        freedom: degrees of freedom of the run's noise.
    """

    information: Vector
    score: Vector
    freedom: float

    @property
    def covariance(self) -> Vector:
        """Return the covariance of the sizes that the run shows, shape (k, k)."""
        return _inverse(self.information)

    @property
    def sizes(self) -> Vector:
        """Return the sizes, shape (k,); 0 where the run shows nothing."""
        made: Vector = self.covariance @ self.score
        return made

    @property
    def shown(self) -> int:
        """Return how many independent sizes the run shows."""
        return _rank(self.information)

    @property
    def gain(self) -> float:
        """Return what χ² of this run loses by the effect."""
        return float(self.score @ self.sizes)

    @property
    def p_value(self) -> float:
        """Return the probability of such a gain where the effect does not act."""
        return chance_of(self.gain, self.shown, self.freedom)


@dataclass(frozen=True)
class Figure:
    """One number with its uncertainty, in the unit of the effect's figure (per month: a rate).

    Attributes:
        value: NaN where it is not known, as the following.
        standard_uncertainty: k = 1.
        band: lower and upper end of the 95 % coverage interval.
    """

    value: float = float("nan")
    standard_uncertainty: float = float("nan")
    band: tuple[float, float] = (float("nan"), float("nan"))


@dataclass(frozen=True)
class Course:
    """What becomes of an effect from run to run.

    Attributes:
        kind: IN_ALL, GROWS, COMES_AND_GOES, CHANGES or UNDETERMINED.
        sizes: figure of each run; unknown where the run does not show it.
        explained: figure of each run by what is not refuted; NaN where nothing explains it.
        common: figure that all runs, or those that have the effect, have in common; unknown where
            one size does not explain them.
        rate: change per month by a straight line; unknown with less than three runs.
        having: indices of runs in which the effect is more than chance, or where it comes and goes
            those that have it.
        lacking: runs that do not have it and would show it.
        blind: runs that could not show it.
        p_common: probability of such differences if all runs have one size.
        p_line: probability of what a straight line leaves; NaN where it leaves nothing.
        p_some: probability of what one size in some runs leaves; NaN as well.
    """

    kind: str
    sizes: tuple[Figure, ...]
    explained: tuple[float, ...]
    common: Figure
    rate: Figure
    having: tuple[int, ...]
    lacking: tuple[int, ...]
    blind: tuple[int, ...]
    p_common: float
    p_line: float
    p_some: float


@dataclass(frozen=True)
class _Fit:
    """A model of the sizes, fitted to all runs.

    Attributes:
        values: its free values, k for each of its columns.
        information: inverse of their covariance.
        left: χ² of what it leaves.
        freedom: number of independent sizes less number of free values.
    """

    values: Vector
    information: Vector
    left: float
    freedom: int


def course_of(
    runs: Sequence[SizesInRun],
    months: Vector,
    functional: Vector,
    level: float = CHANGE_LEVEL,
    renewed: bool = False,
) -> Course:
    """Return what becomes of an effect from run to run.

    Args:
        runs: what each shows, at least two.
        months: date of each run, in months, shape (runs,).
        functional: the figure that is shown is this times the sizes, shape (k,).
        level: probability below which one size in all runs is refuted.
        renewed: the effect belongs to an alignment or a pass, which is another in each run; it does
            not grow from run to run.
    """
    return _Judge(runs, months, functional, level, renewed).course()


class _Judge:
    def __init__(
        self,
        runs: Sequence[SizesInRun],
        months: Vector,
        functional: Vector,
        level: float,
        renewed: bool,
    ) -> None:
        self._runs = runs
        self._months = months
        self._functional = functional
        self._level = level
        self._renewed = renewed
        self._informations = np.stack([one.information for one in runs])
        self._scores = np.stack([one.score for one in runs])
        self._shown = [one.shown for one in runs]
        told = [one for one, shown in zip(runs, self._shown, strict=True) if shown]
        self._freedom = min((one.freedom for one in told), default=np.inf)
        self._factor = coverage_factor(self._freedom) if told else np.nan
        self._total = sum(one.gain for one in told)
        self._count = sum(self._shown)
        every = np.ones((len(runs), 1))
        self._common = self._fitted(every)
        self._line = self._fitted(np.column_stack([every[:, 0], months - np.mean(months)]))
        self._some_runs, self._some = self._best_some()

    def _fitted(self, design: Vector) -> _Fit:
        """Fit sizes that are a sum of columns of the design, shape (runs, m), times free values."""
        free = design.shape[1] * len(self._functional)
        information = np.einsum("ra,rb,rij->aibj", design, design, self._informations)
        information = information.reshape(free, free)
        score = np.einsum("ra,ri->ai", design, self._scores).reshape(free)
        values = _inverse(information) @ score
        left = max(self._total - float(score @ values), 0.0)
        return _Fit(values, information, left, self._count - _rank(information))

    def _best_some(self) -> tuple[tuple[int, ...], _Fit]:
        """Return which runs have the effect, if they have it in one size and others not at all."""
        best = tuple(range(len(self._runs))), self._common
        for start, run in enumerate(self._runs):
            if not self._shown[start]:
                continue
            having, size = np.arange(len(self._runs)) == start, run.sizes
            for _ in range(len(self._runs)):
                squares = np.einsum("i,rij,j->r", size, self._informations, size)
                again = 2.0 * self._scores @ size > squares
                fit = self._fitted(again[:, None].astype(np.float64))
                size = fit.values
                if np.array_equal(again, having):
                    break
                having = again
            if np.any(having) and fit.left < best[1].left:
                best = tuple(np.flatnonzero(having).tolist()), fit
        return best

    def _chance(self, fit: _Fit) -> float:
        """Return the probability of what a model leaves; NaN where it must leave nothing."""
        if fit.freedom <= 0:
            return float("nan")
        return chance_of(fit.left, fit.freedom, self._freedom)

    def _has(self, index: int) -> bool:
        return self._runs[index].p_value < _RUN_LEVEL / len(self._runs)

    def _could_show(self, index: int, size: Vector) -> bool:
        """Say whether a run with sizes like these would show them."""
        shown = self._shown[index]
        if not shown:
            return False
        return float(size @ self._informations[index] @ size) >= _needed(shown, len(self._runs))

    def course(self) -> Course:
        """Judge; see ``course_of``."""
        having = tuple(index for index in range(len(self._runs)) if self._has(index))
        chances = [self._chance(fit) for fit in (self._common, self._line, self._some)]
        kind = self._kind(having, chances)
        if kind == COMES_AND_GOES and self._kept(self._some):
            having = self._some_runs
        known = self._fitted(self._marked(having)) if having else self._common
        size = known.values
        lacking = tuple(
            index
            for index in range(len(self._runs))
            if index not in having and self._could_show(index, size)
        )
        told = {*having, *lacking}
        one_size = kind in (IN_ALL, UNDETERMINED) or (kind == COMES_AND_GOES and self._kept(known))
        common = self._common if kind == IN_ALL else known
        figure = self._functional
        return Course(
            kind,
            tuple(self._figure(one.sizes, one.information, figure) for one in self._runs),
            self._explained(kind, common.values if one_size else None, having),
            self._figure(common.values, common.information, figure) if one_size else Figure(),
            self._rate(),
            having,
            () if kind == IN_ALL else lacking,
            tuple(
                i for i in range(len(self._runs)) if i not in told and not self._could_show(i, size)
            ),
            *chances,
        )

    def _explained(
        self, kind: str, size: Vector | None, having: Sequence[int]
    ) -> tuple[float, ...]:
        """Return the figure of each run by the model that is kept."""
        count, w = len(self._runs), self._functional
        if kind == GROWS:
            start, slope = np.split(self._line.values, 2)
            away = self._months - np.mean(self._months)
            return tuple(float(w @ start + w @ slope * month) for month in away)
        if kind == IN_ALL and size is not None:
            return (float(w @ size),) * count
        if kind == COMES_AND_GOES and size is not None:
            return tuple(float(w @ size) if index in having else 0.0 for index in range(count))
        return (float("nan"),) * count

    def _marked(self, chosen: Sequence[int]) -> Vector:
        return np.array([[float(index in chosen)] for index in range(len(self._runs))])

    def _kept(self, fit: _Fit) -> bool:
        """Say whether a model of the change is not refuted."""
        chance = self._chance(fit)
        return np.isnan(chance) or chance >= _KIND_LEVEL

    def _kind(self, having: tuple[int, ...], chances: Sequence[float]) -> str:
        size = self._common.values
        able = [i for i in range(len(self._runs)) if self._could_show(i, size) or i in having]
        shown = [i for i, count in enumerate(self._shown) if count]
        if len(shown) < _FEWEST or not chances[0] < NEARLY:
            return IN_ALL if len(able) >= _FEWEST else UNDETERMINED
        if chances[0] >= self._level:
            return UNDETERMINED
        if self._renewed:
            return COMES_AND_GOES if self._absent(having) else CHANGES
        line = self._line.freedom > 0 and self._kept(self._line)
        some = len(shown) > _FEWEST and self._kept(self._some) and self._absent(self._some_runs)
        if line and some:
            ahead = self._evidence_of_line() - self._evidence_of_some()
            line, some = ahead > np.log(EVIDENCE_RATIO), ahead < -np.log(EVIDENCE_RATIO)
            return GROWS if line else COMES_AND_GOES if some else CHANGES
        if line or some:
            return GROWS if line else COMES_AND_GOES
        absent = self._absent(having) if len(shown) > _FEWEST else ()
        gone = having and any(having[0] < index < having[-1] for index in absent)
        back = len(having) < len(shown) and absent and having and having[-1] < min(absent)
        return COMES_AND_GOES if gone or back else CHANGES

    def _absent(self, having: Sequence[int]) -> tuple[int, ...]:
        """Return which of the other runs would show what some have."""
        if not having:
            return ()
        size = self._fitted(self._marked(having)).values
        others = [index for index in range(len(self._runs)) if index not in having]
        return tuple(index for index in others if self._could_show(index, size))

    def _evidence_of_line(self) -> float:
        """Return ln p of a straight line of unknown slope, the slope as large as is likeliest."""
        each = max((self._common.left - self._line.left) / len(self._functional), 1.0)
        return -0.5 * (self._line.left + len(self._functional) * float(np.log(each)))

    def _evidence_of_some(self) -> float:
        """Return ln p of one size in some runs, these being some of all choices."""
        return -0.5 * self._some.left - float(np.log(2.0 ** len(self._runs) - 2.0))

    def _rate(self) -> Figure:
        if self._line.freedom <= 0 or self._renewed:
            return Figure()
        slope = np.concatenate([np.zeros_like(self._functional), self._functional])
        return self._figure(self._line.values, self._line.information, slope)

    def _figure(self, values: Vector, information: Vector, functional: Vector) -> Figure:
        """Return a functional of some values; unknown where their information does not hold it."""
        covariance = _inverse(information)
        outside = functional - information @ (covariance @ functional)
        variance = float(functional @ covariance @ functional)
        if not variance > 0.0 or np.any(np.abs(outside) > _HARDLY * np.abs(functional).max()):
            return Figure()
        value, u = float(functional @ values), variance**0.5
        return Figure(value, u, (value - self._factor * u, value + self._factor * u))


@lru_cache
def _needed(count: int, runs: int) -> float:
    """Return the χ² of so many sizes from which on a run shows them, 19 times in 20."""
    from scipy.special import chdtri, chndtrinc

    return float(chndtrinc(float(chdtri(count, _RUN_LEVEL / runs)), count, _MISSED))


def chance_of(squares: float, columns: int, freedom: float) -> float:
    """Return the probability of such a χ² of so many columns, 1 of none, by noise of a run."""
    return float(tail(np.array(squares), float(columns), freedom)) if columns else 1.0


def _scaled(information: Vector) -> tuple[Vector, Vector]:
    """Return an information matrix with ones on its diagonal, and the roots of the old one."""
    roots: Vector = np.sqrt(np.diag(information))
    safe = np.where(roots > 0.0, roots, 1.0)
    return information / np.outer(safe, safe), safe


def _rank(information: Vector) -> int:
    return int(np.linalg.matrix_rank(_scaled(information)[0], hermitian=True, tol=_RANK))


def _inverse(information: Vector) -> Vector:
    """Return the pseudo-inverse of an information matrix whose sizes have different units."""
    scaled, roots = _scaled(information)
    made: Vector = np.linalg.pinv(scaled, rcond=_RANK, hermitian=True) / np.outer(roots, roots)
    return made
