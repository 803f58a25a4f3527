#!/usr/bin/env python3
"""Node: adds the bag of each run to an archive, and reports what its machine's history shows."""

import sys
from collections import deque
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from stepdiag_ros.archive import require_libraries
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.background import BackgroundProcess, WorkFailed
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.run.conclusion import BAG, BAG_CLOSED
from stepdiag_ros.run.health import HealthFinding, Level
from stepdiag_ros.run.supervision import Peer, fact_of_run, said_of_run

LOOK_PERIOD = 0.2
"""Real seconds between two looks at what has been added."""
ARCHIVED = "archived"
"""Fact by which the node says that the bag of a run is in the archive, and in which."""


class ArchiveNode(StepdiagNode):
    """Waits until a recorder has closed a bag, and adds it in a process of low priority.

    The recorder names the file on its own computer, which must be this one, or share the folder.
    """

    role = "archive"

    def __init__(self) -> None:
        super().__init__("archive")
        # They need libraries that a cell without an archive does not have.
        require_libraries()
        from stepdiag_ros.archive.keeping import history_of, keep
        from stepdiag_ros.archive.place import Place
        from stepdiag_ros.words.attention import attention

        if not self.parameter("place"):
            raise Refusal(
                "the parameter 'place' names no archive: give a folder, or a URL",
                fault="missing",
                about="place",
            )
        self._place = Place(self.parameter("place")).url
        self._keep, self._attention = keep, attention
        self._waiting: deque[tuple[str, Path]] = deque()
        self._seen: set[tuple[str, str]] = set()
        self._task: Future[Any] | None = None
        self._at_work = ("", Path())
        self._added = HealthFinding(Level.OK, "no bag was added yet")
        self._history: HealthFinding = attention(None)
        self._background = BackgroundProcess()
        self._first: Future[Any] | None = None
        if self.parameter("machine"):
            self._first = self._background.submit(
                history_of, self._place, self.parameter("machine")
            )
        self.health.add_task("archive", lambda: self._added)
        self.health.add_task("history", lambda: self._history)
        self.follow_run()
        self.every(LOOK_PERIOD, self._look, real=True)

    def on_heartbeat(self, peer: Peer) -> None:
        """Take note of a bag that a recorder has closed."""
        run_id = peer.facts.get(BAG_CLOSED, "").partition(" ")[0]
        bag = said_of_run(peer, BAG, run_id)
        if run_id and bag and (run_id, bag) not in self._seen:
            self._seen.add((run_id, bag))
            self._waiting.append((run_id, Path(bag)))

    def close(self) -> None:
        """Let go of what is not added yet; an archive is whole at any moment."""
        self._background.end()

    def _look(self) -> None:
        if self._first is not None and self._first.done():
            first, self._first = self._first, None
            found = self._result_of(first, "the history cannot be read")
            self._history = self._attention(found)
        if self._task is not None and self._task.done():
            task, self._task = self._task, None
            self._take(task)
        if self._task is None and self._waiting:
            self._begin(*self._waiting.popleft())

    def _begin(self, run_id: str, bag: Path) -> None:
        if not bag.exists():
            self._fail(
                f"{bag} of run {run_id} is not on this computer: start this node where the recorder"
                " runs, or where its folder is shared"
            )
            return
        self._at_work = (run_id, bag)
        self._added = HealthFinding(Level.OK, f"adding {bag.name}")
        self._task = self._background.submit(self._keep, self._place, bag)

    def _take(self, task: "Future[Any]") -> None:
        run_id, bag = self._at_work
        kept = self._result_of(task, f"{bag} is not in the archive")
        if kept is None:
            return
        if kept.problem:
            self._fail(f"{bag} is in {self._place}, but was not evaluated: {kept.problem}")
        else:
            self.facts[ARCHIVED] = fact_of_run(run_id, self._place)
            self._added = HealthFinding(Level.OK, f"{bag.name} is in {self._place}")
            self.get_logger().info(self._added.message)
        if kept.history is not None:
            self._history = self._attention(kept.history)
        self.beat()

    def _result_of(self, task: "Future[Any]", what: str) -> Any:
        try:
            return task.result()
        except (ValueError, WorkFailed) as error:
            self._fail(f"{what}: {str(error).splitlines()[-1]}")
            return None

    def _fail(self, text: str) -> None:
        self._added = HealthFinding(Level.ERROR, text)


def main() -> int:
    """Run the node."""
    return spin(ArchiveNode)


if __name__ == "__main__":
    sys.exit(main())
