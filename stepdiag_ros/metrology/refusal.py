"""What an error says beside its sentence: the kind of fault, what is at fault, and where.

The sentence is for people and may be reworded at any time. Programs and tests ask the fields.
"""

from collections.abc import Callable
from typing import Any, Literal, TypeVar

Made = TypeVar("Made")

Fault = Literal[
    # What was given.
    "missing",  # what is needed is not given: a key, a column, an argument, a line, a password
    "unknown",  # a name that is none of those known: a key, a method, a driver, an axis
    "malformed",  # it cannot be read as what it must be: a number, YAML, a program, a message
    "out_of_range",  # it is beyond a limit, or not finite
    "twice",  # it is there more often than it may be
    "out_of_order",  # it comes before or after its turn
    "mismatch",  # two things that must agree do not
    "ambiguous",  # more than one thing fits
    "too_few",  # there is not enough of it
    "too_many",  # there is too much of it
    "unsupported",  # it is understood, but cannot be done
    "undetermined",  # its value is not known
    # Files.
    "not_found",  # what was named is not there
    "exists",  # it is there already, and is not overwritten
    "wrong_kind",  # it is something else: a folder, another format, another type
    "unreadable",  # the computer does not let it be read
    "unwritable",  # the computer does not let it be written
    "cut",  # it ends in the middle
    "damaged",  # it is not what was written
    "exposed",  # others can read or reach what must be kept
    # Devices, nodes and runs.
    "busy",  # something else is going on
    "not_ready",  # its state does not allow it
    "stopped",  # it was stopped, closed or aborted
    "failed",  # it, or the peer, reports a fault of its own
    "rejected",  # the peer refuses it
    "silent",  # nothing has come in time
    "lost",  # the connection is gone or cannot be made
    "restarted",  # the peer was started again and has forgotten
    "not_installed",  # a library or a program is not there, or does not work
]
"""Kinds of fault; each error has one of them at most."""


class ErrorFields(Exception):
    """An error with fields; always a base beside one of Python's own errors.

    Args:
        words: of the error; the last is its sentence.
        fault: its kind; None if it has not been classed.
        about: name of what is at fault: a key, column, parameter, topic, axis, line or curve.
        where: the file or source that it stands in, as the user calls it.
        row: of a table, or line of a text, counted from 1.
        aspect: which of several demands on the same thing is not met, in a word, such as ``feed``
            or ``limits`` of a move; empty where the kind of fault is enough.
    """

    def __init__(
        self,
        *words: object,
        fault: Fault | None = None,
        about: str = "",
        where: str = "",
        row: int | None = None,
        aspect: str = "",
    ) -> None:
        super().__init__(*words)
        self.fault = fault
        self.about = about
        self.where = where
        self.row = row
        self.aspect = aspect


class Refusal(ErrorFields, ValueError):
    """What was given or asked for is refused; the text says what is wrong and what to do."""


class Findings:
    """Collects refusals that do not depend on each other, so that a user reads all of them at once.

    Attributes:
        found: the refusals so far, in order.
    """

    def __init__(self) -> None:
        self.found: list[ValueError] = []

    def of(self, make: Callable[[], Made], instead: Made) -> Made:
        """Return what is made, or ``instead`` where it is refused, to go on with."""
        try:
            return make()
        except ValueError as error:
            self.found.append(error)
            return instead

    def refuse(self) -> None:
        """Refuse if anything was found.

        Raises:
            ValueError: the only refusal as it was raised; of several, one with a sentence for each
                and the fields of the first.
        """
        if len(self.found) == 1:
            raise self.found[0]
        if self.found:
            words = ". ".join(str(error).rstrip(".") for error in self.found)
            raise Refusal(words, **fields_of(self.found[0]))


def fields_of(error: Exception) -> dict[str, Any]:
    """Return the fields of an error, for another error that says more about the same fault."""
    if not isinstance(error, ErrorFields):
        return {}
    return {name: getattr(error, name) for name in ("fault", "about", "where", "row", "aspect")}


class Lost(ErrorFields, ConnectionError):
    """A connection is gone, cannot be made, or is no longer good for anything."""


class Silent(ErrorFields, TimeoutError):
    """What must come within a time has not come."""


class Unusable(ErrorFields, OSError):
    """The computer or a device does not do what is needed."""
