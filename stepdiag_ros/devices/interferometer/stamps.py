"""When a reading was measured: stated by the instrument, or calculated from its arrival.

What comes in one look at the link came since the look before, evenly as far as anybody knows. So
readings that waited in a busy computer are spread over the time that they waited, not put all on
one instant.

An instrument's own clock counts from when it was switched on. A message cannot come before it was
sent: the smallest difference between the computer's clock and the instrument's, over all messages
so far, is their offset plus the shortest delay. The offset may grow by ``DRIFT``, so that a clock
that is a little slow is followed.
"""

from dataclasses import dataclass

from stepdiag_ros.devices.line_protocol import StartedAgain
from stepdiag_ros.metrology.units import NANOSECONDS

DRIFT = 100e-6
"""By which a quartz in an instrument may differ from the computer's clock."""
JUMP = 5 * NANOSECONDS
"""ns by which the clock of an instrument may seem to jump; more means that it was started again."""


@dataclass(frozen=True)
class StampSettings:
    """How times are calculated.

    Attributes:
        delay: from the measurement to the arrival of the message, at least, ns.
        rate: of the readings, Hz; 0 if it is not known.
        gap: ns between two readings that cannot be without a reading lost between; 0: nothing is
            concluded from times.
    """

    delay: int = 0
    rate: float = 0.0
    gap: int = 0


class ArrivalStamps:
    """Times of readings of which only the arrival is known.

    Args:
        time_ns: now.
        settings: delay and rate.
    """

    def __init__(self, time_ns: int, settings: StampSettings) -> None:
        self._settings = settings
        self._looked = time_ns

    def spread(self, count: int, time_ns: int) -> list[int]:
        """Return the times of readings that have come since the last call, ns.

        Args:
            count: of the readings; none moves the time of the last look all the same.
            time_ns: now.
        """
        since, self._looked = self._looked, max(time_ns, self._looked)
        span = self._looked - since
        return [since + span * (k + 1) // count - self._settings.delay for k in range(count)]


class ClockStamps:
    """Times of readings that the instrument stamps by a clock of its own.

    Args:
        settings: delay.
    """

    def __init__(self, settings: StampSettings) -> None:
        self._settings = settings
        self._offset: int | None = None
        self._last = 0

    def stamp(self, own: int, time_ns: int) -> int:
        """Return the time of a reading, ns.

        Args:
            own: time of the reading by the clock of the instrument, ns.
            time_ns: when it came.

        Raises:
            StartedAgain: the clock of the instrument has jumped.
        """
        offset = time_ns - own
        if self._offset is None:
            self._offset, self._last = offset, own
        expected = self._offset + round(max(own - self._last, 0) * DRIFT)
        if own < self._last or offset < expected - JUMP:
            raise StartedAgain(
                "the clock of the instrument has jumped: it was started again",
                fault="restarted",
                aspect="clock",
            )
        self._offset = min(expected, offset)
        self._last = own
        return own + self._offset - self._settings.delay


class Missing:
    """Finds readings that did not come.

    Args:
        settings: rate, and the gap from which on something is missing.
        wraps_at: the instrument's own number begins again at 0 when it reaches this; 0: never.
    """

    def __init__(self, settings: StampSettings, wraps_at: int = 0) -> None:
        self._settings = settings
        self._wraps_at = wraps_at
        self._time = 0
        self._number: int | None = None

    def by_number(self, number: int) -> int:
        """Return how many readings are missing before the one of this number; -1: it is repeated.

        Raises:
            StartedAgain: the numbers start again.
        """
        last, self._number = self._number, number
        if last is None:
            return 0
        step = number - last
        if self._wraps_at:
            step %= self._wraps_at
            if step > self._wraps_at // 2:
                step -= self._wraps_at
        if step < 0:
            raise StartedAgain(
                f"the numbers of the readings fall from {last} to {number}: the instrument was"
                " started again",
                fault="restarted",
                aspect="number",
            )
        return step - 1

    def by_time(self, time: int) -> int:
        """Return how many readings are missing before the one of this time (ns), at least."""
        last, self._time = self._time, time
        if not last or not self._settings.gap or time - last < self._settings.gap:
            return 0
        return max(round((time - last) / NANOSECONDS * self._settings.rate) - 1, 1)
