"""LinuxCNC with simulated drives, started for a test or a demonstration, isolated from all others.

The machine is that of ``config/linuxcnc/stepdiag_sim.ini``. Each instance has IPC, PID and mount
namespaces of its own (``unshare`` of util-linux): LinuxCNC otherwise allows one a computer, found
by fixed keys of shared memory and a lock file in /tmp, and starting a second one ends the first.
Killing the process that holds the namespaces ends everything in them; that process dies with the
one that has started it.

LinuxCNC's real-time process refuses to run as root. Root becomes nobody (uid 65534) in there; an
ordinary user stays what he is, in a user namespace, where the system allows these.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

from stepdiag_ros import resources
from stepdiag_ros.metrology.geometry import AXES

SERVO_PERIOD = 0.001
"""s: of the simulated machine."""
START_LIMIT = 120.0
"""Real seconds within which LinuxCNC must be up, or have done what it is asked for; 2 are usual."""
PYTHON = "/usr/bin/python3"
"""Python that has LinuxCNC's modules."""
_NML = Path("/usr/share/linuxcnc/linuxcnc.nml")
_NOBODY = 65534
_LONGEST_ADDRESS = 107
_SEAL = """\
set -e
mount -t tmpfs -o mode=1777 tmpfs /mnt
case "$FOLDER" in
/tmp/*)
    mkdir -p "/mnt/${FOLDER#/tmp/}"
    mount --bind "$FOLDER" "/mnt/${FOLDER#/tmp/}"
    ;;
esac
mount --rbind /mnt /tmp
cd "$FOLDER"
exec "$@"
"""
"""Gives the instance a /tmp of its own, and its folder in it."""
_OPERATOR = """\
import sys, time, linuxcnc
c, s = linuxcnc.command(), linuxcnc.stat()
end = time.monotonic() + float(sys.argv[1])
def reach(reached, command, *arguments):
    s.poll()
    asked = 0.0
    while not reached():
        now = time.monotonic()
        if now > end:
            sys.exit('LinuxCNC does not follow: task state %d, homed %s' % (s.task_state, s.homed))
        # On a busy computer LinuxCNC loses commands.
        if now > asked + 1.0:
            asked = now
            command(*arguments)
        time.sleep(0.005)
        s.poll()
for step in sys.argv[2:]:
    if step == 'home':
        reach(lambda: s.task_mode == linuxcnc.MODE_MANUAL, c.mode, linuxcnc.MODE_MANUAL)
        reach(lambda: s.motion_mode == linuxcnc.TRAJ_MODE_FREE, c.teleop_enable, 0)
        for joint in range(s.joints):
            reach(lambda: s.homed[joint], c.home, joint)
    else:
        state = getattr(linuxcnc, step)
        reach(lambda: s.task_state == state or step == 'STATE_OFF' and s.task_state != 4,
              c.state, state)
"""


def missing() -> str:
    """Say why no instance can be started on this computer; empty if it can."""
    for program in ("linuxcnc", "unshare", "setpriv", "pkill"):
        if shutil.which(program) is None:
            return f"{program} is not installed (Debian: linuxcnc-uspace, util-linux, procps)"
    if not _NML.is_file():
        return f"{_NML} is not there"
    done = subprocess.run([*_namespaces(), "true"], capture_output=True, text=True, check=False)
    if done.returncode:
        return f"namespaces are not allowed: {done.stderr.strip()}"
    return ""


