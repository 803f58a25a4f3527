"""From the rows of a run table to passes and setups; refuses what contradicts itself.

A pass is a group of rows that belong together (line, order, repeat, direction, and where the axes
stand that do not move). A setup is a group of consecutive passes that share alignment and zero:
those along the same line in the same order, or as a column ``setup`` or a case file says.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import isnan

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.table_rows import PassKey, TableRow, refusal, same_in_pass
from stepdiag_ros.metrology.geometry import AXES, Vector, beam_direction, line_signs, move_orders
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    FORWARD,
    LINE_NAMES,
    STEP_DIAGONAL,
    Line,
    Volume,
    alignment_of,
)

POSITION_TOLERANCE = 1.5e-6
"""m: positions printed with six decimals are off by up to half of one; so is the box's corner."""
READING_TOLERANCE = 0.01
"""Part of the line's length by which a reading may differ from the commanded displacement."""
LARGEST_STEP = 0.5
"""m: blocks that are larger are taken for a mistaken unit unless a case file states them."""
MOST_REPEATS = 1000


@dataclass(frozen=True)
class TableSetup:
    """Consecutive passes that share alignment and zero: their identity, and the passes in order."""

    identity: str
    lines: tuple[tuple[Line, tuple[TableRow, ...]], ...]


def passes_of(rows: list[TableRow], source: str) -> list[tuple[TableRow, ...]]:
    """Group rows into passes and check that the stops of each count from 0 without a gap.

    Raises:
        TableError: a stop is missing, out of order or there twice, or what holds for a whole pass
            changes within it; names the row.
    """
    passes = []
    for stops in _by_place(rows):
        same_in_pass(stops, source)
        which = stops[0].pass_words
        for expected, row in enumerate(stops):
            if row.stop == expected:
                continue
            if expected > 0 and row.stop == expected - 1:
                twice, aspect = f"stop {row.stop} of '{which}' is there twice", "stop"
                if _same(row, stops[expected - 1]):
                    twice, aspect = "the row is there twice", "row"
                raise refusal(source, row.number, twice, fault="twice", aspect=aspect)
            if row.stop == 0:
                raise refusal(
                    source,
                    row.number,
                    f"'{which}' begins again after {expected} stops; count its repeats, "
                    "or remove the duplicate rows",
                    fault="too_many",
                )
            if row.stop > expected:
                raise refusal(
                    source,
                    row.number,
                    f"stop {expected} of '{which}' is missing before stop {row.stop}",
                    fault="missing",
                )
            raise refusal(
                source,
                row.number,
                f"stop {row.stop} of '{which}' comes after stop {expected - 1}; stops count from 0 "
                "along the direction",
                fault="out_of_order",
            )
        passes.append(stops)
    return passes


def _by_place(rows: list[TableRow]) -> Iterator[tuple[TableRow, ...]]:
    """Yield the rows of each pass: a line that begins again at another place is another pass."""
    for (which, *_), group in groupby(
        rows, key=lambda row: (row.which, row.told.line_index, row.told.mirror_offset)
    ):
        standing = line_signs(which.line) == 0
        stops: list[TableRow] = []
        for row in group:
            if stops and row.stop == 0:
                away = np.abs(np.subtract(row.position, stops[0].position))[standing]
                if np.any(away > POSITION_TOLERANCE):
                    yield tuple(stops)
                    stops = []
            stops.append(row)
        yield tuple(stops)


def _same(row: TableRow, other: TableRow) -> bool:
    return (row.time, row.position, row.reading) == (other.time, other.position, other.reading)


