"""The document ``tracker_report``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from msgspec import Meta

from stepdiag_ros.schemas.parts import Text, Words, document_of, means, one_of


@dataclass(frozen=True, kw_only=True)
class Summary:
    """The first page."""

    headline: Annotated[str, Meta(min_length=1), means("In a few words.")]
    sentences: Annotated[Words, means("What stands below it.")]


@dataclass(frozen=True, kw_only=True)
class Tracker:
    """The instrument."""

    name: Annotated[str, means("In words.")]
    held_by: Annotated[
        str, one_of("table", "carriage"), means("table (workpiece side) or carriage (tool side).")
    ]
    length_noise: Annotated[
        float, Meta(ge=0), means("Standard uncertainty of a length that does not grow with it, m.")
    ]
    length_proportional: Annotated[
        float, Meta(ge=0), means("Standard uncertainty in proportion to the length, m/m.")
    ]
    places: Annotated[
        Mapping[str, Annotated[Sequence[float], Meta(min_length=3, max_length=3)]],
        means("Station → rough place of the tracker in machine coordinates, m."),
    ]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Report of a measurement with a tracker.

    Documents of other schemas are parts of it. Written by `stepdiag report` of a run with a
    tracker.
    """

    run_id: Annotated[Text, means("Identity of the run.")]
    machine: Annotated[Text, means("Its name.")]
    chain: Annotated[Text, means("Order of the axes from workpiece to tool, such as YXZ.")]
    plan: Annotated[Text, means("Its name.")]
    simulated: Annotated[bool | None, means("Whether the run was made on a simulated cell.")]
    summary: Annotated[Summary, means("The first page.")]
    measurement: Annotated[
        Any, document_of("report", "#/properties/sections/properties/measurement")
    ]
    tracker: Annotated[Tracker, means("The instrument, as the plan describes it.")]
    stations: Annotated[
        Sequence[Annotated[Any, document_of("tracker_result")]],
        means("What the seven lines of each station say; empty of a grid."),
    ]
    grid: Annotated[
        Annotated[Any, document_of("result")] | None,
        means("Error curves from the places of a grid; null of seven lines."),
    ]
