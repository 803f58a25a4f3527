"""Writes moves and dwells as an NC program (ISO 6983-1, G-code) for machines without a bridge.

Only words are used that controllers agree on: G21 (mm), G90 (absolute), G94 (mm/min), G1, G4, M0,
M30. Two things they do not agree on are options: how a dwell is written, and the frame around a
program. Every coordinate has a decimal point, because "X10" is ten micrometres on some controllers.
There is no rapid move, and one axis moves at a time unless a move says otherwise.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.text.controls import FARTHEST, NUMBER, Comment, refuse_foreign

DwellForm = Literal["P_ms", "P_s", "X_s", "F_s"]
DWELL_FORMS: dict[DwellForm, str] = {
    "P_ms": "G4 P500 is half a second (Fanuc and most others)",
    "P_s": "G4 P0.5 is half a second (LinuxCNC, Haas, Mach)",
    "X_s": "G4 X0.5 is half a second (Fanuc, Okuma, Mitsubishi)",
    "F_s": "G4 F0.5 is half a second (Siemens, Heidenhain ISO)",
}
"""Ways to write a dwell, with the controllers that read them so."""

_PER_MINUTE = 60.0
_TITLE_WIDTH = 60
_LONGEST_DWELL = 9999.0
_SLOWEST, _FASTEST = 1e-6, 10.0
"""m/s."""
_NUMBERS_APART = 10
_LARGEST_NUMBER = 9999
_COMMENT = Comment("(", ")", signs=".,+-/=[]", capitals=True, width=70)
"""What every controller reads: capitals, and no sign that one may take for something else, such as
% ; : # @ or $."""
_LINES = (
    "%",
    rf"O[0-9]{{4}} {_COMMENT.pattern}",
    *(
        rf"(N[0-9]{{2,4}} )?{block}"
        for block in (
            _COMMENT.pattern,
            "G21 G90 G94",
            r"G1 F[0-9]{1,7}\.[0-9]{1,3}",
            rf"G1( [XYZ]{NUMBER}){{1,3}}",
            r"G4 [PXF][0-9]{1,7}(\.[0-9]{1,3})?",
            "M0",
            "M30",
        )
    ),
)
"""Patterns of all lines that a program has."""

CHECK = "CHECK TRAVEL, TOOL, MIRROR AND CABLE BEFORE RUNNING"
"""Stands at the head of every program."""


@dataclass(frozen=True)
class Dialect:
    """What a controller wants otherwise than others.

    Attributes:
        dwell: how a dwell is written, a key of ``DWELL_FORMS``. The default, P in ms, is the one
            that fails safely: P is not an axis on any controller, and a controller that takes it
            for seconds waits too long instead of too short.
        decimals: of positions in mm, 3 to 6; 4 is a tenth of a micrometre.
        percent: the program stands between two lines ``%``, as for transfer to a controller.
        program_number: O-number, 1 to 9999; None for none.
        line_numbers: N10 N20 … before every line.
    """

    dwell: DwellForm = "P_ms"
    decimals: int = 4
    percent: bool = True
    program_number: int | None = None
    line_numbers: bool = False

    def __post_init__(self) -> None:
        """Refuse what no controller reads.

        Raises:
            ValueError: names the attribute, what is wrong and what is expected.
        """
        if self.dwell not in DWELL_FORMS:
            raise Refusal(
                f"the dwell form '{self.dwell}' is unknown. Use one of {', '.join(DWELL_FORMS)}",
                fault="unknown",
            )
        if not 3 <= self.decimals <= 6:
            raise Refusal(
                f"{self.decimals} decimals of a millimetre: expected 3 to 6", fault="out_of_range"
            )
        number = self.program_number
        if number is not None and not 1 <= number <= _LARGEST_NUMBER:
            raise Refusal(
                f"the program number {number} is not from 1 to {_LARGEST_NUMBER}",
                fault="out_of_range",
            )


