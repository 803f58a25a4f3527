"""Log messages that others cause, at a limited rate."""

import logging
import threading
import time
from collections.abc import Callable

from stepdiag_ros.text.sentence import sentence

MOST = 10
"""Sentences within ``SPAN``; what is more is counted."""
SPAN = 10.0
"""Real seconds."""
_LONGEST = 300
"""Characters of a sentence; a stranger chooses what it quotes."""


class Sparing:
    """Passes sentences on to a log, a few in some seconds, and says how many were left out.

    Any thread may call it.

    Args:
        log: takes a sentence.
    """

    def __init__(self, log: Callable[[str], None]) -> None:
        self._log = log
        self._lock = threading.Lock()
        self._since = -SPAN
        self._said = self._left_out = 0

    def __call__(self, text: str) -> None:
        """Say a sentence, or count it."""
        now = time.monotonic()
        with self._lock:
            if now - self._since >= SPAN:
                self._since, self._said = now, 0
            self._said += 1
            if self._said > MOST:
                self._left_out += 1
                return
            left_out, self._left_out = self._left_out, 0
        more = f" ({left_out} more like this were not written before)" if left_out else ""
        self._log(sentence(ValueError(text))[:_LONGEST] + more)


class Handler(logging.Handler):
    """Takes what a server's library logs of its clients, a sentence each and no traceback.

    Args:
        say: takes a sentence.
        of: in front of it.
    """

    def __init__(self, say: Callable[[str], None], of: str) -> None:
        super().__init__(logging.WARNING)
        self._say, self._of = say, of

    def emit(self, record: logging.LogRecord) -> None:
        """Say what was logged, and the error that it came from."""
        error = record.exc_info[1] if record.exc_info else None
        why = f": {type(error).__name__}: {error}" if error is not None else ""
        self._say(f"{self._of}: {record.getMessage()}{why}")
