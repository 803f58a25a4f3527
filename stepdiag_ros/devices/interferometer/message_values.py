"""What the messages of an interferometer mean (``docs/instruments.md`` explains every key).

::

    values:
      raw: {from: x, unit: nm}              # in vacuum wavelengths, and/or
      compensated: {from: c, unit: mm}      # after the instrument's own compensation
      sign: -1                              # it counts down when the mirror moves away
      signal: {from: s, full: 100, low_below: 20, lost_below: 5}
      status: {from: e, words: {OK: good, ERR2: beam_lost}, otherwise: fault}
      time: {from: t, unit: ms}             # of its own clock
      sequence: {from: n, wraps_at: 65536}
      trigger: {from: k}
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from math import isnan, nan
from typing import NamedTuple

from stepdiag_ros.devices.interferometer import (
    STATUS_BEAM_LOST,
    STATUS_COUNT_ERROR,
    STATUS_FAULT,
    STATUS_LOW_SIGNAL,
    STATUS_OK,
    STATUS_OVERSPEED,
)
from stepdiag_ros.devices.line_protocol import (
    Fields,
    MessageSettings,
    NoMessage,
    SentQuantity,
    field_of,
    quantity,
    times,
)
from stepdiag_ros.metrology.air import HELIUM_NEON_WAVELENGTH
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Refusal

LENGTHS: Mapping[str, Callable[[float], float]] = {
    "m": times(1.0),
    "mm": times(1e-3),
    "um": times(1e-6),
    "µm": times(1e-6),
    "nm": times(1e-9),
    "pm": times(1e-12),
    "in": times(0.0254),
}
"""Unit of length → conversion to m."""
STATUSES = {
    "good": STATUS_OK,
    "low_signal": STATUS_LOW_SIGNAL,
    "beam_lost": STATUS_BEAM_LOST,
    "overspeed": STATUS_OVERSPEED,
    "count_error": STATUS_COUNT_ERROR,
    "fault": STATUS_FAULT,
}
"""Word of the settings → STATUS_*."""
_WORST = (
    STATUS_FAULT,
    STATUS_BEAM_LOST,
    STATUS_OVERSPEED,
    STATUS_COUNT_ERROR,
    STATUS_LOW_SIGNAL,
    STATUS_OK,
)
_CLOCKS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}

FARTHEST = 200.0
"""m: no interferometer on a machine reads more; a larger number is refused."""


class MessageValues(NamedTuple):
    """Contents of one message.

    Attributes:
        raw: displacement in vacuum wavelengths, m; NaN if not in the message.
        compensated: displacement after the instrument's own compensation, m; NaN if not in the
            message.
        signal: 0..1; NaN if not in the message.
        status: STATUS_* of InterferometerReading.msg.
        trigger: number of the hardware trigger; 0: not triggered.
        clock: the instrument's own clock, ns; None if not in the message.
        moment: time of measurement by the computer's clock, ns; None if not in the message.
        sequence: the instrument's own number of the reading; None if not in the message.
    """

    raw: float
    compensated: float
    signal: float
    status: int
    trigger: int = 0
    clock: int | None = None
    moment: int | None = None
    sequence: int | None = None


@dataclass(frozen=True)
class StatusSettings:
    """What the status of a message means.

    Attributes:
        source: field that it comes from.
        words: what stands there → STATUS_*.
        bits: bit of the number that stands there, from 0 → STATUS_*.
        at_least: the number that stands there is at least this → STATUS_*.
        base: of the number.
        otherwise: STATUS_* of what is in none of them.
    """

    source: str
    words: Mapping[str, int]
    bits: Mapping[int, int]
    at_least: Mapping[int, int]
    base: int
    otherwise: int

    def of(self, fields: Fields) -> int:
        """Return the status of a message; a field that is not there is good.

        Raises:
            NoMessage: it should be a number, and is not.
        """
        text = fields.get(self.source)
        if text is None:
            return STATUS_OK
        if text in self.words:
            return self.words[text]
        if not self.bits and not self.at_least:
            return self.otherwise
        try:
            number = int(text, self.base)
        except ValueError:
            raise NoMessage(f"the status '{text[:40]}' is not a whole number") from None
        found = [status for bit, status in self.bits.items() if number >> bit & 1]
        found += [status for limit, status in self.at_least.items() if number >= limit]
        return worst(*(found or [self.otherwise]))


@dataclass(frozen=True)
class SignalSettings:
    """What the signal of a message means.

    Attributes:
        strength: 0..1 of the full signal.
        low_below: strength below which the signal is low; 0: never.
        lost_below: strength below which the beam is lost; 0: never.
    """

    strength: SentQuantity
    low_below: float
    lost_below: float


@dataclass(frozen=True)
class TimeSettings:
    """When a message says that it was measured.

    Attributes:
        clock: the instrument's own clock, ns; None if not in the message.
        wraps: ns at which that clock begins again at 0; 0: never.
        computer: that clock is the computer's own.
        text: field that holds date and time instead; empty without one.
    """

    clock: SentQuantity | None = None
    wraps: int = 0
    computer: bool = False
    text: str = ""


@dataclass(frozen=True)
class ValueSettings:
    """What the fields of a message mean.

    Attributes:
        raw: displacement in vacuum wavelengths; None if not in the messages.
        compensated: displacement after the instrument's own compensation; None if not in the
            messages.
        sign: -1 if the instrument counts down when the mirror moves away from the laser.
        signal: strength of the signal; None if not in the messages.
        status: what the status word means; None without one.
        time: of measurement.
        sequence: the instrument's own number of the reading; None without one.
        sequence_wraps: at which that number begins again at 0; 0: never.
        trigger: number of the hardware trigger; None without one.
    """

    raw: SentQuantity | None
    compensated: SentQuantity | None
    sign: float
    signal: SignalSettings | None
    status: StatusSettings | None
    time: TimeSettings
    sequence: SentQuantity | None
    sequence_wraps: int
    trigger: SentQuantity | None

    @classmethod
    def from_section(cls, section: Section, message: MessageSettings) -> "ValueSettings":
        """Take the settings of all values.

        Args:
            section: whose keys are the values.
            message: which fields there are.

        Raises:
            ValueError: a setting is wrong, or the displacement is missing.
        """
        raw, compensated = (
            quantity(section, name, message, {**LENGTHS, "count": times(1.0)}, _of_counts)
            for name in ("raw", "compensated")
        )
        if raw is None and compensated is None:
            raise Refusal(
                f"{section.source}: neither 'raw' nor 'compensated' is given. Name the field that"
                " holds the displacement",
                fault="missing",
            )
        wraps = 0

        def whole(part: Section) -> Callable[[float], float]:
            nonlocal wraps
            wraps = part.integer("wraps_at", low=0, high=1 << 64, default=0)
            return times(1.0)

        sign = section.integer("sign", low=-1, high=1, default=1)
        if not sign:
            raise Refusal(f"{section.source}: 'sign' is 0; expected 1 or -1", fault="out_of_range")
        settings = cls(
            raw=raw,
            compensated=compensated,
            sign=float(sign),
            signal=_signal(section, message),
            status=_status(section, message),
            time=_time(section, message),
            sequence=quantity(section, "sequence", message, {}, whole),
            sequence_wraps=wraps,
            trigger=quantity(section, "trigger", message, {}, lambda _: times(1.0)),
        )
        section.finish()
        return settings

    def read(self, fields: Fields) -> MessageValues:
        """Return the contents of a message.

        Raises:
            NoMessage: a value is malformed, or impossible.
        """
        status = STATUS_OK if self.status is None else self.status.of(fields)
        raw, compensated = (
            self._length(one, fields, status) for one in (self.raw, self.compensated)
        )
        strength = nan
        if self.signal is not None:
            strength = self.signal.strength.number(fields)
            if strength < self.signal.lost_below:
                status = worst(status, STATUS_BEAM_LOST)
            elif strength < self.signal.low_below:
                status = worst(status, STATUS_LOW_SIGNAL)
        if isnan(raw) and isnan(compensated):
            # The instrument says itself that it has no number.
            status = worst(status, STATUS_BEAM_LOST)
        clock = moment = None
        if self.time.text:
            moment = _moment(fields.get(self.time.text, ""))
        elif self.time.clock is not None:
            number = _whole(self.time.clock, fields)
            clock, moment = (None, number) if self.time.computer else (number, None)
        return MessageValues(
            raw,
            compensated,
            nan if isnan(strength) else min(max(strength, 0.0), 1.0),
            status,
            0 if self.trigger is None else _whole(self.trigger, fields),
            clock,
            moment,
            None if self.sequence is None else _whole(self.sequence, fields),
        )

    def _length(self, one: SentQuantity | None, fields: Fields, status: int) -> float:
        if one is None:
            return nan
        try:
            length = self.sign * one.number(fields)
        except NoMessage:
            # Without a beam many instruments send dashes.
            if status in (STATUS_BEAM_LOST, STATUS_FAULT):
                return nan
            raise
        if abs(length) > FARTHEST:
            raise NoMessage(f"it reports a displacement of {length:g} m")
        return length


def worst(*statuses: int) -> int:
    """Return the status that weighs most."""
    return min(statuses, key=_WORST.index)


def _of_counts(section: Section) -> Callable[[float], float] | None:
    """Return the conversion of counts to m: λ over the counts that a wavelength of path has."""
    if section.text("unit", default="") != "count":
        return None
    wavelength = section.number("wavelength_m", low=1e-7, high=1e-5, default=HELIUM_NEON_WAVELENGTH)
    return times(wavelength / section.number("counts_per_wavelength", low=1e-3, high=1e9))


def _signal(values: Section, message: MessageSettings) -> SignalSettings | None:
    limits = {"low_below": 0.0, "lost_below": 0.0}

    def scale(section: Section) -> Callable[[float], float]:
        full = section.number("full", low=1e-12, default=1.0)
        for key in limits:
            limits[key] = section.number(key, low=0.0, default=0.0) / full
        return times(1.0 / full)

    strength = quantity(values, "signal", message, {}, scale)
    return None if strength is None else SignalSettings(strength, **limits)


def _status(values: Section, message: MessageSettings) -> StatusSettings | None:
    if "status" not in values.keys():  # noqa: SIM118
        return None
    section = values.section("status")
    words, bits, at_least = (
        {text: STATUSES[name] for text, name in section.table(key, tuple(STATUSES)).items()}
        for key in ("words", "bits", "at_least")
    )
    # A word that nobody has explained cannot be taken for good; a number without any bit of
    # trouble can.
    otherwise = "good" if bits or at_least else "fault"
    settings = StatusSettings(
        source=field_of(section, "from", "status", message),
        words=words,
        bits=_by_number(bits, f"{section.source}: bits"),
        at_least=_by_number(at_least, f"{section.source}: at_least"),
        base=16 if section.names("format", ("decimal", "hex"), ("decimal",))[0] == "hex" else 10,
        otherwise=STATUSES[section.names("otherwise", tuple(STATUSES), (otherwise,))[0]],
    )
    section.finish()
    return settings


def _by_number(listed: Mapping[str, int], source: str) -> dict[int, int]:
    try:
        return {int(text, 0): status for text, status in listed.items()}
    except ValueError:
        raise ValueError(
            f"{source}: expected whole numbers as keys, found {list(listed)}"
        ) from None


def _time(values: Section, message: MessageSettings) -> TimeSettings:
    if "time" not in values.keys():  # noqa: SIM118
        return TimeSettings()
    unit = values.section("time").names("unit", (*_CLOCKS, "iso8601"))[0]
    if unit == "iso8601":
        section = values.section("time")
        section.names("unit", ("iso8601",))
        text = field_of(section, "from", "time", message)
        section.finish()
        return TimeSettings(text=text)
    wraps, computer = 0, False

    def more(section: Section) -> Callable[[float], float]:
        nonlocal wraps, computer
        computer = section.names("clock", ("own", "computer"), ("own",))[0] == "computer"
        section.names("unit", tuple(_CLOCKS))
        wraps = round(section.number("wraps_at", low=0.0, high=1e20, default=0.0) * _CLOCKS[unit])
        return times(_CLOCKS[unit])

    clock = quantity(values, "time", message, {}, more)
    return TimeSettings(clock, wraps, computer)


def _whole(one: SentQuantity, fields: Fields) -> int:
    value = one.number(fields)
    if isnan(value) or value < 0.0:
        raise NoMessage(f"'{fields.get(one.source, '')[:40]}' is not a whole number")
    return round(value)


def _moment(text: str) -> int:
    try:
        moment = datetime.fromisoformat(text.replace("Z", "+00:00").replace(",", "."))
    except ValueError:
        raise NoMessage(f"'{text[:40]}' is not a date and time") from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=timezone.utc)
    since = moment - datetime(1970, 1, 1, tzinfo=timezone.utc)
    return (since.days * 86400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000
