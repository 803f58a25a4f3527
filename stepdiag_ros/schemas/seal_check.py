"""The document ``seal_check``."""

from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.parts import means


@dataclass(frozen=True, kw_only=True)
class Seal:
    """The seal beside a file."""

    right: Annotated[
        bool, means("The file is the one that was sealed, and the signature is by the key.")
    ]
    public_key: Annotated[
        str | None, means("Ed25519 public key of the seal, base64 of its 32 bytes.")
    ]
    words: Annotated[str | None, means("Of who sealed it.")]
    sealed_at: Annotated[str | None, means("When it was sealed, ISO 8601, UTC.")]
    problem: Annotated[str | None, means("Why the seal is not right, in a sentence.")]


@dataclass(frozen=True, kw_only=True)
class Document(Seal):
    """Whether a seal is right.

    Printed by `stepdiag seal RUN.mcap --json`.
    """
