"""The document ``export``."""

from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.parts import Words, means


@dataclass(frozen=True, kw_only=True)
class Document:
    """Tables of a bag, as written.

    Printed by `stepdiag export --json`.
    """

    bag: str
    files: Annotated[Words, means("Paths.")]
    remarks: Words
