"""How a controller with Grbl is set up, from what it answers to ``$I``, ``$$`` and ``$N``.

Source: "Grbl v1.1 Configuration" and "Grbl v1.1 Interface" (documentation of gnea/grbl); the
envelope with pull-off is that of grblHAL/core, machine_limits.c.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import nan
from typing import Any

from stepdiag_ros.devices.cnc import Point, Traits
from stepdiag_ros.devices.cnc.grbl_conversation import Timing
from stepdiag_ros.devices.cnc.grbl_protocol import (
    INCH,
    GrblSetting,
    Message,
    Said,
    StartupBlock,
    moves,
)
from stepdiag_ros.devices.link import LinkSettings
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import MILLI, NANOSECONDS

REPORT_MASK, REPORT_INCHES = 10, 13
SOFT_LIMITS, HARD_LIMITS, HOMING, HOMING_DIRECTION, PULL_OFF = 20, 21, 22, 23, 27
STEPS, RATE, ACCELERATION, TRAVEL = 100, 110, 120, 130

_GRBL_DECIMALS = {False: 1e-3 * MILLI, True: 1e-4 * INCH}
"""m: step of a position in a report, whether in inches or not."""


@dataclass(frozen=True)
class GrblSettings:
    """Settings of the driver.

    Attributes:
        connection: serial port or TCP connection.
        timing: of the reports.
        without_homing: accept a controller that does not home.
        home_on_reset: home the machine when an operator resets it and its position is not known.
        homing_limit: ns that homing may take.
    """

    connection: LinkSettings
    timing: Timing
    without_homing: bool = False
    home_on_reset: bool = False
    homing_limit: int = 120 * NANOSECONDS

    @classmethod
    def from_mapping(cls, settings: Mapping[str, Any]) -> "GrblSettings":
        """Take the settings from the parsed YAML of a device file.

        ``connection`` (``url`` and what a serial port needs, 115200 baud by default),
        ``report_rate_hz`` (default 10; at most ``position_rate_hz``, which the bridge adds),
        ``silence_s`` (default 1), ``start_limit_s`` (default 5), ``without_homing`` and
        ``home_on_reset`` (default false), ``homing_limit_s`` (default 120).

        Raises:
            ValueError: a setting is wrong, or not known.
        """
        section = Section(settings, "settings of the grbl controller")
        rate = min(
            section.number("report_rate_hz", low=2.0, high=200.0, default=10.0),
            section.number("position_rate_hz", low=1.0, high=10_000.0, default=10.0),
        )
        silence = section.number("silence_s", low=0.3, high=60.0, default=1.0)
        start = section.number("start_limit_s", low=0.3, high=60.0, default=5.0)
        homing = section.number("homing_limit_s", low=1.0, high=3600.0, default=120.0)
        prepared = cls(
            connection=LinkSettings.from_section(section.section("connection"), baud_rate=115200),
            timing=Timing(
                round(NANOSECONDS / rate), round(silence * NANOSECONDS), round(start * NANOSECONDS)
            ),
            without_homing=section.flag("without_homing", default=False),
            home_on_reset=section.flag("home_on_reset", default=False),
            homing_limit=round(homing * NANOSECONDS),
        )
        section.finish()
        return prepared


@dataclass(frozen=True)
class GrblSetup:
    """What was read from a controller.

    Attributes:
        identity: version, build and name of the machine.
        unit: of the positions in reports, m.
        low: lower limits of X, Y, Z, those of machine file and controller together, m.
        high: upper limits, m.
        rate: largest speed of each axis, m/s.
        traits: for the bridge.
        homing: the controller has a homing cycle, and machine coordinates from it.
    """

    identity: str
    unit: float
    low: Point
    high: Point
    rate: Point
    traits: Traits
    homing: bool


class Interview:
    """Asks a controller how it is set up, one question at a time, and keeps what it answers."""

    def __init__(self) -> None:
        self._left = ["$N", "$$", "$I"]
        self._settings: dict[int, str] = {}
        self._messages: dict[str, str] = {}
        self._startup: dict[int, str] = {}

    @property
    def is_grblhal(self) -> bool:
        """Say whether the firmware is grblHAL."""
        return self._messages.get("FIRMWARE") == "grblHAL"

    def next_question(self) -> str:
        """Return the next line to send; empty when all was asked."""
        return self._left.pop() if self._left else ""

    def take(self, said: Said) -> None:
        """Keep what belongs to an answer."""
        if isinstance(said, GrblSetting):
            self._settings[said.number] = said.value
        elif isinstance(said, StartupBlock):
            self._startup[said.number] = said.code
        elif isinstance(said, Message):
            self._messages[said.kind] = said.text

    def setup(self, machine: Machine, settings: GrblSettings) -> GrblSetup:
        """Return how the controller is set up (see ``read_setup``)."""
        return read_setup(
            self._settings,
            self._messages,
            self._startup,
            machine,
            without_homing=settings.without_homing,
        )


def read_setup(
    settings: Mapping[int, str],
    messages: Mapping[str, str],
    startup: Mapping[int, str],
    machine: Machine,
    *,
    without_homing: bool,
) -> GrblSetup:
    """Return how a controller is set up.

    Args:
        settings: number → value of ``$$``.
        messages: kind → text of ``$I``.
        startup: number → G-code of ``$N``.
        machine: as its file describes it.
        without_homing: a controller that does not home is accepted.

    Raises:
        ValueError: a setting is missing or makes no sense, or the machine must not be moved by
            this controller as it is set up; the text says what to do.
    """
    for number, code in startup.items():
        if moves(code):
            raise Refusal(
                f"the controller moves by itself after each reset ($N{number}={code}): clear that"
                f" start-up block ($N{number}=) before this software may use it",
                fault="rejected",
            )
    homing = _integer(settings, HOMING)
    if not homing & 1 and not without_homing:
        raise Refusal(
            "the controller does not home ($22=0), so its machine coordinates begin where it was"
            " switched on: enable homing, or say without_homing: true in the device file",
            fault="rejected",
        )
    inches = bool(_integer(settings, REPORT_INCHES) & 1)
    steps = _axes(settings, STEPS, "steps/mm")
    step = [MILLI / value for value in steps]
    # A work position and its offset are rounded each.
    told = _GRBL_DECIMALS[inches] * (1 if _integer(settings, REPORT_MASK) & 1 else 2)
    rates = _point(value * MILLI / 60.0 for value in _axes(settings, RATE, "mm/min"))
    accelerations = _point(v * MILLI for v in _axes(settings, ACCELERATION, "mm/s²"))
    low, high = _limits(settings, machine, homing, "Z" in messages.get("OPT", "").split(",")[0])
    return GrblSetup(
        identity=" ".join(
            filter(None, (messages.get("FIRMWARE", "Grbl"), messages.get("VER", "").strip(":")))
        ),
        unit=INCH if inches else MILLI,
        low=low,
        high=high,
        rate=rates,
        traits=Traits(
            resolution=_point(max(value, told) for value in step),
            acceleration=accelerations,
            feed_limit=rates,
            dead_man=nan,
            measured=False,
        ),
        homing=bool(homing & 1),
    )


def _limits(
    settings: Mapping[int, str], machine: Machine, homing: int, zero_at_switch: bool
) -> tuple[Point, Point]:
    """Return the limits of the machine file, within those of the controller if it has any."""
    if not _integer(settings, SOFT_LIMITS):
        return machine.travel_low_m, machine.travel_high_m
    travels = _axes(settings, TRAVEL, "mm")
    # With hard limits grblHAL keeps clear of the switches; with Grbl this is on the safe side.
    kept = _number(settings, PULL_OFF) if _integer(settings, HARD_LIMITS) & 1 else 0.0
    directions = _integer(settings, HOMING_DIRECTION)
    lows, highs = [], []
    for number, (axis, travel) in enumerate(zip(AXES, travels, strict=True)):
        # Machine coordinates are negative, unless zero is set at the switch (build option Z of
        # Grbl, bit 3 of $22 in grblHAL) and the axis homes downwards.
        positive = (zero_at_switch or homing & 8) and directions & (1 << number)
        if positive:
            own = (0.0, (travel - kept) * MILLI)
        elif zero_at_switch or homing & 8:
            own = (-(travel - kept) * MILLI, 0.0)
        else:
            own = (-(travel - kept) * MILLI, -kept * MILLI)
        low = max(machine.travel_low_m[number], own[0])
        high = min(machine.travel_high_m[number], own[1])
        if low >= high:
            raise Refusal(
                f"the soft limits of the controller for {axis} are {own[0]:g} m to {own[1]:g} m"
                f" ($13{number}), those of the machine file {machine.travel_low_m[number]:g} m to"
                f" {machine.travel_high_m[number]:g} m: give the machine file in the machine"
                " coordinates of the controller",
                fault="mismatch",
            )
        lows.append(low)
        highs.append(high)
    return _point(lows), _point(highs)


def _axes(settings: Mapping[int, str], first: int, unit: str) -> Point:
    values = [_number(settings, first + axis) for axis in range(3)]
    for axis, value in enumerate(values):
        if not value > 0.0:
            raise Refusal(
                f"the controller says ${first + axis}={value:g} {unit}: not above 0",
                fault="out_of_range",
            )
    return _point(values)


def _point(values: Iterable[float]) -> Point:
    x, y, z = values
    return x, y, z


def _number(settings: Mapping[int, str], number: int) -> float:
    text = settings.get(number)
    if text is None:
        raise Refusal(
            f"the controller does not report its setting ${number}. Check that it runs Grbl 1.1",
            fault="missing",
        )
    try:
        return float(text)
    except ValueError:
        raise Refusal(
            f"the controller says ${number}={text}: no number", fault="malformed"
        ) from None


def _integer(settings: Mapping[int, str], number: int) -> int:
    return int(_number(settings, number))
