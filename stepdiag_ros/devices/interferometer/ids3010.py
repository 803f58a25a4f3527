"""Driver ``ids3010``: attocube IDS3010, by its JSON-RPC 2.0 interface on TCP port 9090.

Source: attocube systems, public repository IDS-APIs (Python and MATLAB interfaces for firmware 1.9
and before): requests ``com.attocube.ids.…`` or, from API generation "SEN" on,
``com.attocube.sen.…`` for the groups ``system`` and ``displacement``, ``com.attocube.ecu`` for the
compensation of the air, ``com.attocube.system.errorNumberToString``. A result is a list that begins
with an error or warning number, 0 for success; displacements are in pm.

What is not public: the list of these numbers. The driver asks the instrument for the words of each
number that comes, and takes from them what has happened (``WORDS``); the settings may say otherwise
by the number. A warning that it does not understand is a fault. Nor is it public in so many words
how the displacement is compensated; the driver takes it to be the count divided by the refractive
index that ``getRefractiveIndexForCompensation`` returns, unless the settings give another one. Not
tried on a real instrument; the tests speak with a server written from the same source.
"""

import json
import re
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite, nan
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.interferometer import (
    STATUS_BEAM_LOST,
    STATUS_FAULT,
    STATUS_LOW_SIGNAL,
    STATUS_OK,
    STATUS_OVERSPEED,
    Point,
)
from stepdiag_ros.devices.interferometer.message_values import FARTHEST, STATUSES, worst
from stepdiag_ros.devices.interferometer.tally import Counted, ReadingTally, SpeedWatch
from stepdiag_ros.devices.line_protocol_talk import CONNECT_WITHIN
from stepdiag_ros.devices.link import Link, LinkSettings
from stepdiag_ros.devices.link_framing import Lines
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.refusal import Lost, Refusal, Silent, fields_of
from stepdiag_ros.metrology.units import NANOSECONDS
from stepdiag_ros.text.intake import parse_json

PORT = 9090
FAMILIES = ("com.attocube.ids", "com.attocube.sen")
"""Names of the interface, that of older firmware first."""
WORDS: tuple[tuple[str, int], ...] = (
    (r"interrupt|beam.*(lost|block)|no (beam|signal)", STATUS_BEAM_LOST),
    (r"speed|velocity|fast", STATUS_OVERSPEED),
    (r"contrast|signal|intensity|align", STATUS_LOW_SIGNAL),
)
"""What is found in the words of a warning → STATUS_*; anything else is a fault."""
EVERY_MODE = NANOSECONDS
"""ns between two questions for the state of the system."""
EVERY_SIGNAL = NANOSECONDS // 5
EVERY_INDEX = NANOSECONDS
REPLY_WITHIN = 2 * NANOSECONDS
RESET_WITHIN = 30 * NANOSECONDS
"""ns; clearing an error takes up to 20 s, by the maker's own interface."""
_LONGEST_REPLY = 1 << 16


@dataclass(frozen=True)
class IdsSettings:
    """How the instrument is read.

    Attributes:
        link: where it is.
        axis: 0, 1 or 2.
        sign: -1 if its displacement falls when the mirror moves away.
        period: ns between two readings.
        index: that it divides the count by; NaN: it is asked for it.
        low_below: contrast, 0..1, below which the signal is low.
        fastest: m/s that it can follow.
        start: begin the measurement if it is not running.
        start_within: ns that this may take.
        renormalise: when an error is cleared.
        warnings: number → STATUS_*, before the words.
    """

    link: LinkSettings
    axis: int
    sign: float
    period: int
    index: float
    low_below: float
    fastest: float
    start: bool
    start_within: int
    renormalise: bool
    warnings: Mapping[int, int]


@dataclass
class _Asked:
    """A request that is not answered yet: what becomes of the answer, when it was sent, until."""

    method: str
    take: Callable[[list[Any]], None]
    sent: int
    until: int


