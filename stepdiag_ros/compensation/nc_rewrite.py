"""NC programs rewritten point by point: every target less the error that the machine makes there.

For controls that have no tables for it. Each place w that the program goes to is replaced by the
place q at which the tool of this machine is at w (``metrology.target_correction``), and feed moves
are divided so that the tool stays within a tolerance of the wanted line or arc all along
(``nc_division``). Whatever does not move the axes is passed as it is, sign by sign; what cannot be
corrected safely is refused with its line (``nc_program``). Outside the measured box nothing is
known of the machine: a move there is refused, unless the correction of the nearest place of the box
is allowed to go on (``hold``), which the report says line by line.

The map holds for the tool that it was measured with: with a tool longer by L, rotations ε of the
axes displace the tip by a further ε × L, which the map does not contain.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from stepdiag_ros.compensation.nc_division import Division, Pieces
from stepdiag_ros.compensation.nc_motion import ARC, RAPID, Motion
from stepdiag_ros.compensation.nc_reading import MOTIONS, BlockAction, NcSettings, steps_of
from stepdiag_ros.compensation.nc_words import Block, NcError, Word, refusal
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.refusal import Fault, Refusal
from stepdiag_ros.metrology.target_correction import target_for
from stepdiag_ros.metrology.volumetric_map import VolumetricMap
from stepdiag_ros.text.controls import Comment

COMMENT = Comment("(", ")")
REFUSE, HOLD = "refuse", "hold"
_FIRST_PIECE = ("M3", "M4", "M7", "M8", "M13", "M14")
_LAST_PIECE = ("M0", "M1", "M2", "M5", "M9", "M30", "M60")
_SAME = 1e-12


@dataclass(frozen=True)
class RewriteSettings:
    """How a program is rewritten.

    Attributes:
        tolerance: that the tool may be away from its way along feed moves, m.
        decimals: of coordinates in millimetre programs; inch programs get one more.
        outside: what happens outside the measured box: ``REFUSE`` or ``HOLD``.
        program: settings that the program does not state.
    """

    tolerance: float = 2e-6
    decimals: int = 4
    outside: str = REFUSE
    program: NcSettings = field(default_factory=NcSettings)


@dataclass(frozen=True)
class Rewritten:
    """A rewritten program.

    Attributes:
        text: of the program.
        lines: for each line of the original: number of its first line in the text, from 1, and how
            many there are.
        parts: line of the original → parts of its way at the ends of its pieces, shape (n + 1,).
        uncorrected: line of the original and why its move is passed as it is.
        held: lines whose way leaves the box, corrected by what holds at its edge.
        changed: number of moves that were changed.
        remarks: what the reader must know, in words.
    """

    text: str
    lines: tuple[tuple[int, int], ...]
    parts: dict[int, Vector]
    uncorrected: tuple[tuple[int, str], ...]
    held: tuple[int, ...]
    changed: int
    remarks: tuple[str, ...] = ()


def rewrite(
    text: str,
    source: str,
    error_map: VolumetricMap,
    settings: RewriteSettings,
    header: Sequence[str] = (),
) -> Rewritten:
    """Rewrite a program.

    Args:
        text: of the program.
        source: what the user calls it.
        error_map: of the machine, in machine coordinates.
        settings: see there.
        header: texts that stand before the first block, as comments, if anything was changed.

    Raises:
        NcError: something cannot be corrected safely, a way leaves the box or the error there is
            not known, or the tolerance cannot be kept; names the line.
        ValueError: the tolerance is smaller than what the decimals can say.
    """
    finest = 0.5 * 10.0**-settings.decimals * 1e-3
    if settings.tolerance < 3.0 * finest:
        raise Refusal(
            f"a tolerance of {1e6 * settings.tolerance:g} µm cannot be kept with"
            f" {settings.decimals} decimals of a millimetre; allow {3e6 * finest:g} µm, or write"
            " more decimals",
            fault="out_of_range",
        )
    writer = _Writer(source, error_map, settings)
    steps = list(steps_of(text, source, settings.program))
    # The targets of all moves at once, which is much faster than one by one.
    moves = [step.motion for step in steps if step.motion is not None and step.motion.known]
    targets = iter(target_for(error_map, np.array([motion.end for motion in moves]).reshape(-1, 3)))
    for step in steps:
        known = step.motion is not None and step.motion.known
        writer.take(step, next(targets) if known else None)
    return writer.finish(re.findall(r"\r\n|\n|\r", text), header)


class _Writer:
    def __init__(self, source: str, error_map: VolumetricMap, settings: RewriteSettings) -> None:
        self._source, self._map, self._settings = source, error_map, settings
        self._division = Division(error_map, settings.tolerance)
        start = settings.program.start
        self._sent = np.full(3, np.nan) if start is None else np.array(start, dtype=np.float64)
        self._position = self._sent
        self._mode = ""
        self._groups: list[list[str]] = []
        self._front = 0
        self._parts: dict[int, Vector] = {}
        self._uncorrected: list[tuple[int, str]] = []
        self._held: list[int] = []
        self._changed = 0
        self._integers = 0

    def take(self, step: BlockAction, target: Vector | None) -> None:
        """Write what one block becomes.

        Args:
            step: what it does.
            target: for the end of its move, m, shape (3,); None if it is not known.
        """
        block = step.block
        if block.mark and self._front == len(self._groups):
            self._front += 1
        if step.motion is None:
            if step.passed:
                self._uncorrected.append((block.number, step.passed))
            self._groups.append([block.text])
            self._follow(step)
            if step.passed or step.state.motion != self._mode:
                self._mode = self._mode_after(step)
            return
        self._integers += sum(
            "." not in word.text and word.letter in "XYZIJKR" and word.value != 0.0
            for word in block.words
        )
        if target is None:
            self._uncorrected.append(
                (block.number, "a rapid move while an axis stands where it is not known")
            )
            self._verbatim(step)
            return
        self._correct(step, step.motion, target)

    def finish(self, endings: Sequence[str], header: Sequence[str]) -> Rewritten:
        """Put the program together; every line keeps the sign that ended it."""
        texts = header if self._changed else ()
        comments = [line for text in texts for line in COMMENT.lines(text)]
        usual = endings[0] if endings else "\n"
        made: list[str] = []
        places = []
        count = 0
        for place, group in enumerate(self._groups):
            own = comments if place == self._front else []
            places.append((count + len(own) + 1, len(group)))
            count += len(own) + len(group)
            last = endings[place] if place < len(endings) else ""
            made.append("".join(line + usual for line in (*own, *group[:-1])) + group[-1] + last)
        remarks = []
        if self._integers:
            remarks.append(
                f"{self._integers} coordinates have no decimal point and were read as whole"
                " millimetres or inches; some controls read them as smallest increments"
            )
        return Rewritten(
            text="".join(made),
            lines=tuple(places),
            parts=self._parts,
            uncorrected=tuple(self._uncorrected),
            held=tuple(self._held),
            changed=self._changed,
            remarks=tuple(remarks),
        )

    # -- one block ------------------------------------------------------------

    def _refuse(self, block: Block, reason: str, fault: Fault, aspect: str = "") -> NcError:
        return refusal(self._source, block.number, reason, fault, aspect)

    def _follow(self, step: BlockAction) -> None:
        """Take note of where a block that is passed as it is sends the axes.

        An axis that it does not name stays where it was sent, corrected or not.
        """
        after = step.state.position
        named = np.array([step.block.get(letter) is not None for letter in AXES])
        if step.state.absolute or step.machine:
            sent = np.where(named, after, self._sent)
        else:
            sent = self._sent + (after - self._position)
        # Where an axis is not known, neither is where it was sent.
        self._sent = np.where(np.isfinite(after), sent, np.nan)
        self._position = after

    def _mode_after(self, step: BlockAction) -> str:
        """Return the motion mode of the written program after a block that is passed as it is."""
        told = [code for code in step.block.codes if code in MOTIONS]
        if told:
            return told[-1]
        if step.passed or not step.state.motion:
            return step.state.motion
        return self._mode

    def _correct(self, step: BlockAction, motion: Motion, target: Vector) -> None:
        self._check_region(step, motion)
        if not np.all(np.isfinite(target)):
            raise self._not_known(step)
        rounded = self._rounding(step)
        resolution = self._resolution(step)
        plain = bool(
            np.allclose(self._sent, motion.start, rtol=0.0, atol=_SAME, equal_nan=True)
            and np.all(np.abs(target - motion.end) < 0.5 * resolution)
        )
        if plain and (
            motion.kind == RAPID or self._division.uncorrected(motion) <= self._settings.tolerance
        ):
            self._parts[step.block.number] = np.array([0.0, 1.0])
            self._verbatim(step)
            return
        if motion.kind == RAPID:
            sent = np.vstack([self._sent, rounded(target[None, :])[0]])
            pieces = Pieces(np.array([0.0, 1.0]), sent, 0.0)
        else:
            found = self._division.pieces(motion, self._sent, target, rounded)
            if found is None:
                raise self._refuse(
                    step.block,
                    f"the tolerance of {1e6 * self._settings.tolerance:g} µm cannot be kept on this"
                    " move; if it begins where the axes stand uncorrected, go there by G0 before",
                    fault="out_of_range",
                )
            if not np.isfinite(found.remaining):
                raise self._not_known(step)
            pieces = found
        self._parts[step.block.number] = pieces.part
        self._groups.append(self._lines(step, motion, pieces, resolution))
        self._changed += 1
        self._sent, self._position = pieces.sent[-1], motion.end

    def _check_region(self, step: BlockAction, motion: Motion) -> None:
        if motion.kind == RAPID:
            way = motion.end[None, :]
        else:  # a straight way between places in the box is in it
            way = motion.at(np.linspace(0.0, 1.0, 361 if motion.kind == ARC else 2))
        inside = self._map.inside(way)
        if not np.all(inside):
            place = way[int(np.argmin(inside))]
            words = ", ".join(f"{1e3 * value:.3f}" for value in place)
            if self._settings.outside == REFUSE:
                raise self._refuse(
                    step.block,
                    f"machine position X, Y, Z = {words} mm is outside the measured box, where the"
                    " errors are not known; keep the way inside, or let the correction of the"
                    " nearest place in it go on (--outside hold)",
                    fault="out_of_range",
                )
            self._held.append(step.block.number)

    def _not_known(self, step: BlockAction) -> NcError:
        return self._refuse(
            step.block,
            "the errors on this way are not known: "
            f"{', '.join(self._map.unknown_curves)} were not determined everywhere",
            fault="undetermined",
        )

    def _resolution(self, step: BlockAction) -> float:
        """Return the finest step of a coordinate that is written, m."""
        unit = step.state.unit
        return unit * 10.0 ** -self._decimals(step)

    def _decimals(self, step: BlockAction) -> int:
        return self._settings.decimals + (1 if step.state.unit > 2e-3 else 0)

    def _rounding(self, step: BlockAction) -> Callable[[Vector], Vector]:
        # What is written is counted from the zero, or from where the axes were sent.
        counted = step.zero if step.state.absolute or step.machine else self._sent
        unit, decimals = step.state.unit, self._decimals(step)

        def rounded(places: Vector) -> Vector:
            made: Vector = counted + unit * np.round((places - counted) / unit, decimals)
            return made

        return rounded

    # -- text -----------------------------------------------------------------

    def _verbatim(self, step: BlockAction) -> None:
        code = step.state.motion
        text = step.block.text
        if self._mode != code and not any(found in MOTIONS for found in step.block.codes):
            text = _joined(step.block, [code], [], step.block.words)
        self._mode = code
        self._groups.append([text])
        self._follow(step)

    def _lines(
        self,
        step: BlockAction,
        motion: Motion,
        pieces: Pieces,
        resolution: float,
    ) -> list[str]:
        block, count = step.block, len(pieces.part) - 1
        code = "G0" if motion.kind == RAPID else "G1"
        first, last = self._other_words(block, count)
        lead = ["G53"] if step.machine else []
        made = []
        for piece in range(count):
            before, after = pieces.sent[piece], pieces.sent[piece + 1]
            named = [axis for axis in AXES if block.get(axis) is not None] if piece == 0 else []
            coordinates = [
                f"{letter}{self._number(step, before[axis], after[axis], axis)}"
                for axis, letter in enumerate(AXES)
                if not abs(after[axis] - before[axis]) <= 0.25 * resolution or letter in named
            ]
            if not coordinates:
                coordinates = [f"X{self._number(step, before[0], after[0], 0)}"]
            if piece == 0:
                made.append(_joined(block, [*lead, code], coordinates, first))
            else:
                made.append(" ".join([*lead, *([code] if lead else []), *coordinates]))
        if last:
            made[-1] = " ".join([made[-1], *(word.letter + word.text for word in last)])
        self._mode = code
        return made

    def _number(self, step: BlockAction, before: float, after: float, axis: int) -> str:
        zero = step.zero[axis] if step.state.absolute or step.machine else before
        value = (after - zero) / step.state.unit
        digits = f"{value:.{self._decimals(step)}f}".rstrip("0")
        return "0." if digits in ("-0.", "0.") else digits

    def _other_words(self, block: Block, count: int) -> tuple[list[Word], list[Word]]:
        """Return the words that go into the first and behind the last piece of a move."""
        others = [
            word
            for word in block.words
            if word.letter not in "XYZIJKR" and word.code not in (*MOTIONS, "G53")
        ]
        if count == 1:
            return others, []
        last = [word for word in others if word.code in _LAST_PIECE]
        for word in others:
            if word.letter == "M" and word.code not in (*_FIRST_PIECE, *_LAST_PIECE):
                raise self._refuse(
                    block,
                    f"{word.code} stands beside a move that has to be divided; write it in a line"
                    " of its own",
                    fault="mismatch",
                    aspect="division",
                )
        return [word for word in others if word not in last], last


def _joined(
    block: Block, codes: Sequence[str], coordinates: Sequence[str], others: Sequence[Word]
) -> str:
    """Write a block: its number, its codes, the coordinates, then all else and the comments."""
    numbers = [word for word in others if word.letter == "N"]
    modes = [word for word in others if word.letter == "G"]
    rest = [word for word in others if word.letter not in "NG"]
    parts = [
        *(word.letter + word.text for word in (*numbers, *modes)),
        *codes,
        *coordinates,
        *(word.letter + word.text for word in rest),
        *block.comments,
    ]
    return " ".join(parts)
