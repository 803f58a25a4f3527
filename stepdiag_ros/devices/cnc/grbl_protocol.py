"""What a controller with Grbl 1.1 or grblHAL says, line by line, as values.

Source: "Grbl v1.1 Interface", "Grbl v1.1 Commands" and "Grbl v1.1 Configuration" (documentation of
gnea/grbl); for what grblHAL adds (``H:``, sub-states of Alarm, further codes) the sources of
grblHAL/core (report.c, alarms.c, errors.c). The words for codes are our own, after those tables.
"""

import re
from dataclasses import dataclass
from enum import Enum
from math import isfinite

from stepdiag_ros.devices.cnc import Point

INCH = 0.0254
"""m."""

STATUS_QUERY = b"?"
FEED_HOLD = b"!"
SOFT_RESET = b"\x18"


class Activity(Enum):
    """What the controller does: the first field of a status report."""

    IDLE = "Idle"
    RUN = "Run"
    HOLD = "Hold"
    JOG = "Jog"
    ALARM = "Alarm"
    DOOR = "Door"
    CHECK = "Check"
    HOME = "Home"
    SLEEP = "Sleep"
    TOOL = "Tool"


MOVING = (Activity.RUN, Activity.JOG, Activity.HOME)
"""In which the axes are made to move; a hold or an open door may still brake them."""


@dataclass(frozen=True)
class StatusReport:
    """A report in chevrons.

    Attributes:
        activity: of the controller.
        part: sub-state; -1 if none is reported.
        machine: machine position of the first three axes, in the unit of the reports; None
            if the work position is reported instead.
        work: work position; None if the machine position is reported.
        offset: work coordinate offset, where the report has it.
        pins: letters of the inputs that are triggered.
        feed_override: in percent, where the report has it.
        homed: grblHAL says whether all axes are homed; None where it does not.
    """

    activity: Activity
    part: int
    machine: Point | None
    work: Point | None
    offset: Point | None
    pins: str
    feed_override: int | None
    homed: bool | None

    @property
    def at_rest(self) -> bool:
        """Say whether a hold or an open door has brought the axes to rest."""
        return self.part == 0 or (self.activity is Activity.DOOR and self.part == 1)


@dataclass(frozen=True)
class LineAnswer:
    """``ok`` (code 0) or ``error:`` with its code, to the oldest line not answered yet."""

    code: int


@dataclass(frozen=True)
class Alarm:
    """``ALARM:`` with its code."""

    code: int


@dataclass(frozen=True)
class Banner:
    """The welcome after a start or reset; everything starts again."""

    text: str


@dataclass(frozen=True)
class GrblSetting:
    """One line of ``$$``."""

    number: int
    value: str


@dataclass(frozen=True)
class StartupBlock:
    """One line of ``$N``: G-code that the controller executes by itself after a reset."""

    number: int
    code: str


@dataclass(frozen=True)
class Message:
    """Anything else in brackets, such as ``VER``, ``OPT`` or ``MSG``."""

    kind: str
    text: str


LOCKED = Message("MSG", "Reset to continue")
"""After an alarm of limits: it answers nothing any more but a reset."""


@dataclass(frozen=True)
class Garbage:
    """No line of this protocol."""

    line: str


Said = StatusReport | LineAnswer | Alarm | Banner | GrblSetting | StartupBlock | Message | Garbage

_REPORT = re.compile(r"<([^<>]*)>")
_ANSWER = re.compile(r"(ok)|error: ?(\d{1,3})")
_ALARM = re.compile(r"ALARM: ?(\d{1,3})")
_BANNER = re.compile(r"(Grbl|GrblHAL) \d.*")
_SETTING = re.compile(r"\$(\d{1,4})=(.*)")
_STARTUP = re.compile(r"\$N(\d)=(.*)")
_MESSAGE = re.compile(r"\[([^:\]]+):?(.*)\]")
_NUMBER = re.compile(r"-?\d+(\.\d+)?")


def read_line(line: bytes) -> Said:
    """Return what a line says; a line that is damaged or unknown is ``Garbage``."""
    text = line.decode("latin-1").strip()
    # The end of a line may be lost, and the next one be glued to it: a whole report is still whole.
    if reports := _REPORT.findall(text):
        report = _read_report(reports[-1])
        return Garbage(text) if report is None else report
    if found := _ANSWER.fullmatch(text):
        return LineAnswer(0 if found[1] else int(found[2]))
    if found := _ALARM.fullmatch(text):
        return Alarm(int(found[1]))
    if _BANNER.fullmatch(text):
        return Banner(text)
    if found := _SETTING.fullmatch(text):
        return GrblSetting(int(found[1]), found[2].strip())
    if found := _STARTUP.fullmatch(text):
        return StartupBlock(int(found[1]), found[2].strip())
    # ">G54:ok" tells that a startup block was executed.
    if text.startswith(">"):
        return Message("startup", text[1:])
    if found := _MESSAGE.fullmatch(text):
        return Message(found[1], found[2])
    return Garbage(text)


