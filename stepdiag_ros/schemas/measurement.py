"""The document ``measurement``."""

from dataclasses import dataclass
from typing import Annotated, Any

from msgspec import UNSET, UnsetType

from stepdiag_ros.schemas.parts import Count, Words, document_of, means, one_of


@dataclass(frozen=True, kw_only=True)
class Document:
    """Result of a run on nodes that were running already.

    Printed by `stepdiag measure --json`.
    """

    run_id: Annotated[str, means("Identity of the run.")]
    outcome: Annotated[
        str,
        one_of("finished", "aborted"),
        means("finished: all lines are measured; aborted: the run was ended before."),
    ]
    text: Annotated[str, means("How the run ended, in words.")]
    stops_done: Annotated[Count, means("Settled stops in the whole run.")]
    stops_total: Annotated[Count, means("Stops in the whole plan.")]
    incomplete: Annotated[Words, means("Lines of which a stop has no value, with the reason.")]
    verdict: Annotated[
        str,
        means(
            "Of the diagnosis of the whole run: CONSISTENT, NAMED, AMBIGUOUS, DESCRIBED,"
            " UNEXPLAINED or NOT TESTABLE; UNKNOWN without a diagnosis."
        ),
    ]
    sentence: Annotated[str, means("The verdict in words, or why it is missing.")]
    bag: Annotated[
        str | None, means("Path of the bag on the computer of the recorder; null if not known.")
    ]
    bag_closed: Annotated[bool, means("All of the run is in the bag, and the bag is whole.")]
    bag_text: Annotated[str, means("What became of the bag, in words.")]
    lead: (
        Annotated[
            Any,
            document_of("lead"),
            means(
                "Summary of the run, with the largest error as the solver published it; documents"
                " of earlier versions lack it."
            ),
        ]
        | UnsetType
    ) = UNSET
