"""Processes of the package that are forked, for tests, from one that has imported all of it.

A node that starts takes 0.7 s of processor time, nine tenths of it for imports, and a simulated
cell has a dozen nodes. A fork takes none of that. What is forked runs the same module with the same
arguments, environment, files and signals, and is a child of the process that asked for it.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import importlib
import inspect
import os
import pickle
import pkgutil
import runpy
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, NoReturn

PR_SET_CHILD_SUBREAPER = 36
"""From linux/prctl.h."""
LARGEST = 1 << 17
"""Bytes of a request, which holds the whole environment."""
PACKAGE = "stepdiag_ros"
ROOT = str(Path(__file__).resolve().parents[1])
"""Where the package is, which all of them have."""
IMPORTED = ("commands", "nodes")
"""Parts of the package; what they need comes with them."""
STARTING = ("stepdiag_ros.cli", "stepdiag_ros.nodes.diagnosis")
"""Modules that start processes of the package themselves."""


@dataclass(frozen=True)
class Job:
    """What a forked process is to be.

    Attributes:
        arguments: of the command line: the module and what follows it.
        environment: all of it.
        folder: in which it works.
        prepare: a function of a module that it calls first; None for none.
        parent: the process that asks for it.
        session: it begins a session of its own.
    """

    arguments: list[str]
    environment: dict[str, str]
    folder: str
    prepare: Any
    parent: int
    session: bool


class Source:
    """The process from which others are forked, as seen by the one that asks it."""

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel
        self._one_at_a_time = Lock()

    @classmethod
    def started(cls) -> Source:
        """Return one that is started now, and ends with this process."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            process = _Popen(
                [sys.executable, "-c", "import forked; forked.main()", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                cwd=Path(__file__).parent,
                # Its threads would be lost in what is forked.
                env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
        atexit.register(process.wait)
        atexit.register(ours.close)
        return cls(ours)

    def fork(self, job: Job, files: list[int]) -> int:
        """Return the number of a new process (``files``: its three standard files)."""
        with self._one_at_a_time, _adopting():
            socket.send_fds(self._channel, [pickle.dumps(job)], files)
            return int(self._channel.recv(20))


@contextmanager
def _adopting() -> Iterator[None]:
    """Let orphans become children of this process; at other times they go to init, as ever."""
    prctl = ctypes.CDLL(None).prctl
    prctl(PR_SET_CHILD_SUBREAPER, 1)
    try:
        yield
    finally:
        prctl(PR_SET_CHILD_SUBREAPER, 0)


_Popen = subprocess.Popen
_source: list[Source] = []


class ForkedPopen(subprocess.Popen):  # type: ignore[type-arg]
    """Forks what is a module of the package, and starts all else as ever."""

    def _execute_child(self, *values: Any) -> None:
        wanted = dict(zip(_WANTED, values, strict=True))
        job = job_of(wanted)
        if job is None:
            super()._execute_child(*values)  # type: ignore[misc]
            return
        if not _source:
            _source.append(Source.started())
        own = enumerate(("p2cread", "c2pwrite", "errwrite"))
        files = [number if wanted[end] == -1 else wanted[end] for number, end in own]
        try:
            self.pid = _source[0].fork(job, files)
            self._child_created = True
        finally:
            self._close_pipe_fds(*(wanted[end] for end in _PIPES))  # type: ignore[attr-defined]


_WANTED = list(inspect.signature(_Popen._execute_child).parameters)[1:]  # type: ignore[attr-defined]
_PIPES = ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")
_FORKED = {
    *(*_PIPES, "args", "preexec_fn", "close_fds", "cwd", "env", "restore_signals"),
    "start_new_session",
}
"""What may be wanted of a process that is forked; all else must be as it is by default."""


def job_of(wanted: dict[str, Any]) -> Job | None:
    """Return what a process is to be, from what ``Popen`` was given; None if it must be started."""
    special = (value for key, value in wanted.items() if key not in _FORKED)
    if any(value not in (None, -1, False, ()) for value in special):
        return None
    given = wanted["args"]
    command = [str(one) for one in given] if isinstance(given, (list, tuple)) else []
    of_ours = "".join(command[2:3]).partition(".")[0] == PACKAGE
    if command[:2] != [sys.executable, "-m"] or not of_ours:
        return None
    environment = dict(os.environ if wanted["env"] is None else wanted["env"])
    prepare = wanted["preexec_fn"]
    try:
        pickle.dumps(prepare)
    except (AttributeError, pickle.PicklingError):
        return None
    folder = str(wanted["cwd"] or Path.cwd())
    return Job(command[2:], environment, folder, prepare, os.getpid(), wanted["start_new_session"])


def serve(channel: socket.socket) -> Job | None:
    """Fork what is asked for; return what this process is to be, None once nobody asks any more."""
    while True:
        try:
            request, files, _, _ = socket.recv_fds(channel, LARGEST, 3)
        except ConnectionError:
            return None
        if not request:
            return None
        read, write = os.pipe()
        between = os.fork()
        if not between:
            between = os.getpid()
            forked = os.fork()
            if forked:
                os.write(write, str(forked).encode())
                os._exit(0)
            channel.close()
            os.close(read)
            os.close(write)
            return _become(pickle.loads(request), files, between)
        os.waitpid(between, 0)
        channel.send(os.read(read, 20))
        for one in (*files, read, write):
            os.close(one)


def _become(job: Job, files: list[int], between: int) -> Job:
    """Make this process what a new one would be."""
    # From now on it is a child of the process that has asked.
    while os.getppid() == between:
        time.sleep(0.0005)
    if job.arguments[0] in STARTING:
        _source[:] = [_source_of_its_own(files)]
        subprocess.Popen = ForkedPopen  # type: ignore[misc]
    for number, one in enumerate(files):
        os.dup2(one, number)
    for one in files:
        if one > 2:
            os.close(one)
    if job.session:
        os.setsid()
    os.chdir(job.folder)
    os.environ.clear()
    os.environ.update(job.environment)
    given = job.environment.get("PYTHONPATH", "").split(os.pathsep)
    sys.path[:0] = [one for one in given if one not in ("", ROOT, *sys.path)]
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", closefd=False, buffering=1, errors="backslashreplace")  # noqa: SIM115
    if job.prepare is not None:
        job.prepare()
    if os.getppid() != job.parent:
        # It was killed meanwhile, and will never tell this process to end.
        os._exit(1)
    return job


def _source_of_its_own(files: list[int]) -> Source:
    """Return a source for this process, made while it holds nothing but its files."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    if os.fork():
        theirs.close()
        return Source(ours)
    ours.close()
    for one in files:
        os.close(one)
    job = serve(theirs)
    if job is not None:
        _run(job)
    os._exit(0)


def _run(job: Job) -> NoReturn:
    """Run the module of a job to the end of the process."""
    module, *_ = sys.argv = list(job.arguments)
    # As in a new process, the module that runs is not the one that others may import.
    sys.modules.pop(module, None)
    runpy.run_module(module, run_name="__main__", alter_sys=True)
    sys.exit(0)


def main() -> None:
    """Be the source: import all there is, then fork until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for part in IMPORTED:
        inner = importlib.import_module(f"{PACKAGE}.{part}")
        for found in pkgutil.iter_modules(inner.__path__, f"{PACKAGE}.{part}."):
            importlib.import_module(found.name)
    gc.collect()
    gc.freeze()
    with socket.socket(fileno=int(sys.argv[1])) as channel:
        job = serve(channel)
    if job is not None:
        _run(job)
