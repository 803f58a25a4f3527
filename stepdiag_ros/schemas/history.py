"""The document ``history``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from stepdiag_ros.metrology.discrepancy.course import (
    CHANGES,
    COMES_AND_GOES,
    GROWS,
    IN_ALL,
    UNDETERMINED,
)
from stepdiag_ros.schemas.diagnosis import FurtherRun
from stepdiag_ros.schemas.parts import (
    Chance,
    Number,
    Numbers,
    Text,
    Uncertainty,
    Words,
    means,
    one_of,
)

RunNumbers = Sequence[Annotated[int, Meta(ge=1)]]


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run, or several that were made together and are one measurement."""

    number: Annotated[int, Meta(ge=1), means("In the order of the dates, from 1.")]
    start: Annotated[str, means("When the first began, ISO 8601, UTC.")]
    files: Annotated[Sequence[FurtherRun], means("That it was read from.")]
    verdict: Annotated[str, means("Of the diagnosis of this run alone.")]
    sentence: Annotated[str, means("The verdict in words.")]
    noise_m: Annotated[Uncertainty, means("Standard deviation of a reading, from its repeats, m.")]


@dataclass(frozen=True, kw_only=True)
class Value:
    """A number with its uncertainty."""

    value: Number
    standard_uncertainty: Annotated[Uncertainty, means("k = 1.")]
    band_95: Annotated[
        Numbers,
        Meta(min_length=2, max_length=2),
        means("Lower and upper end of the 95 % coverage interval."),
    ]


@dataclass(frozen=True, kw_only=True)
class Followed:
    """The one number by which an effect is followed."""

    name: str
    unit: Annotated[str, means("SI, of all values; of a rate per month (365.2425 days / 12).")]
    meaning: Annotated[str, means("In a few words.")]


@dataclass(frozen=True, kw_only=True)
class Effect:
    """What becomes of an effect from run to run."""

    label: Annotated[str, means("The effect, or on what a gap without a name depends.")]
    shapes: Annotated[Words, means("Labels of what was fitted: the effect, or the shapes.")]
    kind: Annotated[
        str,
        one_of(IN_ALL, GROWS, COMES_AND_GOES, CHANGES, UNDETERMINED),
        means(
            "in all runs: one size explains all runs; grows: in proportion to the date; comes and"
            " goes: some runs have it, others do not; changes: in another way, or the runs do not"
            " show in which; undetermined: the runs show neither that it stays nor that it changes."
        ),
    ]
    sentence: Annotated[str, means("The same in words.")]
    size: Followed
    sizes: Annotated[Sequence[Value], means("In each run; null where it does not show the effect.")]
    explained: Annotated[
        Numbers, means("Size of each run by what explains all; null where nothing does.")
    ]
    common: Annotated[Value, means("Of all runs, or of those that have it; null without one size.")]
    rate: Annotated[Value, means("Change per month by a straight line; null if unknown.")]
    having: Annotated[RunNumbers, means("Numbers of runs in which the effect is beyond chance.")]
    lacking: Annotated[RunNumbers, means("Of runs that would show it and do not.")]
    cannot_show: Annotated[RunNumbers, means("Of runs that could not show it.")]
    named_in: Annotated[RunNumbers, means("Of runs whose own diagnosis names it or a rival.")]
    rivals: Annotated[Words, means("Other effects that all runs together do not rule out.")]
    p_one_size: Annotated[Chance, means("Of such differences if all runs have one size.")]
    p_line: Annotated[Chance, means("Of what a straight line leaves; null if it must fit.")]
    p_some: Annotated[Chance, means("Of what one size in some runs leaves; null as well.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """What becomes of every effect from run to run.

    Written by `stepdiag diagnose` for runs that were made at different times.
    """

    model_file: Annotated[Text, means("It was read from; null if none was given.")]
    runs: Annotated[Sequence[Run], means("In the order of their dates.")]
    effects: Annotated[Sequence[Effect], means("That any run names or describes, clearest first.")]
    change_level: Annotated[
        float,
        means("Chance that any effect of a machine without change is reported to change, at most."),
    ]
    name_level: Annotated[
        float, means("Chance that any effect is listed that no run has, at most.")
    ]
    remarks: Words
