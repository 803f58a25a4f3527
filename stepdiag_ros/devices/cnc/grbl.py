"""Controllers with Grbl 1.1 or grblHAL, over a serial port or TCP.

A move is one line ``G90 G94 G21 G53 G1``: straight, at a feed, in machine coordinates, so that no
work offset, tool length, inch or incremental mode left behind by somebody can change it; and no
jog (``$J``), which obeys neither door nor feed override as a program does. It names only the axes
that may move. One line is on its way at a time, and none is ever sent again: a lost connection can
cost the step that is being made, never make one twice.

Grbl has no encoders. The position it reports is the count of the steps that it has sent, rounded to
1 µm; whether the motors followed, it cannot know. It has no watchdog either: when this computer
falls silent, the machine finishes the one line that it has.

To stop means feed hold (``!``), which brakes along the path, and, when the axes stand, a soft
reset, which throws the rest of the move away and keeps the position. What was interrupted is never
resumed (``~`` is not sent).

Source: "Grbl v1.1 Interface", "Grbl v1.1 Commands", "Grbl v1.1 Configuration" (documentation of
gnea/grbl); reports of grblHAL/core.
"""

from collections.abc import Callable, Mapping
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.cnc import (
    UNKNOWN_POINT,
    CncEvent,
    CncState,
    MoveRefused,
    Point,
    PositionSample,
    StateChange,
    Traits,
    not_ready,
    still_moves,
)
from stepdiag_ros.devices.cnc.grbl_conversation import Conversation
from stepdiag_ros.devices.cnc.grbl_move import (
    Approach,
    Doing,
    MoveProgress,
    ReportedPosition,
    TakenReport,
    braking_limit,
    check_move,
    line_of_move,
    not_yet,
)
from stepdiag_ros.devices.cnc.grbl_protocol import (
    ALARMS_THAT_KEEP_POSITION,
    FEED_HOLD,
    LOCKED,
    MOVING,
    SOFT_RESET,
    Activity,
    Alarm,
    Banner,
    LineAnswer,
    Message,
    Said,
    StatusReport,
    alarm_words,
    error_words,
    unexpected_words,
    with_pins,
)
from stepdiag_ros.devices.cnc.grbl_setup import GrblSettings, GrblSetup, Interview
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.units import NANOSECONDS

_IDLE, _ALARM = Activity.IDLE, Activity.ALARM
REPORT_ALL = b"\x87"
"""grblHAL's query for a report with everything in it; Grbl ignores it."""
STALLED = 3 * NANOSECONDS
"""ns without a change of position in a move."""
RESET_LIMIT = 3 * NANOSECONDS
"""ns from a soft reset to the welcome."""
RESTARTED = "the controller was restarted"


