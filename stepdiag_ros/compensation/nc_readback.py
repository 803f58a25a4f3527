"""A rewritten NC program, read once more: beside its moves it does what the original does.

Only coordinates, the codes of straight moves and comments about the origin may differ from the
original. Whatever else acts (spindle, tools, coolant, stops, modes) stands there as often as it did
in the line that it comes from.
"""

import re
from collections import Counter

from stepdiag_ros.compensation.nc_reading import MOTIONS
from stepdiag_ros.compensation.nc_rewrite import COMMENT, Rewritten
from stepdiag_ros.compensation.nc_words import Block, NcError, blocks_of, refusal
from stepdiag_ros.metrology.refusal import Fault
from stepdiag_ros.text.controls import FARTHEST

SOURCE = "the rewritten program"


def refuse_foreign_words(original: str, rewritten: Rewritten) -> None:
    """Refuse a rewritten program that does anything beside the moves of the original.

    Args:
        original: text of the program.
        rewritten: what was made of it.

    Raises:
        NcError: a line is not a block, has a word or comment that its original lacks, or a
            coordinate beyond what a control takes; names the line.
    """
    source = blocks_of(original, "the original")
    made = blocks_of(rewritten.text, SOURCE)
    owned: set[int] = set()
    for block, (first, count) in zip(source, rewritten.lines, strict=True):
        lines = made[first - 1 : first - 1 + count]
        owned.update(one.number for one in lines)
        if _acting(lines) != _acting([block]):
            raise _foreign(
                lines[0],
                f"it is not what line {block.number} of the original does",
                fault="mismatch",
                aspect="line",
            )
        for one in lines:
            _refuse_far(one)
    for block in made:
        if block.number not in owned and not re.fullmatch(COMMENT.pattern, block.text):
            raise _foreign(
                block,
                "it is neither a comment nor does it replace a line of the original",
                fault="too_many",
                aspect="comment",
            )


def _acting(blocks: list[Block]) -> tuple[Counter[str], tuple[str, ...], tuple[str, ...]]:
    """Return what lines do and say beside their moves: words, comments and marks.

    ``G53`` holds for one line alone, so that it stands in each piece of a move.
    """
    words = Counter(
        f"{word.letter}{word.text}"
        for block in blocks
        for word in block.words
        if word.letter not in "XYZIJKR" and word.code not in (*MOTIONS, "G53")
    )
    comments = tuple(comment for block in blocks for comment in block.comments)
    marks = tuple(block.mark + "/" * block.skipped for block in blocks)
    return words, comments, tuple(filter(None, marks))


def _refuse_far(block: Block) -> None:
    for word in block.words:
        # In either unit; whoever programs in inches has the shorter reach.
        if word.letter in "XYZ" and not abs(word.value) <= FARTHEST * 1e3:
            raise _foreign(
                block,
                f"{word.letter} is {word.value:g}, beyond what a control takes",
                fault="out_of_range",
                aspect="position",
            )


def _foreign(block: Block, why: str, fault: Fault, aspect: str) -> NcError:
    return refusal(SOURCE, block.number, f"{why}; nothing is written", fault, aspect)
