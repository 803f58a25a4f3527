"""The blocks of an NC program (ISO 6983-1): words, comments and what stands between them.

A block is kept with every sign of its line, so that what is not changed is written again as it was.
"""

import re
from dataclasses import dataclass
from typing import NamedTuple

from stepdiag_ros.metrology.refusal import Fault, Refusal

_WORD = re.compile(r"([A-Za-z])[ \t]*([+-]?(?:\d+\.?\d*|\.\d+))")
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_SPACE = re.compile(r"[ \t]+")
_PROGRAM_NUMBER = re.compile(r"[ \t]*[O:]\d+[ \t]*", re.IGNORECASE)


class NcError(Refusal):
    """A program is refused; the text names the file, the line and the reason."""


class Word(NamedTuple):
    """One word: its letter, its number, and the text of the number."""

    letter: str
    value: float
    text: str

    @property
    def code(self) -> str:
        """Return the word as a code, for example ``G1`` or ``G43.1``."""
        return f"{self.letter}{self.value:g}"


@dataclass(frozen=True)
class Block:
    """One line of a program.

    Attributes:
        number: line of the file, from 1.
        text: the line as it is, without its end.
        words: in their order, capital letters.
        comments: as they are, in their order.
        skipped: it begins with ``/``: an operator's switch says whether it is executed.
        bare: it has no words: empty, a comment, ``%`` or the number of the program.
        mark: what a bare line is beside its comments: ``%``, or the number of the program.
    """

    number: int
    text: str
    words: tuple[Word, ...]
    comments: tuple[str, ...]
    skipped: bool
    bare: bool
    mark: str = ""

    def get(self, letter: str) -> float | None:
        """Return the number of a word; None if the block does not have it."""
        return next((word.value for word in self.words if word.letter == letter), None)

    def has(self, letters: str) -> bool:
        """Say whether the block has a word with one of the letters."""
        return any(word.letter in letters for word in self.words)

    @property
    def codes(self) -> tuple[str, ...]:
        """Return the block's G codes, in their order."""
        return tuple(word.code for word in self.words if word.letter == "G")


def blocks_of(text: str, source: str) -> list[Block]:
    """Return the blocks of a program, one for each line.

    Args:
        text: of the program.
        source: what the user calls it.

    Raises:
        NcError: a line is not a block of words, or has a word twice; macros and subprograms are
            such.
    """
    return [
        _block(line, number, source)
        for number, line in enumerate(re.split(r"\r\n|\n|\r", text), start=1)
    ]


def refusal(
    source: str, number: int, reason: str, fault: Fault | None = None, aspect: str = ""
) -> NcError:
    """Return the error that refuses a program because of one line."""
    return NcError(
        f"{source}, line {number}: {reason}", fault=fault, where=source, row=number, aspect=aspect
    )


def _block(line: str, number: int, source: str) -> Block:
    comments = tuple(found.group(0) for found in _COMMENT.finditer(line))
    rest = _COMMENT.sub(" ", line)
    if rest.strip() in ("", "%") or _PROGRAM_NUMBER.fullmatch(rest):
        return Block(number, line, (), comments, skipped=False, bare=True, mark=rest.strip())
    if "(" in rest or ")" in rest:
        raise refusal(
            source,
            number,
            "a comment is not closed or stands in another one",
            fault="malformed",
            aspect="comment",
        )
    skipped = rest.lstrip().startswith("/")
    rest = rest.lstrip().removeprefix("/") if skipped else rest
    words = []
    place = 0
    while place < len(rest):
        space = _SPACE.match(rest, place)
        if space:
            place = space.end()
            continue
        found = _WORD.match(rest, place)
        if not found:
            shown = rest[place:].strip()[:30]
            raise refusal(
                source,
                number,
                f"'{shown}' is not a letter followed by a number; macros, variables and calls of"
                " subprograms cannot be corrected",
                fault="malformed",
                aspect="word",
            )
        words.append(Word(found[1].upper(), float(found[2]), found[2]))
        place = found.end()
    letters = [word.letter for word in words if word.letter not in "GM"]
    for letter in letters:
        if letters.count(letter) > 1:
            raise refusal(source, number, f"the word {letter} is there twice", fault="twice")
    return Block(number, line, tuple(words), comments, skipped, bare=not words)