class LinuxCncInstance:
    """One LinuxCNC with three simulated axes and the agent, from ``start`` to ``stop``.

    Args:
        folder: for its files, made if need be; short, since sockets lie in it. On a second start
            the same folder serves again.
        lag_s: of the drives behind their commands, s, 0 for none.
        lost_motion_m: of X, Y, Z behind the encoders, m, each >= 0.
        tables: axis → LinuxCNC compensation file (``COMP_FILE``); copied.
        table_type: ``COMP_FILE_TYPE``.
        beside: the agent runs beside another display (which shows nothing), so that LinuxCNC goes
            on when the agent ends.
        programs: command lines that LinuxCNC starts too (``[APPLICATIONS] APP``).
        watchdog_s: s of the agent's silence after which the watchdog in HAL inhibits the feed.

    Attributes:
        socket: path of the agent's socket, for the driver.
        log: what LinuxCNC and the agent have printed.
    """

    def __init__(
        self,
        folder: Path,
        lag_s: float = 0.010,
        lost_motion_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
        tables: Mapping[str, Path] | None = None,
        table_type: int = 1,
        beside: bool = False,
        programs: Sequence[str] = (),
        watchdog_s: float = 0.5,
    ) -> None:
        self._folder = folder.resolve()
        self._lag, self._lost = lag_s, lost_motion_m
        self._tables, self._table_type = dict(tables or {}), table_type
        self._beside, self._programs, self._watchdog = beside, list(programs), watchdog_s
        self._process: subprocess.Popen[bytes] | None = None
        self.socket = self._folder / "stepdiag.sock"
        self.log = self._folder / "linuxcnc.log"
        self._bench = self._folder / "bench.sock"
        if len(str(self.socket)) > _LONGEST_ADDRESS:
            raise ValueError(f"{self._folder}: the path is too long for a socket in it")

    def __enter__(self) -> LinuxCncInstance:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def start(self, powered: bool = True) -> None:
        """Start LinuxCNC and wait until its agent listens; what is left of an earlier one ends.

        Args:
            powered: e-stop released, machine on, homed where it stands, at 0, 0, 0.

        Raises:
            OSError: it did not come up; with the end of its log.
        """
        self.stop()
        self._write_files()
        for path in (self.socket, self._bench):
            path.unlink(missing_ok=True)
        command = [
            *("setpriv", "--pdeathsig", "KILL"),
            *_namespaces(),
            *("sh", "-c", _SEAL, "sh"),
            *_become_ordinary(),
            PYTHON,
            str(self._folder / "linuxcnc_agent" / "stepdiag_bench.py"),
            *(str(self._folder / "machine.ini"), str(self._bench)),
        ]
        environment = {
            "PATH": "/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin",
            "LANG": "C.UTF-8",
            # The path of HOME/.rtapi_fifo must be short, and HOME writable.
            "HOME": "/tmp",
            "FOLDER": str(self._folder),
        }
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
            )
        deadline = time.monotonic() + START_LIMIT
        while not _listens(self.socket):
            if self._process.poll() is not None or time.monotonic() > deadline:
                self.stop()
                raise OSError(f"LinuxCNC did not come up: {self._last_words()}")
            time.sleep(0.02)
        if powered:
            self.operate("STATE_ESTOP_RESET", "STATE_ON", "home")

    def stop(self) -> None:
        """End LinuxCNC and whatever runs beside it, at once."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()

    def run(self, *command: str) -> str:
        """Execute a program beside LinuxCNC and return what it prints.

        Raises:
            OSError: it fails; with what it has printed.
        """
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(START_LIMIT)
            connection.connect(str(self._bench))
            connection.sendall(json.dumps({"run": command}).encode() + b"\n")
            told = json.loads(connection.makefile("rb").readline())
        if told["code"]:
            raise OSError(f"{' '.join(command[:2])}: {str(told['out']).strip()}")
        return str(told["out"])

    def operate(self, *steps: str) -> None:
        """Do what an operator does: STATE_ESTOP, STATE_ESTOP_RESET, STATE_OFF, STATE_ON, home.

        Raises:
            OSError: LinuxCNC does not follow.
        """
        self.run(PYTHON, "-c", _OPERATOR, str(0.5 * START_LIMIT), *steps)

    def freeze(self, axis: str) -> None:
        """Let the encoder of an axis stand still from now on, as one that has failed."""
        self.run("halcmd", "setp", f"drive.{axis.lower()}.gain", "0")

    def thaw(self, axis: str) -> None:
        """Let the encoder of an axis work again."""
        self.run("halcmd", "setp", f"drive.{axis.lower()}.gain", repr(self._gain()))

    def signal(self, name: str, process: str) -> None:
        """Send a signal, such as STOP, CONT or KILL, to a process of the instance by its name."""
        self.run("pkill", f"-{name}", "-f", process)

    def _gain(self) -> float:
        return 1.0 - math.exp(-SERVO_PERIOD / self._lag) if self._lag > 0.0 else 1.0

    def _write_files(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        config = resources.directory("config") / "linuxcnc"
        programs = Path(__file__).parent / "linuxcnc_agent"
        (self._folder / "linuxcnc_agent").mkdir(exist_ok=True)
        for source in programs.glob("stepdiag_*.py"):
            copied = Path(shutil.copyfile(source, self._folder / "linuxcnc_agent" / source.name))
            copied.chmod(0o755)
        for source in config.glob("*.hal"):
            text = source.read_text().replace("timeout-0 0.5", f"timeout-0 {self._watchdog}")
            (self._folder / source.name).write_text(text)
        # Without the TCP ports that linuxcncsvr would open to the network.
        nml = _NML.read_text().replace("TCP=5005 xdr", "")
        (self._folder / "machine.nml").write_text(nml)
        for name in ("parameters.var", "tools.tbl"):
            (self._folder / name).touch()
        (self._folder / "machine.ini").write_text(self._ini(config / "stepdiag_sim.ini"))
        if os.geteuid() == 0:
            for path in (self._folder, *self._folder.rglob("*")):
                os.chown(path, _NOBODY, _NOBODY)

    def _ini(self, template: Path) -> str:
        values = {"LAG_GAIN": repr(self._gain()), "SOCKET": str(self.socket)}
        agent = "./linuxcnc_agent/stepdiag_agent.py"
        if self._beside:
            display = self._folder / "idle_display"
            display.write_text("#!/bin/sh\nexec sleep infinity\n")
            display.chmod(0o755)
            values |= {"DISPLAY": "./idle_display", "ERRORS": "LEAVE"}
        for axis, lost in zip(AXES, self._lost, strict=True):
            values[f"HALF_LOST_{axis}"] = f"{500.0 * lost:.9f}"
        lines = []
        for line in template.read_text().splitlines():
            key = line.partition("=")[0].strip()
            lines.append(f"{key} = {values.pop(key)}" if key in values else line)
            if line == "[EMC]":
                lines.append("NML_FILE = machine.nml")
            for number, axis in enumerate(AXES):
                if line == f"[JOINT_{number}]" and axis in self._tables:
                    name = f"{axis.lower()}.comp"
                    shutil.copyfile(self._tables[axis], self._folder / name)
                    lines += [f"COMP_FILE = {name}", f"COMP_FILE_TYPE = {self._table_type}"]
        programs = ([f"{agent} -ini machine.ini"] if self._beside else []) + self._programs
        if programs:
            lines += ["[APPLICATIONS]", *(f"APP = {program}" for program in programs)]
        assert not values, f"{template} has no {', '.join(values)}"
        return "\n".join(lines) + "\n"

    def _last_words(self) -> str:
        lines = self.log.read_text(errors="replace").splitlines()
        return " | ".join(line for line in lines[-15:] if line.strip())


def _namespaces() -> list[str]:
    own = ["--ipc", "--pid", "--mount", "--fork", "--kill-child", "--mount-proc"]
    return ["unshare", *([] if os.geteuid() == 0 else ["--user", "--map-root-user"]), *own]


def _become_ordinary() -> list[str]:
    if os.geteuid() == 0:
        nobody = str(_NOBODY)
        become = ["setpriv", "--reuid", nobody, "--regid", nobody, "--clear-groups"]
    else:
        user, group = str(os.getuid()), str(os.getgid())
        become = ["unshare", "--user", f"--map-user={user}", f"--map-group={group}"]
    # Who becomes another user loses the signal that unshare's --kill-child has asked for.
    return [*become, "setpriv", "--pdeathsig", "KILL"]


def _listens(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return False
    return True
