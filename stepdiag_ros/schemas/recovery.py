"""The document ``recovery``."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.parts import Count, Uncertainty, Words, means


@dataclass(frozen=True, kw_only=True)
class Document:
    """What was saved from a damaged bag.

    Printed by `stepdiag recover --json`.
    """

    source: str
    target: str
    source_was_closed: bool
    messages: Annotated[Count, means("Saved.")]
    messages_lost: Count
    lost_is_known: Annotated[bool, means("The number of lost messages is exact.")]
    damaged_chunks: Count
    unreadable_bytes: Count
    attachments: Count
    topics: Annotated[Mapping[str, Count], means("Full name of the topic to messages saved.")]
    duration_s: Annotated[Uncertainty, means("s.")]
    losses: Words
