"""All sections on one screen: what stands where, and what makes way where there is little room."""

from dataclasses import dataclass

from rich.console import Console
from rich.text import Text

from stepdiag_ros.viewers.terminal import sections
from stepdiag_ros.viewers.terminal.glyphs import Glyphs
from stepdiag_ros.viewers.terminal.sections import Document, Lines, titled

LEAST_WIDTH, LEAST_HEIGHT = 80, 24
"""Columns and rows in which all essentials have their place."""
_LEFT, _LEFT_MOST = 38, 52
"""Columns of the left half, at least and at most; curves are drawn in what the right one gains."""
_GAP = " "
_INDENT = "  "
_FEWEST_FAULTS = 2
_FEWEST_VERDICT = 2
_MOST_WORDS = 2
"""Rows for what the run says of itself, where room is scarce."""


@dataclass(frozen=True)
class Heading:
    """What stands in the first row.

    Attributes:
        source: what is shown: how many nodes answer, or which bag is played.
        time: in words.
    """

    source: str
    time: str


class ScreenPage:
    """Lays out a view.

    Args:
        signs: that the terminal can show.
    """

    def __init__(self, signs: Glyphs) -> None:
        self._signs = signs
        # Only breaks lines.
        self._console = Console(width=LEAST_WIDTH, color_system=None)

    def draw(
        self, documents: dict[str, Document], heading: Heading, width: int, height: int | None
    ) -> Lines:
        """Return the rows of a view.

        Args:
            documents: of all sections, with texts that the terminal can show.
            heading: the first row.
            width: columns; in fewer than ``LEAST_WIDTH`` the sections stand below each other.
            height: rows; None for as many as it takes.

        Returns:
            rows, none of them wider than ``width``, no more of them than ``height``. A
            row states what has no room.
        """
        if width < LEAST_WIDTH:
            return self._narrow(documents, heading, width, height)
        head = [self._heading(documents["run"], heading, width)]
        run = sections.run_lines(documents["run"], documents["progress"], self._signs)
        faults = sections.fault_lines(documents["faults"])
        worst = sections.worst_lines(documents["worst"])
        verdict = [*worst, *sections.verdict_lines(documents["verdict"])]
        halves = self._halves(documents, width)
        extras = self._extras(documents, width)
        if height is None:
            above = head + self._wrapped(run, width)
            whole = [self._wrapped(faults, width), halves, self._wrapped(verdict, width)]
            return self._joined([above, *whole, *extras], None)
        head += self._fitted(run[:1], width, _MOST_WORDS) + self._wrapped(run[1:], width)
        left = height - len(head) - len(halves)
        for_verdict = min(_FEWEST_VERDICT + len(worst), len(self._wrapped(verdict, width)))
        fault_rows = self._fitted(faults, width, max(_FEWEST_FAULTS, left - for_verdict))
        verdict_rows = self._fitted(verdict, width, max(1 + len(worst), left - len(fault_rows)))
        parts = [head, fault_rows, halves, verdict_rows]
        for extra in extras:
            if sum(map(len, parts)) + len(extra) <= height:
                parts.append(extra)
        return self._cut(self._joined(parts, height), width, height)

    def _joined(self, parts: list[Lines], height: int | None) -> Lines:
        """Return parts below each other, with an empty row between them where there is room."""
        rows = [row for part in parts for row in part]
        if height is not None and len(rows) + len(parts) - 1 > height:
            return rows
        spaced = [row for part in parts for row in (*part, Text())]
        return spaced[:-1]

    def _narrow(
        self, documents: dict[str, Document], heading: Heading, width: int, height: int | None
    ) -> Lines:
        run = documents["run"]
        parts = [
            Text(f"{heading.source}, {heading.time}"),
            *([titled(_named(run))] if run["run_id"] else []),
            *sections.run_lines(documents["run"], documents["progress"], self._signs),
            *sections.fault_lines(documents["faults"]),
            *self._left(documents, width),
            *self._right(documents, width),
            *sections.worst_lines(documents["worst"]),
            *sections.verdict_lines(documents["verdict"]),
        ]
        return self._cut(self._wrapped(parts, width), width, height)

    def _heading(self, run: Document, heading: Heading, width: int) -> Text:
        right = f"{heading.source}  {heading.time}"
        told = _named(run) if run["run_id"] else "stepdiag watch"
        left = self._clipped(titled(told), max(0, width - len(right) - len(_GAP)))
        left.pad_right(max(0, width - len(right) - left.cell_len))
        return self._clipped(left.append(right), width)

    def _left(self, documents: dict[str, Document], width: int) -> Lines:
        inner = width - len(_INDENT)
        return self._indented(
            sections.beam_lines(documents["beam"], self._signs),
            sections.stop_lines(documents["stop"], inner),
            sections.block_lines(documents["blocks"], inner, self._signs),
            sections.weather_lines(documents["weather"]),
        )

    def _right(self, documents: dict[str, Document], width: int) -> Lines:
        inner = width - len(_INDENT)
        return self._indented(
            sections.curve_lines(documents["curves"], inner, self._signs),
            sections.squareness_lines(documents["squareness"]),
        )

    def _halves(self, documents: dict[str, Document], width: int) -> Lines:
        """Return both columns side by side."""
        left_width = min(_LEFT_MOST, _LEFT + (width - LEAST_WIDTH) // 2)
        right_width = width - len(_GAP) - left_width
        left = self._wrapped(self._left(documents, left_width), left_width)
        right = self._wrapped(self._right(documents, right_width), right_width)
        rows = []
        for number in range(max(len(left), len(right))):
            row = left[number].copy() if number < len(left) else Text()
            row.pad_right(left_width - row.cell_len + len(_GAP))
            if number < len(right):
                row.append_text(right[number])
            row.rstrip()
            rows.append(row)
        return rows

    def _extras(self, documents: dict[str, Document], width: int) -> list[Lines]:
        """Return what is shown where there is room, the most wanted first."""
        extras = [
            sections.plan_lines(documents["run"]),
            sections.position_lines(documents["position"]),
            sections.before_lines(documents["blocks"], width - len(_INDENT), self._signs),
            sections.course_lines(documents["volume"], documents["progress"]),
            sections.remark_lines(documents["curves"]),
        ]
        return [self._wrapped(extra, width) for extra in extras if extra]

    def _indented(self, *parts: Lines) -> Lines:
        """Return titles as they are and all else indented."""
        rows: Lines = []
        for title, *others in parts:
            rows += [title, *(Text(_INDENT).append_text(other) for other in others)]
        return rows

    def _wrapped(self, lines: Lines, width: int) -> Lines:
        """Return lines broken between words where they are too wide."""
        rows: Lines = []
        for line in lines:
            if line.cell_len <= width:
                rows.append(line)
                continue
            for row in line.wrap(self._console, width):
                row.rstrip()
                rows.append(row)
        return rows

    def _fitted(self, lines: Lines, width: int, most: int) -> Lines:
        """Return at most so many rows, with a mark for lines cut or left out."""
        rows: Lines = []
        for number, line in enumerate(lines):
            left = max(0, most - len(rows))
            following = len(lines) - number - 1
            broken = self._wrapped([line], width)
            # A line takes more than one row only where those that follow still have theirs.
            share = max(1, left - following)
            if left == 0:
                return self._say_more(rows, following + 1, width)
            rows += broken[:share]
            if len(broken) > share:
                rows[-1] = self._clipped(rows[-1].copy().append(" " + self._signs.ellipsis), width)
        return rows

    def _say_more(self, rows: Lines, count: int, width: int) -> Lines:
        """Return rows of which the last one states that more follow."""
        said = f" {self._signs.ellipsis} and {count} more"
        last = self._clipped(rows[-1].copy(), width - len(said))
        return [*rows[:-1], last.append(said)]

    def _clipped(self, line: Text, width: int) -> Text:
        """Return a line that is cut where it is too wide, with a sign that it is."""
        if line.cell_len <= width:
            return line
        sign = self._signs.ellipsis
        line.truncate(max(0, width - len(sign)))
        return line.append(sign) if width >= len(sign) else line

    def _cut(self, rows: Lines, width: int, height: int | None) -> Lines:
        if height is None or len(rows) <= height:
            return rows
        said = f"too small: all is shown in {LEAST_WIDTH} x {LEAST_HEIGHT}"
        return [*rows[: height - 1], self._clipped(titled(said), width)]


def _named(run: Document) -> str:
    """Return which run of which plan is shown."""
    simulated = ", simulated" if run["simulated"] else ""
    return f"{run['run_id']}{simulated}  {run['plan']}"
