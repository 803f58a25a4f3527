"""What a diagnosis says: the verdict, the named effects, what would have been seen, what not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect, Setting
from stepdiag_ros.metrology.effects.learned_shape import READING
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import ROTATIONS, Vector

CONSISTENT = "CONSISTENT"
"""The model explains the run to within its noise."""
NAMED = "NAMED"
"""Effects of the catalogue, and no others, close the gap."""
AMBIGUOUS = "AMBIGUOUS"
"""The gap closes, but several effects would close it and this run does not show which."""
DESCRIBED = "DESCRIBED"
"""No effect of the catalogue closes the gap, but a formula of few quantities of the machine's state
does."""
UNEXPLAINED = "UNEXPLAINED"
"""There is a gap that neither an effect of the catalogue nor a formula closes."""
NOT_TESTABLE = "NOT TESTABLE"
"""The run has no data left over that could contradict the model, or does not determine its
noise.
"""

CONSISTENT_LEVEL = 0.002
"""Probability of a lack of fit below which it counts as a gap, all shapes of the test together."""

LINE_AND_PARABOLA = ("linear", "quadratic")
"""Names of sizes that a share of the travel, and its square, are multiplied by."""

_BOUND = {"setup", "line"}
"""Keys of a setting that ties an effect to one alignment or pass of one run."""


@dataclass(frozen=True)
class Candidate:
    """An effect in one setting, as it is tried on a run.

    Attributes:
        effect: of the catalogue.
        setting: where and how.
        label: unique among the candidates of a run.
    """

    effect: Effect
    setting: Setting
    label: str

    def free(self, stops: Stops) -> Vector:
        """Return columns of its sizes and of what no run determines of it, shape (n, k)."""
        effect = self.effect
        return np.column_stack(
            [effect.columns(self.setting, stops), effect.unknown(self.setting, stops)]
        )

    @property
    def is_bound(self) -> bool:
        """Say whether the effect belongs to one alignment or one pass, and is over with it."""
        return not _BOUND.isdisjoint(self.setting)

    @property
    def family(self) -> str:
        """Return the label without numbers that shape the effect: what counts as one name.

        A slip at the next stop or a time constant a little longer is the same effect less well
        located, not another one.
        """
        words = [str(value) for value in self.setting.values() if isinstance(value, str)]
        return " ".join([self.effect.name, *words])


@dataclass(frozen=True)
class Loose:
    """What scatters in a run and is not an effect that has a size of its own.

    Attributes:
        zero: standard deviation of the zero from pass to pass, m.
        slope: of a pass's change from its middle to its last stop, m.
        rotation: size of the rotations of all axes, rad; see ``plausible``.
    """

    zero: float = 0.0
    slope: float = 0.0
    rotation: float = 0.0


@dataclass(frozen=True)
class RunnerUp:
    """A candidate that lost against a named one.

    Attributes:
        label: of the candidate.
        gain: in χ² over the other findings alone, as for ``Finding.gain``.
        probability: that it, and not the named one, is the cause, 0..1.
        why: it lost, in words.
        ambiguous: the evidence does not rule it out.
    """

    label: str
    gain: float
    probability: float
    why: str
    ambiguous: bool = False


def in_order(rivals: Sequence[RunnerUp]) -> list[RunnerUp]:
    """Return those that are not ruled out, then the others, each with the most probable first.

    Where several are equally improbable, the one that closes more of the gap comes first.
    """
    return sorted(rivals, key=lambda one: (not one.ambiguous, -one.probability, -one.gain))


@dataclass(frozen=True)
class Finding:
    """A named effect.

    Attributes:
        candidate: what acts and where.
        sizes: name → value, SI, fitted together with all other findings and the baseline.
        standard_uncertainty: name → of the size, SI.
        band: name → lower and upper end of the 95 % coverage interval, SI.
        gain: what χ² loses by it, given the other findings.
        p_value: chance of such a gain of any candidate on a run that lacks nothing.
        probability: of this name among all, 0..1, by the evidence.
        group: labels of candidates that show the same in this run whatever its readings are.
        runners_up: the best candidates of other names, best first.
        covariance: of the sizes, in the order of the effect's, SI, shape (sizes, sizes); NaN
            where the run does not determine a size.
        over: every name that may be the cause belonged to an alignment or a pass, so that no
            further measurement shows which it was.
        equivalent: labels of names that are one with this: all belonged to the same alignment.
    """

    candidate: Candidate
    sizes: Mapping[str, float]
    standard_uncertainty: Mapping[str, float]
    band: Mapping[str, tuple[float, float]]
    gain: float
    p_value: float
    probability: float
    group: tuple[str, ...] = ()
    runners_up: tuple[RunnerUp, ...] = ()
    covariance: Vector = field(default_factory=lambda: np.full((0, 0), np.nan))
    over: bool = False
    equivalent: tuple[str, ...] = ()

    @property
    def over_travel(self) -> tuple[float, float, float] | None:
        """Return the change over the whole measured travel, its standard uncertainty and U, SI.

        U is half of the 95 % coverage interval.

        It is the sum of a straight line's and a parabola's part, and often known well where
        a short travel or few levers determine neither part by itself. None for effects of other
        shapes, and where a part is unknown.
        """
        if tuple(self.sizes) != LINE_AND_PARABOLA or self.covariance.shape != (2, 2):
            return None
        variance = float(np.sum(self.covariance))
        name = LINE_AND_PARABOLA[0]
        low, high = self.band[name]
        if not variance >= 0.0 or not self.standard_uncertainty[name] > 0.0:
            return None
        coverage = 0.5 * (high - low) / self.standard_uncertainty[name]
        return sum(self.sizes.values()), variance**0.5, coverage * variance**0.5

    @property
    def label(self) -> str:
        """Return the candidate's label."""
        return self.candidate.label

    @property
    def ambiguous(self) -> tuple[str, ...]:
        """Return the labels of other names that may as well be the cause."""
        rivals = tuple(other.label for other in self.runners_up if other.ambiguous)
        open_names = dict.fromkeys((*self.group, *rivals))
        return tuple(label for label in open_names if label not in self.equivalent)

    @property
    def active(self) -> ActiveEffect:
        """Return the effect with its sizes, for a model or a simulation."""
        return ActiveEffect(self.candidate.effect, self.candidate.setting, self.sizes)


