"""A file that another program wrote: its bytes, its text, and the numbers in it."""

import hashlib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.header import Attachment
from stepdiag_ros.bags.table_rows import refusal

PREFIX = "source/"
"""In front of the names of the files that an imported bag was made from."""
LARGEST = 512 * 1024 * 1024
"""Bytes; a file of results is far smaller, and a bag carries it whole."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"\d{1,9}")
_MEDIA_TYPES = {".csv": "text/csv", ".txt": "text/plain", ".rtl": "text/plain"}
_UNKNOWN_MEDIA_TYPE = "application/octet-stream"
# How a file begins that is not text, and what it is then.
_EXPORT = (
    "no text; its layout is not public: export the test as text (.rtl or CSV) from the program that"
    " made it"
)
_CONTAINERS = {
    b"PK\x03\x04": f"a zip archive, {_EXPORT}",
    b"\xd0\xcf\x11\xe0": f"a document of an old office program, {_EXPORT}",
    b"SQLite format 3": f"a database, {_EXPORT}",
    b"\x89MCAP": "a bag already, with nothing to import. Give it to 'stepdiag solve', 'stepdiag"
    " diagnose' or 'stepdiag report'",
}
_FALLBACK = "cp1252"


@dataclass(frozen=True)
class SourceFile:
    """A file to import.

    Attributes:
        path: of the file.
        data: its bytes, as they are.
    """

    path: Path
    data: bytes

    @property
    def name(self) -> str:
        """Return what the user calls it, for the text of an error."""
        return str(self.path)

    @property
    def sha256(self) -> str:
        """Return the SHA-256 of the bytes, hexadecimal."""
        return hashlib.sha256(self.data).hexdigest()

    def attachment(self) -> Attachment:
        """Return the file as an attachment of a bag, byte for byte."""
        media_type = _MEDIA_TYPES.get(self.path.suffix.lower(), _UNKNOWN_MEDIA_TYPE)
        return Attachment(PREFIX + self.path.name, media_type, self.data)

    def text(self, encoding: str = "") -> "SourceText":
        """Return the file as text.

        Args:
            encoding: a name that Python knows. Without one: what a byte order mark says, else
                UTF-8, else Windows-1252, with a remark.

        Raises:
            TableError: it is not text, or none in this encoding.
        """
        for beginning, what in _CONTAINERS.items():
            if self.data.startswith(beginning):
                raise TableError(f"{self.name} is {what}", fault="wrong_kind", aspect="layout")
        remarks: tuple[str, ...] = ()
        if encoding:
            found = self._decoded(encoding)
        elif self.data.startswith((b"\xff\xfe", b"\xfe\xff")):
            found = self._decoded("utf-16")
        else:
            try:
                found = self.data.decode("utf-8-sig")
            except UnicodeDecodeError:
                found = self.data.decode(_FALLBACK, errors="replace")
                remarks = (
                    "the text is not UTF-8 and was read as Windows-1252; if names look wrong, say"
                    " which encoding it has (--encoding)",
                )
        self._refuse_binary(found)
        return SourceText(self.name, found, remarks)

    def _decoded(self, encoding: str) -> str:
        try:
            return self.data.decode(encoding).lstrip("\ufeff")
        except (LookupError, ValueError):
            raise TableError(
                f"{self.name} is not text in the encoding '{encoding}'", fault="malformed"
            ) from None

    def _refuse_binary(self, text: str) -> None:
        for number, line in enumerate(text.splitlines() or [""], start=1):
            if any(ord(sign) < 32 and sign not in "\t\f" for sign in line):
                raise refusal(
                    self.name,
                    number,
                    "it contains characters that are not text; the file is binary",
                    fault="wrong_kind",
                    aspect="text",
                )


@dataclass(frozen=True)
class SourceText:
    """The text of a file.

    Attributes:
        name: what the user calls the file.
        text: all of it.
        remarks: what the reader must know about how it was read.
    """

    name: str
    text: str
    remarks: tuple[str, ...] = ()

    def lines(self) -> Iterator[tuple[int, str]]:
        """Go through the lines: number from 1, and the line without its end."""
        # Not splitlines(), which counts signs as ends of lines that no editor does.
        yield from enumerate(re.split(r"\r\n|\n|\r", self.text), start=1)


def read_source(path: str | Path) -> SourceFile:
    """Read a file.

    Raises:
        TableError: not there, empty, too large, or it cannot be read.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise TableError(f"{path} is a folder; name a file in it")
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except FileNotFoundError:
        raise TableError(f"there is no file {path}", fault="not_found") from None
    except (OSError, ValueError) as error:
        raise TableError(f"{path} cannot be read: {error}", fault="unreadable") from None
    if len(data) > LARGEST:
        raise TableError(
            f"{path} is larger than {LARGEST >> 20} MiB; so it is not a file of results"
        )
    if not data.strip():
        raise TableError(f"{path} is empty, so it contains no measurement", fault="too_few")
    return SourceFile(path, data)


_SIGNS = {".": "point", ",": "comma"}


def number_in(
    text: str, source: str, row: int, what: str, decimal: str = ".", by: str = "--decimal"
) -> float:
    """Return the number in a text.

    Args:
        text: digits, with one decimal sign at most.
        source: of the file, for the text of an error.
        row: line of the file.
        what: the number is, in words.
        decimal: ``.`` or ``,``.
        by: option, or key of the mapping file, that states the decimal sign.

    Raises:
        TableError: it is not a finite number; names file and row.
    """
    plain = text.strip()
    other = "," if decimal == "." else "."
    if decimal == "," and other not in plain:
        plain = plain.replace(",", ".")
    elif decimal == ",":
        plain = ""
    if not _NUMBER.fullmatch(plain) or not math.isfinite(float(plain)):
        # A text with digits is meant as a number, and the sign in it may be the fault.
        hint = f" with a decimal {_SIGNS[decimal]}" if re.search(r"\d", text) else ""
        if re.fullmatch(rf"[+-]?\d*\{other}\d+", text.strip()):
            sign = _SIGNS[other]
            hint += f"; it has a decimal {sign}: say so with {by.format(sign=sign)}"
        shown = f"'{_short(text)}'" if text.strip() else "empty"
        raise refusal(source, row, f"{what} is {shown}, expected a number{hint}", fault="malformed")
    return float(plain)


def whole_in(text: str, source: str, row: int, what: str, low: int = 0) -> int:
    """Return the whole number in a text, at least ``low``; else raise ``TableError``."""
    if not _WHOLE.fullmatch(text.strip()) or int(text) < low:
        raise refusal(
            source,
            row,
            f"{what} is '{_short(text)}', expected a whole number from {low}",
            fault="malformed",
        )
    return int(text)


def _short(text: str) -> str:
    text = text.strip()
    return text if len(text) <= 40 else f"{text[:40]}…"
