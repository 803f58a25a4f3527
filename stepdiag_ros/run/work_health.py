"""How far those are who work on the data: the run, stops and lines, results, what is stored."""

import shutil
from dataclasses import dataclass
from math import inf, isnan, nan
from pathlib import Path

from stepdiag_ros.metrology.units import NANO
from stepdiag_ros.run.health import WINDOW, Age, HealthFinding, Level, figure
from stepdiag_ros.run.pacing import GovernedTime
from stepdiag_ros.run.sequence import Answer, Progress, State
from stepdiag_ros.text.sentence import sentence

MEGABYTE = 1e6
_ENDINGS = {
    Answer.REJECTED: "was rejected",
    Answer.STOPPED: "was stopped",
    Answer.FAULT: "ended in a fault",
}


def judge_run(progress: Progress | None, waits_for: str) -> HealthFinding:
    """Return where a run is.

    Args:
        progress: of the run; None before the first.
        waits_for: what has to happen before it goes on, in words; empty if nothing is known.
    """
    if progress is None:
        return HealthFinding(Level.OK, "nothing was started")
    values = {
        "state": progress.state.name.lower().replace("_", " "),
        "line": f"{progress.line_index + 1} of {progress.line_count}: {progress.line}",
        "setup": progress.setup,
        "stop of the line": f"{progress.stop + 1} of {progress.stop_count}",
        "stops of the run": f"{progress.stops_done} of {progress.stops_total}",
        "remaining time (s)": figure(progress.remaining_time),
        "waits for": waits_for or "nothing",
    }
    if progress.state is State.FAULT:
        return HealthFinding(Level.ERROR, f"the run is stopped: {progress.text}", values)
    if progress.state in (State.PAUSED, State.WAITING_FOR_SETUP):
        return HealthFinding(Level.WARN, progress.text, values)
    return HealthFinding(Level.OK, progress.text, values)


class StreamArrival:
    """Judges whether a stream still comes that a run cannot do without.

    Args:
        what: comes, in words, such as ``reading``.
        stale_after: s without any after which the stream is stale.
    """

    def __init__(self, what: str, stale_after: float) -> None:
        self._what = what
        self.stale_after = stale_after
        self._age = Age()

    def begin(self, now: int, real: float) -> None:
        """Wait from now on, for a run that begins (``now``: ROS time, ns; ``real``: s)."""
        self._age.take(now, real)

    def take(self, time: int, real: float) -> None:
        """Take note of new data, measured at a ROS time (ns) and come at a real time (s)."""
        self._age.take(time, real)

    def judge(self, in_run: bool, now: int, real: float) -> HealthFinding:
        """Return whether it comes; outside a run nobody waits for it."""
        age = self._age.at(now, real)
        values = {f"age of the last {self._what} (s)": figure(age)}
        if isnan(age):
            return HealthFinding(Level.OK, f"no {self._what} has come yet", values)
        if age <= self.stale_after:
            return HealthFinding(Level.OK, f"each {self._what} comes", values)
        if not in_run:
            return HealthFinding(Level.OK, f"no {self._what} comes, and no run goes on", values)
        silent = f"no {self._what} has come for more than {self.stale_after:g} s"
        return HealthFinding(Level.STALE, silent, values, forbids=True)


@dataclass
class StopCount:
    """Counts what was made of a run.

    Attributes:
        settled: stops with a value.
        rejected: stops without one.
        lines: that were finished, each attempt.
        last_rejection: which stop was rejected last, and why; empty if none was.
    """

    settled: int = 0
    rejected: int = 0
    lines: int = 0
    last_rejection: str = ""

    def take(self, rejection: str) -> None:
        """Take a stop that was decided (``rejection``: which it is and why; empty if settled)."""
        if rejection:
            self.rejected += 1
            self.last_rejection = rejection
        else:
            self.settled += 1

    def judge(self) -> HealthFinding:
        """Return what was made of the run so far."""
        values = {
            "settled stops": str(self.settled),
            "rejected stops": str(self.rejected),
            "finished lines": str(self.lines),
            "last rejection": self.last_rejection or "none",
        }
        if self.rejected:
            return HealthFinding(Level.WARN, "stops of this run were rejected", values)
        return HealthFinding(Level.OK, "every stop so far has settled", values)


@dataclass
class Commands:
    """Counts the commands to a bridge and their outcomes.

    Attributes:
        executed: moves that have ended in position.
        failed: moves that were begun and ended elsewhere.
        rejected: moves that were not begun.
        last: number of the last command.
        last_trouble: number of the last that failed or was rejected, and why; empty if none.
    """

    executed: int = 0
    failed: int = 0
    rejected: int = 0
    last: int | None = None
    last_trouble: str = ""

    def take(self, number: int, answer: Answer, reason: str) -> None:
        """Take what became of a command; a fault is reported until a later one is in position."""
        self.last = number
        if answer is Answer.IN_POSITION:
            self.executed += 1
            self.last_trouble = ""
        elif answer in (Answer.REJECTED, Answer.STOPPED, Answer.FAULT):
            self.rejected += answer is Answer.REJECTED
            self.failed += answer is not Answer.REJECTED
            self.last_trouble = f"{number} {_ENDINGS[answer]}: {reason}"

    def judge(self, moving: bool) -> HealthFinding:
        """Return how it went (``moving``: a command is being executed)."""
        values = {
            "last command": figure(self.last),
            "executed": str(self.executed),
            "failed": str(self.failed),
            "rejected": str(self.rejected),
            "last trouble": self.last_trouble or "none",
        }
        if self.last_trouble:
            return HealthFinding(Level.WARN, f"command {self.last_trouble}", values)
        values["at work"] = "a move" if moving else "none: waits for a command"
        return HealthFinding(Level.OK, "commands are executed", values)