def volume_of(passes: list[tuple[TableRow, ...]], source: str) -> Volume:
    """Find the measured box from the positions.

    Raises:
        TableError: they do not determine all of it, or it is so large that the unit must be
            mistaken.
    """
    # Step diagonals show the most of its stops, and all of the axes that they move.
    steps = [stops for stops in passes if stops[0].which.kind == STEP_DIAGONAL]
    counts: Counter[int] = Counter()
    for stops in steps or passes:
        counts[(len(stops) - 1) // max(len(stops[0].which.order), 1)] += 1
    stepped = np.zeros(3, dtype=bool)
    for stops in steps:
        stepped |= line_signs(stops[0].which.line) != 0
    low, high = np.full(3, np.nan), np.full(3, np.nan)
    for stops in passes:
        which = stops[0].which
        points = np.array([row.position for row in stops])
        moves = line_signs(which.line) != 0
        if which.kind != STEP_DIAGONAL:
            moves &= ~stepped
        low[moves] = np.fmin(low, points.min(axis=0))[moves]
        high[moves] = np.fmax(high, points.max(axis=0))[moves]
    blocks = counts.most_common(1)[0][0]
    if blocks < 1:
        raise refusal(
            source,
            passes[0][0].number,
            "the line has a single stop, so nothing moved",
            fault="too_few",
        )
    low, high = _with_standing_axis(low, high, stepped, passes[0][0])
    for axis, name in enumerate(AXES):
        if not high[axis] - low[axis] > 0:
            raise TableError(
                f"{source}: no line moves {name}, so the size of the measured box is not known; "
                "put a case.yaml with origin_m, step_m and blocks beside the table",
                fault="undetermined",
            )
    step = (high - low) / blocks
    if step.max() > LARGEST_STEP:
        raise refusal(
            source,
            passes[0][1].number,
            f"the blocks would be {step.max():g} m long; positions are in metres, these look like "
            "millimetres (if they are right, state step_m in a case.yaml beside the table)",
            fault="out_of_range",
        )
    return Volume(_rounded(low), _rounded(step), blocks)


def _with_standing_axis(
    low: Vector, high: Vector, stepped: NDArray[np.bool_], row: TableRow
) -> tuple[Vector, Vector]:
    """Return the box of a face's step diagonals with a third side, of an axis that never moved.

    A box has three sides, a machine with two axes a face: the third gets the shortest side of the
    other two. No line determines any of its errors.
    """
    never = np.isnan(low)
    if np.count_nonzero(stepped) != 2 or not np.array_equal(never, ~stepped):
        return low, high
    side = np.min((high - low)[stepped])
    place = np.asarray(row.position)
    return np.where(never, place, low), np.where(never, place + side, high)


def _rounded(values: Vector) -> tuple[float, float, float]:
    # To the picometre: takes the noise of binary fractions off numbers that were printed decimally.
    x, y, z = (round(float(value), 12) + 0.0 for value in values)
    return x, y, z


def setups_of(
    passes: list[tuple[TableRow, ...]],
    volume: Volume,
    source: str,
    one_alignment_per_diagonal: bool = False,
    planned: Sequence[Line] = (),
) -> list[TableSetup]:
    """Check every pass against the box and group the passes into setups.

    Args:
        passes: with their rows.
        volume: the measured box.
        source: of the table, for the text of an error.
        one_alignment_per_diagonal: as in ``Plan``, where no column states the setups.
        planned: lines of the plan, as far as it is known.

    Raises:
        TableError: positions or readings contradict what the row says; names the row.
    """

    def identity_of(entry: tuple[Line, tuple[TableRow, ...]]) -> str:
        line, stops = entry
        return stops[0].told.setup or alignment_of(line, one_alignment_per_diagonal)

    checked = []
    for stops in passes:
        line = _line_of(stops, volume, planned)
        _check_positions(line, stops, volume, source)
        checked.append((line, stops))
    setups: list[TableSetup] = []
    seen: Counter[str] = Counter()
    for identity, group in groupby(checked, key=identity_of):
        lines = tuple(group)
        _check_repeats(lines, source)
        for name in dict.fromkeys(line.name for line, _ in lines):
            _check_readings([entry for entry in lines if entry[0].name == name], volume, source)
        seen[identity] += 1
        told = lines[0][1][0].told.setup is not None
        again = "" if told or seen[identity] == 1 else f" #{seen[identity]}"
        setups.append(TableSetup(identity + again, lines))
    return setups


def _line_of(stops: tuple[TableRow, ...], volume: Volume, planned: Sequence[Line]) -> Line:
    which, told = stops[0].which, stops[0].told.mirror_offset
    places = np.array([row.position for row in stops])
    for line in planned:
        if told is not None and told != line.mirror_offset:
            continue
        if which == PassKey(line.kind, line.name, line.order, line.repeat, line.direction):
            expected = line.stops(volume)
            if len(expected) == len(places) and _equal(expected, places).all():
                return line
    start = stops[0] if which.direction == FORWARD else stops[-1]
    away = np.asarray(start.position) - np.asarray(volume.origin)
    away[line_signs(which.line) != 0] = 0.0
    away[np.abs(away) <= POSITION_TOLERANCE] = 0.0
    offset = _rounded(away)
    mirror = told or (0.0, 0.0, 0.0)
    return Line(
        which.kind,
        which.line,
        which.order,
        which.repeat,
        which.direction,
        offset,
        mirror_offset=mirror,
    )


def _check_positions(line: Line, stops: tuple[TableRow, ...], volume: Volume, source: str) -> None:
    expected = line.stops(volume)
    actual = np.array([row.position for row in stops])
    if len(expected) == len(actual) and _equal(expected, actual).all():
        return
    moved = _moved_like(line, actual, volume)
    if moved:
        raise refusal(
            source, stops[0].number, f"the row says '{line}', but {moved}", fault="mismatch"
        )
    for row, nominal in zip(stops, expected, strict=False):
        if not _equal(np.asarray(row.position), nominal).all():
            reason, aspect = _position_reason(row, line, nominal, volume)
            raise refusal(source, row.number, reason, fault="mismatch", aspect=aspect)
    if len(stops) < len(expected):
        raise refusal(
            source,
            stops[-1].number,
            f"'{line}' ends at stop {len(stops) - 1}; stop {len(stops)} to {len(expected) - 1} "
            "are missing",
            fault="too_few",
        )
    raise refusal(
        source,
        stops[len(expected)].number,
        f"'{line}' goes on behind its last stop {len(expected) - 1}",
        fault="too_many",
    )


def _equal(first: Vector, second: Vector) -> NDArray[np.bool_]:
    equal: NDArray[np.bool_] = np.abs(first - second) <= POSITION_TOLERANCE
    return equal


def _moved_like(line: Line, actual: Vector, volume: Volume) -> str:
    """Say what the positions are if they are those of another pass; an empty text if of none."""
    for direction in (FORWARD, BACKWARD):
        for name in LINE_NAMES[line.kind]:
            for order in move_orders(name) if line.kind == STEP_DIAGONAL else ("",):
                other = Line(line.kind, name, order, line.repeat, direction, line.offset)
                expected = other.stops(volume)
                if len(expected) != len(actual) or not _equal(expected, actual).all():
                    continue
                if (name, order) == (line.name, line.order):
                    return f"the positions run {direction}"
                return f"the positions are those of '{other}'"
    return ""


def _position_reason(row: TableRow, line: Line, nominal: Vector, volume: Volume) -> tuple[str, str]:
    """Return in words and by its aspect why a position is refused."""
    for axis, name in enumerate(AXES):
        value = row.position[axis]
        if abs(value - nominal[axis]) <= POSITION_TOLERANCE:
            continue
        place = (
            f"{name} is {value:g} m at stop {row.stop} of '{line}', expected {nominal[axis]:g} m"
        )
        away = volume.nodes(axis)
        nearest = float(away[np.argmin(np.abs(away - value))])
        if nominal[axis] and abs(value / nominal[axis] - 1000.0) < 1.0:
            return f"{place}; it is 1000 times too large: check the unit of the positions", "unit"
        if abs(value - nearest) > POSITION_TOLERANCE:
            return f"{place}; it is off the grid, whose nearest node is {nearest:g} m", "grid"
        return f"{place}; the position does not follow the line's name and order", "order"
    raise AssertionError("called for a position that is right")


def _check_repeats(lines: tuple[tuple[Line, tuple[TableRow, ...]], ...], source: str) -> None:
    seen: dict[tuple[Line, int | None], int] = {}
    for line, stops in lines:
        which = line, stops[0].told.line_index
        if line.repeat >= MOST_REPEATS:
            raise refusal(
                source, stops[0].number, f"'repeat' is {line.repeat}; repeats count from 0"
            )
        if which in seen:
            raise refusal(
                source,
                stops[0].number,
                f"'{line}' was measured already from row {seen[which]} on; count its repeats",
                fault="twice",
            )
        seen[which] = stops[0].number


def _check_readings(
    lines: Sequence[tuple[Line, tuple[TableRow, ...]]], volume: Volume, source: str
) -> None:
    first_line, _ = lines[0]
    step = np.asarray(volume.step)
    beam = beam_direction(first_line.name, step)
    length = float(np.linalg.norm(line_signs(first_line.name) * step) * volume.blocks)
    start = next((row for _, stops in lines for row in stops if not isnan(row.reading)), None)
    if start is None:
        return
    for line, stops in lines:
        for row in stops:
            nominal = float(beam @ (np.asarray(row.position) - np.asarray(start.position)))
            reading = row.reading - start.reading
            if abs(reading - nominal) > READING_TOLERANCE * length:
                reason, aspect = _reading_reason(line, row, nominal, reading)
                raise refusal(source, row.number, reason, fault="out_of_range", aspect=aspect)


def _reading_reason(line: Line, row: TableRow, nominal: float, reading: float) -> tuple[str, str]:
    """Return in words and by its aspect why a reading is refused."""
    place = (
        f"the reading has changed by {reading:g} m since the first stop of the setup at stop "
        f"{row.stop} of '{line}', where the positions have changed by {nominal:g} m along the beam"
    )
    ratio = reading / nominal if nominal else 0.0
    if abs(ratio + 1.0) < 0.05:
        return f"{place}; its sign is wrong ('sign: -1' in a mapping file turns all signs)", "sign"
    for factor, size in ((1000.0, "1000 times too large"), (0.001, "1000 times too small")):
        if abs(abs(ratio) / factor - 1.0) < 0.1:
            return f"{place}; it is {size}: check the unit of the readings", "unit"
    return (
        f"{place}; check the reading, the size of the blocks (step_m) and the order of the moves",
        "",
    )
