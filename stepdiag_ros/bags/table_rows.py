"""The rows of a run table: CSV text to checked values. Refusals name the row and the reason."""

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import NamedTuple

from stepdiag_ros.bags.csv_cells import unguarded
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.metrology.geometry import AXES, move_orders
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.plan import BACKWARD, DIAGONAL, FORWARD, LINE_NAMES, STEP_DIAGONAL
from stepdiag_ros.metrology.refusal import Fault
from stepdiag_ros.metrology.spelling import nearest, suggestion

ENVIRONMENT_COLUMNS = (
    "air_temperature_degC",
    "air_pressure_Pa",
    "relative_humidity",
    "material_temperature_degC",
)
COLUMNS = (
    "time_s",
    "kind",
    "line",
    "order",
    "repeat",
    "direction",
    "stop",
    "x_m",
    "y_m",
    "z_m",
    "reading_m",
    *ENVIRONMENT_COLUMNS,
)
"""Of a run table, in this order."""
SETTLED = ("true", "false")
OPTIONAL_COLUMNS = (
    "line_index",
    "attempt",
    "setup",
    "overrun_m",
    "mirror_offset_m",
    "standard_uncertainty_m",
    "settled",
)
"""Optional columns of a run table; each is explained in docs/import.md."""

_MISSPELT = 0.75
"""Likeness from which on a column's name is taken for a known one with a typing error; a column of
remarks may stay."""
_LONGEST_REASON = 600
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"\d{1,9}")
# What air in a workshop can be, and what a value outside of it is likely to have been meant as.
UNCERTAINTY = "standard_uncertainty_m"
_PLAUSIBLE = {
    "air_temperature_degC": (-50.0, 100.0, "degrees Celsius; is it in kelvin?"),
    "air_pressure_Pa": (20e3, 130e3, "pascal; is it in hPa, mbar or kPa?"),
    "relative_humidity": (0.0, 1.0, "0 to 1; is it in per cent?"),
    "material_temperature_degC": (-50.0, 100.0, "degrees Celsius; is it in kelvin?"),
    UNCERTAINTY: (0.0, 1e-3, "at most 0.001 m; is it in µm, or is the cell cut off?"),
}


def implausible(column: str, value: float) -> str:
    """Return what a column should hold; empty if the value can be that, or is not known."""
    low, high, expected = _PLAUSIBLE[column]
    return expected if value < low or value > high else ""


class PassKey(NamedTuple):
    """Which pass along which line a row belongs to."""

    kind: str
    line: str
    order: str
    repeat: int
    direction: str

    def __str__(self) -> str:
        name = f"{self.line} {DIAGONAL if self.kind == DIAGONAL else self.order}".strip()
        return f"{name} {self.direction}, repeat {self.repeat}"


class PassColumns(NamedTuple):
    """What optional columns state about a pass; None where the table has no such column.

    Attributes:
        line_index: place of the pass in the plan, from 0.
        attempt: at this pass, from 1.
        setup: identity of the alignment and zero.
        overrun: how far beyond its first stop the pass was begun, m; NaN if unknown.
        mirror_offset: of the mirror from its usual place on the tool, m.
    """

    line_index: int | None = None
    attempt: int | None = None
    setup: str | None = None
    overrun: float | None = None
    mirror_offset: tuple[float, float, float] | None = None


NOTHING_TOLD = PassColumns()


@dataclass(frozen=True)
class TableRow:
    """One row: one stop.

    Attributes:
        number: line of the file, the header being 1.
        time: s since the start of the run; NaN if unknown.
        which: pass that it belongs to.
        stop: from 0 along the direction.
        position: commanded X Y Z, m.
        reading: m; NaN where the stop was rejected.
        environment: air and material; NaN where the cell is empty.
        told: what optional columns state about the pass.
        standard_uncertainty: of the reading, m; NaN if unknown, None without a column for it.
        run: number of the pass in the file, where it counts otherwise than ``which``; else None.
    """

    number: int
    time: float
    which: PassKey
    stop: int
    position: tuple[float, float, float]
    reading: float
    environment: Environment
    told: PassColumns = NOTHING_TOLD
    standard_uncertainty: float | None = None
    run: int | None = None

    @property
    def pass_words(self) -> str:
        """Return the pass as the file names it."""
        if self.run is None:
            return str(self.which)
        return f"{str(self.which).partition(',')[0]}, run {self.run}"


def refusal(
    source: str,
    row: int,
    reason: str,
    fault: Fault | None = None,
    column: str = "",
    aspect: str = "",
) -> TableError:
    """Return the error that refuses a table because of one row, in one line and not without end.

    A cell in quotes may hold line breaks, and so may a message about it.
    """
    sentence = " ".join(reason.splitlines())
    if len(sentence) > _LONGEST_REASON:
        sentence = f"{sentence[:_LONGEST_REASON]}…"
    return TableError(
        f"{source}, row {row}: {sentence}",
        fault=fault,
        about=column,
        where=source,
        row=row,
        aspect=aspect,
    )