@dataclass(frozen=True)
class Move:
    """A place to go to, and what is done there.

    Attributes:
        target_m: X Y Z in machine coordinates, m. Where several axes differ from the place before,
            they move one after the other, X before Y before Z, unless ``at_once`` is set.
        dwell_s: stay there for this time, s; 0 for none.
        comment: written before the move; empty for none.
        at_once: several axes may move together, on the straight line to the target.
        program_stop: what the operator has to do before the move (M0 with this comment); empty to
            go on without a stop.
    """

    target_m: tuple[float, float, float]
    dwell_s: float
    comment: str = ""
    at_once: bool = False
    program_stop: str = ""


@dataclass
class _Writer:
    """The lines of a program as they are written."""

    dialect: Dialect
    lines: list[str] = field(default_factory=list)
    count: int = 0

    def block(self, text: str) -> None:
        self.count += 1
        # Beyond the largest number the numbers begin again, as controllers allow.
        most = _LARGEST_NUMBER // _NUMBERS_APART
        number = ((self.count - 1) % most + 1) * _NUMBERS_APART
        self.lines.append(f"N{number} {text}" if self.dialect.line_numbers else text)

    def comment(self, text: str) -> None:
        for line in _COMMENT.lines(text):
            self.block(line)


def nc_program(
    moves: Iterable[Move],
    *,
    feed_m_per_s: float,
    name: str,
    remarks: Sequence[str] = (),
    dialect: Dialect | None = None,
) -> str:
    """Write an NC program.

    The program begins wherever the machine stands: the axes go to the first target one at a time,
    X before Y before Z.

    Args:
        moves: in order.
        feed_m_per_s: of every move, m/s.
        name: what the program is, for people.
        remarks: more sentences for the head of the program.
        dialect: of the controller; the default ``Dialect`` if None.

    Returns:
        The program, ASCII, every line ended by a line feed.

    Raises:
        ValueError: no moves; a position, dwell or feed that is not a usable number; or two
            different places that are equal in these decimals. One sentence that names the move.
    """
    dialect = dialect or Dialect()
    listed = list(moves)
    _check(listed, feed_m_per_s)
    places = [_coordinates(move, dialect.decimals) for move in listed]
    rounding = max(
        abs(value * IN_MILLI - float(text))
        for move, place in zip(listed, places, strict=True)
        for value, text in zip(move.target_m, place, strict=True)
    )
    writer = _Writer(dialect)
    if dialect.program_number is not None:
        title = _COMMENT.lines(_COMMENT.text(name)[:_TITLE_WIDTH] or "-")[0]
        writer.lines.append(f"O{dialect.program_number:04d} {title}")
    for sentence in _head(name, listed, places, feed_m_per_s, dialect, rounding, remarks):
        writer.comment(sentence)
    writer.block("G21 G90 G94")
    writer.block(f"G1 F{_shortest(feed_m_per_s * IN_MILLI * _PER_MINUTE, 3)}")
    before: tuple[str, str, str] | None = None
    for index, (move, place) in enumerate(zip(listed, places, strict=True)):
        if move.program_stop:
            writer.comment(move.program_stop)
            writer.block("M0")
        if move.comment:
            writer.comment(move.comment)
        changed = [axis for axis in range(3) if before is None or place[axis] != before[axis]]
        if before is not None:
            _check_resolved(listed, index, changed, dialect.decimals)
        words = [f"{AXES[axis]}{place[axis]}" for axis in changed]
        if move.at_once and before is not None and words:
            writer.block("G1 " + " ".join(words))
        else:
            for word in words:
                writer.block(f"G1 {word}")
        if move.dwell_s > 0.0:
            writer.block(dwell_words(move.dwell_s, dialect.dwell))
        before = place
    writer.block("M30")
    lines = ["%", *writer.lines, "%"] if dialect.percent else writer.lines
    program = "\n".join(lines) + "\n"
    refuse_foreign("the NC program", program, *_LINES)
    return program


