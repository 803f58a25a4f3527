"""Readings of a real instrument from its messages: numbered, zeroed, and bad once it lost count.

A counter that lost its beam goes on counting when the beam is back, from a wrong number. While beam
and mirror stand for a setup, a lost count therefore stays lost until the next alignment, whatever
the instrument says later. Before the first alignment nothing depends on the count, and the status
is the instrument's own: that is how an operator sees that the beam is back.
"""

from dataclasses import dataclass
from math import isfinite, isnan, nan

from stepdiag_ros.devices.interferometer import (
    STATUS_BEAM_LOST,
    STATUS_LOW_SIGNAL,
    STATUS_OK,
    STATUS_OVERSPEED,
)
from stepdiag_ros.metrology.measurement import Environment, Reading

_NOTHING = Environment()
_COUNTS = (STATUS_OK, STATUS_LOW_SIGNAL)


@dataclass
class Counted:
    """Values of an instrument at one time.

    Attributes:
        time: of measurement, ns.
        raw: displacement in vacuum wavelengths, m; NaN if it is unknown.
        compensated: displacement after the instrument's own compensation for the air, m; NaN if it
            makes none.
        signal: 0..1; NaN if it is unknown.
        status: STATUS_* of InterferometerReading.msg.
        lost_before: how many readings are missing just before this one.
        trigger: number of the hardware trigger; 0: not triggered.
    """

    time: int
    raw: float
    compensated: float
    signal: float
    status: int
    lost_before: int = 0
    trigger: int = 0


class ReadingTally:
    """Numbers the readings, puts the zero where the instrument was aligned, and keeps a loss."""

    def __init__(self) -> None:
        self._count = 0
        self._last_time = -1
        self._setup = ""
        self._zero_wanted = False
        self._zero = (0.0, 0.0)
        self._lost = STATUS_OK

    @property
    def lost(self) -> bool:
        """Say whether the count of the present setup is lost."""
        return self._lost != STATUS_OK

    def align(self, setup: str) -> bool:
        """Take note that beam and mirror stand for a setup.

        Returns:
            whether the zero is set again, with the next good reading; otherwise they stood for this
            setup already, and its zero is not lost.
        """
        if setup == self._setup and self._lost == STATUS_OK:
            return False
        self._setup, self._lost, self._zero_wanted = setup, STATUS_OK, True
        return True

    def reading(self, told: Counted) -> Reading:
        """Return the values as a reading; its time is later than that of the one before."""
        status = told.status
        if self._setup:
            if status not in _COUNTS:
                self._lost = self._lost or status
                self._zero_wanted = False
            status = self._lost or status
        if self._zero_wanted and status == STATUS_OK and _known(told):
            # What the instrument does not tell has no zero either.
            self._zero = tuple(  # type: ignore[assignment]
                value if isfinite(value) else 0.0 for value in (told.raw, told.compensated)
            )
            self._zero_wanted = False
        number = self._count + told.lost_before
        self._count = number + 1
        time = self._last_time = max(told.time, self._last_time + 1)
        # While the instrument itself has no beam, its number means nothing.
        known = told.status != STATUS_BEAM_LOST
        return Reading(
            time,
            number,
            told.raw - self._zero[0] if known else nan,
            told.compensated - self._zero[1] if known else nan,
            told.signal,
            status,
            _NOTHING,
            told.trigger,
        )

    def missed(self, count: int = 1) -> None:
        """Take note of readings that were lost on the way: their numbers are left out."""
        self._count += count


class SpeedWatch:
    """Calls a jump that no mirror can make what it is: a lost count.

    Args:
        fastest: m/s that the counter can follow; 0: nothing is watched.
        slack: s by which the time between two readings may be longer than their stamps say.
    """

    def __init__(self, fastest: float, slack: float) -> None:
        self._fastest, self._slack = fastest, slack
        self._last: tuple[int, float] | None = None

    def forget(self) -> None:
        """Start again: the count was zeroed."""
        self._last = None

    def status(self, time: int, length: float) -> int:
        """Return the status of a displacement (m) at a time (ns), as far as its speed shows."""
        last, self._last = self._last, (time, length)
        if last is None or not self._fastest or isnan(length) or isnan(last[1]):
            return STATUS_OK
        seconds = max((time - last[0]) * 1e-9, 0.0) + self._slack
        too_fast = abs(length - last[1]) > self._fastest * seconds
        return STATUS_OVERSPEED if too_fast else STATUS_OK


def _known(told: Counted) -> bool:
    return isfinite(told.raw) or isfinite(told.compensated)
