"""Places of figures in a printed page: their size there, in which words keep their own size."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

WIDTH = 7.2
"""Of a figure by itself, inches: the text width of a page of A4."""


class Place(NamedTuple):
    """Where a figure is printed in a page.

    Attributes:
        share: of the text width of the page, greater than 0 and at most 1.
        flatness: height of a panel, as a share of its height in a figure by itself.
    """

    share: float = 1.0
    flatness: float = 1.0

    @property
    def width(self) -> float:
        """Return the width of the figure, inches."""
        return self.share * WIDTH

    @property
    def narrow(self) -> bool:
        """Say whether only short words have room."""
        return self.share < WIDE.share


WHOLE = Place()
FLAT = Place(1.0, 0.55)
WIDE = Place(0.75, 0.42)
HALF = Place(0.49, 0.38)
"""Leaves room beside it for text or another figure."""

_here: ContextVar[Place] = ContextVar("here", default=WHOLE)


def here() -> Place:
    """Return the place that figures are drawn for."""
    return _here.get()


@contextmanager
def printed_at(place: Place) -> Iterator[None]:
    """Draw figures for a place."""
    before = _here.set(place)
    try:
        yield
    finally:
        _here.reset(before)