def read_text(path: Path) -> str:
    """Return the text of a table, with or without a byte order mark.

    Raises:
        TableError: not there or no text, or a YAML file by its name.
    """
    if path.suffix.lower() in (".yaml", ".yml"):
        raise TableError(
            f"{path} is a YAML file, not a measurement: give a bag (.mcap) or a run table (.csv)",
            fault="wrong_kind",
            aspect="YAML",
        )
    try:
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise TableError(f"there is no table {path}", fault="not_found") from None
    except UnicodeDecodeError:
        raise TableError(
            f"{path} is not text in UTF-8; save it as CSV (UTF-8)",
            fault="wrong_kind",
            aspect="text",
        ) from None
    except OSError as error:
        raise TableError(f"{path} cannot be read: {error.strerror}") from None


def parse_rows(text: str, source: str) -> list[TableRow]:
    """Return the checked rows of a run table.

    Args:
        text: the CSV with its header.
        source: what the user calls it; named in errors.

    Raises:
        TableError: a column is missing or its name misspelt, a value is not a number, not finite or
            implausible, a name is unknown, or time goes back; names the row.
    """
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = next(reader, None) or []
        places = _places(header, source)
        rows: list[TableRow] = []
        latest = float("-inf")
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if any(cell.strip() for cell in cells[len(header) :]):
                raise refusal(
                    source,
                    reader.line_num,
                    f"it has {len(cells)} cells under {len(header)} columns; check for a decimal"
                    " comma",
                    fault="too_many",
                )
            row = _row(_RowCells(cells, places, source, reader.line_num))
            if row.time < latest:
                raise refusal(
                    source,
                    row.number,
                    f"time goes back from {latest:g} s to {row.time:g} s; "
                    "rows stand in the order of measurement",
                    fault="out_of_order",
                )
            latest = latest if isnan(row.time) else row.time
            rows.append(row)
    except csv.Error as error:
        raise refusal(
            source,
            reader.line_num,
            f"this is not CSV ({error})",
            fault="malformed",
            aspect="quoting",
        ) from None
    if not rows:
        raise TableError(
            f"{source} has no rows, so it contains no measurement", fault="too_few", aspect="row"
        )
    return rows


def _places(header: list[str], source: str) -> dict[str, int]:
    names = [name.strip() for name in header]
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        raise refusal(
            source,
            1,
            "the columns are not separated by commas; save it with commas",
            fault="wrong_kind",
            aspect="delimiter",
        )
    known = (*COLUMNS, *OPTIONAL_COLUMNS)
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        unknown = [name for name in names if name and name not in known]
        near = nearest(missing[0], unknown)
        hint = f"; there is an unknown column '{near or unknown[0]}'" if unknown else ""
        hint += f": {suggestion(missing[0])}" if near else ""
        if unknown and len(missing) > 1:
            hint += "; a table with columns of its own needs a mapping file (--mapping)"
        if missing[0] in ENVIRONMENT_COLUMNS:
            hint += "; its cells may be empty if it was not measured"
        raise refusal(source, 1, f"column '{missing[0]}' is missing{hint}", fault="missing")
    for name in names:
        if name in known and names.count(name) > 1:
            raise refusal(
                source, 1, f"column '{name}' is there {names.count(name)} times", fault="twice"
            )
        near = nearest(name, known, _MISSPELT)
        if name not in known and near:
            raise refusal(
                source, 1, f"unknown column '{name}'; {suggestion(near)}", fault="unknown"
            )
    return {name: names.index(name) for name in known if name in names}


