"""All sections of the page together: one thread folds in messages, another reads them."""

import json
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from stepdiag_ros.viewers.page.course import (
    PositionSection,
    ProgressSection,
    RunSection,
    VolumeSection,
)
from stepdiag_ros.viewers.page.items import RunBegin
from stepdiag_ros.viewers.page.measured import (
    BeamSection,
    BlockSection,
    StopSection,
    WeatherSection,
)
from stepdiag_ros.viewers.page.results import (
    CurveSection,
    FaultSection,
    SquarenessSection,
    VerdictSection,
    WorstSection,
)
from stepdiag_ros.viewers.page.section import PageSection

SECTIONS: tuple[type[PageSection], ...] = (
    RunSection,
    FaultSection,
    VolumeSection,
    ProgressSection,
    PositionSection,
    BeamSection,
    StopSection,
    BlockSection,
    WorstSection,
    CurveSection,
    SquarenessSection,
    VerdictSection,
    WeatherSection,
)
"""The sections of the page; another is a class and a line here."""
_EARLY = 4000
"""Messages kept that come before the description of their run: lines, stops and blocks of all that
their publishers keep."""


class PageState:
    """What the page shows. Safe to be used by two threads.

    Attributes:
        listener: called after each change, by the thread that has made it.
    """

    def __init__(self) -> None:
        self.listener: Callable[[], None] = lambda: None
        self._lock = threading.Lock()
        self._sections = {kind.name: kind() for kind in SECTIONS}
        self._revision = 1
        self._changed = dict.fromkeys(self._sections, 1)
        self._encoded: dict[str, tuple[int, str]] = {}
        self._run_id = ""
        self._early: deque[tuple[str, object]] = deque(maxlen=_EARLY)

    @property
    def revision(self) -> int:
        """Return a number that grows with every change."""
        return self._revision

    def take(self, item: object, run_id: str = "") -> None:
        """Fold in a message.

        Args:
            item: one of the classes in ``items.SOURCES``.
            run_id: of the run that it belongs to; empty if to none. What belongs to a run that is
                not described yet waits for its description.
        """
        before = self._revision
        with self._lock:
            if isinstance(item, RunBegin):
                self._begin(item)
            elif run_id and run_id != self._run_id:
                self._early.append((run_id, item))
            else:
                self._fold(item)
        if self._revision != before:
            self.listener()

    def _begin(self, run: RunBegin) -> None:
        self._run_id = run.run_id
        for section in self._sections.values():
            if section.of_run:
                section.begin(run)
                self._mark(section.name)
        early, self._early = self._early, deque(maxlen=_EARLY)
        for run_id, item in early:
            if run_id == run.run_id:
                self._fold(item)

    def _fold(self, item: object) -> None:
        for section in self._sections.values():
            if section.take(item):
                self._mark(section.name)

    def _mark(self, name: str) -> None:
        self._revision += 1
        self._changed[name] = self._revision

    def update(self, known: int = 0) -> tuple[int, str]:
        """Return the sections that changed after a revision, as the text of a JSON object.

        Args:
            known: revision that the reader has; 0 for none.

        Returns:
            the revision that the reader has then, and the text; ``{}`` if nothing changed.
        """
        with self._lock:
            parts = [
                f"{json.dumps(name)}:{self._text(name)}"
                for name, changed in self._changed.items()
                if changed > known
            ]
            return self._revision, "{" + ",".join(parts) + "}"

    def news(self, known: int = 0) -> tuple[int, dict[str, dict[str, Any]]]:
        """Return the sections that changed after a revision.

        Args:
            known: revision that the reader has; 0 for none.

        Returns:
            the revision that the reader has then, and the documents by the names of the sections.
        """
        with self._lock:
            changed = [name for name, when in self._changed.items() if when > known]
            return self._revision, {name: self._sections[name].document() for name in changed}

    def document(self, name: str) -> dict[str, Any]:
        """Return one section as it is now."""
        with self._lock:
            return self._sections[name].document()

    def _text(self, name: str) -> str:
        """Return a section's JSON; it is written once however many viewers there are."""
        revision, text = self._encoded.get(name, (0, ""))
        if revision != self._changed[name]:
            document = self._sections[name].document()
            text = json.dumps(document, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
            self._encoded[name] = (self._changed[name], text)
        return text
