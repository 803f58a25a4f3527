"""What a diagnosis says: the verdict, the named effects, what would have been seen, what not."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect, Setting
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector

CONSISTENT = "CONSISTENT"
"""The model explains the run to within its noise."""
NAMED = "NAMED"
"""Effects of the catalogue, and no others, close the gap."""
AMBIGUOUS = "AMBIGUOUS"
"""The gap closes, but several effects would close it and this run does not tell which."""
UNEXPLAINED = "UNEXPLAINED"
"""There is a gap that no effect of the catalogue closes."""
NOT_TESTABLE = "NOT TESTABLE"
"""The run has no data left over that could contradict the model, or does not tell its noise."""


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

    @property
    def family(self) -> str:
        """Return the label without numbers that shape the effect: what counts as one name.

        A slip at the next stop or a time constant a little longer is the same effect less well
        located, not another one.
        """
        words = [str(value) for value in self.setting.values() if isinstance(value, str)]
        return " ".join([self.effect.name, *words])


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

    @property
    def label(self) -> str:
        """Return the candidate's label."""
        return self.candidate.label

    @property
    def ambiguous(self) -> tuple[str, ...]:
        """Return the labels of other names that may as well be the cause."""
        rivals = tuple(other.label for other in self.runners_up if other.ambiguous)
        return tuple(dict.fromkeys((*self.group, *rivals)))

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
class Diagnosis:
    """The result of comparing a run with a model.

    Attributes:
        verdict: CONSISTENT, NAMED, AMBIGUOUS, UNEXPLAINED or NOT TESTABLE.
        sentence: the verdict in words.
        findings: named effects, strongest first; empty unless NAMED or AMBIGUOUS.
        partial: where UNEXPLAINED, what closes part of the gap and is not to be believed alone.
        noise: standard deviation of a reading, from the repeats, m; NaN if not told.
        noise_degrees_of_freedom: of that.
        noise_correlation: between the noise of neighbouring stops of a pass.
        noise_source: where the noise was taken from, in words.
        chi_squared_before: of the run under the model as it was, all its free values fitted.
        chi_squared_after: with the findings (where UNEXPLAINED, ``partial``) fitted too.
        degrees_of_freedom_before: likewise.
        degrees_of_freedom_after: likewise.
        lack_of_fit_p_before: chance of so bad a fit by noise alone.
        lack_of_fit_p_after: likewise with the findings.
        residual_before: gap, measured minus simulated, m, shape (n,); NaN at rejected stops.
        residual_after: likewise with the findings.
        detection_limits: label → smallest size (of the effect's first, SI) seen 19 times in 20.
        not_testable: label → why this run cannot show it.
        where: sentences that say where the gap of the model as it was lies.
        where_after: likewise of the gap that is left, where UNEXPLAINED.
        map: the gap of the model as it was, split in several ways.
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
    tested: int = 0
