"""The document ``nc_correction``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.origin import Origin
from stepdiag_ros.schemas.parts import Count, Number, Words, means, one_of


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """The error of the tool on its ways."""

    largest: Annotated[Number, means("m; null without such moves.")]
    rms: Annotated[
        Number,
        means(
            "m, over the length of the way, or over the ends of rapid moves; null without such"
            " moves."
        ),
    ]
    line: Annotated[
        int | None,
        means("Line of the original where the largest is, from 1; null without such moves."),
    ]


@dataclass(frozen=True, kw_only=True)
class Uncorrected:
    """A line that moves the axes and is passed as it is."""

    line: Annotated[int, means("Of the original, from 1.")]
    reason: Annotated[str, means("In words.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """An NC program rewritten with the errors of a machine.

    Printed by `stepdiag compensate-nc --json`.
    """

    program: Annotated[str, means("Path of the original program.")]
    program_sha256: Annotated[str, means("SHA-256 of the original program.")]
    written: Annotated[
        str | None, means("Path of the rewritten program; null if none was written.")
    ]
    origin: Annotated[Origin, means("Where the errors come from.")]
    tolerance: Annotated[
        float, means("m, that the tool may be away from its way along feed moves.")
    ]
    decimals: Annotated[Count, means("Of millimetres in the written program.")]
    outside: Annotated[
        str, one_of("refuse", "hold"), means("What happens outside the measured box.")
    ]
    changed_moves: Annotated[Count, means("Number of moves that were changed.")]
    feed_moves: Annotated[Count, means("Number of feed moves of the original.")]
    written_feed_moves: Annotated[Count, means("Number of feed moves of the rewritten program.")]
    feed_length: Annotated[float, means("m, of all feed moves.")]
    before: Annotated[Remaining, means("Error of the tool along the feed moves of the original.")]
    after: Annotated[
        Remaining,
        means(
            "Error of the tool along the feed moves of the rewritten program: distance from the"
            " place of the same part of the original's way."
        ),
    ]
    map_standard_uncertainty: Annotated[
        Number,
        means(
            "m, largest standard uncertainty of the error map itself on the ways of feed moves;"
            " null if not known."
        ),
    ]
    rapid_before: Annotated[
        Remaining,
        means("Error at the ends of the rapid moves of the original, where these are known."),
    ]
    rapid_after: Annotated[Remaining, means("The same of the rewritten program.")]
    held_lines: Annotated[
        Sequence[int], means("Lines whose way leaves the measured box, corrected as at its edge.")
    ]
    uncorrected: Annotated[
        Sequence[Uncorrected], means("Lines that move the axes and are passed as they are.")
    ]
    remarks: Annotated[Words, means("What the reader must know, in words.")]
