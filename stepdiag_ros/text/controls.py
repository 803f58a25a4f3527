"""Text for a file that a control reads: comments that stay comments, and nothing beside our own.

A comment names where a file comes from: names of files, plans and machines, versions, verdicts. All
of it comes from a bag or from a user, who may be mistaken or hostile. ``Comment`` writes it so that
no control takes any of it for more than a comment; ``refuse_foreign`` reads a whole file once more
before it is put in place, and lets no line pass that this package does not write.
"""

import re
import textwrap
import unicodedata
from dataclasses import dataclass

from stepdiag_ros.metrology.refusal import Refusal

FARTHEST = 99.999999
"""m: the largest coordinate of an axis in millimetres with increments of 1 µm, which have eight
digits (FANUC, Series 0i Operator's Manual, "Maximum stroke", IS-B)."""
NUMBER = r"[+-]?[0-9]{1,5}(?:\.[0-9]{0,9})?"
"""Pattern of a number within that range, in mm."""
_LONGEST = 480
"""Characters of one text in a comment; the documents beside a file have all of it."""
_WORDS_INSTEAD = str.maketrans(
    {"µ": "u", "μ": "u", "–": "-", "—": "-", "−": "-", "×": "x", "°": " deg ", "%": " percent "}
    | {"(": "[", ")": "]", "{": "[", "}": "]", ";": ","}
)
_LESS = {":": " -", "_": "-"}
"""What stands in for signs that not every control takes."""
_ACTIVE = re.compile("(?i:abort|axis|debug|include|log|msg|print|probe|py|web)")
"""How a comment may begin that acts: LinuxCNC and its kin execute ``(MSG,…)``, ``(DEBUG,…)``,
``(PRINT,…)``, ``(LOGOPEN,…)``, ``(PROBEOPEN …)``, ``(ABORT,…)``, ``(AXIS,…)`` and ``(PY,…)``
(LinuxCNC, "G-Code Overview", section "Comments"), and INI files of LinuxCNC have ``#INCLUDE``."""


def printable(text: str) -> str:
    """Return a text as it may be shown, with its line feeds.

    A blank stands in for other line breaks, control characters (which steer a terminal), marks that
    change the direction of writing, and characters that Unicode does not define.
    """
    return "".join(c if c.isprintable() or c == "\n" else " " for c in text)


def one_line(text: str) -> str:
    """Return a text as one line that may be shown; see ``printable``."""
    return " ".join(printable(text).split())


@dataclass(frozen=True)
class Comment:
    """How the comments of a kind of file look.

    Attributes:
        opening: before the text.
        closing: behind it; empty where a comment ends with its line.
        signs: characters beside ASCII letters, digits and blanks that no control of this kind takes
            for anything else within a comment.
        capitals: letters are capitals, which are all that some controls have.
        width: of the text, in characters; longer texts go on in the next line.
    """

    opening: str
    closing: str = ""
    signs: str = ".,+-/=[]:_"
    capitals: bool = False
    width: int = 100

    def text(self, text: str) -> str:
        """Return a text as it may stand in a comment, on one line: ASCII, and harmless.

        Letters lose their accents. Characters that a comment must not have become the nearest one
        that it may have, or a blank.
        """
        less = {ord(c): other for c, other in _LESS.items() if c not in self.signs}
        signs = _WORDS_INSTEAD | less
        readable = unicodedata.normalize("NFKD", one_line(text).translate(signs))
        # What is taken apart may show the characters once more that were replaced.
        letters = readable.translate(signs).encode("ascii", "ignore").decode("ascii")
        letters = letters.upper() if self.capitals else letters
        return " ".join(
            "".join(c if c.isalnum() or c in self.signs else " " for c in letters).split()
        )

    def lines(self, text: str) -> list[str]:
        """Return the comment lines of a text, without line ends; none for an empty one."""
        whole = self.text(text)
        short = whole if len(whole) <= _LONGEST else f"{whole[:_LONGEST]}..."
        return [
            f"{self.opening}{'- ' if _ACTIVE.match(part) else ''}{part}{self.closing}"
            for part in textwrap.wrap(short, self.width)
        ]

    @property
    def pattern(self) -> str:
        """Return the pattern of one comment line."""
        opening, closing = re.escape(self.opening), re.escape(self.closing)
        allowed = rf"[A-Za-z0-9 {re.escape(self.signs)}]"
        return rf"{opening}(?!{_ACTIVE.pattern}){allowed}{{0,{self.width + 2}}}{closing}"


def refuse_foreign(name: str, text: str, *known: str) -> None:
    """Refuse a file that has a line which this package does not write.

    Args:
        name: of the file.
        text: of the file; every line ends with a line feed.
        known: patterns of the lines that it may have.

    Raises:
        ValueError: a line fits none of the patterns; names file and line.
    """
    allowed = re.compile("|".join(f"(?:{one})" for one in known))
    for number, line in enumerate(text.removesuffix("\n").split("\n"), start=1):
        if not allowed.fullmatch(line):
            raise Refusal(
                f"{name} line {number} would be '{one_line(line)[:60]}', which does not belong in"
                " such a file, so nothing is written. Report this with the measurement",
                fault="rejected",
            )
