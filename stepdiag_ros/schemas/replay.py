"""The document ``replay``."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.parts import Count, means


@dataclass(frozen=True, kw_only=True)
class Document:
    """A replay into live nodes.

    Printed by `stepdiag replay --json`.
    """

    bag: str
    messages: Annotated[Count, means("Replayed.")]
    recorded_seconds: Annotated[float, means("s.")]
    real_seconds: Annotated[float, means("s.")]
    same: Annotated[
        Mapping[str, bool],
        means(
            "Topic to whether what the nodes made equals the recording to the last bit; empty"
            " without --check."
        ),
    ]
    differences: Annotated[Mapping[str, str], means("Topic to what differs.")]