class Ids3010:
    """One axis of an IDS3010 (``InterferometerDevice``).

    Args:
        settings: how it is read.
        time_ns: now.

    Raises:
        OSError: it is not there.
    """

    def __init__(self, settings: IdsSettings, time_ns: int) -> None:
        self._settings = settings
        self._link = Link(settings.link)
        self._lines = Lines(b"\n", _LONGEST_REPLY)
        self._asked: dict[int, _Asked] = {}
        self._number = 0
        self._now = self._opened = time_ns
        self._family = ""
        self._unanswering = deque(FAMILIES)
        self._running = False
        self._started: int | None = None
        self._mode_due = time_ns
        self._reading_due = time_ns
        self._signal_due = time_ns
        self._index_due = time_ns
        self._index = settings.index
        self._contrast = nan
        self._tally = ReadingTally()
        self._speed = SpeedWatch(settings.fastest, settings.period / NANOSECONDS)
        self._names: dict[int, int] = {0: STATUS_OK, **settings.warnings}
        # Time, warning and displacement (m), until the words of every warning are known.
        self._held: deque[tuple[int, int, float]] = deque()
        self._asked_about = 0
        self._answered = _Asked("", self._done, 0, 0)

    def align(self, time_ns: int, setup: str, line: str, step: Point, start: Point) -> None:  # noqa: ARG002
        """Set the zero in software; clear the error that an interrupted beam leaves behind."""
        lost = self._tally.lost
        if self._tally.align(setup):
            self._speed.forget()
            if lost and self._running:
                method = f"{self._family}.system.resetError"
                # It stands still meanwhile: nothing else is asked.
                self._ask(method, [self._settings.renormalise], self._done, RESET_WITHIN)

    def update_position(self, time_ns: int, position: Point) -> None:
        """A real instrument sees for itself where the mirror is."""

    def update_environment(self, time_ns: int, environment: Environment) -> None:
        """The node compensates; what the instrument takes for the air is its own matter."""

    def poll(self, time_ns: int) -> list[Reading]:
        """Return the readings since the last poll, in order.

        Raises:
            OSError: it is gone, does not answer, or no longer measures.
            ValueError: what it answers makes no sense.
        """
        self._now = max(time_ns, self._now)
        for line in self._lines.take(self._link.receive()):
            self._take(line)
        if self._link.ready:
            self._ask_what_is_due()
        elif self._now - self._opened > CONNECT_WITHIN:
            limit = CONNECT_WITHIN // NANOSECONDS
            raise TimeoutError(
                f"{self._link.url} does not accept a connection within {limit} s: is the IDS3010"
                " switched on, and is 'host' its name or IP address?"
            )
        for asked in self._asked.values():
            if self._now > asked.until:
                waited = (asked.until - asked.sent) / NANOSECONDS
                raise Silent(
                    f"the IDS has not answered {asked.method} within {waited:g} s",
                    fault="silent",
                    aspect="answer",
                )
        return self._readings()

    def close(self) -> None:
        """Let the instrument go; it goes on measuring, for others that look at it."""
        self._link.close()

    # Requests -------------------------------------------------------------------------------------

    def _ask_what_is_due(self) -> None:
        if any(asked.method.endswith("resetError") for asked in self._asked.values()):
            return
        if not self._family:
            if not self._asked:
                self._ask(f"{self._unanswering[0]}.system.getCurrentMode", [], self._take_mode)
            return
        axis = self._settings.axis
        displacement = f"{self._family}.displacement"
        if self._now >= self._mode_due and not self._waits(self._take_mode):
            self._mode_due = self._now + EVERY_MODE
            self._ask(f"{self._family}.system.getCurrentMode", [], self._take_mode)
        if not self._running:
            return
        if self._now >= self._index_due and not isfinite(self._settings.index):
            self._index_due = self._now + EVERY_INDEX
            # By the source, the axis has to be -1: all of them.
            self._ask("com.attocube.ecu.getRefractiveIndexForCompensation", [-1], self._take_index)
        if self._now >= self._signal_due:
            self._signal_due = self._now + EVERY_SIGNAL
            self._ask(f"{displacement}.getAxisSignalQuality", [axis], self._take_signal)
        if self._now >= self._reading_due and not self._waits(self._take_displacement):
            # What could not be asked in time is left out, not asked all at once.
            self._reading_due = max(self._reading_due + self._settings.period, self._now)
            self._ask(f"{displacement}.getAxisDisplacement", [axis], self._take_displacement)

    def _waits(self, take: Callable[[list[Any]], None]) -> bool:
        return any(asked.take == take for asked in self._asked.values())

    def _ask(
        self,
        method: str,
        parameters: list[Any],
        take: Callable[[list[Any]], None],
        within: int = REPLY_WITHIN,
    ) -> None:
        self._number += 1
        request = {
            "jsonrpc": "2.0",
            "method": method,
            "params": parameters,
            "id": self._number,
            "api": 2,
        }
        self._asked[self._number] = _Asked(method, take, self._now, self._now + within)
        self._link.send(json.dumps(request).encode() + b"\n")

    def _take(self, line: bytes) -> None:
        """Take one answer.

        Raises:
            ValueError: it is not an answer.
        """
        try:
            answer = parse_json(line.decode(), "the answer")
        except ValueError:
            raise Refusal(
                f"{self._link.url} answers {line[:60]!r}, which is not JSON: is it the IDS3010?",
                fault="malformed",
                aspect="JSON",
            ) from None
        if not isinstance(answer, dict):
            raise Refusal(
                f"{self._link.url} answers {line[:60]!r}, which is not JSON-RPC",
                fault="malformed",
                aspect="JSON-RPC",
            )
        asked = self._asked.pop(answer.get("id"), None)  # type: ignore[arg-type]
        if asked is None:
            # A notification, or an answer that somebody else's program asked for.
            return
        if "error" in answer:
            self._take_refusal(asked, answer["error"])
            return
        result = answer.get("result")
        if not isinstance(result, list) or not result:
            raise ValueError(f"the IDS answers {asked.method} with {str(result)[:60]}")
        self._answered = asked
        asked.take(result)

    def _take_refusal(self, asked: _Asked, error: Any) -> None:
        if not self._family and len(self._unanswering) > 1:
            self._unanswering.popleft()
            return
        words = error.get("message", error) if isinstance(error, dict) else error
        if asked.take == self._take_signal:
            # Without it nothing is lost but the strength of the signal.
            self._signal_due = self._now + 60 * NANOSECONDS
            return
        raise ValueError(f"the IDS refuses {asked.method}: {words}")

    # Answers --------------------------------------------------------------------------------------

    def _take_mode(self, result: list[Any]) -> None:
        mode = result[-1]
        if not isinstance(mode, str):
            raise ValueError(f"the IDS reports {str(mode)[:60]} as the state of its system")
        self._family = self._family or self._unanswering[0]
        if mode == "measurement running":
            self._running = True
            return
        if self._running:
            raise Lost(f"the IDS no longer measures: its state is '{mode}'", fault="stopped")
        if mode in ("measurement starting", "measurement restarting"):
            self._started = self._started or self._now
        elif mode == "system idle" and self._settings.start:
            if self._started is None:
                self._started = self._now
                self._ask(f"{self._family}.system.startMeasurement", [], self._done)
        else:
            raise Lost(f"the IDS does not measure: its state is '{mode}'", fault="not_ready")
        if self._now - self._started > self._settings.start_within:
            limit = self._settings.start_within / NANOSECONDS
            raise Silent(
                f"the IDS has not begun to measure within {limit:g} s",
                fault="silent",
                aspect="measurement",
            )

    def _done(self, result: list[Any]) -> None:
        if result[0] not in (0, None):
            raise ValueError(f"the IDS refuses {self._answered.method}: error {result[0]}")

    def _take_index(self, result: list[Any]) -> None:
        if result[0] not in (0, None) or len(result) < 2:
            raise Refusal(
                f"the IDS does not report the refractive index of air that it divides by (error"
                f" {result[0]}). Give it in the setting 'refractive_index'",
                fault="undetermined",
            )
        index = _number(result[1], self._answered.method)
        if not 1.0 <= index < 1.01:
            raise ValueError(f"the IDS reports {index:g} as the refractive index of air")
        self._index = index

    def _take_signal(self, result: list[Any]) -> None:
        # Contrast in permille of the full one; a warning here comes with the displacement too.
        if len(result) > 1:
            self._contrast = _number(result[1], self._answered.method) / 1000.0

    def _take_displacement(self, result: list[Any]) -> None:
        if len(result) < 2:
            raise ValueError(f"the IDS answers {self._answered.method} with {result}")
        warning = result[0] or 0
        if not isinstance(warning, int):
            raise ValueError(f"the IDS answers {self._answered.method} with {result}")
        # Somewhere between question and answer it was measured.
        time = (self._answered.sent + self._now) // 2
        metres = _number(result[1], self._answered.method) * 1e-12
        if abs(metres) > FARTHEST:
            raise ValueError(f"the IDS reports a displacement of {metres:g} m")
        self._held.append((time, warning, metres))

    def _take_words(self, result: list[Any]) -> None:
        words = str(result[-1]).lower()
        found = (status for pattern, status in WORDS if re.search(pattern, words))
        self._names[self._asked_about] = next(found, STATUS_FAULT)

    def _readings(self) -> list[Reading]:
        readings = []
        while self._held and self._held[0][1] in self._names and isfinite(self._index):
            time, warning, metres = self._held.popleft()
            status = worst(self._names[warning], self._speed.status(time, metres))
            if self._contrast < self._settings.low_below:
                status = worst(status, STATUS_LOW_SIGNAL)
            compensated = self._settings.sign * metres
            raw = compensated * self._index
            if self._settings.index == 1.0:
                # Nothing was divided by: it makes no compensation.
                compensated = nan
            strength = min(max(self._contrast, 0.0), 1.0)
            readings.append(self._tally.reading(Counted(time, raw, compensated, strength, status)))
        if self._held and self._held[0][1] not in self._names:
            self._ask_for_words(self._held[0][1])
        return readings

    def _ask_for_words(self, warning: int) -> None:
        if not self._waits(self._take_words):
            self._asked_about = warning
            self._ask("com.attocube.system.errorNumberToString", [0, warning], self._take_words)