def dwell_words(dwell_s: float, form: DwellForm) -> str:
    """Return the block of a dwell, rounded up to a whole millisecond, for example ``G4 P500``."""
    # Less a millionth of a millisecond: 0.4 s are 400 ms, whatever a float makes of it.
    milliseconds = math.ceil(dwell_s * IN_MILLI - 1e-6)
    if form == "P_ms":
        return f"G4 P{milliseconds}"
    return f"G4 {form[0]}{_shortest(milliseconds / IN_MILLI, 3)}"


def _shortest(value: float, decimals: int) -> str:
    """Write a number with a decimal point and no needless zeros behind it."""
    text = f"{value:.{decimals}f}".rstrip("0")
    return text + "0" if text.endswith(".") else text


def _coordinates(move: Move, decimals: int) -> tuple[str, str, str]:
    # Adding 0.0 makes of a rounded -0.0 a zero without sign.
    x, y, z = (f"{round(value * IN_MILLI, decimals) + 0.0:.{decimals}f}" for value in move.target_m)
    return x, y, z


def _check(moves: list[Move], feed: float) -> None:
    if not moves:
        raise Refusal("an NC program needs at least one move", fault="too_few")
    if not _SLOWEST <= feed <= _FASTEST:
        raise Refusal(
            f"the feed of an NC program is {feed:g} m/s; expected {_SLOWEST:g} to {_FASTEST:g} m/s",
            fault="out_of_range",
            aspect="feed",
        )
    for number, move in enumerate(moves, start=1):
        if not all(abs(value) <= FARTHEST for value in move.target_m):
            raise Refusal(
                f"move {number}: the target {move.target_m} is not a position",
                fault="out_of_range",
                aspect="target",
            )
        if not 0.0 <= move.dwell_s <= _LONGEST_DWELL:
            raise Refusal(
                f"move {number}: a dwell of {move.dwell_s:g} s; expected 0 to {_LONGEST_DWELL:g} s",
                fault="out_of_range",
                aspect="dwell",
            )


def _check_resolved(moves: list[Move], index: int, changed: list[int], decimals: int) -> None:
    before, after = moves[index - 1].target_m, moves[index].target_m
    for axis in range(3):
        # A way below a nanometre is rounding of the computation.
        if abs(after[axis] - before[axis]) > 1e-9 and axis not in changed:
            raise Refusal(
                f"move {index + 1}: {AXES[axis]} goes from {before[axis] * IN_MILLI:.9g} mm to "
                f"{after[axis] * IN_MILLI:.9g} mm, which are the same number in {decimals}"
                " decimals. Write more decimals",
                fault="mismatch",
            )


def _head(
    name: str,
    moves: list[Move],
    places: list[tuple[str, str, str]],
    feed: float,
    dialect: Dialect,
    rounding: float,
    remarks: Sequence[str],
) -> list[str]:
    several = any(move.at_once for move in moves)
    reach = ", ".join(
        f"{AXES[axis]} {min(column, key=float)} to {max(column, key=float)}"
        for axis, column in enumerate(zip(*places, strict=True))
    )
    sentences = [
        name,
        CHECK,
        f"Box in mm: {reach}",
        "Machine coordinates: work offsets, tool length and rotation must be zero",
        f"Feed {feed * IN_MILLI * _PER_MINUTE:.6g} mm/min, no rapid moves, "
        + ("several axes together on diagonal lines" if several else "one axis at a time"),
        f"Dwell: {DWELL_FORMS[dialect.dwell]}",
        "Begins by going to the first target from where the machine stands: X, then Y, then Z",
    ]
    if rounding > 1e-7:
        sentences.append(f"Positions are rounded by up to {rounding / IN_MILLI * IN_MICRO:.3f} um")
    return [*sentences, *remarks]
