"""Ctrl-C and requests to end, which never strike while a message is handled.

An answer that is being read when an exception strikes is lost: if it was the answer to the goal of
a run, nobody could cancel that run any more. Signals belong to the whole process, and so does this.
"""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from stepdiag_ros.run.interruption import Terminated

_handling = False
_come: KeyboardInterrupt | None = None


@contextmanager
def raised() -> Iterator[None]:
    """Let SIGINT and SIGTERM raise KeyboardInterrupt in the block, except in ``held``.

    SIGTERM raises ``Terminated``, which is one.

    SIGINT stays ignored where it was, as in the background of a shell.
    """
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    numbers = (signal.SIGTERM,) if ignored else (signal.SIGTERM, signal.SIGINT)
    before = {number: signal.signal(number, _on_signal) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def held() -> Iterator[None]:
    """Hold signals back while the block handles a message.

    Raises:
        KeyboardInterrupt: at the end of the block, for what came in it.
    """
    global _handling, _come
    _handling = True
    try:
        yield
    finally:
        _handling = False
    if _come is not None:
        come, _come = _come, None
        raise come


def _on_signal(number: int, _frame: FrameType | None) -> None:
    global _come
    asked = Terminated() if number == signal.SIGTERM else KeyboardInterrupt()
    if not _handling:
        raise asked
    _come = asked
