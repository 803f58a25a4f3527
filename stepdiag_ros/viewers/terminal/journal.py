"""The view as a log: a line, with the time, for each change of what matters."""

import re
from collections.abc import Callable
from datetime import datetime
from typing import Any

from stepdiag_ros.viewers.page.state import PageState
from stepdiag_ros.viewers.terminal.glyphs import Glyphs
from stepdiag_ros.viewers.terminal.sections import largest, of_passes, worst_lines

_FIGURE = re.compile(r"[-+]?\d+(\.\d+)?")


class Journal:
    """Writes what has changed in the sections of a view.

    Args:
        state: whose sections they are.
        signs: that can be written.
        clock: returns the time of the newest message.
        say: writes a line.
    """

    def __init__(
        self,
        state: PageState,
        signs: Glyphs,
        clock: Callable[[], datetime],
        say: Callable[[str], None],
    ) -> None:
        self._state = state
        self._signs = signs
        self._clock = clock
        self._say = say
        self._documents: dict[str, dict[str, Any]] = {}
        self._revision = 0
        self._run_id = ""
        self._told: dict[str, Any] = {}
        # That nothing is heard before anything is, is not news.
        self._note: str = state.document("faults")["note"]
        self._faults: dict[tuple[str, str, str], str] = {}
        self._starting: set[str] = set()

    def look(self) -> None:
        """Write what is new."""
        self._revision, changed = self._state.news(self._revision)
        self._documents.update(changed)
        run_id = self._documents["run"]["run_id"]
        if run_id != self._run_id:
            self._run_id = run_id
            # What was told is told of another run.
            self._told = {}
            self._tell_of_run(self._documents["run"])
        tellers = {
            "run": self._tell_state,
            "progress": self._tell_lines,
            "curves": self._tell_result,
            "worst": self._tell_worst,
            "verdict": self._tell_verdict,
            "faults": self._tell_faults,
        }
        for name, tell in tellers.items():
            if name in changed:
                tell(self._documents[name])

    def write(self, text: str) -> None:
        """Write a line with the time."""
        self._say(self._signs.text(f"{self._clock().isoformat(timespec='seconds')} {text}"))

    def _tell_of_run(self, run: dict[str, Any]) -> None:
        simulated = ", simulated" if run["simulated"] else ""
        self.write(f"run {run['run_id']}{simulated}: {run['plan']}")

    def _is_news(self, name: str, value: object) -> bool:
        if self._told.get(name) == value:
            return False
        self._told[name] = value
        return True

    def _tell_state(self, run: dict[str, Any]) -> None:
        state = run["state"]
        if run.get("target") and self._is_news("target", run["target"]):
            self.write(run["target"])
        if state is None or not self._is_news("state", state):
            return
        text = f": {run['text']}" if run["text"] and run["text"] != run["words"] else ""
        done = f" ({run['stops_done']} of {run['stops_total']} stops)" if run["stops_total"] else ""
        self.write(f"state: {run['words']}{text}{done}")

    def _tell_lines(self, progress: dict[str, Any]) -> None:
        courses = self._documents["volume"]["courses"]
        for course, stands in zip(courses, progress["courses"], strict=True):
            name = course["name"]
            incomplete = stands["incomplete"]
            if not stands["done"] or not self._is_news(
                f"line {name}", (stands["done"], incomplete)
            ):
                continue
            missing = f", {incomplete} of them incomplete" if incomplete else ""
            self.write(f"line {name}: {stands['done']} of {course['passes']} passes{missing}")

    def _tell_result(self, curves: dict[str, Any]) -> None:
        if not curves["curves"] or not self._is_news("result", (curves["method"], curves["lines"])):
            return
        squareness = self._documents["squareness"]["figures"]
        shown = [
            f"{one['name']} {' at '.join(filter(None, largest(one)))}" for one in curves["curves"]
        ]
        shown += [f"{one['name']} {one['text']}" for one in squareness]
        self.write(f"result: {curves['method']}, {of_passes(curves['lines'])}: {'; '.join(shown)}")

    def _tell_worst(self, worst: dict[str, Any]) -> None:
        for line in worst_lines(worst):
            if self._is_news("worst", line.plain):
                self.write(line.plain[0].lower() + line.plain[1:])

    def _tell_verdict(self, verdict: dict[str, Any]) -> None:
        if verdict["verdict"] is None or not self._is_news("verdict", verdict):
            return
        lines = f"{verdict['lines']} of {verdict['lines_planned']} passes"
        lines += "" if verdict["final"] else ", so far"
        found = "".join(f"; found: {one['label']}" for one in verdict["findings"])
        self.write(f"verdict: {verdict['verdict']}, {lines}: {verdict['sentence']}{found}")

    def _tell_starts(self, faults: dict[str, Any]) -> None:
        """Write which nodes are starting, and which of them have no fault afterwards."""
        waits = {one["who"]: one["text"] for one in faults["starting"]}
        for node in waits.keys() - self._starting:
            self.write(f"starting: {node}: {waits[node]}")
        at_fault = {one["who"].partition(": ")[0] for one in faults["faults"]}
        for node in sorted(self._starting - waits.keys() - at_fault):
            self.write(f"ready: {node}")
        self._starting = set(waits)

    def _tell_faults(self, faults: dict[str, Any]) -> None:
        """Write what has come and gone; a figure that changes is not news.

        What is gone and has something else of the same level and node in its place is not written.
        """
        now = {}
        for one in faults["faults"]:
            key = one["level"], one["who"], _FIGURE.sub("#", one["text"])
            now[key] = f"{one['level']}: {one['who']}: {one['text']}"
        replaced = set()
        for key, text in now.items():
            if key not in self._faults:
                replaced.add(key[:2])
                self.write(text)
        for key, text in self._faults.items():
            if key not in now and key[:2] not in replaced:
                self.write(f"gone: {text}")
        self._faults = now
        self._tell_starts(faults)
        if faults["note"] != self._note:
            self._note = faults["note"]
            if self._note:
                self.write(self._note)
