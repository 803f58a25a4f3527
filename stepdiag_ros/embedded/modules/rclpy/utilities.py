"""Small helpers around the default context."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence

from rclpy.context import Context
from stepdiag_ros.embedded import arguments

_lock = threading.Lock()
_default: Context | None = None


def get_default_context(*, shutting_down: bool = False) -> Context:  # noqa: ARG001
    """Return the context used where none is given; a new one after a shutdown is made by init."""
    global _default
    with _lock:
        if _default is None:
            _default = Context()
        return _default


def _renew_default_context() -> Context:
    global _default
    with _lock:
        if _default is None or _default._state == "shut down":
            _default = Context()
        return _default


def ok(*, context: Context | None = None) -> bool:
    """Return whether a context (the default one) is initialised and not shut down."""
    return (context or get_default_context()).ok()


def shutdown(*, context: Context | None = None) -> None:
    """End a context (the default one)."""
    (context or get_default_context()).shutdown()


def try_shutdown(*, context: Context | None = None) -> None:
    """End a context (the default one) if it is running."""
    (context or get_default_context()).try_shutdown()


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """Return a command line (``sys.argv`` if ``None``) without the part between ``--ros-args``."""
    return arguments.parse(sys.argv if args is None else args).remaining


def get_rmw_implementation_identifier() -> str:
    """Return the name of the middleware."""
    return "stepdiag_embedded_cyclonedds"


def timeout_sec_to_nsec(timeout_sec: float | None) -> int:
    """Return a timeout in nanoseconds; ``None`` and negative ones mean no limit (-1)."""
    if timeout_sec is None or timeout_sec < 0:
        return -1
    return int(timeout_sec * 1_000_000_000)
