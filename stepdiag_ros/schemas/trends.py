"""The document ``trends``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import UNSET, UnsetType

from stepdiag_ros.metrology.trends.crossing import Outlook
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
class Change:
    """A change of a figure."""

    kind: Annotated[
        str,
        one_of("step", "bend", "alone"),
        means("step: of the level; bend: of the trend; alone: a run that differs from all others."),
    ]
    not_before: Annotated[str, means("Last run before which it was not yet (95 %), ISO 8601, UTC.")]
    not_after: Annotated[str, means("First run at which it surely was, ISO 8601, UTC.")]
    size: Annotated[Number, means("In the unit of the figure; of a bend per year.")]
    expanded_uncertainty: Annotated[Uncertainty, means("U of the size, 95 %.")]
    e_n: Annotated[Uncertainty, means("Magnitude of the size over its U.")]


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """When a figure leaves its tolerance, if nothing changes."""

    outlook: Annotated[
        str,
        one_of(*(one.name for one in Outlook)),
        means("; ".join(f"{one.name}: {one.value}" for one in Outlook) + "."),
    ]
    earliest: Annotated[Text, means("Lower end of the 90 % interval, a date; null if not known.")]
    latest: Annotated[Text, means("Upper end of the interval, a date; null if not known.")]


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of a machine over its runs."""

    kind: Annotated[str, means("As in the catalogue: result, volume or effect.")]
    name: Annotated[str, means("As in the catalogue.")]
    unit: Annotated[str, means("Of all values; SI.")]
    times: Annotated[Sequence[str], means("When each run was made, ISO 8601, UTC.")]
    values: Annotated[Numbers, means("Of each run.")]
    expanded_uncertainties: Annotated[Numbers, means("U of each value, 95 %.")]
    adjusted: Annotated[
        Numbers, means("Values without temperature, season and instrument; empty if unknown.")
    ]
    line: Annotated[Numbers, means("Level at each run; empty if unknown.")]
    line_expanded_uncertainties: Annotated[Numbers, means("U of the line, 95 %.")]
    other_methods: Annotated[Count, means("Runs left out, since another method solved them.")]
    other_boxes: (
        Annotated[
            Count,
            means(
                "Runs left out, since they measured another box than the newest; 0 of figures that"
                " do not depend on the box."
            ),
        ]
        | UnsetType
    ) = UNSET
    unknown: Annotated[
        Text,
        one_of("runs", "time", None),
        means("Why nothing is known: too few runs, or all of one time; null if it is known."),
    ]
    level: Annotated[Number, means("At the last run.")]
    level_expanded_uncertainty: Uncertainty
    slope: Annotated[Number, means("Change per year (365.2425 days).")]
    slope_expanded_uncertainty: Uncertainty
    grows: Annotated[bool, means("Its magnitude grows, beyond U.")]
    per_kelvin: Annotated[Number, means("Change with the temperature of the machine.")]
    per_kelvin_expanded_uncertainty: Uncertainty
    temperature_degC: Annotated[Number, means("Mean, at which the level holds.")]  # noqa: N815
    between_runs: Annotated[
        Uncertainty, means("Standard deviation from run to run, beyond the runs' own uncertainty.")
    ]
    degrees_of_freedom: Annotated[Count, means("That the uncertainties rest on.")]
    limits: Annotated[
        Numbers, means("Control limits of the next adjusted value, 99.73 %, lower and upper.")
    ]
    left_out: Annotated[Words, means("What the runs do not determine.")]
    changes: Annotated[Sequence[Change], means("In the order of their dates.")]
    tolerance: Annotated[Number, means("Largest magnitude that the owner allows.")]
    crossing: Crossing


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine over its runs."""

    name: Annotated[str, means("In the archive.")]
    runs: Annotated[Count, means("With a date and a figure.")]
    first: Annotated[str, means("When the first was made, ISO 8601, UTC.")]
    last: Annotated[str, means("When the last was made, ISO 8601, UTC.")]
    instruments: Annotated[Words, means("That measured it: serial numbers or names.")]
    scale_known: Annotated[
        bool, means("The uncertainty of the scale of each instrument is stated and contained.")
    ]
    without_temperature: Annotated[Count, means("Runs whose bag states no temperature.")]
    figures: Sequence[Figure]
    remarks: Words


@dataclass(frozen=True, kw_only=True)
class Document:
    """What the years of machines show.

    Written by `stepdiag history`; machines worst first.
    """

    place: Annotated[str, means("The archive.")]
    change_level: Annotated[
        Chance, means("Chance that any change of a machine without change is reported, at most.")
    ]
    machines: Sequence[Machine]
