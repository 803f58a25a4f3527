"""An interferometer that speaks in messages, wherever they come from: a link, or a growing file."""

from dataclasses import dataclass
from math import isnan
from typing import Protocol

from stepdiag_ros.devices.interferometer import Point
from stepdiag_ros.devices.interferometer.message_values import MessageValues, ValueSettings, worst
from stepdiag_ros.devices.interferometer.stamps import (
    ArrivalStamps,
    ClockStamps,
    Missing,
    StampSettings,
)
from stepdiag_ros.devices.interferometer.tally import Counted, ReadingTally, SpeedWatch
from stepdiag_ros.devices.line_protocol import MessageSettings, NoMessage
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import NANOSECONDS

MOST_UNREADABLE = 20
"""Messages in a row that may be unreadable before the device counts as another one."""


class MessageSource(Protocol):
    """Where messages come from."""

    def poll(self, time_ns: int) -> list[bytes]:
        """Return the messages since the last call, in order."""
        ...

    def zero(self) -> None:
        """Ask the instrument to zero its count, if it can be asked."""
        ...

    def close(self) -> None:
        """Let it go."""
        ...


@dataclass(frozen=True)
class InstrumentSettings:
    """How an instrument that speaks in messages is read.

    Attributes:
        message: how a message is split into fields.
        values: what the fields mean.
        stamps: how times are calculated.
        fastest: m/s at which the counter can follow, if this is to be watched; 0 if not.
    """

    message: MessageSettings
    values: ValueSettings
    stamps: StampSettings
    fastest: float

    @classmethod
    def from_section(cls, section: Section) -> "InstrumentSettings":
        """Take ``message``, ``values``, ``rate_hz``, ``delay_s`` … of the settings.

        Raises:
            ValueError: a setting is wrong.
        """
        message = MessageSettings.from_section(section.section("message"))
        rate = section.number("rate_hz", low=0.0, high=1e5, default=0.0)
        # Without a number in the messages a gap shows in the times alone; these are as uneven as
        # the link and the computer make them.
        usual = max(5.0 / rate, 0.2) if rate else 0.0
        gap = section.number("gap_s", low=0.0, high=86400.0, default=usual)
        return cls(
            message=message,
            values=ValueSettings.from_section(section.section("values"), message),
            stamps=StampSettings(
                delay=round(
                    section.number("delay_s", low=0.0, high=60.0, default=0.0) * NANOSECONDS
                ),
                rate=rate,
                gap=round(gap * NANOSECONDS),
            ),
            fastest=section.number("fastest_m_per_s", low=0.0, high=1e3, default=0.0),
        )


class MessageInterferometer:
    """An interferometer that speaks in messages (``InterferometerDevice``).

    A message that cannot be read is a lost reading: its number is left out. The first one
    after the start does not count: it was cut in the middle.

    Args:
        settings: what the messages mean.
        source: where they come from; it is closed with the instrument.
        time_ns: now.
    """

    def __init__(self, settings: InstrumentSettings, source: MessageSource, time_ns: int) -> None:
        self._settings = settings
        self._source = source
        self._tally = ReadingTally()
        self._arrivals = ArrivalStamps(time_ns, settings.stamps)
        self._clock = ClockStamps(settings.stamps)
        self._missing = Missing(settings.stamps, settings.values.sequence_wraps)
        # What the instrument's clock told last, and how often it began again, ns.
        self._clock_told = self._wrapped = 0
        # Unreadable messages in a row, and those that no reading has followed yet.
        self._unreadable = self._pending = 0
        self._first = True
        # A time of arrival is as uncertain as the time between two readings.
        rate = settings.stamps.rate
        self._speed = SpeedWatch(settings.fastest, 1.0 / rate if rate else 0.01)

    def align(self, time_ns: int, setup: str, line: str, step: Point, start: Point) -> None:  # noqa: ARG002
        """Set the zero, in software, and the instrument's own if it can be asked to."""
        if self._tally.align(setup):
            self._speed.forget()
            self._source.zero()

    def update_position(self, time_ns: int, position: Point) -> None:
        """A real instrument sees for itself where the mirror is."""

    def update_environment(self, time_ns: int, environment: Environment) -> None:
        """The node compensates; what the instrument takes for the air is its own matter."""

    def poll(self, time_ns: int) -> list[Reading]:
        """Return the readings since the last poll, in order.

        Raises:
            OSError: the instrument is gone, silent, or was started again.
            ValueError: what it says makes no sense.
        """
        readable: list[tuple[MessageValues, int]] = []
        for message in self._source.poll(time_ns):
            try:
                fields = self._settings.message.split(message)
                told = None if fields is None else self._settings.values.read(fields)
            except NoMessage as error:
                self._note_unreadable(str(error))
                continue
            if told is not None:
                readable.append((told, self._pending))
                self._unreadable = self._pending = 0
                self._first = False
        stamps = self._arrivals.spread(len(readable), time_ns)
        readings = []
        for (told, unreadable), arrived in zip(readable, stamps, strict=True):
            time = self._stamp(told, arrived)
            lost = self._lost_before(told, time, unreadable)
            if lost < 0:
                continue
            length = told.compensated if isnan(told.raw) else told.raw
            status = worst(told.status, self._speed.status(time, length))
            readings.append(
                self._tally.reading(
                    Counted(
                        time, told.raw, told.compensated, told.signal, status, lost, told.trigger
                    )
                )
            )
        return readings

    def close(self) -> None:
        """Let the instrument go."""
        self._source.close()

    def _note_unreadable(self, text: str) -> None:
        if self._first:
            self._first = False
            return
        self._unreadable += 1
        self._pending += 1
        if self._unreadable >= MOST_UNREADABLE:
            raise Refusal(
                f"{MOST_UNREADABLE} messages in a row cannot be read, the last one since {text}:"
                " check that the settings fit the device",
                fault="malformed",
            )

    def _stamp(self, told: MessageValues, arrived: int) -> int:
        delay = self._settings.stamps.delay
        if told.moment is not None:
            return told.moment - delay
        if told.clock is None:
            return arrived
        wraps = self._settings.values.time.wraps
        # A clock of 32 bits of microseconds begins again after 71 minutes.
        if wraps and told.clock + wraps // 2 < self._clock_told:
            self._wrapped += wraps
        self._clock_told = told.clock
        return self._clock.stamp(told.clock + self._wrapped, arrived + delay)

    def _lost_before(self, told: MessageValues, time: int, unreadable: int) -> int:
        if told.sequence is not None:
            return self._missing.by_number(told.sequence)
        # The instrument's own clock is even; a calculated time is as uneven as the link.
        own = time if told.clock is None else told.clock + self._wrapped
        return max(self._missing.by_time(own), unreadable)
