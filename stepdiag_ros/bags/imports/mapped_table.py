"""Reads any table of text with a mapping file that says what its columns mean (``mapping``)."""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stepdiag_ros.bags.case import Case
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports.axis_test import OVERRUN_UNDETERMINED, AxisRow, axis_name, axis_test
from stepdiag_ros.bags.imports.imported import Imported, ImportOptions
from stepdiag_ros.bags.imports.made import overrun_passed_over
from stepdiag_ros.bags.imports.mapping import (
    AIR_UNITS,
    AXIS,
    DELIMITERS,
    LINES,
    READINGS,
    TableMapping,
    mapping_of,
)
from stepdiag_ros.bags.imports.source import SourceFile, number_in, whole_in
from stepdiag_ros.bags.table_plan import planned_lines
from stepdiag_ros.bags.table_rows import (
    ENVIRONMENT_COLUMNS,
    UNCERTAINTY,
    PassColumns,
    PassKey,
    TableRow,
    implausible,
    refusal,
)
from stepdiag_ros.configuration import find, plan_from_text, read_text
from stepdiag_ros.metrology.geometry import Vector, beam_direction, line_signs, move_orders
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.plan import (
    DIAGONAL,
    FORWARD,
    LARGEST_OVERRUN,
    LINE_NAMES,
    LINEAR,
    Line,
    Volume,
    kind_of,
)
from stepdiag_ros.metrology.refusal import fields_of
from stepdiag_ros.metrology.units import NANOSECONDS
from stepdiag_ros.text.intake import parse_yaml

NAME = "table with a mapping file"
_LATEST = 4e9
"""s: what a time stamp of ROS can hold, about."""
_GOOD = 0
_OPTIONS = {
    "axis": (AXIS,),
    "box": (AXIS,),
    "standing": (AXIS,),
    "directions": (AXIS,),
    "plan": (READINGS,),
}
"""Option of the user → tables that it serves."""
_ROUNDING = 1e-9
_MOST_NAMED = 5
"""Columns without a use that are named."""
_DECIMAL = "'decimal: {sign}' under 'text' of the mapping file"


Place = tuple[float, float, float]
"""m from the first corner of the box, X Y Z."""


class _Cells(NamedTuple):
    """One row of data: its line in the file, and its cells by meaning."""

    row: int
    texts: dict[str, str]


def read(source: SourceFile, options: ImportOptions) -> Imported:
    """Read a table.

    Raises:
        TableError: mapping and table do not fit, or a cell is wrong; names file and row.
    """
    mapping, name = _mapping(options.mapping)
    text = source.text(options.encoding or mapping.encoding)
    rows = list(_rows(text.text, text.name, mapping))
    if not rows:
        raise TableError(f"{text.name} has no rows of data; check skip_rows in {name}")
    made = _made(text.name, rows, mapping, options)
    return replace(made, remarks=(*made.remarks, *_unused(text.text, text.name, mapping)))


def _made(
    source: str, rows: Sequence[_Cells], mapping: TableMapping, options: ImportOptions
) -> Imported:
    """Make what the rows of a table hold."""
    # Everything that the import was made with stays with it.
    further = {"mapping.yaml": mapping.text}
    facts = dict(mapping.facts)
    _refuse_idle_options(source, mapping.table, options)
    if math.isnan(options.overrun):
        options = replace(options, overrun=mapping.overrun)
    if mapping.table == AXIS:
        axis = axis_name(mapping.axis, options, source)
        if options.standing is None:
            options = replace(options, standing=mapping.standing)
        found = _axis_rows(source, rows, mapping)
        return axis_test(
            source, NAME, axis, found, options, mapping.environment, facts, (), further
        )
    if mapping.table == LINES:
        return _lines(source, rows, mapping, options.overrun, facts, further)
    return _stream(source, rows, mapping, options, facts, further)


