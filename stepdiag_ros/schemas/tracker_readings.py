"""The document ``tracker_readings``."""

from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.parts import Count, means


@dataclass(frozen=True, kw_only=True)
class Document:
    """Simulated tracker readings, as written.

    Printed by `stepdiag tracker simulate --json`.
    """

    table: Annotated[str, means("Path.")]
    readings: Count
