"""What an NC program makes a three-axis machine do: modal state, and the move of each block.

ISO 6983-1 with what controls share beyond it: G0 to G3 (I J K, or R), G17 to G19, G20 and G21, G53
to G59.3, G90 and G91, G90.1 and G91.1, G28 and G30, G43 H and G49, canned cycles by G80 to G89.
What would move the axes otherwise, or move what the program's coordinates mean, is refused with its
line, so that no correction is made for a way that the machine does not take.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from stepdiag_ros.compensation.nc_motion import (
    ARC,
    LINE,
    RAPID,
    Motion,
    arc_by_center,
    arc_by_radius,
)
from stepdiag_ros.compensation.nc_words import Block, NcError, blocks_of, refusal
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.refusal import Fault, Refusal


class Refuse(Protocol):
    """Makes the error that refuses a block."""

    def __call__(self, reason: str, fault: Fault, aspect: str = "") -> NcError:
        """Return the error; ``fault`` and ``aspect`` are those of ``Refusal``."""
        ...


MOTIONS = {"G0": RAPID, "G1": LINE, "G2": ARC, "G3": ARC}
CYCLES = ("G73", "G81", "G82", "G83", "G84", "G85", "G86", "G87", "G88", "G89")
SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
MILLIMETRE, INCH = 1e-3, 25.4e-3
_PLANES = {"G17": (0, 1, 2), "G18": (2, 0, 1), "G19": (1, 2, 0)}
# They move nothing and change no coordinates.
_HARMLESS = (
    *("G4", "G9", "G15", "G40", "G61", "G61.1", "G64", "G69", "G80", "G90.1", "G91.1"),
    *("G94", "G95", "G96", "G97", "G98", "G99"),
)
_REASONS = {
    "G41": "cutter radius compensation changes the way; let the CAM system offset it",
    "G42": "cutter radius compensation changes the way; let the CAM system offset it",
    "G93": "with inverse time feed each piece of a divided move would need another F",
    "G10": "it changes offsets in the middle of the program",
    "G52": "it shifts the coordinate system; put the shift into the work offset",
    "G92": "it shifts the coordinate system; put the shift into the work offset",
    "G16": "polar coordinates are not read",
    "G68": "rotated coordinates are not read",
    "G51": "scaled coordinates are not read",
    "G31": "a probing move ends where the probe says",
    "G65": "macros cannot be corrected",
    "G66": "macros cannot be corrected",
}
_SUBPROGRAMS = ("M97", "M98", "M99", "M198")
_MOVING_LETTERS = "XYZIJKR"
_ALLOWED = "NGXYZIJKRFSTMHD"


@dataclass(frozen=True)
class NcSettings:
    """Settings that the program does not state.

    Attributes:
        offsets: coordinate system (G54 …) → machine coordinates of its zero, m.
        tool_lengths: number of H → what it adds to the machine coordinate Z, m.
        start: machine coordinates where the program begins, m; None if not known.
        cycles: let canned cycles pass as they are, uncorrected.
    """

    offsets: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    tool_lengths: Mapping[int, float] = field(default_factory=dict)
    start: tuple[float, float, float] | None = None
    cycles: bool = False


@dataclass(frozen=True)
class ModalState:
    """The modal state of a control, and where the axes are.

    Attributes:
        motion: G0, G1, G2, G3 or a canned cycle; empty before the first.
        plane: see ``nc_motion.Arc``.
        unit: m in one unit of the program.
        absolute: coordinates are absolute (G90).
        absolute_centers: I, J, K are coordinates (G90.1), not counted from the start.
        system: coordinate system in use.
        length: what tool length compensation adds to Z, m.
        position: machine coordinates of the axes, m, shape (3,); NaN where not known.
    """

    motion: str = ""
    plane: tuple[int, int, int] = (0, 1, 2)
    unit: float = MILLIMETRE
    absolute: bool = True
    absolute_centers: bool = False
    system: str = "G54"
    length: float = 0.0
    position: Vector = field(default_factory=lambda: np.full(3, np.nan))


@dataclass(frozen=True)
class BlockAction:
    """What one block does.

    Attributes:
        block: the line.
        state: after it; its modal state is that by which the block's coordinates are read.
        zero: machine coordinates of the zero that the block's coordinates count from, m, (3,).
        motion: of the axes; None if the block does not move them, or not in a way that is known.
        machine: the coordinates are those of the machine (G53).
        passed: why the block is passed as it is, though it moves the axes; empty otherwise.
    """

    block: Block
    state: ModalState
    zero: Vector
    motion: Motion | None = None
    machine: bool = False
    passed: str = ""


def steps_of(text: str, source: str, settings: NcSettings) -> Iterator[BlockAction]:
    """Go through a program, block by block.

    Args:
        text: of the program.
        source: what the user calls it.
        settings: what the program does not state.

    Raises:
        NcError: something in it cannot be followed safely; names the line.
    """
    start = np.full(3, np.nan) if settings.start is None else np.array(settings.start, float)
    state = ModalState(position=start)
    numbered = False
    for block in blocks_of(text, source):
        if block.bare:
            if block.mark not in ("", "%"):
                if numbered:
                    raise refusal(
                        source,
                        block.number,
                        "a second program or subprogram begins",
                        fault="unsupported",
                    )
                numbered = True
            yield BlockAction(block, state, np.zeros(3))
            continue
        step = _step(block, state, source, settings)
        state = step.state
        yield step


def _step(block: Block, before: ModalState, source: str, settings: NcSettings) -> BlockAction:
    def refuse(reason: str, fault: Fault, aspect: str = "") -> NcError:
        return refusal(source, block.number, reason, fault, aspect)

    state, machine, other = _modal(block, before, source, settings)
    for word in block.words:
        if word.letter == "M" and word.code in _SUBPROGRAMS:
            raise refuse(f"{word.code}: subprograms cannot be corrected", "unsupported")
    if "G4" in block.codes:
        return BlockAction(block, state, np.zeros(3))
    for code in ("G28", "G30"):
        if code in block.codes:
            named = [axis for axis in range(3) if block.get(AXES[axis]) is not None]
            state = _unknown(state, named or [0, 1, 2])
            return BlockAction(
                block, state, np.zeros(3), passed=f"{code} goes to a reference point"
            )
    moving = block.has(_MOVING_LETTERS)
    if moving or other:
        for word in block.words:
            if word.letter not in _ALLOWED and not (other and word.letter in "PQL"):
                raise refuse(
                    f"the word {word.letter} in a block that moves is not understood",
                    "unsupported",
                    "word",
                )
    elif block.has("ABCUVWE"):
        raise refuse("only the axes X, Y and Z are followed", "unsupported", "axes")
    if block.skipped and (moving or other or state is not before):
        raise refuse(
            "a move or a mode in a block that the operator may skip (/)", "unsupported", "skip"
        )
    changed = any(word.code == "M6" for word in block.words)
    if state.length != before.length and not block.has("Z"):
        # Some controls move Z by the difference of the lengths now, others with the next Z.
        state = _unknown(state, [2])
    if not block.has("XYZ") and not (state.motion in ("G2", "G3") and block.has("IJKR")):
        if moving and state.motion in ("G2", "G3", ""):
            raise refuse("an arc without a motion mode or an end", "undetermined", "mode")
        return BlockAction(block, _unknown(state, [0, 1, 2]) if changed else state, np.zeros(3))
    if changed:
        raise refuse(
            "a tool change and a move in one block; write them in two", "unsupported", "tool"
        )
    if not state.motion:
        raise refuse(
            "coordinates without a motion mode (G0 to G3) before them", "undetermined", "mode"
        )
    zero = _zero(state, machine, settings, refuse)
    if state.motion in CYCLES:
        # Where Z ends depends on G98, G99 and R; the next move with Z tells it again.
        end = _end(block, state, zero, machine)
        return BlockAction(
            block,
            # With a number of repeats (L) the last hole may lie anywhere.
            _unknown(replace(state, position=end), [0, 1, 2] if block.has("L") else [2]),
            zero,
            passed=f"the canned cycle {state.motion} is not corrected",
        )
    if machine and not state.absolute:
        raise refuse("G53 with incremental coordinates (G91)", "unsupported")
    end = _end(block, state, zero, machine)
    motion = _motion(block, state, zero, end, refuse)
    return BlockAction(block, replace(state, position=end), zero, motion, machine)


def _modal(
    block: Block, before: ModalState, source: str, settings: NcSettings
) -> tuple[ModalState, bool, bool]:
    """Return the modes in force for a block, whether G53 is, and whether it calls a cycle."""
    state, machine, cycle = before, False, False
    motions = [code for code in block.codes if code in (*MOTIONS, *CYCLES)]
    if len(motions) > 1:
        raise refusal(
            source,
            block.number,
            f"{' and '.join(motions)} in one block",
            fault="mismatch",
            aspect="modes",
        )
    for code in block.codes:
        if code in MOTIONS:
            state = replace(state, motion=code)
        elif code in CYCLES:
            if not settings.cycles:
                raise refusal(
                    source,
                    block.number,
                    f"the canned cycle {code} cannot be corrected; write it out, or let it pass"
                    " uncorrected (--cycles pass)",
                    fault="unsupported",
                )
            state, cycle = replace(state, motion=code), True
        elif code in _PLANES:
            state = replace(state, plane=_PLANES[code])
        elif code in ("G20", "G21"):
            state = replace(state, unit=INCH if code == "G20" else MILLIMETRE)
        elif code in ("G90", "G91"):
            state = replace(state, absolute=code == "G90")
        elif code in ("G90.1", "G91.1"):
            state = replace(state, absolute_centers=code == "G90.1")
        elif code in SYSTEMS:
            state = replace(state, system=code)
        elif code == "G53":
            machine = True
        elif code == "G43":
            state = replace(state, length=_tool_length(block, source, settings))
        elif code == "G49":
            state = replace(state, length=0.0)
        elif code == "G80":
            state = replace(state, motion="" if state.motion in CYCLES else state.motion)
        elif code not in (*_HARMLESS, "G28", "G30"):
            reason = _REASONS.get(code, "it is not known what it moves")
            raise refusal(
                source, block.number, f"{code} cannot be corrected: {reason}", fault="unsupported"
            )
    return state, machine, cycle or state.motion in CYCLES


def _tool_length(block: Block, source: str, settings: NcSettings) -> float:
    number = block.get("H")
    if number is None or int(number) not in settings.tool_lengths:
        which = "without H" if number is None else f"H{number:g}"
        raise refusal(
            source,
            block.number,
            f"G43 {which}: its length is needed, as the errors depend on where Z stands"
            " (--tool-length H=MM)",
            fault="undetermined",
            aspect="length",
        )
    return settings.tool_lengths[int(number)]


def _unknown(state: ModalState, axes: list[int]) -> ModalState:
    position = state.position.copy()
    position[axes] = np.nan
    return replace(state, position=position)


def _zero(state: ModalState, machine: bool, settings: NcSettings, refuse: Refuse) -> Vector:
    if machine:
        return np.zeros(3)
    if state.system not in settings.offsets:
        raise refuse(
            f"the position of the zero of {state.system} in machine coordinates is not given. Add"
            f" --offset {state.system}=X,Y,Z",
            "undetermined",
            "zero",
        )
    zero: Vector = np.array(settings.offsets[state.system]) + np.array([0.0, 0.0, state.length])
    return zero


def _end(block: Block, state: ModalState, zero: Vector, machine: bool) -> Vector:
    end: Vector = state.position.copy()
    for axis, letter in enumerate(AXES):
        value = block.get(letter)
        if value is None:
            continue
        if state.absolute or machine:
            end[axis] = zero[axis] + state.unit * value
        else:
            end[axis] += state.unit * value
    return end


def _motion(block: Block, state: ModalState, zero: Vector, end: Vector, refuse: Refuse) -> Motion:
    start, kind = state.position, MOTIONS[state.motion]
    if kind != RAPID and not (np.all(np.isfinite(start)) and np.all(np.isfinite(end))):
        missing = [AXES[axis] for axis in range(3) if not np.isfinite(start[axis] + end[axis])]
        raise refuse(
            f"where {' and '.join(missing)} stands when this feed move begins is not known; go"
            " there by G0 in absolute coordinates before, or say where the program begins"
            " (--start)",
            "undetermined",
            "start",
        )
    if kind != ARC:
        if block.has("IJKR"):
            raise refuse("I, J, K or R in a straight move", "mismatch", "straight")
        return Motion(kind, start, end)
    first, second, _ = state.plane
    clockwise = state.motion == "G2"
    radius = block.get("R")
    try:
        if radius is not None:
            if block.has("IJK"):
                raise Refusal("an arc has either R or I, J, K", fault="mismatch", aspect="R")
            arc = arc_by_radius(start, end, state.plane, state.unit * radius, clockwise)
        else:
            center = _center(block, state, zero)
            arc = arc_by_center(start, end, state.plane, center[[first, second]], clockwise)
    except Refusal as error:
        raise refuse(str(error), error.fault or "mismatch", error.aspect) from None
    return Motion(ARC, start, end, arc)


def _center(block: Block, state: ModalState, zero: Vector) -> Vector:
    names = "IJK"
    in_plane = state.plane[:2]
    told = [axis for axis in range(3) if block.get(names[axis]) is not None]
    if not told:
        raise Refusal("an arc needs I, J, K or R", fault="missing", aspect="centre")
    if any(axis not in in_plane for axis in told):
        raise Refusal(
            "I, J or K stands for an axis that is not in the arc's plane",
            fault="mismatch",
            aspect="plane",
        )
    if state.absolute_centers and len(told) < 2:
        raise Refusal(
            "with G90.1 an arc needs both coordinates of its center",
            fault="missing",
            aspect="centre",
        )
    center: Vector = (zero if state.absolute_centers else state.position).copy()
    for axis in told:
        center[axis] += state.unit * (block.get(names[axis]) or 0.0)
    return center
