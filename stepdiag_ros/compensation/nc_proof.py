"""What remains of the errors when a program runs: the original and the rewritten one, executed.

Both texts are read again and run through the forward model of the machine: axes at q, tool at
q + e(q). The error of the original is what the tool is away from the programmed way, that of the
rewritten program what it is away from the place of the same part of the original's way, which is
never less than its distance from that way. The places that are looked at are not those by which
the program was divided.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan, sqrt

import numpy as np

from stepdiag_ros.compensation.nc_division import Division
from stepdiag_ros.compensation.nc_motion import RAPID, Motion
from stepdiag_ros.compensation.nc_reading import NcSettings, steps_of
from stepdiag_ros.compensation.nc_rewrite import Rewritten
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.target_correction import held_errors, place_of
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

POINTS = 13
"""Of every piece, beside the planes of nodes; none of them but the ends was used for dividing."""

_AT_ONCE = 100_000
_MOST_FOR_UNCERTAINTY = 2_000


@dataclass(frozen=True)
class Remaining:
    """The error along one kind of moves of a program.

    Attributes:
        largest: m; NaN without such moves.
        rms: over the length of the way, m (over the ends of rapid moves).
        line: of the original, where the largest is; 0 without such moves.
    """

    largest: float
    rms: float
    line: int


@dataclass(frozen=True)
class Proof:
    """Errors of both programs.

    Attributes:
        length: of all feed moves, m.
        before: along the feed moves of the original.
        after: along those of the rewritten program.
        rapid_before: at the ends of the rapid moves of the original, where these are known.
        rapid_after: the same of the rewritten program.
        moves: number of feed moves of the original.
        pieces: number of feed moves of the rewritten program.
        map_uncertainty: largest standard uncertainty of the map itself on the ways of feed moves,
            root of the sum of squares of its components, m; NaN if not known. The proof is one for
            the map; this is how well the map is known.
    """

    length: float
    before: Remaining
    after: Remaining
    rapid_before: Remaining
    rapid_after: Remaining
    moves: int
    pieces: int
    map_uncertainty: float


class _Ways:
    """Collects where the tool should be and where the axes are, to look at all at once."""

    def __init__(self) -> None:
        self._wanted: list[Vector] = []
        self._axes: list[Vector] = []
        self._weights: list[Vector] = []
        self._lines: list[Vector] = []

    def take(self, wanted: Vector, axes: Vector, weights: Vector, line: int) -> None:
        self._wanted.append(wanted)
        self._axes.append(axes)
        self._weights.append(weights)
        self._lines.append(np.full(len(weights), line))

    def before(self, error_map: VolumetricMap) -> Remaining:
        return self._remaining(lambda wanted, _: held_errors(error_map, wanted))

    def after(self, error_map: VolumetricMap) -> Remaining:
        return self._remaining(lambda wanted, axes: place_of(error_map, axes) - wanted)

    def map_uncertainty(self, error_map: VolumetricMap) -> float:
        if not self._lines:
            return nan
        wanted = np.concatenate(self._wanted)
        looked = error_map.nearest(wanted[:: max(1, len(wanted) // _MOST_FOR_UNCERTAINTY)])
        spread = error_map.standard_uncertainty_at(looked)
        if not np.all(np.isfinite(spread)):
            spread = error_map.uncertainty_limit_at(looked)
        return float(np.max(np.linalg.norm(spread, axis=1)))

    def _remaining(self, errors: Callable[[Vector, Vector], Vector]) -> Remaining:
        if not self._lines:
            return Remaining(nan, nan, 0)
        wanted, axes = np.concatenate(self._wanted), np.concatenate(self._axes)
        size = np.concatenate(
            [
                np.linalg.norm(errors(wanted[begin:][:_AT_ONCE], axes[begin:][:_AT_ONCE]), axis=1)
                for begin in range(0, len(wanted), _AT_ONCE)
            ]
        )
        weights = np.concatenate(self._weights)
        worst = int(np.argmax(size))
        total = float(np.sum(weights))
        rms = sqrt(float(np.sum(weights * size**2)) / total) if total > 0.0 else 0.0
        return Remaining(float(size[worst]), rms, int(np.concatenate(self._lines)[worst]))


def prove(
    original: str, rewritten: Rewritten, error_map: VolumetricMap, settings: NcSettings
) -> Proof:
    """Execute both programs on the modelled machine.

    Args:
        original: text.
        rewritten: the other program, and which of its lines stand for which of the original.
        error_map: the machine; beyond its box the errors of its edge hold.
        settings: what the programs do not state.

    Raises:
        NcError: a text cannot be followed.
        ValueError: the rewritten program does not have the moves that it says it has.
    """
    made = _moves_by_line(rewritten, settings)
    division = Division(error_map, nan)
    feeds, rapids = _Ways(), _Ways()
    length, moves, pieces = 0.0, 0, 0
    for step in steps_of(original, "the original", settings):
        line, motion = step.block.number, step.motion
        if motion is None or not motion.known:
            continue
        part = rewritten.parts.get(line)
        found = made.get(line, [])
        if part is None or len(found) != len(part) - 1:
            raise ValueError(f"line {line} of the original was not rewritten move by move")
        if motion.kind == RAPID:
            rapids.take(motion.end[None], found[-1].end[None], np.ones(1), line)
            continue
        moves, pieces, length = moves + 1, pieces + len(found), length + motion.length
        looked, weights = _places(motion, part, division)
        feeds.take(motion.at(looked), _executed(found, part, looked), weights, line)
    return Proof(
        length=length,
        before=feeds.before(error_map),
        after=feeds.after(error_map),
        rapid_before=rapids.before(error_map),
        rapid_after=rapids.after(error_map),
        moves=moves,
        pieces=pieces,
        map_uncertainty=feeds.map_uncertainty(error_map),
    )


def _executed(found: Sequence[Motion], part: Vector, looked: Vector) -> Vector:
    """Return where the axes are at parts of the original's way, m, shape (n, 3)."""
    piece = np.clip(np.searchsorted(part, looked, side="left") - 1, 0, len(part) - 2)
    axes = np.empty((len(looked), 3))
    for number in np.unique(piece):
        own = piece == number
        begin, end = part[number], part[number + 1]
        axes[own] = found[number].at((looked[own] - begin) / (end - begin))
    return axes


def _moves_by_line(rewritten: Rewritten, settings: NcSettings) -> dict[int, list[Motion]]:
    """Return the known moves of the rewritten program by the lines of the original."""
    owner = {}
    for line, (first, count) in enumerate(rewritten.lines, start=1):
        owner.update(dict.fromkeys(range(first, first + count), line))
    made: dict[int, list[Motion]] = {}
    for step in steps_of(rewritten.text, "the rewritten program", settings):
        if step.motion is not None and step.motion.known:
            made.setdefault(owner[step.block.number], []).append(step.motion)
    return made


def _places(motion: Motion, part: Vector, division: Division) -> tuple[Vector, Vector]:
    """Return parts of a way to look at, and the length that each stands for, m."""
    inner = (np.arange(POINTS) + 0.5) / POINTS
    points = (part[:-1, None] + inner * np.diff(part)[:, None]).ravel()
    looked = np.unique(np.concatenate([points, part, division.kinks(motion)]))
    weights = motion.length * np.gradient(looked) if len(looked) > 1 else np.zeros(len(looked))
    return looked, weights
