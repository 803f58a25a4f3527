"""What is published and recorded of a diagnosis: plain values, without the run's stops.

A ``Diagnosis`` holds the effects themselves and the gap at every stop. A subscriber, or a reader of
a bag, has neither the catalogue nor the lines at hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf

from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    DESCRIBED,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
    RunnerUp,
    Share,
)
from stepdiag_ros.metrology.effects.angular_error import EFFECT as ANGULAR
from stepdiag_ros.metrology.effects.several_angular_errors import EFFECT as SEVERAL
from stepdiag_ros.metrology.effects.smooth_angular_error import EFFECT as WAVY
from stepdiag_ros.metrology.geometry import ROTATIONS

NOT_DIAGNOSED = "NOT DIAGNOSED"
"""In place of a verdict where a run was not compared with its model."""
_ROTATIONS = frozenset({
    SEVERAL.name,
    *(effect.label({"error": name}) for effect in (ANGULAR, WAVY) for name in ROTATIONS),
})  # fmt: skip
"""Labels of effects by which nothing but an axis rotates as it moves."""
_LARGEST = 3.0
"""Size of rotations, over the plausible one, up to which bands were seen to hold (test/bands)."""


@dataclass(frozen=True)
class Verdict:
    """Whether a model explains a run, in as few words as decide what may be done with its errors.

    Attributes:
        name: CONSISTENT, NAMED, AMBIGUOUS, DESCRIBED, UNEXPLAINED, NOT TESTABLE or NOT DIAGNOSED.
        sentence: the verdict in words, or why it is missing.
        effects: labels of the effects that act, strongest first; where DESCRIBED, of the
            shapes that close the gap; empty where CONSISTENT, UNEXPLAINED or NOT TESTABLE.
        rivals: where AMBIGUOUS, labels of others that may act in place of these.
        contained: all that acts is rotations of the axes, whichever of the names is right, and none
            is larger than every uncertainty of an error contains.
    """

    name: str = NOT_DIAGNOSED
    sentence: str = "Whether anything acts that these errors do not contain was not tested."
    effects: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    contained: bool = False

    @classmethod
    def of_effects(
        cls, name: str, sentence: str, found: Sequence["FoundEffect"], rotation: float
    ) -> "Verdict":
        """Return a verdict.

        Args:
            name: of it.
            sentence: of it.
            found: the effects that act, strongest first.
            rotation: plausible size of rotations, rad.
        """
        effects = tuple(one.label for one in found)
        every = dict.fromkeys(label for one in found for label in one.ambiguous_with)
        rivals = tuple(label for label in every if label not in effects)
        rotations = name in (NAMED, AMBIGUOUS) and _ROTATIONS.issuperset((*effects, *rivals))
        sizes = [abs(size.value) for one in found for size in one.sizes]
        contained = rotations and max(sizes, default=inf) <= _LARGEST * rotation
        return cls(name, sentence, effects, rivals, contained)

    @property
    def words(self) -> str:
        """Return the name with what acts or may act: ``AMBIGUOUS: dead path (or drift)``."""
        acts = ", ".join(self.effects) + (f" (or {', '.join(self.rivals)})" if self.rivals else "")
        return f"{self.name}: {acts}" if acts else self.name

    @property
    def more_acts(self) -> bool:
        """Say whether the run shows more than its errors and their uncertainty contain."""
        return self.name in (NAMED, AMBIGUOUS, DESCRIBED, UNEXPLAINED) and not self.contained

    @property
    def tested(self) -> bool:
        """Say whether a reading of the run could contradict its model, and was compared with it."""
        return self.name not in (NOT_TESTABLE, NOT_DIAGNOSED)


@dataclass(frozen=True)
class FoundSize:
    """One size of an effect that was found; SI, NaN if not known.

    Attributes:
        name: for example ``lost_motion``.
        unit: SI, for example ``m``.
        meaning: in a few words.
        value: fitted together with all other findings.
        standard_uncertainty: of ``value``.
        band: lower and upper end of the 95 % coverage interval.
    """

    name: str
    unit: str
    meaning: str
    value: float
    standard_uncertainty: float
    band: tuple[float, float]


@dataclass(frozen=True)
class FoundEffect:
    """An effect that was found; see ``metrology.discrepancy.Finding``.

    Attributes:
        label: for example ``backlash of X``.
        effect: its name in the catalogue.
        setting: name → value as text; where and how it acts.
        sentence: what happens in the machine.
        source: where the effect is described.
        sizes: all of them.
        gain: what χ² loses by it.
        p_value: chance of such a gain of any candidate on a run that lacks nothing.
        probability: of this name among all, 0..1.
        ambiguous_with: labels of other names that may as well be the cause.
        runners_up: the best candidates of other names, best first; ``ambiguous_with`` names
            those that are not ruled out.
    """

    label: str
    effect: str
    setting: dict[str, str]
    sentence: str
    source: str
    sizes: tuple[FoundSize, ...]
    gain: float
    p_value: float
    probability: float
    ambiguous_with: tuple[str, ...] = ()
    runners_up: tuple[RunnerUp, ...] = ()


@dataclass(frozen=True)
class Limit:
    """The smallest size of an effect that would have been seen, 19 times in 20.

    Attributes:
        effect: name in the catalogue.
        label: of the effect in its setting; the effect's name where several settings are in one.
        settings: how many places or shapes of the effect these limits are of.
        size: name of the size.
        unit: of it, SI.
        smallest: smallest limit of these settings.
        largest: largest limit of these settings.
    """

    effect: str
    label: str
    settings: int
    size: str
    unit: str
    smallest: float
    largest: float


@dataclass(frozen=True)
class GapFigures:
    """How large a gap is, and how well noise alone would explain it; NaN if not known.

    Attributes:
        chi_squared: of the fit.
        degrees_of_freedom: of ``chi_squared``.
        p_value: chance of so bad a fit by noise alone.
        rms: of the gap, m.
        largest: size of the gap at one reading, m.
    """

    chi_squared: float
    degrees_of_freedom: int
    p_value: float
    rms: float
    largest: float


@dataclass(frozen=True)
class ModelSource:
    """With what a run was compared.

    Attributes:
        name: of the model, in words.
        text: YAML of the model.
        sha256: of that text, 64 hexadecimal digits.
    """

    name: str
    text: str
    sha256: str


@dataclass(frozen=True)
class DiagnosisSummary:
    """A diagnosis of the lines of a run, as far as it has come.

    Attributes:
        time: of the last line that was used, ns.
        run_over: the run has ended.
        lines: compared.
        lines_planned: of the whole plan.
        verdict: CONSISTENT, NAMED, AMBIGUOUS, DESCRIBED, UNEXPLAINED or NOT TESTABLE.
        sentence: the verdict in words.
        findings: what is missing; where DESCRIBED, the shapes that close the gap.
        partial: where UNEXPLAINED, what closes a part of the gap.
        covariance: of all sizes of these, one finding's after another's, SI, row by row.
        noise: standard deviation of a reading, m; NaN if unknown.
        noise_degrees_of_freedom: of ``noise``.
        noise_correlation: between the noise of neighbouring stops.
        noise_source: in words.
        before: the gap of the model as it is.
        after: the gap with the findings.
        where: in words, where the gap of the model as it is lies.
        where_after: the same for the remaining gap, where UNEXPLAINED.
        map: the gap of the model as it is, split in several ways.
        detection_limits: one for each effect and setting, or for all settings of one effect.
        not_testable: what these lines cannot show, and why, in words.
        tested: number of candidates.
        model: with what the lines were compared.
        seed: of the draws.
        software_version: of stepdiag_ros that compared.
        remarks: what the reader must know.
    """

    time: int
    run_over: bool
    lines: int
    lines_planned: int
    verdict: str
    sentence: str
    findings: tuple[FoundEffect, ...]
    partial: tuple[FoundEffect, ...]
    covariance: tuple[float, ...]
    noise: float
    noise_degrees_of_freedom: float
    noise_correlation: float
    noise_source: str
    before: GapFigures
    after: GapFigures
    where: tuple[str, ...]
    where_after: tuple[str, ...]
    map: tuple[Share, ...]
    detection_limits: tuple[Limit, ...]
    not_testable: tuple[str, ...]
    tested: int
    model: ModelSource
    seed: int
    software_version: str
    remarks: tuple[str, ...] = field(default=())

    @property
    def words(self) -> str:
        """Return the verdict, on how many lines it rests, and what it means, for people."""
        whole = self.lines >= self.lines_planned
        count = f"{self.lines}" if whole else f"{self.lines} of {self.lines_planned}"
        return f"{self.verdict} ({count} passes): {self.sentence}"
