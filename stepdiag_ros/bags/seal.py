"""Seals: a detached signature by which a recording is known to be the same as when it was signed.

Checksums and counts find damage and careless changes. An attacker who changes a bag with
care also corrects them, but cannot sign without the private key. The seal of ``RUN.mcap`` is a JSON
document beside it, ``RUN.mcap.sig``: SHA-256 of the file, time, words of who sealed it, public key,
and the Ed25519 signature (RFC 8032) of all of these. It does not prove that the content is true.
"""

import base64
import binascii
import os
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from stepdiag_ros import schemas
from stepdiag_ros.bags.digest import sha256_of
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.schemas.seal import Document
from stepdiag_ros.text.intake import parse_json

SUFFIX = ".sig"
PUBLIC_SUFFIX = ".pub"
_SIGNED = ("sha256", "size", "sealed_at", "words", "public_key")
_PURPOSE = b"stepdiag_ros seal 1\n"
"""In front of what is signed: a signature for something else cannot be taken for a seal."""
_LONGEST = 100_000


@dataclass(frozen=True)
class Seal:
    """Contents of a seal, and whether it is valid.

    Attributes:
        right: the file is the one that was sealed, and the signature is by the key.
        key: the public key, base64 of its 32 bytes.
        words: of who sealed it.
        sealed_at: ISO 8601, UTC.
        problem: why it is not right, in a sentence; empty if it is.
    """

    right: bool
    key: str = ""
    words: str = ""
    sealed_at: str = ""
    problem: str = ""

    @property
    def text(self) -> str:
        """Say in words whether the seal is right, and by which key."""
        if not self.right:
            return f"WRONG: {self.problem}"
        by = f" ({self.words})" if self.words else ""
        return f"right, of {self.sealed_at} by key {self.key}{by}"

    def as_dict(self) -> dict[str, Any]:
        """Return the seal as plain data for JSON."""
        return {
            "right": self.right,
            "public_key": self.key or None,
            "words": self.words or None,
            "sealed_at": self.sealed_at or None,
            "problem": self.problem or None,
        }


def seal_path(path: Path) -> Path:
    """Return where the seal of a file is: beside it."""
    return path.with_name(path.name + SUFFIX)


def new_key(path: Path) -> Path:
    """Make a key pair: the private key, readable for its owner alone, and the public one beside it.

    Args:
        path: of the private key (PEM, PKCS #8); must not exist.

    Returns:
        Path of the public key (PEM).

    Raises:
        ValueError: one of the files exists.
        OSError: one cannot be written.
    """
    public = path.with_name(path.name + PUBLIC_SUFFIX)
    for one in (path, public):
        if one.exists():
            raise Refusal(f"{one} exists already; a key is never overwritten", fault="exists")
    key = Ed25519PrivateKey.generate()
    private_text = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    public_text = key.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    # Nobody else can read it at any moment.
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(private_text)
    public.write_bytes(public_text)
    return public


def seal(path: Path, key_path: Path, words: str = "") -> Path:
    """Seal a file.

    Args:
        path: the recording, or any other file.
        key_path: of the private key.
        words: who seals it, and why; signed as well.

    Returns:
        Path of the seal.

    Raises:
        ValueError: it is not a file, has a seal already, or the key is malformed.
        OSError: a file cannot be read or written.
    """
    if not path.is_file():
        raise ValueError(f"{path} is not a file. Seal one file at a time")
    target = seal_path(path)
    if target.exists():
        raise Refusal(
            f"{target} exists already; remove it to seal {path.name} again", fault="exists"
        )
    key = _private_key(key_path)
    content: dict[str, Any] = {
        "sha256": sha256_of(path),
        "size": path.stat().st_size,
        "sealed_at": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "words": words,
        "public_key": _base64(key.public_key()),
    }
    content["signature"] = base64.b64encode(key.sign(_signed(content))).decode()
    with target.open("x", encoding="utf-8") as file:
        file.write(schemas.json_text(schemas.document("seal", Document(**content))) + "\n")
    return target


