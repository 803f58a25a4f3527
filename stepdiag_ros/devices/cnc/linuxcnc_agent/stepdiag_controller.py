"""LinuxCNC as the agent sees it: its status in SI units, its commands, and what is wrong with it.

Beside ``stepdiag_agent.py``, for the same Python (see there): standard library and LinuxCNC's own
modules only. LinuxCNC's Python interface is that of its manual, "Python Interface" and "HAL User
Interface Python Module".
"""

from __future__ import annotations

import contextlib
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import hal
import linuxcnc
from stepdiag_cycles import Cycles

AXES = "XYZ"
SLOW_PERIOD = 0.02
"""Seconds between two looks at what is dear to ask for: joints and processes."""
STALL = 100_000_000
"""ns without a servo cycle after which time goes on by the clock alone."""
TASK_LIMIT = 30.0
"""Seconds within which LinuxCNC's task must be up."""
EXPLAINED = (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR)

ESTOP_CHAIN = "iocontrol.0.emc-enable-in"
WATCHDOG_BIT = "stepdiag-agent-lost"
"""HAL signal of ``stepdiag_watch.hal``: the watchdog has inhibited the feed, and keeps it so until
the session ends."""


class Controller:
    """LinuxCNC as the agent sees it: its status in SI units, and what is wrong with it."""

    def __init__(self, inifile: str) -> None:
        self._ini = linuxcnc.ini(inifile)
        self._folder = Path(inifile).resolve().parent
        self.version = str(linuxcnc.version)
        self.stat = linuxcnc.stat()
        self.command = linuxcnc.command()
        reads = self.setting("ERRORS", "READ").upper() != "LEAVE"
        self._messages = linuxcnc.error_channel() if reads else None
        try:
            self.component = hal.component("stepdiag")
        except hal.error:
            raise SystemExit(
                "HAL has a component stepdiag already: another agent runs, or one has been killed;"
                " restart LinuxCNC"
            ) from None
        for pin in ("heartbeat", "session", "stop"):
            self.component.newpin(pin, hal.HAL_BIT, hal.HAL_OUT)
        self.component.ready()
        self._wait_for_task()
        # Machine units a metre.
        self.per_metre = 1000.0 * self.stat.linear_units
        self.time = time.time_ns()
        # When the present status was asked for, s of a clock that never steps.
        self.looked = time.monotonic()
        self.position = (0.0, 0.0, 0.0)
        self._slow, self._dead = "", False
        self._slow_at = 0.0
        self._reopen_at = 0.0
        self._pins, self._offsets = self._motor_pins()
        self._motors: list[float] = []
        self._feedback = [f"joint.{joint}.pos-fb" for joint in self._joints()]
        self._processes = self._own_processes()
        self.cycles = self._sampled()
        # Time (ns), position and motors (m) of the cycles since the last look but one.
        self.samples: list[tuple[int, list[float], list[float] | None]] = []
        file = self.setting("HALFILE", "")
        if file:
            command = ["halcmd", "-i", inifile, "-f", str(self._folder / file)]
            if subprocess.run(command, check=False).returncode:
                raise SystemExit(f"[STEPDIAG] HALFILE {file}: halcmd refuses it, see above")
        self.look()

    def _wait_for_task(self) -> None:
        """Wait for LinuxCNC's task, which starts at the same time as its display."""
        end = time.monotonic() + TASK_LIMIT
        while True:
            with contextlib.suppress(linuxcnc.error):
                self.stat.poll()
                # milltask's own component is ready after it has read the INI file.
                if self.stat.linear_units and self.stat.joints and hal.component_is_ready("inihal"):
                    return
            if time.monotonic() > end:
                raise SystemExit(f"LinuxCNC's task has not come up within {TASK_LIMIT:g} s")
            time.sleep(0.01)

    def setting(self, name: str, default: str) -> str:
        """Return a setting of ``[STEPDIAG]``."""
        return self._ini.find("STEPDIAG", name) or default

    def look(self) -> None:
        """Take the present status."""
        self.looked = time.monotonic()
        try:
            self._poll()
        except linuxcnc.error as error:
            self._slow = f"LinuxCNC no longer reports its status ({error})"
            return
        now = time.time_ns()
        x, y, z = self.stat.actual_position[:3]
        if self._feedback:
            # The status comes from the task, which a busy computer delays; HAL is of this moment,
            # and so are the motors, read together with it.
            x, y, z = (hal.get_value(pin) for pin in self._feedback)
        self._motors = [hal.get_value(pin) for pin in self._pins]
        if self.cycles is not None:
            self.samples = [self._sample(*one) for one in self.cycles.read(self.time)]
            # The status is not of a later moment than cycles whose positions are still to come.
            now = self.cycles.latest if now - self.cycles.latest < STALL else now
        # Whoever sets the clock back does not make times fall.
        self.time = max(now, self.time + 1)
        self.position = (x / self.per_metre, y / self.per_metre, z / self.per_metre)
        self.component["heartbeat"] = not self.component["heartbeat"]
        if time.monotonic() - self._slow_at > SLOW_PERIOD:
            self._slow_at = time.monotonic()
            self._slow = self._look_closer()

    def _poll(self) -> None:
        """Take LinuxCNC's status; open its channel again if it fails.

        A channel with an internal error keeps it and never works again.

        Raises:
            linuxcnc.error: the new channel fails too.
        """
        try:
            self.stat.poll()
        except linuxcnc.error:
            if self.looked < self._reopen_at:
                raise
            self._reopen_at = self.looked + SLOW_PERIOD
            stat = linuxcnc.stat()
            stat.poll()
            # A channel that has not been polled shows a machine that is switched off.
            self.stat = stat

    def _sampled(self) -> Cycles | None:
        """Let HAL record every servo cycle; where it cannot, positions are read now and then."""
        if not self._feedback:
            return None
        try:
            return Cycles(self.component, [*self._feedback, *self._pins])
        except OSError as error:
            print(f"positions are not recorded in every servo cycle: {error}", flush=True)
            return None

    def _sample(
        self, at: int, values: Sequence[float]
    ) -> tuple[int, list[float], list[float] | None]:
        position = [value / self.per_metre for value in values[:3]]
        return at, position, self._from_motors(values[3:])

    def motors(self) -> list[float] | None:
        """Return the positions of the motors, before LinuxCNC's compensation, m."""
        return self._from_motors(self._motors)

    def _from_motors(self, values: Sequence[float]) -> list[float] | None:
        if not self._pins:
            return None
        offsets = [hal.get_value(pin) for pin in self._offsets] or [0.0] * 3
        return [(values[axis] - offsets[axis]) / self.per_metre for axis in range(3)]

    def commanded(self) -> list[float]:
        """Return the position that is commanded at present, m."""
        return [value / self.per_metre for value in self.stat.position[:3]]

    def trouble(self) -> str:
        """Return why the machine cannot move, for any client; empty if it can."""
        state = self.stat.task_state
        # HAL knows of an open e-stop chain first; without iocontrol only the task's state does.
        if state == linuxcnc.STATE_ESTOP or not _bit(ESTOP_CHAIN, unknown=True):
            return "e-stop"
        if state != linuxcnc.STATE_ON:
            return "the machine is switched off"
        # The watchdog, if there is one, found this process stopped or starved.
        if _bit(WATCHDOG_BIT, unknown=False):
            return "the agent was silent for too long, and the watchdog has inhibited the feed"
        return self._slow

    def hindrance(self) -> str:
        """Say why the state of the interpreter does not allow moves; empty if it does."""
        if self.stat.interp_state != linuxcnc.INTERP_IDLE:
            return "LinuxCNC executes a program"
        if self.stat.rotation_xy != 0.0:
            return "the coordinates are rotated (G10 L2 R); moves in them are not the machine's"
        if 410 in self.stat.gcodes or 420 in self.stat.gcodes:
            return "cutter compensation is on (G41 or G42): switch it off (G40)"
        return ""

    def take_over(self) -> None:
        """Ask LinuxCNC to take single lines."""
        self.command.mode(linuxcnc.MODE_MDI)

    def in_mdi(self) -> bool:
        """Say whether LinuxCNC takes single lines, and nobody has taken the machine over."""
        return bool(self.stat.task_mode == linuxcnc.MODE_MDI)

    def move(self, target: list[float], feed: float) -> int:
        """Send a straight move to LinuxCNC; return the number under which it reports on it."""
        x, y, z = (1000.0 * value for value in target)
        line = f"G21 G90 G94 G53 G1 X{x:.7f} Y{y:.7f} Z{z:.7f} F{60000.0 * feed:.5f}"
        self.command.mdi(line)
        return int(self.command.serial)

    def ended(self, serial: int) -> bool:
        """Say whether LinuxCNC calls its part of a command done."""
        stat = self.stat
        if stat.echo_serial_number < serial or stat.state != linuxcnc.RCS_DONE:
            return False
        return bool(stat.inpos) and stat.queue == 0 and stat.interp_state == linuxcnc.INTERP_IDLE

    def at_rest(self) -> bool:
        """Say whether LinuxCNC commands no motion any more.

        Without real time, an axis may stand for a moment in mid-move.
        """
        return bool(abs(self.stat.current_vel) < 1e-9)

    def failed(self, serial: int) -> bool:
        """Return whether LinuxCNC has refused a command, even if others read its messages."""
        stat = self.stat
        return bool(stat.echo_serial_number >= serial and stat.state == linuxcnc.RCS_ERROR)

    def abort(self) -> None:
        """Brake now; use HAL for what LinuxCNC does not accept."""
        if self._dead:
            # A command would be waited for, for seconds.
            self.component["stop"] = True
            return
        try:
            self.command.abort()
        except linuxcnc.error:
            self.component["stop"] = True

    def errors(self) -> list[str]:
        """Return LinuxCNC's error messages since the last call."""
        found: list[str] = []
        while self._messages is not None:
            try:
                message = self._messages.poll()
            except linuxcnc.error:
                self._messages = linuxcnc.error_channel()
                break
            if not message:
                break
            kind, text = message
            print(f"LinuxCNC: {text.strip()}", flush=True)
            if kind in EXPLAINED:
                found.append(" ".join(text.split()))
        return found

    def limits(self) -> tuple[list[float], list[float]]:
        """Return the soft limits of X, Y, Z, m: those of axes, and of joints that are axes."""
        low = [axis["min_position_limit"] for axis in self.stat.axis[:3]]
        high = [axis["max_position_limit"] for axis in self.stat.axis[:3]]
        for axis, joint in enumerate(self._joints()):
            told = self.stat.joint[joint]
            low[axis] = max(low[axis], told["min_position_limit"])
            high[axis] = min(high[axis], told["max_position_limit"])
        return [v / self.per_metre for v in low], [v / self.per_metre for v in high]

    def largest(self, name: str) -> list[float | None]:
        """Return MAX_VELOCITY or MAX_ACCELERATION of X, Y, Z; None where the INI is silent."""
        found = [self._ini.find("AXIS_" + axis, name) for axis in AXES]
        return [float(value) / self.per_metre if value else None for value in found]

    def _joints(self) -> list[int]:
        """Return the joints of X, Y, Z where each axis is a joint (trivkins); else none."""
        words = (self._ini.find("KINS", "KINEMATICS") or "").split()
        if not words or words[0] != "trivkins":
            return []
        letters = "XYZABCUVW"
        for word in words[1:]:
            if word.lower().startswith("coordinates="):
                letters = word.split("=", 1)[1].upper()
        return [letters.index(axis) for axis in AXES] if set(AXES) <= set(letters) else []

    def _motor_pins(self) -> tuple[list[str], list[str]]:
        named = self.setting("MOTORS", "").split()
        if named:
            if len(named) != 3:
                raise SystemExit(f"[STEPDIAG] MOTORS names {len(named)} HAL pins, not 3")
            return named, []
        joints = self._joints()
        pins = [f"joint.{joint}.motor-pos-fb" for joint in joints]
        return pins, [f"joint.{joint}.motor-offset" for joint in joints]

    def _own_processes(self) -> dict[str, int]:
        """Return the processes without which nothing moves: task, and real time in user space."""
        found = {}
        for name in (Path(self._ini.find("TASK", "TASK") or "milltask").name, "rtapi_app"):
            number = _process(name)
            if number:
                found[name] = number
        return found

    def _look_closer(self) -> str:
        for name, number in self._processes.items():
            if not _lives(number):
                # Of rtapi_app there are short-lived ones beside the one that stays.
                self._processes[name] = number = _process(name)
            if not number:
                # Task would have stopped the machine; now only HAL can.
                self._dead = self.component["stop"] = True
                return f"LinuxCNC's process {name} has died: restart LinuxCNC"
        for number, joint in enumerate(self.stat.joint[: self.stat.joints]):
            if joint["fault"]:
                return f"the drive of joint {number} is faulty"
            if joint["min_hard_limit"] or joint["max_hard_limit"]:
                return f"joint {number} is on its limit switch"
            if not joint["homed"]:
                return f"joint {number} is not homed"
        return ""


def _bit(name: str, unknown: bool) -> bool:
    """Return a pin or signal of HAL; ``unknown`` on a machine without it."""
    try:
        return bool(hal.get_value(name))
    except (RuntimeError, hal.error):
        return unknown


def _lives(number: int) -> bool:
    try:
        # The state comes after the name, which may hold anything.
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state not in "XZ"


def _process(name: str) -> int:
    """Return the number of a living process of that name; 0 without one."""
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if (folder / "comm").read_text().strip() == name and _lives(int(folder.name)):
                return int(folder.name)
    return 0
