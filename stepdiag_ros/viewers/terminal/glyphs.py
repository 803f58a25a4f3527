"""The signs that a terminal can show, and small drawings made of them."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

_INSTEAD = str.maketrans(
    {
        "µ": "u",
        "μ": "u",
        "±": "+-",
        "°": "deg ",
        "×": "x",
        "·": "-",
        "–": "-",
        "—": "-",
        "…": "...",
        "χ": "chi",
        "σ": "sigma",
        "≤": "<=",
        "≥": ">=",
        "‘": "'",
        "’": "'",
        "“": '"',
        "”": '"',
    }
)


@dataclass(frozen=True)
class Glyphs:
    """What is drawn with.

    Attributes:
        ascii_only: the terminal shows no other signs.
        levels: of a row of values, from the lowest to the highest.
        full: of a bar, what is reached.
        empty: of a bar, what is left.
        ellipsis: where something is left out.
        rule: of a line across.
    """

    ascii_only: bool
    levels: str
    full: str
    empty: str
    ellipsis: str
    rule: str

    def text(self, text: str) -> str:
        """Return a text as this terminal can show it, on one line.

        What steers a terminal is taken out: any participant of the ROS graph may send texts.
        """
        shown = "".join(sign if sign.isprintable() else " " for sign in text)
        if not self.ascii_only or shown.isascii():
            return shown
        decomposed = unicodedata.normalize("NFKD", shown.replace("°C", "C").translate(_INSTEAD))
        without_accents = "".join(sign for sign in decomposed if not unicodedata.combining(sign))
        return without_accents.encode("ascii", "replace").decode("ascii")

    def readable(self, document: Any) -> Any:
        """Return a document with all its texts as this terminal can show them."""
        if isinstance(document, str):
            return self.text(document)
        if isinstance(document, dict):
            return {key: self.readable(value) for key, value in document.items()}
        if isinstance(document, (list, tuple)):
            return [self.readable(value) for value in document]
        return document

    def bar(self, share: float, width: int) -> str:
        """Return a bar that is filled to a share (0..1)."""
        inside = max(1, width - 2)
        reached = min(inside, max(0, round(share * inside)))
        return f"[{self.full * reached}{self.empty * (inside - reached)}]"

    def row(self, values: Sequence[float | None]) -> str:
        """Return a sign for each value, between the lowest and the highest; ``?`` if not known."""
        known = [value for value in values if value is not None]
        if not known:
            return "?" * len(values)
        low, high = min(known), max(known)
        steps = (len(self.levels) - 1) / (high - low) if high > low else 0.0
        return "".join(
            "?" if value is None else self.levels[round((value - low) * steps)] for value in values
        )


UNICODE = Glyphs(False, "▁▂▃▄▅▆▇█", "█", "░", "…", "─")
ASCII = Glyphs(True, "12345678", "#", ".", "...", "-")


def glyphs_for(encoding: str) -> Glyphs:
    """Return the signs that an output of this encoding can show."""
    return UNICODE if encoding.lower().startswith("utf") else ASCII