class Work:
    """Times the pieces of a work that takes long.

    Args:
        what: is made, in words, such as ``solution``.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._begun = nan
        self._took = nan
        self._longest = -inf
        self._done = 0

    def begin(self, real: float) -> None:
        """Take note that a piece is begun (s of a clock that never steps)."""
        self._begun = real

    def end(self, real: float) -> None:
        """Take note that it is done; the next, if one is owed, is begun with that."""
        self._took = real - self._begun
        self._longest = max(self._longest, self._took)
        self._done += 1
        self._begun = real

    def judge(self, left: int, lines: int) -> HealthFinding:
        """Return how far the work is.

        Args:
            left: pieces that are still owed.
            lines: of the run that have come.
        """
        values = {
            "lines of the run": str(lines),
            "work left": str(left),
            f"{self._what}s made": str(self._done),
            f"last {self._what} took (s)": figure(self._took),
            "longest took (s)": figure(self._longest if self._done else nan),
        }
        message = f"at work on a {self._what}" if left else f"no {self._what} is owed"
        return HealthFinding(Level.OK, message, values)


class Storage:
    """Judges what a recorder writes and how much room is left for it.

    Args:
        warn_below: bytes of free space below which it says so.
        stop_below: bytes of free space below which no run can begin or go on.
    """

    def __init__(self, warn_below: float, stop_below: float) -> None:
        self.warn_below = warn_below
        self.stop_below = stop_below
        self._since = nan
        self._size = 0
        self._rate = nan

    def look(self, folder: Path, bag: Path | None, real: float) -> HealthFinding:
        """Return how much room there is for the bags in a folder.

        Args:
            folder: where bags are written.
            bag: that is being written; None without one.
            real: s of a clock that never steps.
        """
        try:
            free = shutil.disk_usage(folder).free
            size = bag.stat().st_size if bag is not None else 0
        except OSError as error:
            return HealthFinding(Level.ERROR, f"the disk cannot be looked at: {sentence(error)}")
        return self.judge(free, size, real)

    def judge(self, free: int, size: int, real: float) -> HealthFinding:
        """Return how much room there is.

        Args:
            free: bytes on the disk.
            size: bytes of the bag that is being written; 0 without one.
            real: s of a clock that never steps.
        """
        if isnan(self._since) or size < self._size:
            self._since, self._size, self._rate = real, size, nan
        elif real - self._since >= WINDOW:
            self._rate = (size - self._size) / (real - self._since)
            self._since, self._size = real, size
        left = free / self._rate if self._rate > 0.0 else nan
        values = {
            "free space (MB)": figure(free / MEGABYTE),
            "bag (MB)": figure(size / MEGABYTE),
            "written a second (MB/s)": figure(self._rate / MEGABYTE),
            "full in (s), at this rate": figure(left),
        }
        if free < self.stop_below:
            little = f"less than {self.stop_below / MEGABYTE:g} MB are left on the disk"
            return HealthFinding(Level.ERROR, little, values, forbids=True)
        if free < self.warn_below:
            little = f"less than {self.warn_below / MEGABYTE:g} MB are left on the disk"
            return HealthFinding(Level.WARN, little, values)
        return HealthFinding(Level.OK, "there is room on the disk", values)


class Reached:
    """Judges how fast simulated time really goes, against how fast it should."""

    LEAST = 0.8
    """Part of the wished factor below which time is reported to go slower."""

    def __init__(self) -> None:
        self._since = nan
        self._time = 0
        self._factor = nan

    def judge(self, governed: GovernedTime, real: float) -> HealthFinding:
        """Return the factor of the last window (``real``: s of a clock that never steps)."""
        if isnan(self._since):
            self._since, self._time = real, governed.advance(real)
        elif real - self._since >= WINDOW:
            time = governed.advance(real)
            self._factor = (time - self._time) * NANO / (real - self._since)
            self._since, self._time = real, time
        waiting = [name for name, last in governed.waited_for.items() if real - last <= WINDOW]
        values = {
            "simulated seconds in a real second": figure(self._factor),
            "asked for": figure(governed.factor),
            "waits for": ", ".join(waiting) or "nobody",
        }
        if self._factor < self.LEAST * governed.factor:
            slow = "simulated time goes slower than asked for: this computer is too slow for it"
            return HealthFinding(Level.WARN, slow, values)
        return HealthFinding(Level.OK, "simulated time goes as fast as asked for", values)


def judge_recording(
    path: str, messages: int, stored: str, waiting: int, failure: str
) -> HealthFinding:
    """Return what a recorder does.

    Args:
        path: of the bag that is being written; empty if none is.
        messages: in it.
        stored: command of the last stop that is on the disk; empty if none is.
        waiting: stops whose readings are still awaited.
        failure: why the bag could not be written any more; empty if it could.
    """
    values = {
        "bag": path or "none",
        "messages": str(messages),
        "last stop on the disk": stored or "none",
        "stops that wait for readings": str(waiting),
    }
    if failure:
        return HealthFinding(Level.ERROR, failure, values)
    return HealthFinding(Level.OK, "records a run" if path else "waits for a run", values)
