"""Signals: Ctrl-C and SIGTERM end all contexts, even while a call into DDS waits."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType
from typing import Any


class SignalHandlerOptions(IntEnum):
    """Which signals are handled."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3


_previous: dict[int, Any] = {}
_watcher: _Watcher | None = None
#: What came while the main thread could not be interrupted; ``None`` while it can.
_put_off: list[tuple[int, FrameType | None]] | None = None


class _Watcher:
    """Thread that wakes threads waiting in DDS when a signal has come.

    Python runs its signal handlers between two of its own instructions, which a waiting C function
    does not reach; it does write a byte to the wake-up descriptor at once.
    """

    def __init__(self) -> None:
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)
        self._previous = signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, name="rclpy-signals", daemon=True).start()

    def _watch(self) -> None:
        from rclpy.context import _contexts

        while True:
            data = os.read(self._read, 64)
            if not data:
                return
            for context in list(_contexts):
                for wake in list(context._wakers):
                    wake()

    def close(self) -> None:
        signal.set_wakeup_fd(self._previous)
        os.close(self._write)


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Handle signals; only the main thread can, elsewhere nothing happens."""
    global _watcher
    if threading.current_thread() is not threading.main_thread():
        return
    for number, wanted in (
        (signal.SIGINT, options & SignalHandlerOptions.SIGINT),
        (signal.SIGTERM, options & SignalHandlerOptions.SIGTERM),
    ):
        if wanted and number not in _previous:
            _previous[number] = signal.signal(number, _handle)
    if options and _watcher is None:
        _watcher = _Watcher()


def uninstall_signal_handlers() -> None:
    """Give the signals back to their earlier handlers."""
    global _watcher
    if threading.current_thread() is not threading.main_thread():
        return
    for number, handler in _previous.items():
        signal.signal(number, handler if handler is not None else signal.SIG_DFL)
    _previous.clear()
    if _watcher is not None:
        _watcher.close()
        _watcher = None


def get_current_signal_handlers_options() -> SignalHandlerOptions:
    """Return which signals are handled."""
    handled = (signal.SIGINT in _previous) + 2 * (signal.SIGTERM in _previous)
    return SignalHandlerOptions(handled)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Put off what Ctrl-C raises in the main thread to the end of a block.

    Python's thread pools fail, or wait for ever at the exit, if it comes while they take up work.
    """
    global _put_off
    if threading.current_thread() is not threading.main_thread() or _put_off is not None:
        yield
        return
    came = _put_off = []
    try:
        yield
    finally:
        _put_off = None
    for number, frame in came:
        _pass_on(number, frame)


def _handle(number: int, frame: FrameType | None) -> None:
    from rclpy.context import _contexts

    for context in list(_contexts):
        context.try_shutdown()
    if _put_off is not None:
        _put_off.append((number, frame))
    else:
        _pass_on(number, frame)


def _pass_on(number: int, frame: FrameType | None) -> None:
    """Call the earlier handler of a signal."""
    previous = _previous.get(number)
    if callable(previous):
        previous(number, frame)
