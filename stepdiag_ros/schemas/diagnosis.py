"""The document ``diagnosis``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import UNSET, Meta, UnsetType

from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    DESCRIBED,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
)
from stepdiag_ros.metrology.geometry import CURVES, ROTATIONS
from stepdiag_ros.schemas.parts import (
    Chance,
    Count,
    Number,
    Numbers,
    Text,
    Uncertainty,
    Words,
    means,
    one_of,
)


@dataclass(frozen=True, kw_only=True)
class FurtherRun:
    """A run that was diagnosed together with the first."""

    run_id: Text
    bag: Annotated[str, means("File.")]
    sha256: Annotated[str, means("SHA-256 of this file.")]


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Where the size of an effect comes from."""

    bag: (
        Annotated[str, means("File name of the run that determined it; of several, with ` + `.")]
        | UnsetType
    ) = UNSET
    sha256: Annotated[str, means("SHA-256 of this file, or of each.")] | UnsetType = UNSET
    date: Annotated[str, means("ISO 8601.")] | UnsetType = UNSET
    evidence: Annotated[str, means("In words.")] | UnsetType = UNSET


@dataclass(frozen=True, kw_only=True)
class Effect:
    """An effect that a model takes as known."""

    effect: Annotated[str, means("Name in the catalogue.")]
    setting: Annotated[Mapping[str, str | float], means("Where and how it acts.")]
    domain: (
        Annotated[
            Mapping[str, Sequence[float]],
            means(
                "Of a learned shape: quantity on which it depends to its range, as the run that it"
                " was learned from covered it; SI, temperatures in degC. Places are machine"
                " coordinates of the measured box."
            ),
        ]
        | UnsetType
    ) = UNSET
    sizes: Annotated[Mapping[str, float], means("Name to value, in the unit of that size.")]
    standard_uncertainty: (
        Annotated[Mapping[str, Uncertainty], means("Of the sizes, in their units.")] | UnsetType
    ) = UNSET
    status: Annotated[
        str,
        one_of("fixed", "fitted"),
        means("fixed: subtracted with these sizes; fitted: determined from every run."),
    ]
    provenance: Annotated[Provenance, means("Where this comes from.")] | UnsetType = UNSET
    covariance: (
        Annotated[
            Mapping[str, float],
            means(
                "Of a learned shape: label of each that was learned together with it to the"
                " covariance of both amplitudes, SI."
            ),
        ]
        | UnsetType
    ) = UNSET


@dataclass(frozen=True, kw_only=True)
class Model:
    """A model of a machine."""

    name: Annotated[str, means("Of the machine, in words.")]
    chain: Annotated[str, means("Order of the axes from workpiece to tool, or `unknown`.")]
    curves: Annotated[
        Annotated[str, one_of("free")]
        | Mapping[
            Annotated[
                str,
                one_of(*CURVES),
            ],
            Sequence[float],
        ],
        means("`free`, or values at the nodes (m) under ISO 230-1 names."),
    ]
    effects: Annotated[Sequence[Effect], means("Effects that the model takes as known.")]


@dataclass(frozen=True, kw_only=True)
class _File:
    """What a model was read from."""

    file: Annotated[Text, means("It was read from; null if none was given.")]


@dataclass(frozen=True, kw_only=True)
class FiledModel(Model, _File):
    """A model with its file."""


@dataclass(frozen=True, kw_only=True)
class Size:
    """One size of an effect."""

    name: Annotated[str, means("Of the size.")]
    unit: Annotated[str, means("SI, of value, standard_uncertainty and band_95.")]
    meaning: Annotated[str, means("In a few words.")]
    value: Number
    standard_uncertainty: Annotated[Uncertainty, means("k = 1.")]
    band_95: Annotated[
        Numbers,
        Meta(min_length=2, max_length=2),
        means("Lower and upper end of the 95 % coverage interval."),
    ]


@dataclass(frozen=True, kw_only=True)
class OverTravel:
    """The change over the whole measured travel."""

    value: float
    standard_uncertainty: Annotated[float, Meta(ge=0), means("k = 1.")]
    expanded_uncertainty: Annotated[float, Meta(ge=0), means("Half of the 95 % coverage interval.")]


