"""Talk with a controller with Grbl: one line at a time, reports asked for, silence noticed.

Source: "Grbl v1.1 Interface" (documentation of gnea/grbl), sections "Streaming a G-Code Program to
Grbl" (simple send-response), "Status Reporting" and "Real-time Status Reports".
"""

from dataclasses import dataclass

from stepdiag_ros.devices.cnc.grbl_protocol import (
    STATUS_QUERY,
    Banner,
    Garbage,
    LineAnswer,
    Said,
    StatusReport,
    read_line,
)
from stepdiag_ros.devices.link import Link, LinkSettings
from stepdiag_ros.devices.link_framing import Lines
from stepdiag_ros.metrology.refusal import Refusal, Silent

LONGEST_LINE = 512
"""Bytes; Grbl's own lines have up to about 100, grblHAL's reports up to about 250."""
LONGEST_COMMAND = 79
"""Characters that Grbl takes in a line (LINE_BUFFER_SIZE - 1)."""
ASK_AGAIN = 100_000_000
"""ns without a report after which it is asked for again: not every query is answered, and one that
comes while another waits is left out."""
MOST_LATE = 20_000_000
"""ns from the query to the report, at the most, by Grbl's documentation; the rest is transport."""
ANSWER_LIMIT = 1_500_000_000
"""ns in which a line is answered; Grbl itself pauses for 0.5 s after an alarm."""
MOST_GARBAGE = 10
"""Lines in sequence that make no sense."""


@dataclass(frozen=True)
class Timing:
    """How often and how long is waited, all in ns.

    Attributes:
        period: between two queries for a status report.
        silence: without a report after which the controller is lost.
        start: the same for the first report: a board that is reset by its port takes 2 s.
    """

    period: int
    silence: int
    start: int


@dataclass(frozen=True)
class Heard:
    """Something that the controller said.

    Attributes:
        time: ns; of a report, when it was made, between query and arrival.
        said: what.
        answers: the line that a ``LineAnswer`` answers; empty if none was sent.
    """

    time: int
    said: Said
    answers: str = ""


class Conversation:
    """Sends lines and queries, and returns the answers.

    Args:
        connection: where the controller is.
        timing: of the queries.
        start: now, ns.

    Raises:
        OSError: the port cannot be opened.
    """

    def __init__(self, connection: LinkSettings, timing: Timing, start: int) -> None:
        self._timing = timing
        self._link = Link(connection)
        self._lines = Lines(b"\n", longest=LONGEST_LINE)
        self._heard_any = False
        self._garbage, self._nonsense = 0, ""
        # The last query, and the first of those that are not answered yet.
        self._asked = start
        self._unanswered: int | None = start
        self._due = start
        self._query = STATUS_QUERY
        self._awaiting = ""
        self._answer_by = 0
        self._silent = False

    @property
    def awaiting(self) -> str:
        """Return the line whose answer is to come; empty if no line is unanswered."""
        return self._awaiting

    def send(self, now: int, line: str, limit: int = ANSWER_LIMIT) -> None:
        """Send a line that is to be answered within a limit (ns); only when none is on its way.

        Raises:
            OSError: the link is broken.
            ValueError: the line before is not answered yet, or this one is too long.
        """
        if self._awaiting:
            raise ValueError(f"'{self._awaiting}' is not answered yet")
        if len(line) > LONGEST_COMMAND:
            raise ValueError(f"'{line}' is longer than the {LONGEST_COMMAND} characters Grbl takes")
        self._awaiting, self._answer_by = line, now + limit
        self._link.send(line.encode("ascii") + b"\n")

    def command(self, byte: bytes) -> None:
        """Send a real-time command: it acts at once, and is not answered."""
        self._link.send(byte)

    def ask_with(self, query: bytes) -> None:
        """Ask for the next report with another real-time command than ``?``."""
        self._query = query

    def be_patient(self, now: int, *, silent: bool) -> None:
        """Expect no reports for a while, or expect them again."""
        self._silent = silent
        self._unanswered, self._due = None, now

    def poll(self, now: int) -> list[Heard]:
        """Return the answers since the last call; ask for a report when it is due.

        Raises:
            OSError: the link is broken, the controller is silent, or a line was not answered.
            ValueError: what it says makes no sense.
        """
        heard = []
        if self._link.ready:
            for line in self._lines.take(self._link.receive()):
                heard.append(self._take(now, read_line(line)))
            self._ask(now)
        else:
            self._link.receive()
        self._judge(now)
        return heard

    def close(self) -> None:
        """Let the link go."""
        self._link.close()

    def _take(self, now: int, said: Said) -> Heard:
        if isinstance(said, Garbage):
            self._garbage += 1
            self._nonsense = said.line[:40]
            if self._garbage > MOST_GARBAGE:
                raise self._no_grbl()
            return Heard(now, said)
        self._garbage = 0
        self._heard_any = True
        if isinstance(said, StatusReport):
            time = now
            if self._unanswered is not None:
                time = self._asked + min((now - self._asked) // 2, MOST_LATE)
                # After a pause of the asker, queries are not made up for.
                self._due = max(self._asked + self._timing.period, now)
            self._unanswered = None
            return Heard(time, said)
        if isinstance(said, LineAnswer):
            line, self._awaiting = self._awaiting, ""
            return Heard(now, said, line)
        if isinstance(said, Banner):
            # A reset throws away the line on its way, and the query.
            self._awaiting, self._unanswered, self._due = "", None, now
        return Heard(now, said)

    def _ask(self, now: int) -> None:
        if self._silent or now < self._due:
            return
        self._link.send(self._query)
        self._query = STATUS_QUERY
        self._asked = now
        if self._unanswered is None:
            self._unanswered = now
        self._due = now + ASK_AGAIN

    def _judge(self, now: int) -> None:
        if self._awaiting and now > self._answer_by:
            line = self._awaiting
            raise Silent(
                f"the controller did not answer '{line}': whether it was executed is not known",
                fault="undetermined",
                aspect="answer",
            )
        if self._unanswered is None or self._silent:
            return
        limit = self._timing.silence if self._heard_any else self._timing.start
        if now - self._unanswered > limit:
            if self._garbage:
                raise self._no_grbl()
            raise Silent(
                f"the controller has not answered for {limit * 1e-9:g} s. Check that it is"
                " switched on and connected; reset it after a limit or emergency-stop alarm",
                fault="silent",
            )

    def _no_grbl(self) -> Refusal:
        return Refusal(
            f"the controller speaks no Grbl, the last was {self._nonsense!r}: are port and baud"
            " rate right?",
            fault="malformed",
        )
