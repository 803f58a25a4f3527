"""Starts the nodes of a run as processes and sees to it that none is left behind."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence as Listing
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

import stepdiag_ros
from stepdiag_ros.parameters.declaration import written
from stepdiag_ros.parameters.nodes import declared_node
from stepdiag_ros.run.supervision import HELD
from stepdiag_ros.text.sentence import PREFIX

PR_SET_PDEATHSIG = 1
"""From linux/prctl.h."""
ENCLAVE = "/stepdiag"
"""Folder of the security enclaves in ``config/security``; counts where ROS_SECURITY_ENABLE does."""
OVERRIDE = "ROS_SECURITY_ENCLAVE_OVERRIDE"
"""Environment variable with the enclave of a process; an empty one counts as none."""
END_LIMIT = 5.0
"""Real seconds that a node has to end after it was asked to."""


@dataclass(frozen=True)
class NodeProcess:
    """What to start: a node module and its ROS arguments.

    Attributes:
        name: of the module in ``stepdiag_ros.nodes``.
        parameters: name → value, given as ``-p name:=value``.
        ros_arguments: further ROS arguments, such as a parameter file and a namespace.

    Raises:
        ValueError: the node would refuse a parameter.
    """

    name: str
    parameters: dict[str, object] = field(default_factory=dict)
    ros_arguments: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        node = declared_node(self.name)
        for name, value in self.parameters.items():
            node.check(name, str(value) if isinstance(value, Path) else value)

    @property
    def enclave(self) -> str:
        """The node's own security enclave."""
        return f"{ENCLAVE}/{self.name}"

    def command(self) -> list[str]:
        """Return the command line."""
        arguments = [sys.executable, "-m", f"stepdiag_ros.nodes.{self.name}", "--ros-args"]
        arguments += ["--enclave", self.enclave, *self.ros_arguments]
        for name, value in self.parameters.items():
            # Quoted, so that a name such as 'on' or '12' stays a text.
            given = written(str(value) if isinstance(value, Path) else value)
            arguments += ["-p", f"{name}:={given}"]
        return arguments


def _end_with_parent() -> None:
    """Let the node end when the process that started it is killed, not only when it ends well."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def environment() -> dict[str, str]:
    """Return the environment of node processes: this one's, with two things of their own.

    The enclave of the command line is not that of its nodes. And nodes are those of the package
    that starts them, also in a folder that holds another copy, such as a clone of the repository
    (from Python 3.11 on).
    """
    made = {**os.environ, OVERRIDE: "", "PYTHONSAFEPATH": "1"}
    package = Path(stepdiag_ros.__file__).resolve().parents[1]
    if package == Path.cwd():
        made["PYTHONPATH"] = os.pathsep.join(filter(None, (made.get("PYTHONPATH"), str(package))))
    return made


def exit_words(code: int) -> str:
    """Return how a process has ended, from its exit code: by which signal, or with which code."""
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def ending(name: str, code: int, last: str) -> str:
    """Say how a node has ended, why, and what may be done where it could not say so itself.

    Args:
        name: of the node.
        code: exit code of its process, below zero for a signal.
        last: the last line of its log; empty if it has no line.
    """
    # A node that is ended by a signal says nothing of it, and [INFO] is not a reason.
    informs = last.startswith(("[INFO]", "[DEBUG]"))
    if last and code >= 0 and not informs:
        return f"the {name} node has ended ({exit_words(code)}): {last}"
    if code == -signal.SIGKILL:
        why = "somebody killed it, or the computer ran out of memory (see dmesg)"
    elif code < 0:
        why = "the signal came from outside or from a crash in a library"
    else:
        why = "start it by hand to see why"
    said = f"its last line was: {last}" if last else "it had not said anything"
    return f"the {name} node has ended ({exit_words(code)}): {why}; {said}"


def is_stopped(stat: str) -> bool:
    """Say whether a process is stopped, by SIGSTOP or a debugger.

    Args:
        stat: text of /proc/PID/stat.
    """
    # The state stands after the program's name, which may hold blanks and brackets.
    return stat.rpartition(")")[2].split()[:1] in (["T"], ["t"])


class Processes:
    """Node processes, ended together however the block ends.

    Args:
        nodes: what to start.
        log_folder: each node's output goes to NAME.log there; made for the time being, and kept
            where a node has written.
        held: get the processes ready at once, but let the nodes join the graph only after
            ``release``.
    """

    def __init__(self, nodes: Listing[NodeProcess], log_folder: Path, held: bool = False) -> None:
        self._nodes = nodes
        self._logs = log_folder
        self._held = held
        self._made: list[Path] = []
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> "Processes":
        self._made = [one for one in (self._logs, *self._logs.parents) if not one.exists()]
        self._logs.mkdir(parents=True, exist_ok=True)
        for node in self._nodes:
            self.start(node)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end()
        # Where the nodes were not let into the graph, nothing is left behind.
        for name in self.running:
            with suppress(OSError):
                if not self._log(name).stat().st_size:
                    self._log(name).unlink()
        for one in self._made:
            with suppress(OSError):
                one.rmdir()

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"

    def start(self, node: NodeProcess) -> None:
        """Start one node, or start it again."""
        with self._log(node.name).open("ab") as log:
            self.running[node.name] = subprocess.Popen(
                node.command(),
                stdin=subprocess.PIPE if self._held else subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                # Ctrl-C is for the command line, which then ends the nodes in order.
                start_new_session=True,
                env={**environment(), HELD: "1" if self._held else ""},
                preexec_fn=_end_with_parent,
            )

    def release(self) -> None:
        """Let nodes that are held join the graph; those started from now on are not held."""
        self._held = False
        for process in self.running.values():
            if process.stdin is not None:
                process.stdin.close()

    def ended(self) -> dict[str, str]:
        """Return name → sentence of the nodes that have ended."""
        codes = {name: process.poll() for name, process in self.running.items()}
        return {
            name: ending(name, code, self._last_words(name))
            for name, code in codes.items()
            if code is not None
        }

    def stopped(self) -> dict[str, int]:
        """Return name → process of the nodes that are stopped and may wake; known on Linux only."""
        found = {}
        for name, process in self.running.items():
            try:
                stat = Path(f"/proc/{process.pid}/stat").read_text()
            except OSError:
                continue
            if is_stopped(stat):
                found[name] = process.pid
        return found

    def end(self) -> None:
        """Ask every node to end, and end those that do not."""
        for process in self.running.values():
            if process.poll() is None:
                # Not SIGINT, which a process started in the background of a shell ignores.
                process.terminate()
        deadline = time.monotonic() + END_LIMIT
        for process in self.running.values():
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdin is not None:
                process.stdin.close()

    def _last_words(self, name: str) -> str:
        log = self._log(name)
        lines = [line for line in log.read_text(errors="replace").splitlines() if line.strip()]
        return f"{lines[-1].strip().removeprefix(PREFIX)} (see {log})" if lines else ""