@dataclass(frozen=True, kw_only=True)
class RunnerUp:
    """A candidate that lost."""

    label: str
    gain: Annotated[Number, means("In χ² over the other findings alone.")]
    probability: Chance
    ruled_out: Annotated[bool, means("The evidence excludes it.")]
    why: Annotated[str, means("It lost, in words.")]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A named effect."""

    label: Annotated[str, means("The effect with its setting, in words.")]
    effect: Annotated[str, means("Name in the catalogue.")]
    setting: Annotated[Mapping[str, str | float], means("Where and how it acts.")]
    sentence: Annotated[str, means("What happens in the machine.")]
    source: Annotated[str, means("Where that is described.")]
    sizes: Annotated[
        Sequence[Size], means("Fitted together with all other findings and the baseline.")
    ]
    covariance: Annotated[
        Sequence[Numbers],
        means(
            "Of the sizes, in their order and units; rows of null where the run does not"
            " determine them."
        ),
    ]
    over_travel: Annotated[
        OverTravel | None,
        means(
            "Change over the whole measured travel, of a shape that is a line and a parabola, in"
            " the unit of the first size; null for others."
        ),
    ]
    gain: Annotated[Number, means("What χ² loses by it, given the other findings.")]
    p_value: Annotated[
        Chance, means("Chance of such a gain of any candidate on a run that lacks nothing.")
    ]
    probability: Annotated[Chance, means("Of this name among all, by the evidence.")]
    group: Annotated[
        Words, means("Labels that show the same in this run whatever its readings are.")
    ]
    ambiguous_with: Annotated[Words, means("Labels that may as well be the cause.")]
    runners_up: Annotated[Sequence[RunnerUp], means("What else was tried, best first.")]


@dataclass(frozen=True, kw_only=True)
class Noise:
    """The noise of a stop."""

    standard_deviation_m: Annotated[Uncertainty, means("Of the value of one stop, m.")]
    degrees_of_freedom: Annotated[Uncertainty, means("Of that estimate.")]
    correlation: Annotated[
        Annotated[float, Meta(ge=-1, le=1)] | None,
        means("Between the noise of neighbouring stops of a pass."),
    ]
    source: Annotated[str, means("Where it was taken from.")]
    zero_scatter_m: Annotated[
        Uncertainty,
        means(
            "Standard deviation of the zero from pass to pass beside the noise, estimated from"
            " passes over the same places, m; 0 where they show none; null where there are none."
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class Fit:
    """How well a model fits the readings."""

    chi_squared: Annotated[Uncertainty, means("Of the readings against the noise.")]
    degrees_of_freedom: Count
    p_value: Annotated[Chance, means("Chance of so bad a fit by noise alone.")]
    rms_m: Annotated[Uncertainty, means("Of the gap, m.")]
    largest_m: Annotated[Uncertainty, means("Largest absolute gap, m.")]


@dataclass(frozen=True, kw_only=True)
class Pattern:
    """What a gap looks like."""

    words: Annotated[
        str,
        means("The whole in words, for example `the Y moves of pnp and ppn, growing with time`."),
    ]
    place: Annotated[str, means("Where in the run.")]
    lines: Annotated[Words, means("Lines that it is on; empty: all that have the place.")]
    with_what: Annotated[str, means("What it goes with.")]
    rms_m: Annotated[
        Uncertainty, means("Of the pattern's part of the gap at the stops concerned, m.")
    ]
    share: Annotated[
        Chance,
        means("Of what the gap's χ² exceeds noise by; null where that excess is itself unclear."),
    ]
    gain: Annotated[Number, means("What χ² loses by it.")]
    p_value: Annotated[Chance, means("Chance of so clear a pattern by noise alone.")]
    or_else: Annotated[
        Words,
        means(
            "Other influences that it may depend on, or other places where it may be, as far as"
            " this run shows."
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class Share:
    """The gap in one part of the run."""

    split: Annotated[
        str,
        means("Way of splitting: line, setup, pass, moved axis, block, direction, repeat, time, …"),
    ]
    part: Annotated[str, means("For example ppp, Y, 3.")]
    mean_m: Annotated[Number, means("Of the gap there, m.")]
    rms_m: Annotated[Uncertainty, means("Of the gap there, m.")]
    readings: Annotated[Count, means("Number of them.")]
    p_value: Annotated[Chance, means("Chance of a mean square so large by noise alone.")]


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """On what a gap without a name depends."""

    acts_on: Annotated[
        str,
        one_of("X", "Y", "Z", *ROTATIONS, "reading"),
        means(
            "Axis along which the tool is displaced, rotation of an axis, or the reading itself."
        ),
    ]
    drivers: Annotated[Words, means("The quantities on whose product it depends.")]
    shapes: Annotated[Words, means("Products of factors by which it is written.")]
    gain: Annotated[Number, means("What χ² loses by it, given the dependences before.")]
    p_value: Annotated[Chance, means("Chance that noise gives any dependence such evidence.")]
    probability: Annotated[Chance, means("Of this dependence among all that were tried.")]
    rivals: Annotated[
        Words, means("Others at odds of less than 20 to 1 against them, likeliest first.")
    ]


@dataclass(frozen=True, kw_only=True)
class Description:
    """What a gap without a name depends on."""

    dependences: Annotated[Sequence[Dependence], means("Clearest first.")]
    nearest: Annotated[
        Text, means("Label of the nearest effect of the catalogue; null without any.")
    ]
    nearest_share: Annotated[
        Number, means("Of what the shapes take from χ², that the nearest effect takes, 0..1.")
    ]


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The verdict and what it rests on."""

    verdict: Annotated[
        str, one_of(CONSISTENT, NAMED, AMBIGUOUS, DESCRIBED, UNEXPLAINED, NOT_TESTABLE)
    ]
    sentence: Annotated[str, means("The verdict in words.")]
    findings: Annotated[
        Sequence[Finding],
        means(
            "Named effects, strongest first; where DESCRIBED, the shapes that close the gap, behind"
            " the effects that act beside them; empty for other verdicts."
        ),
    ]
    partial: Annotated[
        Sequence[Finding],
        means("Where UNEXPLAINED: what closes a part of the gap, and is not to be believed alone."),
    ]
    description: Annotated[
        Description | None,
        means(
            "Of a gap without a name; null unless DESCRIBED, or UNEXPLAINED where it describes a"
            " part of the gap."
        ),
    ]
    tested: Annotated[Count, means("Number of candidates tried.")]
    noise: Annotated[Noise, means("Noise of a stop.")]
    before: Annotated[Fit, means("The run under the model as it was, all its free values fitted.")]
    after: Annotated[
        Fit, means("The same with the findings (where UNEXPLAINED: with `partial`) fitted too.")
    ]
    where: Annotated[Words, means("Where the gap of the initial model lies, in sentences.")]
    where_after: Annotated[Words, means("The same for the remaining gap, where UNEXPLAINED.")]
    patterns: Annotated[
        Sequence[Pattern], means("What that gap looks like, clearest first; none where CONSISTENT.")
    ]
    patterns_after: Annotated[
        Sequence[Pattern], means("The same for the remaining gap, where UNEXPLAINED.")
    ]
    map: Annotated[Sequence[Share], means("The gap of the model as it was, split in several ways.")]
    detection_limits: Annotated[
        Mapping[str, Uncertainty],
        means(
            "Label to the smallest size (of the effect's first, SI) that would have been seen 19"
            " times in 20."
        ),
    ]
    not_testable: Annotated[Mapping[str, str], means("Label to why this run cannot show it.")]


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A stop of the run."""

    run: Annotated[
        int, Meta(ge=1), means("Number of the run, from 1: the first file, then the further ones.")
    ]
    line: Annotated[str, means("Name of the line: x, y, z, or a diagonal such as ppp.")]
    order: Annotated[
        Text, means("Order of the single-axis moves of a block; null for other lines.")
    ]
    repeat: Annotated[Count, means("From 0.")]
    direction: Annotated[str, one_of("forward", "backward")]
    stop: Annotated[Count, means("Number in its pass, from 0.")]
    time_s: Annotated[Number, means("Since the start of the run, s.")]


@dataclass(frozen=True, kw_only=True)
class Gap:
    """The gap between run and model, stop by stop."""

    stops: Annotated[Sequence[Stop], means("All stops in the order of measurement.")]
    before_m: Annotated[
        Numbers, means("Measured minus simulated at each of the stops, m; null at rejected ones.")
    ]
    after_m: Annotated[Numbers, means("The gap with the findings fitted, m.")]


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two causes and how well a plan distinguishes them."""

    labels: Annotated[Words, means("Two causes.")]
    separation: Annotated[
        float, Meta(ge=0), means("Expected difference of the two, in standard deviations.")
    ]
    chance: Annotated[float, Meta(ge=0, le=1), means("Probability of distinguishing them.")]


