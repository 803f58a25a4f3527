"""Which known name somebody meant who misspelt it, and how that is asked."""

from collections.abc import Iterable
from difflib import get_close_matches

_LIKENESS = 0.66
"""Ordinary least likeness: that of two names of three letters, of which two are exchanged."""


def nearest(name: object, known: Iterable[str], likeness: float = _LIKENESS) -> str:
    """Return the known name that another is a misspelling of; empty where none is near.

    Args:
        name: as it was typed.
        known: the right names.
        likeness: least part of the two names that is alike, 0 to 1 (``difflib``).
    """
    return next(iter(get_close_matches(str(name), list(known), n=1, cutoff=likeness)), "")


def suggestion(near: str, otherwise: str = "") -> str:
    """Return the question whether a known name was meant.

    Args:
        near: that name; empty where none is near.
        otherwise: the words to return then.
    """
    return f"did you mean '{near}'?" if near else otherwise
