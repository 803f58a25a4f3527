"""A bag played into the page, without any node: what a viewer would have seen, at another rate."""

import threading
import time
from pathlib import Path
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.bags.bag import RecordedMessage
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import check_version
from stepdiag_ros.bags.runs import choose_run, records_of
from stepdiag_ros.run.pacing import Pace
from stepdiag_ros.viewers.page.items import SOURCES, HeardTopic, to_run_begin
from stepdiag_ros.viewers.page.state import PageState

_LOOK = 0.05
"""Real seconds between two messages of a topic of which the newest is enough."""


class Replay:
    """A recorded run that is folded into the page.

    Args:
        path: of the bag.
        state: of the page.
        run_id: which run, where the bag holds several.

    Raises:
        BagError: the bag cannot be read, or holds no run or several and none is named.

    Attributes:
        time: at which the message that was folded in last was recorded, ns.
    """

    def __init__(self, path: Path, state: PageState, run_id: str | None = None) -> None:
        self._bag = BagReader(path)
        self._run = choose_run(self._bag, run_id)
        description = self._run.description
        check_version(path, description.schema_version, description.software_version)
        self.time = to_run_begin(description).time
        self._state = state
        by_name = {
            topics.absolute(source.topic, self._run.namespace): source
            for source in SOURCES
            if source.topic is not topics.RUN_DESCRIPTION
        }
        self._sources: dict[str, HeardTopic] = {
            name: source for name, source in by_name.items() if name in self._bag.topics
        }

    def play(self, rate: float, stop: threading.Event) -> int:
        """Fold in the whole run, and return how many messages were looked at.

        Args:
            rate: recorded seconds in a real second; 0 for as fast as possible.
            stop: ends it early.
        """
        self._state.take(to_run_begin(self._run.description))
        pace: Pace | None = None
        looked: dict[str, float] = {}
        passed: dict[str, tuple[RecordedMessage, Any]] = {}
        count = 0
        for record, message in records_of(self._bag, self._run, self._sources.keys()):
            pace = pace or Pace(rate or 1.0, record.log_time, time.monotonic())
            left = pace.real(record.log_time) - time.monotonic() if rate else 0.0
            if stop.is_set() or (left > 0.0 and stop.wait(left)):
                break
            if self._sources[record.topic].newest:
                now = time.monotonic()
                if now - looked.get(record.topic, 0.0) < _LOOK:
                    passed[record.topic] = (record, message)
                    continue
                looked[record.topic] = now
                passed.pop(record.topic, None)
            self._fold_in(record, message)
            count += 1
        # What was passed over is the newest now: where the machine stands at the end.
        for record, message in passed.values():
            self._fold_in(record, message)
        return count + len(passed)

    def _fold_in(self, record: RecordedMessage, message: Any) -> None:
        self.time = record.log_time
        found = self._bag.decode(record) if message is None else message
        run_id = str(getattr(found, "run_id", ""))
        for item in self._sources[record.topic].convert(found):
            self._state.take(item, run_id)

    def close(self) -> None:
        """Close the bag."""
        self._bag.close()
