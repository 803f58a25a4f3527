"""The document ``fleet``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.metrology.standards.conformity import Conformity
from stepdiag_ros.schemas.parts import Count, Number, Text, Uncertainty, means, one_of

_STATES = tuple(one.name for one in Conformity)
_STATE_MEANS = (
    "ISO 14253-1. WITHIN: value + U is within the tolerance; NOT_WITHIN: value - U is beyond it;"
    " UNDECIDED: neither is proven; NOT_ASKED: no tolerance is stated."
)


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run of a machine."""

    run_id: Annotated[Text, means("Identity of the run.")]
    time: Annotated[Text, means("When it began, ISO 8601, UTC.")]
    verdict: Annotated[Text, means("Of the diagnosis, such as CONSISTENT or NAMED.")]
    largest: Annotated[Number, means("Longest error vector in the measured box, m.")]
    largest_expanded_uncertainty: Annotated[Uncertainty, means("U of `largest`, 95 %, m.")]
    problem: Annotated[Text, means("Why the run could not be evaluated; null if it was.")]
    bag: Annotated[Text, means("The bag in the archive; null if it is not there any more.")]
    report: Annotated[Text, means("Page of its report in the archive; null without a report.")]
    simulated: Annotated[
        bool | None, means("It was made in a simulated cell; null if the bag does not say so.")
    ]


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A figure of the newest run beside its tolerance."""

    name: Annotated[str, means("As in the catalogue.")]
    unit: Annotated[str, means("Of value, U and tolerance; SI.")]
    value: Annotated[Number, means("Of the newest run.")]
    expanded_uncertainty: Annotated[Uncertainty, means("U of the value, 95 %.")]
    tolerance: Annotated[float, means("Largest magnitude that the owner allows.")]
    conformity: Annotated[str, one_of(*_STATES), means(_STATE_MEANS)]


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine of the archive."""

    name: Annotated[str, means("In the archive.")]
    serial_number: Text
    state: Annotated[
        str, one_of(*_STATES), means(f"The worst of the figures that are judged; {_STATE_MEANS}")
    ]
    judged: Annotated[Sequence[Judged], means("Figures of the newest run with a tolerance.")]
    outlook: Annotated[str, means("When it leaves a tolerance, or that this is unknown, in words.")]
    changed: Annotated[Text, means("What has changed lately, or grows, in words.")]
    due: Annotated[Text, means("Date of the next run; null without an interval or a dated run.")]
    overdue: Annotated[
        bool | None, means("The next run is late; null if no interval between runs is stated.")
    ]
    runs: Annotated[Sequence[Run], means("Newest first; those without a date at the end.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """The machines of an archive as they are now.

    Written by `stepdiag fleet`; machines worst first. `stepdiag history` writes their trends.
    """

    place: Annotated[str, means("The archive.")]
    made: Annotated[str, means("When the archive was read, ISO 8601, UTC.")]
    every_days: Annotated[Count | None, means("Stated interval between runs; null without one.")]
    machines: Sequence[Machine]