@dataclass(frozen=True)
class Share:
    """How the gap lies over one way of splitting it.

    Attributes:
        split: the way, for example ``line`` or ``moved axis``.
        part: for example ``ppp`` or ``Y``.
        mean: of the gap there, m.
        rms: of the gap there, m.
        readings: number of them.
        p_value: chance of a mean square so large by noise alone.
    """

    split: str
    part: str
    mean: float
    rms: float
    readings: int
    p_value: float


@dataclass(frozen=True)
class Pattern:
    """What a gap, or a part of it, looks like before it has a name.

    Attributes:
        place: in the run, in words, for example ``the Y moves``.
        lines: names of the lines that it is on; empty if on all that have the place.
        with_what: what it goes with, in words, for example ``growing with time``.
        rms: of the pattern's part of the gap at the stops concerned, m.
        share: of what the gap's χ² exceeds noise by, 0..1; NaN where that excess is itself unclear.
        gain: what χ² loses by it.
        p_value: chance of so clear a pattern, of all that were tried, by noise alone.
        or_else: other influences that it may depend on, or other places where it may be, as far as
            this run shows.
        columns: number of values that were fitted to the gap for it.
    """

    place: str
    lines: tuple[str, ...]
    with_what: str
    rms: float
    share: float
    gain: float
    p_value: float

    or_else: tuple[str, ...] = ()
    columns: int = 1

    @property
    def words(self) -> str:
        """Return the whole in words: ``the Y moves of pnp and ppn, growing with time``."""
        return f"{pattern_words(self.place, self.lines)}, {self.with_what}"


def pattern_words(place: str, lines: tuple[str, ...]) -> str:
    """Return where a pattern is, for example ``the Y moves of pnp and ppn``."""
    return " of ".join([place, *([listed(lines)] if lines else [])])


