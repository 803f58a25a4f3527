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
            "For each topic, whether the messages of the nodes equal the recording bit for bit;"
            " empty without --check."
        ),
    ]
    differences: Annotated[Mapping[str, str], means("Topic to what differs.")]