def _number(value: Any, method: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ValueError(f"the IDS answers {method} with {str(value)[:60]}, which is not a number")
    return float(value)


def from_settings(
    settings: Mapping[str, Any],
    surroundings: Surroundings,  # noqa: ARG001
) -> Callable[[int], Ids3010]:
    """Return what connects the instrument at a time, ns.

    Settings: ``host``, ``port`` (default 9090), ``axis`` (0, 1 or 2; default 0), ``sign`` (1 or
    -1), ``rate_hz`` (default 50), ``refractive_index`` (default: ask the instrument; 1: it does not
    compensate), ``low_contrast`` (0..1, default 0.05), ``fastest_m_per_s`` (default 2),
    ``start_measurement`` (default true), ``start_within_s`` (default 180), ``renormalise`` (default
    false), ``warnings`` (number → good, low_signal, beam_lost, overspeed or fault).

    Raises:
        ValueError: a setting is wrong.
    """
    section = Section(settings, "settings of the IDS3010")
    host = _host(section)
    port = section.integer("port", low=1, high=65535, default=PORT)
    sign = section.integer("sign", low=-1, high=1, default=1)
    if not sign:
        raise Refusal(f"{section.source}: 'sign' is 0; expected 1 or -1", fault="out_of_range")
    warnings = section.table("warnings", tuple(STATUSES))
    if wrong := [number for number in warnings if not number.isdecimal()]:
        raise ValueError(f"{section.source}: 'warnings' has '{wrong[0]}'; expected a number")
    asks = section.unknown("refractive_index")
    made = IdsSettings(
        link=LinkSettings(f"socket://{host}:{port}"),
        axis=section.integer("axis", low=0, high=2, default=0),
        sign=float(sign),
        period=round(NANOSECONDS / section.number("rate_hz", low=0.1, high=500.0, default=50.0)),
        index=nan if asks else section.number("refractive_index", low=1.0, high=1.01),
        low_below=section.number("low_contrast", low=0.0, high=1.0, default=0.05),
        fastest=section.number("fastest_m_per_s", low=0.0, high=100.0, default=2.0),
        start=section.flag("start_measurement", default=True),
        start_within=round(
            NANOSECONDS * section.number("start_within_s", low=1.0, high=3600.0, default=180.0)
        ),
        renormalise=section.flag("renormalise", default=False),
        warnings={int(number): STATUSES[word] for number, word in warnings.items()},
    )
    section.finish()
    return lambda start: Ids3010(made, start)


def _host(section: Section) -> str:
    try:
        host = section.text("host")
    except Refusal as error:
        fields = fields_of(error)
        if fields.get("fault") != "missing":
            raise
        what = "give the name or IP address of the instrument, such as 192.168.1.1"
        raise Refusal(f"{error}; {what}", **fields) from None
    if not re.fullmatch(r"[\w.:-]+|\[[0-9a-fA-F:]+\]", host):
        raise Refusal(
            f"{section.source}: 'host' is '{host}'; expected a name or an IP address",
            fault="malformed",
        )
    return host
