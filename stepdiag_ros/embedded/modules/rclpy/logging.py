"""Logging to the console and to ``/rosout``, in rcl's format and with its levels."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable
from enum import IntEnum
from typing import Any

from stepdiag_ros.embedded.arguments import RosArguments

_KEYWORDS = frozenset(
    ("throttle_duration_sec", "throttle_time_source_type", "skip_first", "once", "name")
)


class LoggingSeverity(IntEnum):
    """Levels; the numbers are those of rcutils."""

    UNSET = 0
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50


_FORMAT = os.environ.get(
    "RCUTILS_CONSOLE_OUTPUT_FORMAT", "[{severity}] [{time}] [{name}]: {message}"
)
_lock = threading.RLock()
_loggers: dict[str, RcutilsLogger] = {}
_levels: dict[str, int] = {"": LoggingSeverity.INFO}
_console = True
#: Who publishes to ``/rosout``, by the name of the node's logger.
_rosout: dict[str, Callable[[int, int, str, str, str, str, int], None]] = {}


class RcutilsLogger:
    """Logger of a name; ``parent.child`` inherits its parent's level."""

    def __init__(self, name: str = "") -> None:
        self.name = name
        #: State of throttled, skipped and once-only calls, by their place in the code.
        self._places: dict[Any, float] = {}

    def get_child(self, name: str) -> RcutilsLogger:
        """Return the logger ``this.name``.

        Raises:
            ValueError: The name is empty.
        """
        if not name:
            raise ValueError("Child logger name must not be empty.")
        return get_logger(f"{self.name}.{name}" if self.name else name)

    def set_level(self, level: LoggingSeverity | int) -> None:
        """Log from this level on; UNSET inherits the parent's."""
        set_logger_level(self.name, level)

    def get_effective_level(self) -> LoggingSeverity:
        """Return the level from which on this logger logs."""
        return get_logger_effective_level(self.name)

    def is_enabled_for(self, severity: LoggingSeverity | int) -> bool:
        """Return whether this logger logs at a level."""
        return self.get_effective_level() <= int(severity)

    def log(self, message: str, severity: LoggingSeverity | int, **kwargs: Any) -> bool:
        """Log a message; return whether it was logged.

        Args:
            message: The text.
            severity: Its level.
            **kwargs: ``throttle_duration_sec`` (at most once in as many seconds), ``skip_first``
                and ``once``, each counted for the place in the code that calls; ``name``.

        Raises:
            TypeError: A keyword is unknown.
        """
        severity = LoggingSeverity(severity)
        unknown = kwargs.keys() - _KEYWORDS
        if unknown:
            raise TypeError(f"log() got unexpected keyword arguments {sorted(unknown)}")
        if not self.is_enabled_for(severity):
            return False
        frame: Any = sys._getframe(1)
        while frame.f_back is not None and frame.f_code.co_filename == __file__:
            frame = frame.f_back
        code = frame.f_code
        if kwargs and not self._passes((code.co_filename, frame.f_lineno), kwargs):
            return False
        name = kwargs.get("name") or self.name
        _write(severity, name, str(message), code.co_filename, code.co_name, frame.f_lineno)
        return True

    def debug(self, message: str, **kwargs: Any) -> bool:
        """Log at level DEBUG."""
        return self.log(message, LoggingSeverity.DEBUG, **kwargs)

    def info(self, message: str, **kwargs: Any) -> bool:
        """Log at level INFO."""
        return self.log(message, LoggingSeverity.INFO, **kwargs)

    def warning(self, message: str, **kwargs: Any) -> bool:
        """Log at level WARN."""
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def warn(self, message: str, **kwargs: Any) -> bool:
        """Log at level WARN."""
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def error(self, message: str, **kwargs: Any) -> bool:
        """Log at level ERROR."""
        return self.log(message, LoggingSeverity.ERROR, **kwargs)

    def fatal(self, message: str, **kwargs: Any) -> bool:
        """Log at level FATAL."""
        return self.log(message, LoggingSeverity.FATAL, **kwargs)

    def _passes(self, place: Any, rules: dict[str, Any]) -> bool:
        with _lock:
            if rules.get("skip_first") and ("skip", place) not in self._places:
                self._places["skip", place] = 0.0
                return False
            if rules.get("once"):
                if ("once", place) in self._places:
                    return False
                self._places["once", place] = 0.0
            throttle = rules.get("throttle_duration_sec")
            if throttle:
                clock = rules.get("throttle_time_source_type")
                now = clock.now().nanoseconds / 1e9 if clock else time.monotonic()
                last = self._places.get(("throttle", place))
                if last is not None and 0 <= now - last < throttle:
                    return False
                self._places["throttle", place] = now
        return True


def get_logger(name: str) -> RcutilsLogger:
    """Return the logger of a name.

    Raises:
        ValueError: The name is empty.
    """
    if not name:
        raise ValueError("Logger name must not be empty.")
    with _lock:
        return _loggers.setdefault(name, RcutilsLogger(name))


def set_logger_level(
    name: str,
    level: LoggingSeverity | int,
    detailed_error: bool = False,  # noqa: ARG001 - rclpy's signature
) -> None:
    """Make a logger log from a level on; UNSET inherits the parent's."""
    with _lock:
        _levels[name] = LoggingSeverity(level)
        if not _levels[name] and name:
            del _levels[name]


def get_logger_level(name: str) -> LoggingSeverity:
    """Return the level that was set for a logger, UNSET if none was."""
    return LoggingSeverity(_levels.get(name, LoggingSeverity.UNSET))


def get_logger_effective_level(name: str) -> LoggingSeverity:
    """Return the level from which on a logger logs, its own or its nearest parent's."""
    while name:
        level = _levels.get(name)
        if level is not None:
            return LoggingSeverity(level)
        name = name.rpartition(".")[0]
    return LoggingSeverity(_levels[""] or LoggingSeverity.INFO)


def get_logging_severity_from_string(log_severity: str) -> LoggingSeverity:
    """Return a level by its name."""
    return LoggingSeverity[log_severity.upper()]


def initialize() -> None:
    """Do nothing; there is nothing to prepare."""


def shutdown() -> None:
    """Do nothing; the console needs no end."""


def clear_config() -> None:
    """Set all levels back to INFO."""
    with _lock:
        _levels.clear()
        _levels[""] = LoggingSeverity.INFO


def _configure(arguments: RosArguments) -> None:
    global _console
    _console = arguments.use_stdout
    for name, level in arguments.log_levels.items():
        set_logger_level(name, level)


def _write(
    severity: LoggingSeverity, name: str, message: str, file: str, function: str, line: int
) -> None:
    now = time.time_ns()
    if _console:
        stamp = f"{now // 1_000_000_000}.{now % 1_000_000_000:09d}"
        text = _FORMAT
        for key, value in (
            ("{severity}", severity.name),
            ("{time}", stamp),
            ("{time_as_nanoseconds}", str(now)),
            ("{name}", name),
            ("{function_name}", function),
            ("{file_name}", file),
            ("{line_number}", str(line)),
            ("{message}", message),
        ):
            text = text.replace(key, value)
        try:
            # One call, so that lines of several processes do not mix.
            sys.stderr.write(text + "\n")
            sys.stderr.flush()
        except (OSError, ValueError):
            # A closed terminal must not stop a measurement.
            pass
    owner = name
    while owner:
        publish = _rosout.get(owner)
        if publish is not None:
            publish(now, int(severity), name, message, file, function, line)
            return
        owner = owner.rpartition(".")[0]