def read_seal(path: Path) -> Seal | None:
    """Return the seal beside a file, compared with the file; None without a seal.

    Raises:
        OSError: the file or its seal cannot be read.
    """
    # A folder has no seal, and may have no name (".").
    if not path.is_file() or not (beside := seal_path(path)).exists():
        return None
    try:
        told = _document(beside)
        key = Ed25519PublicKey.from_public_bytes(base64.b64decode(told["public_key"]))
        key.verify(base64.b64decode(told["signature"]), _signed(told))
    except InvalidSignature:
        return Seal(False, problem=f"{beside}: the signature is not by the key that it names")
    except (ValueError, KeyError, TypeError, binascii.Error) as error:
        return Seal(False, problem=f"{beside} is not a seal: {str(error)[:200]}")
    made = Seal(True, told["public_key"], str(told["words"]), str(told["sealed_at"]))
    if told["size"] != path.stat().st_size or told["sha256"] != sha256_of(path):
        problem = f"{path} is not the file that was sealed on {made.sealed_at}"
        return Seal(False, made.key, made.words, made.sealed_at, problem)
    return made


def require_seal(path: Path, public_key: Path) -> Seal:
    """Return the seal of a file, if it is right and by a key.

    Args:
        path: the file.
        public_key: file of the public key that is trusted.

    Raises:
        ValueError: there is no seal, it is wrong, by another key, or the key is malformed.
        OSError: a file cannot be read.
    """
    wanted = _public_key(public_key)
    found = read_seal(path)
    if found is None:
        raise ValueError(f"{path} has no seal ({path.name}{SUFFIX}); make one: stepdiag seal")
    if not found.right:
        raise Refusal(
            f"the seal of {path} is wrong: {found.problem}", fault="mismatch", aspect="content"
        )
    if found.key != wanted:
        raise Refusal(
            f"{path} is sealed by key {found.key}, not by that of {public_key} ({wanted})",
            fault="mismatch",
            aspect="key",
        )
    return found


def _document(path: Path) -> dict[str, Any]:
    if path.stat().st_size > _LONGEST:
        raise ValueError(f"longer than {_LONGEST} bytes")
    told = parse_json(path.read_text(encoding="utf-8"), str(path))
    if not isinstance(told, dict) or told.get("schema") != schemas.identifier("seal"):
        raise ValueError(f"not of the schema {schemas.identifier('seal')}")
    return told


def _signed(content: dict[str, Any]) -> bytes:
    """Return the bytes that are signed: the same for the same content, however it is written."""
    texts = [(name, str(content[name]).encode()) for name in _SIGNED]
    # With their lengths, so that no text can be taken for the next field.
    fields = [f"{name} {len(text)} ".encode() + text + b"\n" for name, text in texts]
    return _PURPOSE + b"".join(fields)


def _private_key(path: Path) -> Ed25519PrivateKey:
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        raise Refusal(
            f"{path} is not a private key; make one: stepdiag seal --new-key",
            fault="wrong_kind",
            aspect="private key",
        ) from None
    if not isinstance(key, Ed25519PrivateKey):
        raise ValueError(f"{path} is not an Ed25519 key; make one: stepdiag seal --new-key")
    return key


def _public_key(path: Path) -> str:
    try:
        key = serialization.load_pem_public_key(path.read_bytes())
    except (ValueError, UnsupportedAlgorithm):
        raise Refusal(
            f"{path} is not a public key; 'stepdiag seal --new-key' makes one",
            fault="wrong_kind",
            aspect="public key",
        ) from None
    if not isinstance(key, Ed25519PublicKey):
        raise ValueError(f"{path} is not an Ed25519 key; 'stepdiag seal --new-key' makes one")
    return _base64(key)


def _base64(key: Ed25519PublicKey) -> str:
    raw = key.public_bytes(serialization.Encoding.Raw, serialization.PublicFormat.Raw)
    return base64.b64encode(raw).decode()