class GrblCnc:
    """A controller with Grbl 1.1 or grblHAL (protocol: ``CncDevice``).

    It is FAULT, and refuses moves, until it has reported its settings.

    Args:
        machine: travel, feed limit, window and hold time; in the machine coordinates of the
            controller.
        settings: of the driver.
        start: now, ns.

    Raises:
        OSError: the port cannot be opened.
    """

    def __init__(self, machine: Machine, settings: GrblSettings, start: int) -> None:
        self._machine = machine
        self._settings = settings
        self._braking_limit = NANOSECONDS
        self._now = start
        self._told = start
        self._talk = Conversation(settings.connection, settings.timing, start)
        self._doing = Doing.STARTING
        self._since = start
        self._events: list[CncEvent] = []
        self._setup: GrblSetup | None = None
        self._interview = Interview()
        self._report: StatusReport | None = None
        self._place = ReportedPosition(start)
        self._homed: bool | None = None
        # Why the position is not known, and why the controller is locked; empty if it is not.
        self._lost = self._alarm = ""
        self._critical = self._greeted = False
        self._approach = Approach(machine, UNKNOWN_POINT, UNKNOWN_POINT)
        self._idle_once = False
        self._why = ""
        self._state, self._reason = CncState.FAULT, ""
        self._change(start, CncState.FAULT, f"the controller {Doing.ASKING.value}")

    @property
    def state(self) -> CncState:
        """State at the last time passed to the device."""
        return self._state

    @property
    def soft_limits(self) -> tuple[Point, Point]:
        """Limits of machine file and controller together, m; of the file until it has reported."""
        if self._setup is None:
            return self._machine.travel_low_m, self._machine.travel_high_m
        return self._setup.low, self._setup.high

    @property
    def traits(self) -> Traits:
        """Properties of the controller; unknown until it has reported them."""
        return Traits(measured=False) if self._setup is None else self._setup.traits

    def start_move(self, time_ns: int, target: Point, feed: float, axes: str) -> None:
        """Begin a straight move of the named axes (see ``CncDevice.start_move``)."""
        now = self._tick(time_ns)
        self._check(target, feed, axes)
        if axes:
            self._talk.send(now, line_of_move(target, feed, axes))
        self._approach = Approach(self._machine, self.traits.resolution, target)
        self._approach.acknowledged = not axes
        self._place.changed = now
        self._begin(Doing.MOVING)
        self._change(now, CncState.MOVING, "")

    def stop(self, time_ns: int, reason: str) -> None:
        """Brake to rest at once; STOPPED, with the reason, is reported when the axes stand."""
        now = self._tick(time_ns)
        if self._doing is Doing.HOMING:
            # A feed hold does nothing while it homes.
            self._soft_reset()
        elif self._doing in (Doing.HOLDING, Doing.RESETTING):
            return
        elif self._state is CncState.READY and not self._in_motion():
            self._change(now, CncState.STOPPED, reason)
        elif self._state is CncState.MOVING or self._in_motion():
            self._hold(reason)

    def reset(self, time_ns: int) -> None:
        """Become READY again after a stop or a fault whose cause is gone.

        What needs an answer of the controller (unlocking, a soft reset, homing) is begun, and
        refused for the moment: it is to be asked for again.

        Raises:
            MoveRefused: the axes still move, or it is not ready yet; the text says what to do.
        """
        now = self._tick(time_ns)
        if self._state is CncState.READY:
            return
        report = self._report
        brakes = report is not None and report.activity is Activity.HOLD and not report.at_rest
        if self._state is CncState.MOVING or self._in_motion() or brakes:
            raise still_moves()
        starting = self._doing is Doing.STARTING and report is not None
        if self._doing is not Doing.NOTHING and not starting:
            raise not_yet(f"the controller {self._doing.value}", self._doing.name)
        if report is None and not self._critical:
            raise not_yet("the controller has not reported its state yet", "state")
        if self._critical or report is None or report.activity not in (_IDLE, _ALARM):
            if report is not None and report.activity is Activity.DOOR and report.part == 1:
                said = "the safety door is open: close it, then reset again"
                raise MoveRefused(said, fault="not_ready", aspect="door")
            self._soft_reset()
            raise not_yet("the controller is being reset", "reset")
        if report.activity is _ALARM or self._lost:
            self._unlock(now)
        if self._setup is None:
            raise not_yet(f"the controller {Doing.ASKING.value}", Doing.ASKING.name)
        self._alarm = ""
        self._change(now, CncState.READY, "")

    def poll(self, time_ns: int) -> list[CncEvent]:
        """Return what has happened since the last poll, in order of time."""
        now = self._tick(time_ns)
        for heard in self._talk.poll(now):
            if isinstance(heard.said, StatusReport):
                self._on_report(max(heard.time, self._told), heard.said)
            else:
                self._on_words(heard.said, heard.answers)
        self._judge()
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Let the controller go."""
        self._talk.close()

    # What it says ---------------------------------------------------------------------------------

    def _on_words(self, said: Said, answers: str) -> None:
        if isinstance(said, LineAnswer):
            self._on_answer(said, answers)
        elif isinstance(said, Alarm):
            self._alarm = alarm_words(said.code)
            if said.code not in ALARMS_THAT_KEEP_POSITION:
                self._lost = self._alarm
            self._fault(self._alarm)
        elif isinstance(said, Banner):
            self._on_banner()
        elif isinstance(said, Message) and said == LOCKED:
            # It answers nothing but a reset.
            self._critical = True
            self._talk.be_patient(self._now, silent=True)
        else:
            self._interview.take(said)

    def _on_answer(self, answer: LineAnswer, line: str) -> None:
        wrong = error_words(answer.code) if answer.code else ""
        if self._doing is Doing.ASKING and line:
            if wrong:
                raise ValueError(f"cannot read the settings of the controller ({line}): {wrong}")
            self._ask_next()
        elif self._doing is Doing.MOVING and line:
            self._approach.acknowledged = not wrong
            if wrong:
                self._fault(f"the controller refused the move: {wrong}")
        elif self._doing in (Doing.UNLOCKING, Doing.HOMING):
            homed = self._doing is Doing.HOMING
            self._talk.be_patient(self._now, silent=False)
            self._begin(Doing.NOTHING)
            self._report = None
            if not wrong:
                self._alarm = self._lost = ""
                if homed:
                    self._place = ReportedPosition(self._now)
            else:
                self._fault(f"the controller cannot be {'homed' if homed else 'unlocked'}: {wrong}")
        elif wrong and self._doing is not Doing.RESETTING:
            self._fault(f"the controller says {wrong}, without being asked")

    def _on_banner(self) -> None:
        self._critical, self._report = False, None
        self._talk.be_patient(self._now, silent=False)
        if self._doing is Doing.RESETTING:
            self._greeted = True
            return
        if self._setup is not None:
            # Its position may be another one now: it is known again when the first report agrees.
            self._lost = self._lost or RESTARTED
            restarted = f"{RESTARTED}, by its reset button or by loss of power"
            self._fault("; ".join(filter(None, (self._alarm, restarted))))
        self._place.forget_offset()
        self._begin(Doing.STARTING)

    def _on_report(self, time: int, report: StatusReport) -> None:
        self._report = report
        self._locate(time, report)
        if report.homed is not None:
            self._on_homed(report.homed)
        if self._doing is Doing.STARTING:
            self._on_first(report)
        elif self._doing is Doing.MOVING:
            self._watch_move(time, report)
        elif self._doing is Doing.HOLDING:
            self._watch_hold(report)
        elif self._doing is Doing.RESETTING and self._greeted:
            self._after_reset(time, report)
        elif self._doing is Doing.NOTHING:
            self._watch_rest(time, report)

    def _locate(self, time: int, report: StatusReport) -> None:
        """Take the position, if it is reported and possible."""
        if self._setup is None:
            return
        before = self._place.position
        homing = report.activity is Activity.HOME or self._doing is Doing.HOMING
        taken = self._place.take(time, report, self._setup, anywhere=homing)
        if taken is TakenReport.NOT_YET:
            return
        position = self._place.position
        if taken is TakenReport.JUMPED:
            self._lost = self._lost or "the position jumped"
            self._fault("the position jumped: the controller has another zero than before")
        elif self._lost == RESTARTED and position == before:
            # A reset at rest keeps the position; all zeros may come from switching off as well.
            self._lost = "" if any(position) or self._setup.homing else self._lost
        self._told = time
        self._events.append(PositionSample(time, position))

    def _on_homed(self, homed: bool) -> None:
        if homed and self._homed is False:
            self._lost = ""
        self._homed = homed
        if not homed and not self._settings.without_homing:
            self._lost = self._lost or "the machine is not homed"
            if self._state is CncState.READY:
                self._fault("the machine is not homed")

    # Beginning ------------------------------------------------------------------------------------

    def _on_first(self, report: StatusReport) -> None:
        if report.activity in (_IDLE, _ALARM):
            self._interview = Interview()
            self._begin(Doing.ASKING)
            self._ask_next()
        elif self._why != (words := unexpected_words(report)):
            self._why = words
            self._fault(words)

    def _ask_next(self) -> None:
        if question := self._interview.next_question():
            self._talk.send(self._now, question)
            return
        known = self._setup is not None
        self._setup = self._interview.setup(self._machine, self._settings)
        self._braking_limit = braking_limit(self._machine, self._setup)
        if self._interview.is_grblhal:
            self._talk.ask_with(REPORT_ALL)
        self._begin(Doing.NOTHING)
        self._why = "" if known else "opened"

    # Watching -------------------------------------------------------------------------------------

    def _watch_rest(self, time: int, report: StatusReport) -> None:
        opened, self._why = self._why == "opened", ""
        if report.activity is _ALARM:
            words = self._alarm or "the controller is locked: it is not homed, or had an alarm"
            self._lost = self._lost or ("" if self._alarm else words)
            if opened or self._state is not CncState.FAULT:
                self._fault(with_pins(words, report))
        elif report.activity in MOVING:
            if opened or self._state is not CncState.FAULT:
                self._fault(unexpected_words(report))
        elif opened:
            if report.activity is _IDLE and not self._lost:
                self._change(time, CncState.READY, "")
            else:
                self._fault(self._lost or unexpected_words(report))
        elif self._state is CncState.READY and report.activity is not _IDLE:
            if report.activity in (Activity.HOLD, Activity.DOOR):
                self._change(time, CncState.STOPPED, unexpected_words(report))
            else:
                self._fault(unexpected_words(report))

    def _watch_move(self, time: int, report: StatusReport) -> None:
        if report.activity is _ALARM:
            self._fault(with_pins(self._alarm or "the controller is locked by an alarm", report))
        elif report.activity in (Activity.HOLD, Activity.DOOR):
            self._why = unexpected_words(report)
            self._begin(Doing.HOLDING)
            self._watch_hold(report)
        elif report.activity not in (_IDLE, Activity.RUN):
            self._fault(unexpected_words(report))
        elif self._approach.acknowledged:
            moving = report.activity is Activity.RUN
            progress = self._approach.judge(time, self._place.position, moving=moving)
            if progress is MoveProgress.ARRIVED:
                self._begin(Doing.NOTHING)
                self._change(time, CncState.READY, "")
            elif progress is MoveProgress.AWAY:
                where = ", ".join(f"{value * 1e3:.3f}" for value in self._place.position)
                self._fault(f"the controller is idle at {where} mm, away from the target")

    def _watch_hold(self, report: StatusReport) -> None:
        """Wait until the axes stand, then throw the rest of the move away."""
        if report.activity is _ALARM:
            self._begin(Doing.NOTHING)
            self._fault(self._alarm or "the controller is locked by an alarm")
        elif report.activity in (Activity.HOLD, Activity.DOOR):
            if report.at_rest:
                self._soft_reset()
        elif report.activity is _IDLE and not self._talk.awaiting and self._idle_once:
            self._soft_reset()
        elif report.activity in (*MOVING, _IDLE):
            # A line that is read just now begins after the first hold: once idle is not enough.
            self._idle_once = report.activity is _IDLE
            self._talk.command(FEED_HOLD)
        else:
            self._soft_reset()

    def _after_reset(self, time: int, report: StatusReport) -> None:
        self._begin(Doing.NOTHING if self._setup is not None else Doing.STARTING)
        if report.activity is _ALARM:
            self._fault(self._alarm or "the controller is locked after its reset")
        elif self._state is CncState.MOVING:
            self._change(time, CncState.STOPPED, self._why)
        self._why = ""

    def _judge(self) -> None:
        """Notice what does not happen in time."""
        waited = self._now - self._since
        if self._doing is Doing.HOLDING and waited > self._braking_limit:
            # Killed: the axes stop at once, and steps may be lost. The alarm says so.
            self._soft_reset()
        elif self._doing is Doing.RESETTING and waited > RESET_LIMIT:
            raise TimeoutError("the controller does not answer a reset: use the emergency stop")
        elif (
            self._doing is Doing.MOVING
            and self._approach.acknowledged
            and not self._approach.inside
            and self._now - self._place.changed > STALLED
        ):
            self._fault(f"the axes have stood for {STALLED // NANOSECONDS} s away from the target")

    # Doing ----------------------------------------------------------------------------------------

    def _check(self, target: Point, feed: float, axes: str) -> None:
        """Refuse a move that must not be made."""
        if self._setup is None or self._doing in (Doing.STARTING, Doing.ASKING):
            raise MoveRefused(f"the controller {self._doing.value}", fault="busy")
        if self._state is not CncState.READY or self._doing is not Doing.NOTHING:
            raise not_ready(self._state)
        check_move(self._machine, self._setup, self._place.position, target, feed, axes)

    def _unlock(self, now: int) -> None:
        """Begin to unlock the controller, or to home the machine.

        Raises:
            MoveRefused: always; the text says what was begun, or what to do.
        """
        if self._lost and not self._settings.without_homing:
            if not self._settings.home_on_reset:
                said = f"the position is not known ({self._lost}): home the machine and reopen the"
                advice = "controller, or set home_on_reset in the device file"
                raise MoveRefused(f"{said} {advice}", fault="undetermined", aspect="position")
            self._begin(Doing.HOMING)
            self._talk.be_patient(now, silent=True)
            self._talk.send(now, "$H", self._settings.homing_limit)
            said = "the machine is homing: reset again when it has finished"
            raise MoveRefused(said, fault="busy", aspect="homing")
        self._begin(Doing.UNLOCKING)
        self._talk.send(now, "$X")
        raise not_yet("the controller is being unlocked", "unlocking")

    def _hold(self, reason: str) -> None:
        self._why, self._idle_once = reason, False
        self._begin(Doing.HOLDING)
        self._talk.command(FEED_HOLD)

    def _soft_reset(self) -> None:
        self._greeted = False
        self._begin(Doing.RESETTING)
        self._talk.be_patient(self._now, silent=True)
        self._talk.command(SOFT_RESET)

    def _fault(self, reason: str) -> None:
        """Be faulty; what moves is braked."""
        moves = self._doing is Doing.MOVING and (self._in_motion() or self._talk.awaiting)
        # While it is being reset, the alarm of that reset is told by a report after it.
        if self._doing is not Doing.RESETTING:
            if moves and not self._alarm:
                self._hold(reason)
            elif self._doing is Doing.MOVING:
                self._begin(Doing.NOTHING)
        if self._state is not CncState.FAULT or reason != self._reason:
            self._change(self._now, CncState.FAULT, reason)

    def _in_motion(self) -> bool:
        report = None if self._critical else self._report
        return report is not None and report.activity in MOVING

    def _begin(self, doing: Doing) -> None:
        self._doing, self._since = doing, self._now

    def _tick(self, time_ns: int) -> int:
        self._now = max(time_ns, self._now)
        return self._now

    def _change(self, time: int, state: CncState, reason: str) -> None:
        self._told = max(time, self._told)
        self._state, self._reason = state, reason
        self._events.append(StateChange(self._told, state, self._place.position, reason))


def from_settings(
    settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], GrblCnc]:
    """Return what opens a controller with Grbl at a time, ns.

    Settings: those of ``GrblSettings.from_mapping``.

    Raises:
        ValueError: a setting is wrong, or there is no machine.
    """
    machine = surroundings.machine_for("grbl controller")
    prepared = GrblSettings.from_mapping(settings)
    return lambda start: GrblCnc(machine, prepared, start)
