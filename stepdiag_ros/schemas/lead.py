"""The document ``lead``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import UNSET, Meta, UnsetType

from stepdiag_ros.schemas.parts import Count, Numbers, Uncertainty, means, one_of


@dataclass(frozen=True, kw_only=True)
class Flaw:
    """What is wrong with the recording."""

    kind: Annotated[
        str,
        one_of("missing", "doubled", "out_of_order", "different", "begun_late", "recovered"),
        means(
            "missing: what was recorded is not there; doubled: it is there more than once, and"
            " counted once; out_of_order: it does not stand in the order of recording; different:"
            " recorded lines do not follow from the readings; begun_late: the recording began after"
            " the run; recovered: it was made whole after damage, with losses."
        ),
    ]
    sentence: Annotated[str, Meta(min_length=1), means("In words.")]
    messages: Annotated[
        Mapping[str, Annotated[int, Meta(ge=1), means("Messages.")]],
        means("Full name of a topic to the number of messages; empty where that is not known."),
    ]


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The verdict of the diagnosis."""

    name: Annotated[
        str,
        one_of(
            "CONSISTENT",
            "NAMED",
            "AMBIGUOUS",
            "DESCRIBED",
            "UNEXPLAINED",
            "NOT TESTABLE",
            "NOT DIAGNOSED",
        ),
        means("NOT DIAGNOSED: the run was not compared with its model; the sentence says why."),
    ]
    sentence: Annotated[str, means("The verdict in words, or why it is missing.")]
    effects: Annotated[
        Sequence[Annotated[str, Meta(min_length=1)]],
        means("Labels of the effects that act, strongest first; empty unless NAMED or AMBIGUOUS."),
    ]
    rivals: Annotated[
        Sequence[Annotated[str, Meta(min_length=1)]],
        means("Where AMBIGUOUS, labels of others that may act in place of these."),
    ]
    contained: Annotated[
        bool,
        means(
            "All that acts is rotations of the axes, none larger than every uncertainty of an error"
            " contains."
        ),
    ] = False


@dataclass(frozen=True, kw_only=True)
class Passes:
    """How much of the plan was measured."""

    planned: Annotated[Count, means("Of the plan.")]
    complete: Annotated[
        Count, means("Passes of which every stop has a value, or stops that have one.")
    ]
    unit: Annotated[str, one_of("passes", "stops"), means("What is counted.")]
    missing: Annotated[
        Sequence[Annotated[str, Meta(min_length=1)]],
        means("Lines of which a pass is not complete, in the order of the plan."),
    ]
    end: Annotated[
        str | None,
        means("How the run ended, in words; null where the recording does not state it."),
    ]


@dataclass(frozen=True, kw_only=True)
class SingleError:
    """An error over the travel."""

    name: Annotated[str, means("ISO 230-1 name.")]
    value: Annotated[
        float,
        Meta(ge=0),
        means(
            "Peak to peak over the travel, m; of squareness what it makes over the travel of the"
            " axis."
        ),
    ]
    expanded_uncertainty: Annotated[Uncertainty, means("Of that (95 %), m.")]
    travel: Annotated[float, Meta(ge=0), means("Measured travel, m.")]


@dataclass(frozen=True, kw_only=True)
class Step:
    """What to do next."""

    command: Annotated[str | None, means("What to run; null where no command does it.")]
    why: Annotated[str, Meta(min_length=1), means("What it is for, in words.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Summary of a run.

    Part of the documents of `stepdiag solve` and `stepdiag measure`.
    """

    recording: Annotated[
        Sequence[Flaw],
        means(
            "What is wrong with the recording, most serious first: empty if it holds what was"
            " recorded, as far as its counts show."
        ),
    ]
    verdict: Annotated[
        Verdict,
        means(
            "Of the diagnosis of the run, with all error curves free and no other effects in the"
            " model."
        ),
    ]
    passes: Annotated[
        Passes | None, means("How much of the plan was measured; null if that is not known.")
    ]
    solved: Annotated[
        bool | None,
        means(
            "Errors were estimated, and what follows is of the method to rely on; null: they were"
            " not asked for."
        ),
    ]
    misfit: Annotated[
        Annotated[str, one_of("none", "unclear", "shown")] | None,
        means(
            "Whether the errors explain the readings: none: they do; unclear: they do not, and"
            " this cannot be distinguished from poor repeatability; shown: they do not, beyond"
            " what repeats scatter. null where nothing was solved."
        ),
    ]
    reduced_chi_squared: Annotated[
        Uncertainty, means("Chi squared of the fit over its degrees of freedom.")
    ]
    unknown: Annotated[
        Sequence[Annotated[str, Meta(min_length=1)]],
        means(
            "Names of the error curves (of the nine of positioning and straightness) and of the"
            " squareness errors that the lines do not determine."
        ),
    ]
    remedy: Annotated[
        str | None,
        means(
            "Which lines, measured as well, would determine them; null where that is not known, or"
            " a run cut short lacks lines of its own plan."
        ),
    ]
    noise: Annotated[
        bool | None,
        means(
            "The errors are no more than noise makes; null if the largest error in the volume is"
            " not known."
        ),
    ]
    largest_in_volume: Annotated[Uncertainty, means("Longest error vector in the measured box, m.")]
    largest_at: (
        Annotated[Numbers, means("Where that is, machine coordinates X Y Z, m; null if unknown.")]
        | UnsetType
    ) = UNSET
    largest_upper_bound: (
        Annotated[Uncertainty, means("What the error is below at every place (95 %), m.")]
        | UnsetType
    ) = UNSET
    expanded_uncertainty: Annotated[
        Uncertainty,
        means(
            "Of that (95 %), m: with an uncertainty budget the larger of U by the budget and U of"
            " the readings, without one U of the readings."
        ),
    ]
    expanded_uncertainty_of_readings: (
        Annotated[
            Uncertainty,
            means(
                "Of that (95 %), m: of the readings, of rotations as far as the readings leave them"
                " open, and of the laser's scale alone."
            ),
        ]
        | UnsetType
    ) = UNSET
    budgeted: (
        Annotated[bool, means("An uncertainty budget is in the uncertainties.")] | UnsetType
    ) = UNSET
    lower_bound: (
        Annotated[
            bool,
            means("A source that acts is not known, so that uncertainties are lower bounds."),
        ]
        | UnsetType
    ) = UNSET
    single_errors: Annotated[
        Sequence[SingleError],
        means(
            "The errors over the travel that are known, largest first. Where some are unknown, the"
            " first of these is not the largest of the machine."
        ),
    ]
    taken_as_zero: Annotated[
        Sequence[Annotated[str, Meta(min_length=1)]],
        means("Rotations that the method takes as zero."),
    ]
    sentences: Annotated[
        Sequence[Annotated[str, Meta(min_length=1)]],
        means("All of that in words, in the order in which it decides."),
    ]
    next: Annotated[Sequence[Step], means("What to do next, most urgent first.")]
