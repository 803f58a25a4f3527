"""Requests of a viewer with the token, and how the answer is reported."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass

ACTIONS = ("start", "pause", "resume", "abort")
"""As the sequencer's services are called."""
LEADERS = ("sequencer", "by_hand")
"""Roles of who leads a run; a cell has one of them."""


@dataclass(frozen=True)
class RequestAnswer:
    """What came of a request.

    Attributes:
        done: it was done as asked.
        text: in plain words.
    """

    done: bool
    text: str


Ask = Callable[[str], "Future[RequestAnswer]"]
"""Asks for one of ``ACTIONS``; called from the server's thread."""
