"""The view on a terminal: drawn again when something changes, a few times a second at most."""

import time
from collections.abc import Callable
from math import inf

from rich.console import Console, Group
from rich.live import Live

from stepdiag_ros.viewers.page.state import PageState
from stepdiag_ros.viewers.terminal.glyphs import glyphs_for
from stepdiag_ros.viewers.terminal.page import Heading, ScreenPage
from stepdiag_ros.viewers.terminal.sections import Document, Lines

RATE = 4.0
"""Drawings in a second, at most."""


class Screen:
    """Draws the sections of a view.

    Args:
        state: whose sections they are.
        console: of the terminal.
        heading: called for the first row.
    """

    def __init__(self, state: PageState, console: Console, heading: Callable[[], Heading]) -> None:
        self._state = state
        self._console = console
        self._heading = heading
        self._signs = glyphs_for(console.encoding)
        self._page = ScreenPage(self._signs)
        self._documents: dict[str, Document] = {}
        self._revision = 0
        self._drawn: tuple[Lines, tuple[int, int]] = ([], (0, 0))
        self._time = -inf
        self._live: Live | None = None

    def begin(self) -> None:
        """Take the whole terminal."""
        self._live = Live(console=self._console, screen=True, auto_refresh=False)
        self._live.start()

    def end(self) -> None:
        """Give the terminal back as it was; harmless if it was not taken."""
        live, self._live = self._live, None
        if live is not None:
            live.stop()

    def look(self) -> None:
        """Draw what has changed, if the last drawing is long enough ago."""
        now = time.monotonic()
        if self._live is None or now - self._time < 1.0 / RATE:
            return
        self._time = now
        width, height = self._console.size
        lines = self._lines(width, height)
        drawn = lines, (width, height)
        if drawn != self._drawn:
            self._drawn = drawn
            self._live.update(Group(*lines), refresh=True)

    def print(self) -> None:
        """Write the whole view once, however many rows it takes."""
        for line in self._lines(self._console.width, None):
            self._console.print(line)

    def _lines(self, width: int, height: int | None) -> Lines:
        self._revision, changed = self._state.news(self._revision)
        self._documents.update(self._signs.readable(changed))
        return self._page.draw(self._documents, self._heading(), width, height)
