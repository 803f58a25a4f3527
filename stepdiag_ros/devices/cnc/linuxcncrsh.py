"""LinuxCNC through its text server linuxcncrsh, where the agent cannot be installed.

Requests and replies as in the manual page linuxcncrsh(1) of LinuxCNC 2.9. What that server cannot
do, and what is done about it:

- An acknowledged command is neither reached nor sound: an e-stop in mid-move is acknowledged like
  any other, and the commanded position then jumps to the actual one. So a move has ended when both
  the commanded and the *actual* position are at the target, and e-stop, power, mode, faults and
  errors are asked for all the while.
- All connections share one parser: this must be the only one. Settings that would make replies late
  or turn their units (time-out, waiting, units of length) are set when it is opened.
- **A connection that is lost lets the machine finish its move**: there is no watchdog here.
- It does not report soft limits; those of the machine file count, and LinuxCNC's own errors.
"""

from __future__ import annotations

import errno
import re
import select
import socket
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite, nan
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.cnc import (
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
from stepdiag_ros.devices.cnc.move_check import check_target
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Refusal

RESOLUTION = 1e-9
"""m: positions are reported with six decimals of a millimetre."""
SILENCE_LIMIT = 1.5
"""Real seconds after which an unanswered request counts as a dead server, unless set; the answer to
one that changes something takes 0.1 s."""
WAIT_SHARE = 0.3
"""Share of that time for which the bridge waits: for a connection, to be let in, and for LinuxCNC
to take single lines, which is usually 0.1 s."""
STANDING = 0.1
"""Seconds for which no axis may have left the window, for the machine to stand."""
ERROR_LAG = 0.15
"""Seconds for which messages and states are awaited that explain a fault: they race."""
STALL_LIMIT = 10.0
"""Seconds of standing still in a move, off its target, after which it has failed."""
_LONGEST_LINE = 65536
_STATUS = (
    "linear_unit_conversion",
    "abs_act_pos",
    "abs_cmd_pos",
    "estop",
    "machine",
    "mode",
    "joint_fault",
    "joint_homed",
    "error",
)
_SETUP = (
    "set timeout 0",
    "set set_wait received",
    "set linear_unit_conversion mm",
)


@dataclass(frozen=True)
class ServerAccess:
    """Where the server is, and how it lets a client in.

    Attributes:
        host: name or address.
        port: TCP port.
        connect_password: option --connectpw of the server.
        enable_password: option --enablepw of the server.
        joints: of the machine, which must be homed.
        silence: s after which an unanswered request counts as a dead server.
    """

    host: str
    port: int
    connect_password: str
    enable_password: str
    joints: int
    silence: float


@dataclass
class _Move:
    target: Point
    acknowledged: bool = False
    stopping: str = ""
    within_since: float | None = None
    fault_since: float | None = None


class LinuxCncRsh:
    """A machine tool controlled by LinuxCNC, through linuxcncrsh (protocol: ``CncDevice``).

    Args:
        access: to the server.
        machine: travel, feed limit and in-position window.
        sample_rate: of the position samples, Hz.

    Raises:
        OSError: the server does not answer.
        ValueError: it does not let this client in, or answers nonsense.
    """

    def __init__(self, access: ServerAccess, machine: Machine, sample_rate: float) -> None:
        self._access, self._machine = access, machine
        self._wait_limit = WAIT_SHARE * access.silence
        self._period = 1.0 / sample_rate
        self._window = machine.position_window_m + RESOLUTION
        self._in, self._out = b"", b""
        # What is not answered yet: the beginning of its reply, and since when it is waited for.
        self._awaited: deque[tuple[str, float]] = deque()
        self._told: dict[str, str] = {}
        self._cycle_begun = 0.0
        self._state, self._session = CncState.FAULT, False
        self._halted = ""
        self._last: tuple[CncState, str] | None = None
        self._known = False
        self._time = 0
        self._position = self._commanded = (nan, nan, nan)
        self._stood_at, self._stands_since = self._position, 0.0
        self._events: list[CncEvent] = []
        self._errors: list[str] = []
        self._abort_refused = False
        self._move: _Move | None = None
        try:
            self._socket = socket.create_connection((access.host, access.port), self._wait_limit)
        except OSError as error:
            raise OSError(error.errno, f"{self._whom} cannot be reached ({error})") from None
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._enter()
        except BaseException:
            self._socket.close()
            raise

    @property
    def state(self) -> CncState:
        """State at the last time passed to the device."""
        return self._state

    @property
    def soft_limits(self) -> tuple[Point, Point]:
        """Lower and upper soft limits of X, Y, Z, m: those of the machine file."""
        return self._machine.travel_low_m, self._machine.travel_high_m

    @property
    def traits(self) -> Traits:
        """What is known: nothing brakes the machine when this process ends."""
        return Traits(resolution=(RESOLUTION, RESOLUTION, RESOLUTION), dead_man=nan)

    def start_move(self, time_ns: int, target: Point, feed: float, axes: str) -> None:
        """Begin a straight move (see ``CncDevice.start_move``); it is sent once."""
        if self._state is not CncState.READY:
            raise not_ready(self._state)
        if not self._session:
            raise MoveRefused("no operator has released the machine to move", fault="not_ready")
        check_target(
            self._commanded,
            target,
            feed,
            axes,
            limits=self.soft_limits,
            feed_limit=self._machine.feed_limit_m_per_s,
            near=[self._window] * 3,
        )
        self._move = _Move(target)
        self._errors.clear()
        self._stands_since = time.monotonic()
        self._change(time_ns, CncState.MOVING, "")
        self._send(f"set mdi {line_of_move(target, feed)}", "SET MDI")

    def stop(self, time_ns: int, reason: str) -> None:
        """Brake to rest at once; STOPPED, with the reason, is reported when the axes stand."""
        if self._state in (CncState.STOPPED, CncState.FAULT):
            return
        self._session = False
        self._send("set abort", "SET ABORT")
        if self._move is not None:
            self._move.stopping = self._move.stopping or reason or "stopped"
            self._stands_since = time.monotonic()
        else:
            self._halt(time_ns, CncState.STOPPED, reason or "stopped")

    def reset(self, time_ns: int) -> None:
        """Let LinuxCNC take moves, which an operator has allowed (see ``CncDevice.reset``)."""
        trouble = self._trouble()
        stands = time.monotonic() - self._stands_since >= STANDING
        if not trouble and self._move is not None:
            raise still_moves()
        if any(reply.startswith("SET") for reply, _ in self._awaited):
            # Asked again and again it would do nothing but that: each takes it 0.1 s.
            trouble = trouble or "linuxcncrsh is still busy with what it was asked before"
        elif not trouble and not isfinite(self._position[0]):
            # The server refuses that while the machine is off, so it may not be set yet.
            self._set_up()
            trouble = "linuxcncrsh does not report positions in millimetres yet"
        elif not trouble and not stands:
            raise still_moves()
        if trouble:
            raise MoveRefused(trouble, fault="not_ready")
        self._set_up()
        self._send("set mode mdi", "SET MODE")
        deadline = time.monotonic() + self._wait_limit
        for name in ("MODE", "ERROR"):
            self._told.pop(name, None)
        # ERROR is the last one of a whole look at the machine.
        while self._told.get("MODE") != "MDI" or "ERROR" not in self._told:
            if time.monotonic() > deadline:
                raise MoveRefused("LinuxCNC has not changed to MDI: check whether a program runs")
            select.select([self._socket], [], [], 0.01)
            self._work(time_ns)
        self._session, self._halted = True, ""
        self._change(time_ns, CncState.READY, "")

    def poll(self, time_ns: int) -> list[CncEvent]:
        """Return what has happened since the last poll, in order of time."""
        self._work(time_ns)
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Let LinuxCNC go; a move is aborted first, since it would go on otherwise."""
        if self._move is not None:
            try:
                self._send("set abort", "SET ABORT")
            except OSError:
                # The connection is what has failed: nothing more can be said through it.
                self._move = None
        self._socket.close()

    @property
    def _whom(self) -> str:
        return f"linuxcncrsh on {self._access.host}:{self._access.port}"

    # Conversation ---------------------------------------------------------------------------------

    def _enter(self) -> None:
        """Be let in, and set what replies depend on."""
        access = self._access
        requests = [
            (f"hello {access.connect_password} stepdiag 1", "HELLO"),
            # The reply to it is its echo.
            ("set echo off", "SET ECHO"),
            ("set verbose on", "SET VERBOSE"),
        ]
        deadline = time.monotonic() + self._wait_limit + 0.1 * len(requests)
        for line, reply in requests:
            self._send(line, reply)
            while self._awaited:
                left = deadline - time.monotonic()
                if left <= 0.0:
                    raise OSError(errno.ETIMEDOUT, f"{self._whom} does not let this client in")
                select.select([self._socket], [], [], left)
                self._take()
        self._set_up()

    def _set_up(self) -> None:
        """Get control and set what replies depend on; in an e-stop the server refuses that.

        A connection that ends late may take the control away that this one has been given.
        """
        self._send(f"set enable {self._access.enable_password}", "SET ENABLE")
        for line in _SETUP:
            # The reply to it begins like it.
            self._send(line, " ".join(line.split()[:2]).upper())

    def _send(self, line: str, reply: str) -> None:
        self._awaited.append((reply, time.monotonic()))
        self._out += line.encode() + b"\r\n"
        self._flush()

    def _flush(self) -> None:
        try:
            sent = self._socket.send(self._out)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise OSError(error.errno, f"{self._whom} has gone") from None
        self._out = self._out[sent:]
        if len(self._out) > _LONGEST_LINE:
            raise OSError(errno.ENOBUFS, f"{self._whom} does not accept the commands sent to it")

    def _work(self, time_ns: int) -> None:
        self._time = max(time_ns, self._time)
        if self._out:
            self._flush()
        self._take()
        now = time.monotonic()
        if self._awaited:
            limit = self._access.silence
            if now - self._awaited[0][1] > limit:
                raise OSError(errno.ETIMEDOUT, f"{self._whom} has not answered for {limit:g} s")
        elif now - self._cycle_begun >= self._period:
            self._cycle_begun = now
            for name in _STATUS:
                self._send(f"get {name}", name.upper())

    def _take(self) -> None:
        """Take what the server has replied."""
        while True:
            try:
                data = self._socket.recv(_LONGEST_LINE)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                raise OSError(errno.ECONNRESET, f"{self._whom} has gone")
            # Replies end with any of LF CR and CR LF.
            *lines, self._in = re.split(rb"[\r\n]+", self._in + data)
            if len(self._in) > _LONGEST_LINE:
                raise ValueError(f"{self._whom}: its reply has no end")
            for line in filter(None, lines):
                self._understand(line.decode(errors="replace").strip())

    def _understand(self, line: str) -> None:
        if not self._awaited:
            raise Refusal(f"{self._whom}: '{line[:80]}' was not asked for", fault="malformed")
        awaited = self._awaited.popleft()[0]
        if not line.upper().startswith(awaited):
            raise Refusal(
                f"{self._whom}: '{line[:80]}' is not a reply to {awaited}", fault="malformed"
            )
        rest = line[len(awaited) :].strip()
        if rest.upper() == "NAK":
            if awaited == "SET MDI" and self._move is not None:
                self._errors.append("linuxcncrsh does not take the move")
            if awaited == "SET ABORT":
                self._abort_refused = True
            if awaited not in ("HELLO", "SET ENABLE"):
                return
            raise Refusal(f"{self._whom} refuses {awaited}: check the password", fault="rejected")
        if awaited == "SET MDI" and self._move is not None:
            self._move.acknowledged = True
        self._told[awaited] = rest
        if awaited == "ERROR":
            if rest.upper() != "OK":
                self._errors.append(rest)
            self._judge()

    # The machine ----------------------------------------------------------------------------------

    def _judge(self) -> None:
        """Judge the machine, once all values have been reported."""
        now, time_ns = time.monotonic(), self._time
        self._position = self._point("ABS_ACT_POS")
        self._commanded = self._point("ABS_CMD_POS")
        if not self._near(self._position, self._stood_at):
            self._stood_at, self._stands_since = self._position, now
        if isfinite(self._position[0]):
            self._events.append(PositionSample(time_ns, self._position))
        trouble = self._trouble()
        if self._abort_refused and not trouble:
            raise ValueError(f"{self._whom} refuses to abort: use the emergency stop")
        self._abort_refused = False
        if not trouble and self._session and self._told["MODE"].upper() != "MDI":
            trouble = "the machine was taken over at the control"
        if self._move is not None:
            self._follow(self._move, trouble, now)
        elif self._session and trouble:
            self._halt(time_ns, CncState.FAULT, trouble)
        elif not self._session and not self._halted:
            self._change(time_ns, CncState.FAULT if trouble else CncState.READY, trouble)
        if self._move is None:
            self._errors.clear()
        self._known = True

    def _follow(self, move: _Move, trouble: str, now: float) -> None:
        if trouble or self._errors:
            move.fault_since = move.fault_since or now
            if now - move.fault_since > ERROR_LAG:
                reasons = [*self._errors, trouble] if trouble else self._errors
                if not trouble:
                    self._send("set abort", "SET ABORT")
                self._halt(self._time, CncState.FAULT, "; ".join(dict.fromkeys(reasons)))
            return
        stands = now - self._stands_since
        if move.stopping:
            if stands >= STANDING:
                self._halt(self._time, CncState.STOPPED, move.stopping)
            return
        at_target = self._near(self._commanded, move.target)
        if not (move.acknowledged and at_target and self._near(self._position, move.target)):
            move.within_since = None
            if stands > STALL_LIMIT:
                off = [abs(a - b) for a, b in zip(self._position, move.target, strict=True)]
                axis = AXES[off.index(max(off))]
                self._send("set abort", "SET ABORT")
                words = f"the machine stands, but {axis} is {1e6 * max(off):.3g} um off its target"
                self._halt(self._time, CncState.FAULT, words)
            return
        move.within_since = move.within_since or now
        if now - move.within_since >= self._machine.position_hold_s:
            self._move = None
            self._change(self._time, CncState.READY, "")

    def _near(self, one: Point, other: Point) -> bool:
        # Written so that what is not a number is not near.
        return all(abs(a - b) <= self._window for a, b in zip(one, other, strict=True))

    def _trouble(self) -> str:
        told = {name: value.upper().split() for name, value in self._told.items()}
        if not self._known and "ERROR" not in told:
            return "LinuxCNC has not reported its state yet"
        if told["ESTOP"] != ["OFF"]:
            return "e-stop"
        if told["MACHINE"] != ["ON"]:
            return "the machine is switched off"
        for joint in range(self._access.joints):
            if told["JOINT_FAULT"][joint : joint + 1] != ["OK"]:
                return f"the drive of joint {joint} is faulty"
            if told["JOINT_HOMED"][joint : joint + 1] != ["YES"]:
                return f"joint {joint} is not homed"
        return ""

    def _point(self, name: str) -> Point:
        """Return a position, m; NaN while the server reports it in other units."""
        if self._told["LINEAR_UNIT_CONVERSION"].upper() != "MM":
            return nan, nan, nan
        try:
            x, y, z = (1e-3 * float(word) for word in self._told[name].split()[:3])
        except ValueError:
            x = y = z = nan
        if not (isfinite(x) and isfinite(y) and isfinite(z)):
            raise ValueError(f"{self._whom}: '{name} {self._told[name][:80]}' is not a position")
        return x, y, z

    def _halt(self, time_ns: int, state: CncState, reason: str) -> None:
        self._halted, self._session, self._move = reason, False, None
        self._change(time_ns, state, reason)

    def _change(self, time_ns: int, state: CncState, reason: str) -> None:
        if (state, reason) != self._last:
            self._state, self._last = state, (state, reason)
            self._events.append(StateChange(time_ns, state, self._position, reason))


def line_of_move(target: Point, feed: float) -> str:
    """Return the block of a move: target in m, feed in m/s."""
    x, y, z = (1000.0 * value for value in target)
    return f"G21 G90 G94 G53 G1 X{x:.7f} Y{y:.7f} Z{z:.7f} F{60000.0 * feed:.5f}"


def from_settings(
    settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], LinuxCncRsh]:
    """Return what connects to linuxcncrsh.

    Settings: ``host`` (default 127.0.0.1), ``port`` (5007), ``connect_password`` (EMC),
    ``enable_password`` (EMCTOO), ``joints`` that must be homed (3), ``position_rate_hz`` (50, at
    most 100), ``silence_s`` (1.5, 0.5 to 30): a request that is not answered for so long means that
    the server is dead.

    Raises:
        ValueError: a setting is wrong, or there is no machine.
    """
    machine = surroundings.machine_for("linuxcncrsh driver")
    section = Section(settings, "settings of the linuxcncrsh driver")
    access = ServerAccess(
        host=section.text("host", default="127.0.0.1"),
        port=section.integer("port", low=1, high=65535, default=5007),
        connect_password=section.text("connect_password", default="EMC"),
        enable_password=section.text("enable_password", default="EMCTOO"),
        joints=section.integer("joints", low=1, high=16, default=3),
        silence=section.number("silence_s", low=0.5, high=30.0, default=SILENCE_LIMIT),
    )
    # Above, the server itself limits it.
    rate = min(section.number("position_rate_hz", low=1.0, high=10_000.0, default=50.0), 100.0)
    section.finish()
    for name in (access.connect_password, access.enable_password):
        if not name or not name.isprintable() or " " in name:
            raise Refusal(
                f"{section.source}: a password has no blanks, and is not empty", fault="malformed"
            )
    return lambda _: LinuxCncRsh(access, machine, rate)