class _RowCells:
    """The cells of one row, taken out by column with a check."""

    def __init__(self, cells: list[str], places: dict[str, int], source: str, number: int) -> None:
        self._cells, self._places = cells, places
        self._source, self.number = source, number
        if len(cells) <= max(places.values()):
            raise refusal(
                source,
                number,
                f"it has only {len(cells)} cells; the table may be cut off",
                fault="too_few",
            )

    def wrong(self, column: str, expected: str, fault: Fault) -> TableError:
        return refusal(
            self._source,
            self.number,
            f"'{column}' is '{self.text(column)}'; expected {expected}",
            fault,
            column,
        )

    def has(self, column: str) -> bool:
        return column in self._places

    def text(self, column: str) -> str:
        return unguarded(self._cells[self._places[column]].strip())

    def number_or_unknown(self, column: str) -> float:
        """Return a number; NaN where the cell is empty."""
        return self.number_of(column) if self.text(column) else float("nan")

    def size(self, column: str) -> float | None:
        """Return a number from 0, NaN where the cell is empty, None without such a column."""
        if not self.has(column):
            return None
        value = self.number_or_unknown(column)
        if value < 0.0:
            raise self.wrong(
                column,
                "a number from 0, or an empty cell where it is not known",
                fault="out_of_range",
            )
        if column == UNCERTAINTY and (expected := implausible(column, value)):
            raise self.wrong(column, expected, fault="out_of_range")
        return value

    def number_of(self, column: str) -> float:
        text = self.text(column)
        if text.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            raise self.wrong(
                column,
                "a finite number; leave a stop without a value out, with its line",
                fault="out_of_range",
            )
        if not _NUMBER.fullmatch(text):
            comma = " (with a point, not a comma)" if "," in text else ""
            raise self.wrong(column, f"a number{comma}", fault="malformed")
        return float(text)

    def place(self, column: str) -> tuple[float, float, float] | None:
        """Return X Y Z; None without such a column."""
        if not self.has(column):
            return None
        texts = self.text(column).split()
        if len(texts) != len(AXES) or not all(_NUMBER.fullmatch(text) for text in texts):
            raise self.wrong(column, "X Y Z, three numbers with spaces between", fault="malformed")
        x, y, z = (float(text) for text in texts)
        return x, y, z

    def whole(self, column: str) -> int:
        if not _WHOLE.fullmatch(self.text(column)):
            raise self.wrong(column, "a whole number from 0", fault="malformed")
        return int(self.text(column))

    def one_of(self, column: str, known: tuple[str, ...]) -> str:
        if self.text(column) not in known:
            raise self.wrong(column, "one of " + ", ".join(known), fault="unknown")
        return self.text(column)

    def environment(self, column: str) -> float:
        if self.text(column).lower() in ("", "nan"):
            return float("nan")
        value = self.number_of(column)
        if expected := implausible(column, value):
            raise self.wrong(column, expected, fault="out_of_range")
        return value


def _row(cells: _RowCells) -> TableRow:
    kind = cells.one_of("kind", tuple(LINE_NAMES))
    line = cells.one_of("line", LINE_NAMES[kind])
    order = ""
    if kind == STEP_DIAGONAL:
        order = cells.one_of("order", move_orders(line))
    elif cells.text("order"):
        raise cells.wrong("order", f"nothing for a line of kind {kind}", fault="mismatch")
    which = PassKey(
        kind,
        line,
        order,
        cells.whole("repeat"),
        cells.one_of("direction", (FORWARD, BACKWARD)),
    )
    return TableRow(
        number=cells.number,
        time=cells.number_or_unknown("time_s"),
        which=which,
        stop=cells.whole("stop"),
        position=(cells.number_of("x_m"), cells.number_of("y_m"), cells.number_of("z_m")),
        reading=_reading(cells),
        environment=Environment(*(cells.environment(name) for name in ENVIRONMENT_COLUMNS)),
        told=_told(cells),
        standard_uncertainty=cells.size(UNCERTAINTY),
    )


def _reading(cells: _RowCells) -> float:
    settled = not cells.has("settled") or cells.one_of("settled", SETTLED) == SETTLED[0]
    if settled:
        return cells.number_of("reading_m")
    if cells.text("reading_m"):
        raise cells.wrong(
            "reading_m",
            "an empty cell: 'settled' says that the stop was rejected",
            fault="mismatch",
        )
    return float("nan")


def _told(cells: _RowCells) -> PassColumns:
    if cells.has("setup") and not cells.text("setup"):
        raise cells.wrong(
            "setup", "the name of the alignment that the pass was measured in", fault="missing"
        )
    attempt = cells.whole("attempt") if cells.has("attempt") else None
    if attempt == 0:
        raise cells.wrong("attempt", "a whole number from 1", fault="out_of_range")
    return PassColumns(
        line_index=cells.whole("line_index") if cells.has("line_index") else None,
        attempt=attempt,
        setup=cells.text("setup") if cells.has("setup") else None,
        overrun=cells.size("overrun_m"),
        mirror_offset=cells.place("mirror_offset_m"),
    )


def same_in_pass(stops: Sequence[TableRow], source: str) -> None:
    """Check that the rows of one pass agree in what they state about the whole pass.

    Raises:
        TableError: an optional column changes within the pass, or only some rows have a time.
    """
    first = stops[0]
    for row in stops:
        for name, value, expected in zip(PassColumns._fields, row.told, first.told, strict=True):
            if repr(value) != repr(expected):
                raise refusal(
                    source,
                    row.number,
                    f"'{name}' changes within '{row.which}' from {expected} to {value}; it holds"
                    " for a whole pass",
                    fault="mismatch",
                )
    known = [row for row in stops if not isnan(row.time)]
    if known and len(known) < len(stops):
        row = next(row for row in stops if isnan(row.time))
        raise refusal(
            source,
            row.number,
            "'time_s' is ''; expected a number, since other stops of the pass have one",
            fault="malformed",
            column="time_s",
        )
