"""ROS domains for tests: each is used by one at a time on this computer, whoever runs tests there.

Nothing is imported here beyond Python itself, so that this serves tests on any client library.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO
from unittest import mock

FIRST_PORT, PORTS_EACH = 7400, 250
"""Of a domain's participants: from 7400 + 250 × number on (RTPS 2.3, 9.6.1)."""
NUMBERS = (*range(1, 101), *range(215, 231))
"""Whose ports Linux gives to nobody who asks for any port."""
FOLDER = Path(tempfile.gettempdir()) / "stepdiag_test_domains"


@contextmanager
def taken_domain() -> Iterator[int]:
    """Hold a domain that no other test on this computer holds.

    It is the one that was left longest ago: a node that ends late is not met by the next test.

    Raises:
        RuntimeError: all are taken.
    """
    number, lock = _first_free()
    with lock:
        yield number
        os.utime(lock.fileno())


@contextmanager
def own_domain() -> Iterator[int]:
    """Hold a domain (see ``taken_domain``) and let this process and those that it starts use it."""
    with taken_domain() as number, mock.patch.dict(os.environ):
        os.environ["ROS_DOMAIN_ID"] = str(number)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        yield number


def _first_free() -> tuple[int, IO[str]]:
    FOLDER.mkdir(exist_ok=True)
    left = {path.name: path.stat().st_mtime for path in FOLDER.iterdir()}
    occupied = _occupied()
    for number in sorted(NUMBERS, key=lambda one: left.get(str(one), 0.0)):
        if number in occupied:
            continue
        try:
            lock = (FOLDER / str(number)).open("a")
        except PermissionError:  # another user's
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
        else:
            return number, lock
    raise RuntimeError(f"all {len(NUMBERS)} ROS domains are taken by tests; see {FOLDER}")


def _occupied() -> set[int]:
    """Return the domains in which somebody is on this computer: a user's own, or a late node."""
    with suppress(OSError):
        lines = Path("/proc/net/udp").read_text().splitlines()[1:]
        ports = [int(line.split()[1].partition(":")[2], 16) for line in lines]
        return {(port - FIRST_PORT) // PORTS_EACH for port in ports}
    return set()


_rooms_held = 0


@contextmanager
def room_for_a_cell() -> Iterator[None]:
    """Wait until the computer has room for another whole cell, and hold it.

    A cell has a dozen nodes, which take more than one processor between them. Where more run at
    once than there is room for, each makes the others late, and all take several times as long
    beside a load that no test can stand. In a block within the block nothing more is held.
    """
    global _rooms_held
    FOLDER.mkdir(exist_ok=True)
    with ExitStack() as held:
        if not _rooms_held:
            held.enter_context(_first_free_room())
        _rooms_held += 1
        try:
            yield
        finally:
            _rooms_held -= 1


def _first_free_room() -> IO[str]:
    rooms = max(1, len(os.sched_getaffinity(0)) // 2)
    while True:
        for number in range(rooms):
            lock = (FOLDER / f"room {number}").open("a")
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                lock.close()
            else:
                return lock
        time.sleep(0.1)
