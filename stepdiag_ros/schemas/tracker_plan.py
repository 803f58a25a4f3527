"""The document ``tracker_plan``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from stepdiag_ros.schemas.parts import Count, Words, means


@dataclass(frozen=True, kw_only=True)
class Duration:
    """How long a station takes."""

    tracker: Annotated[float, Meta(ge=0), means("With the tracker, setting it up included, s.")]
    laser: Annotated[
        float, Meta(ge=0), means("With a conventional laser, aligned for each line, s.")
    ]


@dataclass(frozen=True, kw_only=True)
class Document:
    """A plan for a tracker, as written.

    Printed by `stepdiag tracker plan --json`.
    """

    files: Annotated[Words, means("Paths.")]
    places: Annotated[Count, means("Number of readings planned.")]
    durations: Annotated[
        Sequence[Duration | None],
        means(
            "Of each station's seven-line test, s; empty for a grid. null: not known, because there"
            " is no way in sight of the tracker."
        ),
    ]
