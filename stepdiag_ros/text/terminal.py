"""Sentences on a terminal: a line ends between two words, never in a path or a number."""

import os
from textwrap import wrap
from typing import IO


def columns(stream: IO[str]) -> int | None:
    """Return how many columns a stream shows; None if it is not a terminal."""
    try:
        return os.get_terminal_size(stream.fileno()).columns or None
    except (OSError, ValueError):
        return None


def fitted(text: str, width: int | None, indent: str = "") -> str:
    """Return a text with line ends where a terminal would break it in the middle of a word.

    Args:
        text: sentences; their own line ends stay.
        width: columns of the terminal; None to leave the text as it is.
        indent: of all lines but the first.
    """
    if width is None:
        return text
    lines = [
        wrap(
            line,
            width,
            subsequent_indent=indent,
            break_long_words=False,
            break_on_hyphens=False,
            replace_whitespace=False,
        )
        or [""]
        for line in text.split("\n")
    ]
    return "\n".join(part for parts in lines for part in parts)
