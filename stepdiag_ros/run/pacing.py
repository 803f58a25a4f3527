"""Simulated time against real time."""

from dataclasses import dataclass


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