def _refuse_idle_options(source: str, table: str, options: ImportOptions) -> None:
    """Refuse what the user states and this kind of table has no use for."""
    for name, serves in _OPTIONS.items():
        if getattr(options, name) and table not in serves:
            raise TableError(
                f"{source}: --{name} has no effect on a table of {table}. Leave it out",
                fault="mismatch",
                about=f"--{name}",
            )


def _unused(text: str, source: str, mapping: TableMapping) -> list[str]:
    """Return a sentence that names the columns which the mapping does not use, if there are any."""
    if not mapping.header:
        return []
    for number, cells in _split(text, source, mapping.delimiter):
        if number <= mapping.skip_rows or not any(cell.strip() for cell in cells):
            continue
        used = set(_places(source, number, cells, mapping).values())
        left = [
            f"'{cell.strip()}'"
            for place, cell in enumerate(cells)
            if place not in used and cell.strip() not in ("", *mapping.ignored)
        ]
        more = len(left) - _MOST_NAMED
        if not left:
            return []
        shown = ", ".join(left[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
        what = f"column {shown} is" if len(left) == 1 else f"columns {shown} are"
        return [f"{what} not used: the mapping does not name {'it' if len(left) == 1 else 'them'}"]
    return []


def _mapping(path: str) -> tuple[TableMapping, str]:
    try:
        found = find(path, "imports")
        text = read_text(found)
        return mapping_of(parse_yaml(text, str(found)), str(found), text), str(found)
    except ValueError as error:
        raise TableError(str(error), **fields_of(error)) from None


def _rows(text: str, source: str, mapping: TableMapping) -> Iterator[_Cells]:
    """Go through the rows of data; cells are taken by the columns' names or numbers."""
    places: dict[str, int] | None = None
    count = 0
    for number, cells in _split(text, source, mapping.delimiter):
        if number <= mapping.skip_rows or not any(cell.strip() for cell in cells):
            continue
        if mapping.end and cells[0].strip().startswith(mapping.end):
            return
        if places is None:
            places = _places(source, number, cells, mapping)
            count = len(cells)
            if mapping.header:
                continue
        # Programs leave empty cells at the ends of rows, and leave them out again.
        if any(cell.strip() for cell in cells[count:]):
            raise refusal(
                source,
                number,
                f"it has {len(cells)} cells, the first row has {count}; check for a decimal comma",
                fault="too_many",
            )
        if max(places.values()) >= len(cells):
            raise refusal(
                source,
                number,
                f"it has only {len(cells)} cells; the table may be cut off here. If other text"
                " follows the data, name it in 'end' of the mapping",
                fault="too_few",
            )
        yield _Cells(number, {name: cells[place].strip() for name, place in places.items()})


def _split(text: str, source: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    if delimiter == " ":
        for number, line in enumerate(io.StringIO(text, newline=None), start=1):
            yield number, line.split() or [""]
        return
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        for cells in reader:
            yield reader.line_num, cells or [""]
    except csv.Error as error:
        raise refusal(source, reader.line_num, f"this is not a table ({error})") from None


def _places(source: str, row: int, cells: Sequence[str], mapping: TableMapping) -> dict[str, int]:
    names = [cell.strip() for cell in cells]
    wanted = dict(mapping.columns)
    wanted.update({_run_key(place): run.column for place, run in enumerate(mapping.runs)})
    made: dict[str, int] = {}
    for meaning, column in wanted.items():
        if mapping.header and column in names:
            if names.count(column) > 1:
                raise refusal(
                    source,
                    row,
                    f"there are {names.count(column)} columns '{column}'; number it",
                    fault="ambiguous",
                )
            place = names.index(column)
        elif column.isdigit():
            place = int(column) - 1
        else:
            shown = ", ".join(f"'{name}'" for name in names[:12])
            raise refusal(
                source,
                row,
                f"there is no column '{column}', but {shown}{_separated(column, names, mapping)}",
                fault="not_found",
            )
        if place >= len(cells):
            raise refusal(source, row, f"there is no column {column}, only {len(cells)}")
        if place in made.values():
            raise refusal(source, row, f"the mapping uses column {column} twice")
        made[meaning] = place
    return made


def _separated(column: str, names: Sequence[str], mapping: TableMapping) -> str:
    """Say which sign separates the columns, if a column appears once the row is split by it."""
    for word, sign in DELIMITERS.items():
        if sign not in (" ", mapping.delimiter) and any(
            column in [part.strip(' "') for part in name.split(sign)] for name in names
        ):
            return (
                f". The columns seem to be separated by another sign: write 'delimiter: {word}'"
                " under 'text' of the mapping file"
            )
    return ""


def _run_key(place: int) -> str:
    return f"run column {place}"


class _Numbers:
    """Takes numbers in SI units out of the cells of one table."""

    def __init__(self, source: str, mapping: TableMapping) -> None:
        self._source, self._mapping = source, mapping

    def number(self, cells: _Cells, name: str, unit: str = "") -> float:
        """Return a number in SI units; raises ``TableError``."""
        what = f"'{self._mapping.columns.get(name, name)}'"
        if name.startswith("run column"):
            what = f"'{self._mapping.runs[int(name.split()[-1])].column}'"
        text = cells.texts[name]
        factor = self._mapping.units[unit or name]
        decimal = self._mapping.decimal
        return factor * number_in(text, self._source, cells.row, what, decimal, _DECIMAL)

    def time(self, cells: _Cells) -> float:
        """Return the time in s; NaN where no column states it."""
        return self.number(cells, "time") if "time" in cells.texts else float("nan")

    def known(self, cells: _Cells, name: str) -> float | None:
        """Return a size in SI units, NaN where the cell is empty, None without such a column."""
        if name not in cells.texts:
            return None
        value = self.number(cells, name) if cells.texts[name] else float("nan")
        if value < 0.0:
            raise refusal(self._source, cells.row, f"'{name}' is negative")
        if name == "uncertainty" and (expected := implausible(UNCERTAINTY, value)):
            reason = f"'{name}' is {value:g} m; expected {expected}"
            raise refusal(self._source, cells.row, reason, fault="out_of_range", column=name)
        return value

    def position(self, cells: _Cells, nominal: Vector) -> tuple[float, float, float]:
        """Return the position of the machine, m: the nominal one where no columns state it."""
        x, y, z = (
            self.number(cells, name) if name in cells.texts else float(value)
            for name, value in zip("xyz", nominal, strict=True)
        )
        return x, y, z

    def rejected(self, cells: _Cells) -> bool:
        """Say whether the stop of a row was rejected."""
        value = cells.texts.get("reading", cells.texts.get("deviation"))
        return self._mapping.rejected is not None and value == self._mapping.rejected

    def environment(self, cells: _Cells) -> Environment:
        """Return air and material: of the columns, else what held during the whole measurement."""
        values = [
            self._in_unit(cells, name, value)
            for name, value in zip(ENVIRONMENT_COLUMNS, self._mapping.environment, strict=True)
        ]
        return Environment(*values)

    def _in_unit(self, cells: _Cells, name: str, whole: float) -> float:
        if name not in cells.texts:
            return whole
        text = cells.texts[name]
        what = f"'{self._mapping.columns[name]}'"
        if not text:
            return float("nan")
        scale, added = self._mapping.air_units[name]
        told = number_in(text, self._source, cells.row, what, self._mapping.decimal, _DECIMAL)
        value = scale * told + added
        if expected := implausible(name, value):
            units = ", ".join(AIR_UNITS[name])
            raise refusal(
                self._source,
                cells.row,
                f"{what} is {text}; expected {expected} State the unit under 'units' of the"
                f" mapping, as '{name}: UNIT' with one of {units}",
                fault="out_of_range",
            )
        return value

    def told(self, cells: _Cells) -> PassColumns:
        """Return what columns state about the whole pass."""
        attempt = None
        if "attempt" in cells.texts:
            what = f"'{self._mapping.columns['attempt']}'"
            attempt = whole_in(cells.texts["attempt"], self._source, cells.row, what, 1)
        return PassColumns(
            attempt=attempt,
            setup=cells.texts.get("setup"),
            overrun=self.overrun(cells),
        )

    def overrun(self, cells: _Cells) -> float | None:
        """Return how far beyond its first stop a pass was begun, m; None without such a column."""
        told = self.known(cells, "overrun")
        if told is not None and told > LARGEST_OVERRUN:
            raise refusal(
                self._source,
                cells.row,
                f"'overrun' is {told:g} m; expected 0 to {LARGEST_OVERRUN:g} m. Check its unit",
                fault="out_of_range",
            )
        return told

    def run(self, cells: _Cells) -> int:
        """Return the number of the run; 1 where no column states it."""
        if "run" not in cells.texts:
            return 1
        what = f"'{self._mapping.columns['run']}'"
        return whole_in(cells.texts["run"], self._source, cells.row, what)

    def direction(self, cells: _Cells) -> str:
        """Return the direction that a column or the mapping states; empty where neither does."""
        if "direction" not in cells.texts:
            return self._mapping.direction
        word = cells.texts["direction"]
        found = self._mapping.words.get(word.lower(), "")
        if not found:
            known = ", ".join(f"'{one}'" for one in self._mapping.words)
            raise refusal(
                self._source,
                cells.row,
                f"the direction is '{word}'; the mapping knows {known}. State what it means under"
                f" 'directions' of the mapping, as 'forward: \"{word}\"'",
                fault="unknown",
            )
        return found


def _axis_rows(source: str, rows: Sequence[_Cells], mapping: TableMapping) -> list[AxisRow]:
    numbers = _Numbers(source, mapping)
    made = []
    if mapping.runs:
        for place, run in enumerate(mapping.runs):
            for cells in rows:
                deviation = mapping.sign * numbers.number(cells, _run_key(place), "deviation")
                target = numbers.number(cells, "target")
                made.append(AxisRow(cells.row, run.run, target, deviation, run.direction))
        return made
    for cells in rows:
        target = numbers.number(cells, "target")
        if "deviation" in cells.texts:
            deviation = mapping.sign * numbers.number(cells, "deviation")
        else:
            deviation = mapping.sign * numbers.number(cells, "position") - target
        made.append(
            AxisRow(
                cells.row,
                numbers.run(cells),
                target,
                deviation,
                numbers.direction(cells),
                numbers.time(cells),
            )
        )
    return made


def _lines(
    source: str,
    rows: Sequence[_Cells],
    mapping: TableMapping,
    overrun: float,
    facts: dict[str, str],
    further: dict[str, str],
) -> Imported:
    volume = mapping.volume
    assert volume is not None, "a mapping of lines has a volume"
    told = list(_stops(source, rows, mapping, volume))
    begun = {"overrun_m": overrun} if math.isfinite(overrun) else {}
    course = {**mapping.plan, **begun}
    case = Case(
        chain=mapping.chain,
        rotations=mapping.rotations,
        volume=volume,
        plan=course,
        facts=facts,
        source="the mapping file",
    )
    of_steps = mapping.step_overrun
    if math.isnan(of_steps) and overrun == 0.0:
        # An overrun of the lines along an axis says nothing of steps; that there is none, does.
        of_steps = 0.0
    found = planned_lines(f"imported from {source}", told, case, overrun, source, of_steps)
    untold = math.isnan(overrun) and any(math.isnan(line.overrun) for line in found.lines)
    return Imported(
        format=NAME,
        volume=volume,
        plan_text=found.text,
        lines=found.lines,
        machine_text=case.machine_text("the mapping file") if case.tells_of_the_machine else "",
        facts=facts,
        remarks=(
            *((OVERRUN_UNDETERMINED,) if untold else ()),
            *_taken_at_the_corner(told, mapping),
            *overrun_passed_over(overrun, found.lines),
        ),
        chain=mapping.chain,
        further=further,
    )


def _taken_at_the_corner(stops: Sequence[TableRow], mapping: TableMapping) -> tuple[str, ...]:
    """Say which lines along an axis are taken to be at the first corner, as nothing says where."""
    assert mapping.volume is not None
    corner = mapping.volume.origin
    here = {
        row.which.line
        for row in stops
        if row.which.kind == LINEAR
        and not np.any(np.subtract(row.position, corner)[line_signs(row.which.line) == 0])
    }
    if not here or "x" in mapping.columns or "lines" in mapping.plan:
        return ()
    lines = f"line {min(here)}" if len(here) == 1 else f"lines {', '.join(sorted(here))}"
    return (
        f"{lines}: the table does not state the place, so the first corner of the box is taken."
        " Name a line at another place by its distance from that corner in m, such as"
        " z@0,0.29,0, or add columns for x, y and z",
    )


def _without_order(which: PassKey) -> str:
    """Say what makes a step diagonal of a diagonal that was read as one move from end to end."""
    if which.kind != DIAGONAL:
        return ""
    return (
        ". Without 'order' a diagonal has a stop after each block; a step diagonal has one after"
        " each move, and needs 'order', such as 'order: XYZ', in the mapping"
    )


def _stops(
    source: str, rows: Sequence[_Cells], mapping: TableMapping, volume: Volume
) -> Iterator[TableRow]:
    """Make the rows of a run table: where the machine stood follows from line and stop."""
    numbers = _Numbers(source, mapping)
    repeats: dict[tuple[object, ...], dict[int, int]] = {}
    before: tuple[PassKey, Place] | None = None
    stop, last_time = 0, float("nan")
    for cells in rows:
        name, order, place = _line_order_and_place(source, cells, mapping, volume)
        direction = numbers.direction(cells) or FORWARD
        counted = repeats.setdefault((name, order, direction, place), {})
        repeat = counted.setdefault(numbers.run(cells), len(counted))
        which = PassKey(kind_of(name, order), name, order, repeat, direction)
        stop = stop + 1 if (which, place) == before else 0
        before = which, place
        if "stop" in cells.texts:
            what = f"'{mapping.columns['stop']}'"
            stop = whole_in(cells.texts["stop"], source, cells.row, what)
        positions = Line(which.kind, name, order, repeat, direction, offset=place).stops(volume)
        if stop >= len(positions):
            raise refusal(
                source,
                cells.row,
                f"'{which}' has no stop {stop}: it has {len(positions)} in the volume of the"
                f" mapping, counted from 0{_without_order(which)}",
                fault="out_of_range",
            )
        time = numbers.time(cells)
        if time < last_time:
            raise refusal(source, cells.row, f"time goes back from {last_time:g} s to {time:g} s")
        last_time = time
        x, y, z = numbers.position(cells, positions[stop])
        start = positions[0 if direction == FORWARD else -1]
        along = beam_direction(name, np.asarray(volume.step))
        reading = _reading(source, cells, mapping, float((positions[stop] - start) @ along))
        yield TableRow(
            number=cells.row,
            time=time,
            which=which,
            stop=stop,
            position=(x, y, z),
            reading=reading,
            environment=numbers.environment(cells),
            told=numbers.told(cells),
            standard_uncertainty=numbers.known(cells, "uncertainty"),
            run=numbers.run(cells) if "run" in cells.texts else None,
        )


def _reading(source: str, cells: _Cells, mapping: TableMapping, nominal: float) -> float:
    """Return the reading at a stop, m; NaN where it was rejected."""
    numbers = _Numbers(source, mapping)
    if numbers.rejected(cells):
        return math.nan
    if cells.texts.get("reading") == "" and mapping.rejected:
        raise refusal(
            source,
            cells.row,
            f"'{mapping.columns['reading']}' is empty; write '{mapping.rejected}' at a stop that"
            " was not read",
            fault="missing",
        )
    if "reading" in cells.texts:
        return mapping.sign * numbers.number(cells, "reading")
    return nominal + mapping.sign * numbers.number(cells, "deviation")


def _line_order_and_place(
    source: str, cells: _Cells, mapping: TableMapping, volume: Volume
) -> tuple[str, str, Place]:
    known = {name for names in LINE_NAMES.values() for name in names}
    name, _, place = cells.texts.get("line", mapping.line).lower().partition("@")
    if name not in known:
        raise refusal(
            source,
            cells.row,
            f"the line is '{name}'; expected one of {', '.join(sorted(known))}",
            fault="unknown",
        )
    order = cells.texts.get("order", mapping.order).upper()
    if order and len(name) > 1 and order not in move_orders(name):
        raise refusal(
            source,
            cells.row,
            f"the order of {name} is '{order}'; expected one of {', '.join(move_orders(name))}",
        )
    if len(name) == 1 and order and "order" in cells.texts:
        raise refusal(source, cells.row, f"a line along one axis ({name}) has no order '{order}'")
    return name, "" if len(name) == 1 else order, _place(source, cells, name, place, volume)


def _place(source: str, cells: _Cells, line: str, text: str, volume: Volume) -> Place:
    """Return how far from the first corner a line lies, m, as plans name it: ``z@0,0.29,0``."""
    if not text:
        return (0.0, 0.0, 0.0)
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = math.nan
    side = np.asarray(volume.step) * volume.blocks * (line_signs(line) == 0)
    if not np.all(np.abs([x, y, z]) <= side * (1.0 + _ROUNDING)):
        raise refusal(
            source,
            cells.row,
            f"the line is '{line}@{text}'; expected behind @ its distance from the first corner of"
            " the box along X,Y,Z in m, such as z@0,0.29,0: 0 along the axes that it moves, and a"
            " place in the box along the others",
            fault="malformed",
        )
    return (x, y, z)


def _stream(
    source: str,
    rows: Sequence[_Cells],
    mapping: TableMapping,
    options: ImportOptions,
    facts: dict[str, str],
    further: dict[str, str],
) -> Imported:
    if not options.plan:
        raise TableError(
            f"{source}: a stream of readings needs the plan of its measurement: --plan FILE",
            fault="missing",
        )
    try:
        plan = plan_from_text(options.plan, "the plan")
    except ValueError as error:
        raise TableError(str(error)) from None
    numbers = _Numbers(source, mapping)
    unknown = float("nan")
    readings: list[Reading] = []
    for sequence, cells in enumerate(rows):
        seconds = numbers.time(cells)
        if not 0.0 <= seconds <= _LATEST:
            raise refusal(
                source,
                cells.row,
                f"the time is {seconds:g} s, expected 0 to 4e9 s",
                fault="out_of_range",
            )
        time = round(seconds * NANOSECONDS)
        if readings and time <= readings[-1].time:
            raise refusal(
                source,
                cells.row,
                f"time does not advance: {seconds:.9g} s follows {readings[-1].time / 1e9:.9g} s",
                fault="out_of_order",
            )
        value = mapping.sign * numbers.number(cells, "reading")
        readings.append(
            Reading(
                time=time,
                sequence=sequence,
                raw_displacement=unknown if mapping.compensated else value,
                compensated_displacement=value if mapping.compensated else unknown,
                signal_strength=unknown,
                status=_GOOD,
                environment=mapping.environment,
            )
        )
    return Imported(
        format=NAME,
        volume=plan.volume,
        plan_text=options.plan,
        readings=tuple(readings),
        facts=facts,
        further=further,
    )
