"""What the lines show of each error, as a part of several documents."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from stepdiag_ros.schemas.parts import Text, Uncertainty, Words, means, one_of


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the lines show of one error."""

    status: Annotated[str, one_of("determined", "partly determined", "confounded", "invisible")]
    words: Annotated[str, Meta(min_length=1)]
    part: Annotated[Text, means("What of it is determined; null unless partly.")]
    confounded_with: Annotated[
        Words, means("What can do the same as that which is not determined.")
    ]
    unit: Annotated[str, Meta(min_length=1), means("Of the uncertainties.")]
    standard_uncertainty_at_end: Annotated[Uncertainty, means("At the last node.")]
    largest_standard_uncertainty: Annotated[
        Uncertainty,
        means(
            "Over the determined nodes; of the deviations from the line where only the shape is"
            " determined."
        ),
    ]
    inflation: Annotated[
        Uncertainty, means("Factor of the largest uncertainty over that with all else known.")
    ]


@dataclass(frozen=True, kw_only=True)
class Visibility:
    """What the lines show of each error where all of them are free at every node."""

    chain: Annotated[Text, means("For which it holds; null: translations only.")]
    stop_uncertainty: Annotated[
        Uncertainty, means("Standard uncertainty of a stop, root mean square, m.")
    ]
    readings: Annotated[int, Meta(ge=1), means("Number of stops.")]
    unknowns: Annotated[int, Meta(ge=1)]
    rank: Annotated[
        int, Meta(ge=1), means("Number of independent sums of the unknowns that are determined.")
    ]
    condition_number: Annotated[Uncertainty, means("Of the determined part of the problem.")]
    errors: Annotated[
        Mapping[str, Verdict],
        Meta(min_length=12),
        means("ISO 230-1 name to the verdict."),
    ]
