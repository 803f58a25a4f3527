"""The document ``seal``."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from stepdiag_ros.schemas.parts import Count, means


@dataclass(frozen=True, kw_only=True)
class Document:
    """Seal of a recording.

    The detached signature that `stepdiag seal` writes beside a file. Signed are the bytes
    `stepdiag_ros seal 1` and a line feed; then for each of sha256, size, sealed_at, words and
    public_key, in this order: name, space, length of the value as UTF-8 text in bytes, space, the
    value, a line feed.
    """

    sha256: Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$"), means("SHA-256 of the file.")]
    size: Annotated[Count, means("Of the file, bytes.")]
    sealed_at: Annotated[str, means("When it was sealed, by the computer's clock, ISO 8601, UTC.")]
    words: Annotated[str, means("Of who sealed it; may be empty.")]
    public_key: Annotated[
        str,
        Meta(min_length=44, max_length=44),
        means("Ed25519 public key, base64 of its 32 bytes."),
    ]
    signature: Annotated[
        str,
        Meta(min_length=88, max_length=88),
        means("Ed25519 signature (RFC 8032), base64 of its 64 bytes."),
    ]
