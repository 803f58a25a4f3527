"""The document ``by_hand``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.parts import Count, Words, means


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recording of readings."""

    file: Annotated[str, means("Path of the file.")]
    readings: Annotated[Count, means("Number of its readings.")]
    rests: Annotated[Count, means("Number of times at which the mirror stood still.")]
    hint: Annotated[str, means("What may be wrong with the whole recording; empty if nothing is.")]


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line that was looked for."""

    line: Annotated[str, means("Which pass, in words.")]
    line_index: Annotated[Count, means("Line of the plan, from 0.")]
    found: Annotated[bool, means("The line was measured.")]
    complete: Annotated[bool, means("Every stop of it has a value.")]
    refusal: Annotated[str, means("Why there is no result; empty if there is one.")]
    remarks: Annotated[
        Words, means("Other findings in it: stops missed or doubled, rests that are not stops.")
    ]


@dataclass(frozen=True, kw_only=True)
class Document:
    """A run found in recordings of readings alone.

    Printed by `stepdiag by-hand --json`.
    """

    bag: Annotated[str, means("Path of the bag that was made.")]
    run_id: Annotated[
        str, means("Identity of the run in it; the same for the same recordings and plan.")
    ]
    recordings: Annotated[
        Sequence[Recording], means("What was evaluated, in order of measurement.")
    ]
    lines: Annotated[Sequence[Line], means("The lines that were looked for, in order.")]
    remarks: Annotated[Words, means("All remarks, one sentence each.")]