@dataclass(frozen=True, kw_only=True)
class LeftOpen:
    """Causes that no plan distinguishes."""

    labels: Words
    why: str


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """What to measure next."""

    sentence: Annotated[str, means("What to measure next, in words.")]
    plan_file: Annotated[Text, means("File that the plan was written to.")]
    duration_s: Annotated[Uncertainty, means("Duration of the plan, s; null without a plan.")]
    certainty: Annotated[Chance, means("Chance that it leaves one name.")]
    alignments: Annotated[Words, means("To be made, in order.")]
    passes: Annotated[Words, means("In words.")]
    rivals: Annotated[Sequence[Words], means("Groups of labels to distinguish.")]
    pairs: Annotated[Sequence[Pair], means("The least certain first.")]
    left_open: Annotated[Sequence[LeftOpen], means("What no plan distinguishes.")]
    conditions: Annotated[Words, means("Conditions under which the plan decides.")]


@dataclass(frozen=True, kw_only=True)
class Prediction(Fit):
    """How well a model predicts readings that took no part in its fit."""

    residual_m: Annotated[
        Numbers, means("Measured minus predicted at each stop, m; null where it was not held out.")
    ]


@dataclass(frozen=True, kw_only=True)
class Gain:
    """What the effects explain of the held-out readings."""

    chi_squared: Annotated[
        Number,
        means(
            "What chi-squared loses by following the predicted difference; negative where the"
            " readings go the other way."
        ),
    ]
    p_value: Annotated[Chance, means("Chance of as much where the effects do not act, one-sided.")]


