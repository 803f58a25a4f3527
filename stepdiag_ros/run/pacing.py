"""Simulated time against real time."""

from dataclasses import dataclass
from typing import NamedTuple

FOLLOWER_LAG = 0.02
"""Real seconds by which a follower may be behind before simulated time waits for it."""
FOLLOWER_PATIENCE = 1.0
"""Real seconds that simulated time waits for a follower that does not come on at all."""
RECORDER_LAG = 0.75
"""Real seconds by which the recorder may be behind: only its heartbeats report on it."""


@dataclass(frozen=True)
class Pace:
    """A time that runs ``factor`` times as fast as real time.

    Attributes:
        factor: simulated seconds in a real second.
        origin: simulated time at the start, ns.
        real_start: real time at the start, s.
    """

    factor: float
    origin: int
    real_start: float

    def time(self, real: float) -> int:
        """Return the simulated time in ns at a real time in s."""
        return self.origin + round((real - self.real_start) * self.factor * 1e9)

    def real(self, time: int) -> float:
        """Return the real time in s at which the simulated time (ns) is reached."""
        return self.real_start + (time - self.origin) * 1e-9 / self.factor

    def span(self, time: int) -> float:
        """Return the simulated seconds from the origin to a time (ns)."""
        return (time - self.origin) * 1e-9

    def part(self, time: int, end: int) -> float:
        """Return which part (0..1) of the way from the origin to ``end`` (ns) a time (ns) is."""
        return (time - self.origin) / max(end - self.origin, 1)


class _Follower(NamedTuple):
    time: int
    real: float
    lag: float


class GovernedTime:
    """Simulated time that waits for those who must keep up with it.

    On a computer too slow for the wished factor, an ungoverned clock would run away from the
    devices that it drives.

    Args:
        factor: simulated seconds in a real second, where nobody is behind.
        origin: simulated time at the start, ns.
        real_start: real time at the start, s.

    Attributes:
        factor: that is wished for now.
        waited_for: follower → real time, s, at which it was waited for last.
    """

    def __init__(self, factor: float, origin: int, real_start: float) -> None:
        self.factor = factor
        self.waited_for: dict[str, float] = {}
        self._time = origin
        self._real = real_start
        self._followers: dict[str, _Follower] = {}

    def heard(self, time: int, real: float, name: str = "", lag: float = FOLLOWER_LAG) -> None:
        """Take note that a follower has come on.

        Args:
            time: simulated time that it has come to, ns.
            real: real time of its message, s.
            name: which follower.
            lag: real seconds by which it may be behind.
        """
        before = self._followers.get(name)
        if before is None or time != before.time:
            self._followers[name] = _Follower(time, real, lag)

    def run_at(self, factor: float, real: float) -> None:
        """Go on at another factor, in simulated seconds a real second, from a real time (s) on."""
        self.advance(real)
        self.factor = factor

    def advance(self, real: float) -> int:
        """Go on to a real time (s) and return the simulated time, ns."""
        if not self._must_wait(real):
            self._time += round((real - self._real) * self.factor * 1e9)
        self._real = real
        return self._time

    def _must_wait(self, real: float) -> bool:
        # A follower that has died must not stop time for all the others.
        behind = [
            name
            for name, follower in self._followers.items()
            if real - follower.real <= FOLLOWER_PATIENCE
            and self._time - follower.time > follower.lag * max(self.factor, 10.0) * 1e9
        ]
        self.waited_for.update(dict.fromkeys(behind, real))
        return bool(behind)
