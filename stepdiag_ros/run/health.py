"""What a part of the system finds out about its own state: levels, findings, and plain judges.

Ages of data count in ROS time and on a clock that never steps, and the smaller of the two counts:
neither a simulated clock that hurries nor a computer that was busy for a moment makes data old.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum
from math import isnan, nan

from stepdiag_ros.metrology.measurement import Reading
from stepdiag_ros.metrology.units import NANO

WINDOW = 1.0
"""Real seconds over which rates, shares and extremes are taken."""
HOLD = 2.0
"""Real seconds for which a fault that has passed is still reported, so that a monitor shows it."""
AHEAD = 1.0
"""s by which a stamp may lie in the future: another computer's clock, a tick of simulated time."""
UNKNOWN = "unknown"


class Level(IntEnum):
    """How bad it is; the numbers are those of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class HealthFinding:
    """What one look at one subject has found.

    Attributes:
        level: how bad it is.
        message: the same in words that do not change as long as the state does not.
        values: readable name, with the unit in brackets → value; the figures behind the words.
        forbids: no run can begin or go on like this.
    """

    level: Level
    message: str
    values: dict[str, str] = field(default_factory=dict)
    forbids: bool = False

    def says(self, other: "HealthFinding | None") -> bool:
        """Return whether another finding states the same, whatever its figures are."""
        return other is not None and (self.level, self.message) == (other.level, other.message)


def figure(value: float | None, digits: int = 4) -> str:
    """Return a number for a reader, or that it is unknown."""
    if value is None or isnan(value):
        return UNKNOWN
    return str(value) if isinstance(value, int) else f"{value:.{digits}g}"


class SetBack:
    """Notices that the clock of the computer was set back.

    What goes by the latest time that it was given would stand still until the clock has caught up.
    """

    LEAST = 0.1
    """s: by less, nothing stands still for long."""

    def __init__(self) -> None:
        self._latest = 0

    def look(self, now: int) -> float:
        """Return by how many s the clock was set back since the last look; 0 if it was not.

        Args:
            now: time of the computer, ns.
        """
        back = (self._latest - now) * NANO
        if back > self.LEAST:
            self._latest = now
            return back
        self._latest = max(now, self._latest)
        return 0.0


@dataclass
class Age:
    """How long ago the newest of a stream of data was measured.

    Attributes:
        time: of the newest, ns of ROS time; None before the first.
        heard: when it came, or since when the first is waited for, s of a clock that never steps.
    """

    time: int | None = None
    heard: float = nan

    def begin(self, real: float) -> None:
        """Wait for the first data from now on."""
        self.time, self.heard = None, real

    def take(self, time: int, real: float) -> None:
        """Take note of new data."""
        self.time, self.heard = time, real

    def waited(self, real: float) -> float:
        """Return for how many s the first data has been waited for; 0 if it has come."""
        return real - self.heard if self.time is None else 0.0

    def at(self, now: int, real: float) -> float:
        """Return the age in s, never below 0; NaN if there is no data yet.

        Where the stamp lies in the future, the clock was set back, and has no say.

        Args:
            now: ROS time, ns.
            real: time in s on the clock that never steps.
        """
        if self.time is None:
            return nan
        age = (now - self.time) * NANO
        return real - self.heard if age < -AHEAD else max(0.0, min(age, real - self.heard))


class StampRate:
    """How many a second there are of something that is stamped, against how many there should be.

    Args:
        asked: Hz of ROS time; NaN if nobody asked for a rate.
        tolerance: part of the rate by which it may be off.
    """

    def __init__(self, asked: float, tolerance: float) -> None:
        self._asked = asked
        self.tolerance = tolerance
        self._count = 0
        self._first = self._last = 0
        self._since = nan
        self._measured = nan

    def take(self, count: int, last: int) -> None:
        """Take note of some that have come, the last of them measured at a time (ns)."""
        if self._count == 0:
            # Only the span between stamps is known: the first one opens it and is not counted.
            self._first, self._count = last, 1
        else:
            self._count += count
        self._last = last

    def judge(self, real: float) -> HealthFinding:
        """Return how the rate over the last window compares (``real``: s, never steps)."""
        if isnan(self._since):
            self._since = real
        elif real - self._since >= WINDOW:
            span = (self._last - self._first) * NANO
            self._measured = (self._count - 1) / span if span > 0.0 else nan
            self._since, self._first = real, self._last
            self._count = min(self._count, 1)
        values = {"readings a second (Hz)": figure(self._measured)}
        values["asked for (Hz)"] = figure(self._asked)
        if isnan(self._measured):
            return HealthFinding(Level.STALE, "rate unknown: too few readings", values)
        if isnan(self._asked):
            return HealthFinding(Level.OK, "nobody asked for a rate", values)
        if self._measured < self._asked * (1.0 - self.tolerance):
            return HealthFinding(Level.WARN, "fewer readings a second than asked for", values)
        if self._measured > self._asked * (1.0 + self.tolerance):
            return HealthFinding(Level.WARN, "more readings a second than asked for", values)
        return HealthFinding(Level.OK, "as many readings a second as asked for", values)


@dataclass
class Gaps:
    """Which of a numbered stream are missing, came late or came twice.

    Missing numbers are reported as long as the run lasts in which they went missing, and
    for ``HOLD`` in any case.

    Attributes:
        missing: how many numbers were left out.
        first_missing: the first of them; None without any.
        last_missing: the last of them.
        late: how many came that were not newer than the one before: late, or repeated.
        restarts: how often the numbers began again while time went on.
        what: is numbered, in words.
    """

    missing: int = 0
    first_missing: int | None = None
    last_missing: int | None = None
    late: int = 0
    restarts: int = 0
    what: str = "reading"
    _number: int | None = None
    _time: int = 0
    _trouble: float = nan

    def begin(self) -> None:
        """Count again, for a new run; the numbers go on."""
        self.missing = self.late = self.restarts = 0
        self.first_missing = self.last_missing = None
        self._trouble = nan

    def take(self, number: int, time: int, real: float, count: int = 1) -> None:
        """Take the next of the stream.

        Args:
            number: its sequence number.
            time: when it was measured, ns.
            real: when it came, s of a clock that never steps.
            count: how many there are in a row, if they come together.
        """
        last = self._number
        if last is not None and number != last + 1:
            self._trouble = real
            if time <= self._time:
                self.late += 1
                return
            if number > last:
                self.missing += number - last - 1
                self.last_missing = number - 1
                if self.first_missing is None:
                    self.first_missing = last + 1
            else:
                self.restarts += 1
        self._number, self._time = number + count - 1, time

    def take_all(self, readings: Iterable[Reading], real: float) -> None:
        """Take readings in the order in which they came (see ``take``)."""
        for reading in readings:
            self.take(reading.sequence, reading.time, real)

    def judge(self, in_run: bool, real: float) -> HealthFinding:
        """Return what is missing (``real``: s of a clock that never steps)."""
        values = {
            "missing": str(self.missing),
            "first missing": figure(self.first_missing),
            "last missing": figure(self.last_missing),
            "late or repeated": str(self.late),
            "numbers started again": str(self.restarts),
            "last number": figure(self._number),
        }
        if self._number is None:
            return HealthFinding(Level.OK, f"no {self.what} has come yet", values)
        found = self._words()
        if found and (in_run or real - self._trouble <= HOLD):
            return HealthFinding(Level.WARN, found, values)
        return HealthFinding(
            Level.OK, f"no {self.what} is missing" if not found else f"before: {found}", values
        )

    def _words(self) -> str:
        found = []
        if self.missing == 1:
            found.append(f"{self.what} {self.first_missing} is missing")
        elif self.missing:
            between = f"{self.first_missing} and {self.last_missing}"
            found.append(f"{self.missing} {self.what}s are missing, all between numbers {between}")
        if self.late:
            found.append(f"{self.late} {self.what}s came late or twice")
        if self.restarts:
            found.append("the instrument was started again: its zero is lost")
        return "; ".join(found)


class Clockwork:
    """Whether ROS time goes on evenly, and is that of the other nodes.

    Args:
        simulated: ROS time comes from /clock.
    """

    LARGEST_STEP = 0.1
    """s by which ROS time may leave a clock that never steps, from look to look."""
    LARGEST_OFFSET = 0.1
    """s by which the ROS time of another node may differ: data of both are laid side by side."""
    FEWEST_HEARTBEATS = 10
    """Of a node, from which its time is judged."""
    STANDSTILL = 2.0
    """Real seconds without any progress after which simulated time counts as standing still."""
    REMEMBERED = 60.0
    """Real seconds for which a step is reported: stamps on both sides of it do not belong
    together.
    """

    def __init__(self, simulated: bool) -> None:
        self._simulated = simulated
        self._now = 0
        self._real = nan
        self._moved: float | None = None
        self._stepped = nan
        self._step = 0.0
        self._steps = 0
        self._delays: dict[str, deque[float]] = {}

    @property
    def source(self) -> str:
        """Return where ROS time comes from."""
        return "/clock" if self._simulated else "computer"

    def hear(self, node: str, source: str, stamp: int, now: int) -> None:
        """Take a heartbeat of another node.

        Args:
            node: its name.
            source: of its ROS time; only with the computer's own clock can another be compared.
            stamp: of the heartbeat, ns.
            now: ROS time here at which it has come, ns.
        """
        if self._simulated or source != self.source:
            return
        delays = self._delays.setdefault(node, deque(maxlen=self.FEWEST_HEARTBEATS))
        delays.append((now - stamp) * NANO)

    def forget(self, nodes: Iterable[str]) -> None:
        """Take note that nodes have gone."""
        for node in nodes:
            self._delays.pop(node, None)

    def _offsets(self) -> dict[str, float]:
        """Return by how many s the time of other nodes is behind.

        A message never comes before it is sent: the quickest of some heartbeats shows the
        offset, up to its transmission time.
        """
        whole = (pair for pair in self._delays.items() if len(pair[1]) == self.FEWEST_HEARTBEATS)
        return {node: min(delays) for node, delays in whole}

    def judge(self, now: int, real: float) -> HealthFinding:
        """Return how ROS time (ns) has gone on since the last look (``real``: s)."""
        if now != self._now or self._moved is None:
            self._moved = real
        if self._now and now:
            step = (now - self._now) * NANO
            if not self._simulated:
                step -= real - self._real
            # How fast simulated time goes on is up to whoever simulates it.
            even = step >= 0.0 if self._simulated else abs(step) <= self.LARGEST_STEP
            if not even:
                self._step, self._stepped = step, real
                self._steps += 1
        self._now, self._real = now, real
        values = {
            "source": self.source,
            "steps": str(self._steps),
            "last step (s)": figure(self._step if self._steps else nan),
        }
        still = real - self._moved > self.STANDSTILL
        if not now:
            waiting = "waits for simulated time: nothing is published on /clock"
            return HealthFinding(Level.STALE if still else Level.OK, waiting, values)
        if real - self._stepped <= self.REMEMBERED:
            way = "back" if self._step < 0.0 else "forward"
            return HealthFinding(Level.WARN, f"ROS time has stepped {way}", values)
        if self._simulated and still:
            return HealthFinding(Level.WARN, "simulated time stands still", values)
        offsets = self._offsets()
        apart = {node for node, late in offsets.items() if abs(late) > self.LARGEST_OFFSET}
        values.update({f"{node} is behind by (s)": figure(offsets[node]) for node in sorted(apart)})
        if apart:
            names = ", ".join(sorted(apart))
            words = f"the time here differs from the time of {names}: synchronise the computers"
            return HealthFinding(Level.WARN, words, values)
        return HealthFinding(Level.OK, "ROS time goes on evenly", values)