def listed(names: tuple[str, ...]) -> str:
    """Return names in a row: ``X, Y and Z``."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


@dataclass(frozen=True)
class Dependence:
    """On what a gap without a name depends.

    Attributes:
        acts_on: X, Y or Z for a displacement of the tool along that axis, or ``reading``.
        drivers: the quantities of the machine's state on whose product it depends, in words.
        shapes: products of factors by which it is written (``effects.learned_shape``).
        gain: what χ² loses by it, given the dependences before.
        p_value: chance that noise gives any dependence such evidence.
        probability: of this dependence among all that were tried, 0..1, by the evidence.
        rivals: others, as ``acts_on`` and ``drivers``, at odds of less than 20 to 1 against them,
            likeliest first.
    """

    acts_on: str
    drivers: tuple[str, ...]
    shapes: tuple[str, ...]
    gain: float
    p_value: float
    probability: float
    rivals: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @property
    def words(self) -> str:
        """Return for example ``a displacement along Y that depends on the places of X and Z``."""
        return dependence_words(self.acts_on, self.drivers)


def dependence_words(acts_on: str, drivers: tuple[str, ...]) -> str:
    """Say what acts and on what it depends."""
    if acts_on == READING:
        what = "a change of the reading"
    elif acts_on in ROTATIONS:
        what = f"a rotation {acts_on}"
    else:
        what = f"a displacement along {acts_on}"
    return f"{what} that depends on {listed(drivers)}"


@dataclass(frozen=True)
class Description:
    """On what a gap without a name depends; the findings hold the shapes that close it.

    Attributes:
        dependences: clearest first.
        nearest: label of the effect of the catalogue that comes nearest; empty if none does.
        nearest_share: of what the shapes take from χ², that this effect takes, 0..1.
    """

    dependences: tuple[Dependence, ...]
    nearest: str = ""
    nearest_share: float = 0.0


@dataclass(frozen=True)
class Diagnosis:
    """The result of comparing a run with a model.

    Attributes:
        verdict: CONSISTENT, NAMED, AMBIGUOUS, DESCRIBED, UNEXPLAINED or NOT TESTABLE.
        sentence: the verdict in words.
        findings: named effects, strongest first; where DESCRIBED, the shapes behind those that act
            beside them; empty for other verdicts.
        partial: where UNEXPLAINED, what closes part of the gap and is not to be believed alone.
        noise: standard deviation of a reading, from the repeats, m; NaN if unknown.
        noise_degrees_of_freedom: of ``noise``.
        noise_correlation: between the noise of neighbouring stops of a pass.
        noise_source: where the noise was taken from, in words.
        loose: what scatters beside the noise.
        description: of a gap without a name; None if it has one, or no structure is clear. Where
            UNEXPLAINED, it describes a part of the gap.
        wrong_readings: which readings are wrong, in words, where UNEXPLAINED and the run agrees
            without them.
        chi_squared_before: of the run under the model as it was, all its free values fitted.
        chi_squared_after: with the findings (where UNEXPLAINED, ``partial``) fitted too.
        degrees_of_freedom_before: without the findings.
        degrees_of_freedom_after: with the findings.
        lack_of_fit_p_before: chance of so bad a fit by noise alone.
        lack_of_fit_p_after: the same with the findings.
        residual_before: gap, measured minus simulated, m, shape (n,); NaN at rejected stops.
        residual_after: the same with the findings.
        detection_limits: label → smallest size (of the effect's first, SI) seen 19 times in 20.
        not_testable: label → why this run cannot show it.
        where: sentences that say where the gap of the model as it was lies.
        where_after: the same for the remaining gap, where UNEXPLAINED.
        map: the gap of the model as it was, split in several ways.
        patterns: what that gap looks like, clearest first; none where it is CONSISTENT.
        patterns_after: the same for the remaining gap, where UNEXPLAINED.
        covariance: of all sizes of the findings (where UNEXPLAINED, ``partial``), one finding's
            after another's, SI, shape (sizes, sizes); NaN where the run does not determine a size.
        tested: number of candidates tried.
        stops: all stops, rows as of the residuals.
    """

    verdict: str
    sentence: str
    findings: tuple[Finding, ...]
    partial: tuple[Finding, ...]
    noise: float
    noise_degrees_of_freedom: float
    noise_correlation: float
    noise_source: str
    chi_squared_before: float
    chi_squared_after: float
    degrees_of_freedom_before: int
    degrees_of_freedom_after: int
    lack_of_fit_p_before: float
    lack_of_fit_p_after: float
    residual_before: Vector
    residual_after: Vector
    detection_limits: Mapping[str, float]
    not_testable: Mapping[str, str]
    where: tuple[str, ...]
    stops: Stops
    where_after: tuple[str, ...] = ()
    map: tuple[Share, ...] = field(default=())
    patterns: tuple[Pattern, ...] = ()
    patterns_after: tuple[Pattern, ...] = ()
    tested: int = 0
    covariance: Vector = field(default_factory=lambda: np.zeros((0, 0)))
    loose: Loose = Loose()
    description: Description | None = None
    wrong_readings: tuple[str, ...] = ()