@dataclass(frozen=True, kw_only=True)
class Proof:
    """The proof of the findings on held-out readings."""

    split: Annotated[str, means("What was held out, in words.")]
    readings: Annotated[Count, means("Number of held-out stops.")]
    effects: Annotated[Words, means("Labels of those proven.")]
    named_by_the_other_readings_alone: Annotated[
        bool, means("The other readings alone name the same.")
    ]
    verdict_of_the_other_readings: str
    before: Prediction
    after: Prediction
    gain: Annotated[
        Gain,
        means(
            "What the effects themselves explain of the held-out readings, their difference"
            " predicted by the other readings alone."
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class _Run:
    """What was compared."""

    run_id: Annotated[Text, means("Identity of the run.")]
    bag: Annotated[Text, means("File of the run.")]
    sha256: Annotated[Text, means("SHA-256 of this file.")]
    further_runs: Annotated[
        Sequence[FurtherRun],
        means("Further runs of the same machine, diagnosed together with the first."),
    ]
    model: Annotated[FiledModel, means("The model as it was.")]


@dataclass(frozen=True, kw_only=True)
class Document(Verdict, _Run):
    """Comparison of a run with a model of the machine.

    Printed by `stepdiag diagnose --json`, written as diagnosis.json.
    """

    gap: Gap
    proposal: Annotated[
        Proposal | None,
        means("The extra plan for an ambiguous diagnosis; null if none was asked for."),
    ]
    held_out: Annotated[
        Proof | None,
        means("Proof on readings that took no part in the fit; null without a proof."),
    ]
    rounds: Annotated[
        Sequence[Verdict],
        means("The run under the extended model, again and again until nothing more is named."),
    ]
    extended_model: Annotated[
        Model | None, means("The model with what was named; null if nothing was.")
    ]
    extended_model_file: Annotated[Text, means("File that the plan was written to.")]
    remarks: Words