def _read_report(text: str) -> StatusReport | None:
    first, *rest = text.split("|")
    name, _, part = first.partition(":")
    fields = {}
    for field in rest:
        key, _, value = field.partition(":")
        fields[key] = value
    try:
        activity = Activity(name)
        machine, work = _point(fields.get("MPos")), _point(fields.get("WPos"))
        if (machine is None) == (work is None):
            return None
        override = fields.get("Ov")
        homed = fields.get("H")
        return StatusReport(
            activity,
            int(part) if part else -1,
            machine,
            work,
            _point(fields.get("WCO")),
            fields.get("Pn", ""),
            None if override is None else int(override.split(",")[0]),
            None if homed is None else homed.startswith("1"),
        )
    except ValueError:
        return None


def _point(text: str | None) -> Point | None:
    if text is None:
        return None
    values = text.split(",")
    if len(values) < 3 or not all(_NUMBER.fullmatch(value) for value in values):
        raise ValueError("no position")
    x, y, z = (float(value) for value in values[:3])
    if not all(map(isfinite, (x, y, z))):
        raise ValueError("no position")
    return x, y, z


_WORD = re.compile(r"([A-Z])([-+.\d]+)")
_RETURNS = {28.0, 30.0, 38.2, 38.3, 38.4, 38.5}
_SHIFTS = {10.0, 28.1, 30.1, 43.1, 92.0}
"""These store a position or shift coordinates: their axis words move nothing."""


def moves(code: str) -> bool:
    """Say whether a block of G-code may move an axis."""
    bare = re.sub(r"\([^)]*\)|;.*|\s", "", code).upper()
    letters, commands = set(), set()
    for letter, value in _WORD.findall(bare):
        letters.add(letter)
        if letter == "G" and _NUMBER.fullmatch(value):
            commands.add(float(value))
    return bool(commands & _RETURNS) or (
        bool(letters & set("XYZABCUVW")) and not commands & _SHIFTS
    )


_ALARMS = {
    1: "a limit switch was hit",
    2: "a target lay beyond the soft limits of the controller",
    3: "it was reset while the axes moved",
    4: "the probe was not in its initial state",
    5: "the probe touched nothing",
    6: "it was reset while it homed",
    7: "the safety door was opened while it homed",
    8: "homing: the limit switch was not left when pulling off",
    9: "homing: no limit switch was found",
    10: "homing: the second switch of a twin axis was not found, or (grblHAL) emergency stop",
    11: "homing is required",
    12: "a limit switch is engaged",
    13: "the probe protection was triggered",
    14: "the spindle did not reach its speed",
    15: "homing: the second switch of a squared axis was not found",
    16: "its self-test failed",
    17: "a motor fault",
    18: "homing is set up wrongly",
    19: "a Modbus device does not answer",
    20: "an input/output expander does not answer",
    21: "its memory of settings failed",
    22: "its buffer ran over",
}
ALARMS_THAT_KEEP_POSITION = frozenset({2, 4, 5})
"""After every other one the machine may have lost steps, or does not know where it is."""

_ERRORS = {
    1: "a letter of G-code is missing",
    2: "a number cannot be read",
    3: "it does not know this $ command",
    4: "a value is negative",
    5: "homing is not enabled",
    6: "its step pulse is too short",
    7: "its memory of settings cannot be read",
    8: "it is not idle",
    9: "it is locked by an alarm or a jog",
    10: "soft limits need homing",
    11: "the line is too long",
    12: "the step rate is too high",
    13: "the safety door is open",
    14: "the line is too long to be stored",
    15: "the target lies beyond its travel",
    16: "a jog is not allowed so",
    17: "laser mode is not possible",
    18: "it was reset",
    20: "it does not know this G-code",
    21: "two commands of one group",
    22: "no feed was given",
    23: "a whole number is needed",
    24: "two commands want the axes",
    25: "a word comes twice",
    26: "no axis is named",
    27: "the line number is not allowed",
    28: "a value is missing",
    30: "G53 needs G0 or G1",
    31: "an axis is named that nothing moves",
    33: "the target is not allowed",
    36: "a word is not used",
    39: "a value is out of range",
    40: "a tool change is pending",
    43: "the feed is too high",
    45: "a limit switch is engaged",
    46: "homing is required",
    49: "its self-test failed",
    50: "the emergency stop is active",
    51: "a motor fault",
    79: "it must be reset first",
}


def alarm_words(code: int) -> str:
    """Return an alarm in words."""
    return f"alarm {code}: {_ALARMS.get(code, 'see the manual of the firmware')}"


def error_words(code: int) -> str:
    """Return an error in words."""
    return f"error {code}: {_ERRORS.get(code, 'see the manual of the firmware')}"


def unexpected_words(report: StatusReport) -> str:
    """Say what a controller does that was not asked for."""
    words = {
        Activity.RUN: "the controller moves by the command of somebody else",
        Activity.JOG: "the machine is jogged by somebody else",
        Activity.HOME: "the machine is homed by somebody else",
        Activity.HOLD: "feed hold at the machine",
        Activity.DOOR: "the safety door was opened",
        Activity.CHECK: "the controller only checks G-code ($C) and makes no moves",
        Activity.SLEEP: "the controller sleeps ($SLP): its motors have no current",
        Activity.TOOL: "the controller waits for a tool change",
    }
    return with_pins(
        words.get(report.activity, f"the controller is {report.activity.value}"), report
    )


def with_pins(words: str, report: StatusReport) -> str:
    """Add the inputs that are triggered, if any are."""
    return f"{words} (inputs {report.pins})" if report.pins else words
