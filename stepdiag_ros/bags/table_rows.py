"""The rows of a run table: CSV text to checked values. Refusals name the row and the reason."""

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.metrology.geometry import move_orders
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    DIAGONAL,
    FORWARD,
    LINE_NAMES,
    STEP_DIAGONAL,
)

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

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"\d{1,9}")
# What air in a workshop can be, and what a value outside of it is likely to have been meant as.
_PLAUSIBLE = {
    "air_temperature_degC": (-50.0, 100.0, "degrees Celsius; is it in kelvin?"),
    "air_pressure_Pa": (20e3, 130e3, "pascal; is it in hPa, mbar or kPa?"),
    "relative_humidity": (0.0, 1.0, "0 to 1; is it in per cent?"),
    "material_temperature_degC": (-50.0, 100.0, "degrees Celsius; is it in kelvin?"),
}


class Pass(NamedTuple):
    """Which pass along which line a row belongs to."""

    kind: str
    line: str
    order: str
    repeat: int
    direction: str

    def __str__(self) -> str:
        name = f"{self.line} {DIAGONAL if self.kind == DIAGONAL else self.order}".strip()
        return f"{name} {self.direction}, repeat {self.repeat}"


@dataclass(frozen=True)
class Row:
    """One row: one stop.

    Attributes:
        number: line of the file, the header being 1.
        time: s since the start of the run; NaN if unknown (imported lines).
        which: pass that it belongs to.
        stop: from 0 along the direction.
        position: commanded X Y Z, m.
        reading: m.
        environment: air and material; NaN where the cell is empty.
    """

    number: int
    time: float
    which: Pass
    stop: int
    position: tuple[float, float, float]
    reading: float
    environment: Environment


def refusal(source: str, row: int, reason: str) -> TableError:
    """Return the error that refuses a table because of one row."""
    return TableError(f"{source}, row {row}: {reason}")


def read_text(path: Path) -> str:
    """Return the text of a table, with or without a byte order mark.

    Raises:
        TableError: not there or no text.
    """
    try:
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise TableError(f"there is no table {path}") from None
    except UnicodeDecodeError:
        raise TableError(f"{path} is no text in UTF-8; save it as CSV (UTF-8)") from None
    except OSError as error:
        raise TableError(f"{path} cannot be read: {error.strerror}") from None


def parse_rows(text: str, source: str) -> list[Row]:
    """Return the checked rows of a run table.

    Args:
        text: the CSV with its header.
        source: what the user calls it; named in errors.

    Raises:
        TableError: a column is missing, a value is no number, not finite or implausible, a name is
            unknown, or time goes back; names the row.
    """
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = next(reader, None) or []
        places = _places(header, source)
        rows: list[Row] = []
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if any(cell.strip() for cell in cells[len(header) :]):
                raise refusal(
                    source,
                    reader.line_num,
                    f"it has {len(cells)} cells under {len(header)} columns; is there a decimal"
                    " comma?",
                )
            row = _row(_RowCells(cells, places, source, reader.line_num))
            if rows and row.time < rows[-1].time:
                raise refusal(
                    source,
                    row.number,
                    f"time goes back from {rows[-1].time:g} s to {row.time:g} s; "
                    "rows stand in the order of measurement",
                )
            rows.append(row)
    except csv.Error as error:
        raise refusal(source, reader.line_num, f"this is no CSV ({error})") from None
    if not rows:
        raise TableError(f"{source} has no rows; there is nothing measured in it")
    return rows


def _places(header: list[str], source: str) -> dict[str, int]:
    names = [name.strip() for name in header]
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        raise refusal(source, 1, "the columns are not separated by commas; save it with commas")
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        unknown = [name for name in names if name and name not in COLUMNS]
        hint = f"; there is an unknown column '{unknown[0]}'" if unknown else ""
        if missing[0] in ENVIRONMENT_COLUMNS:
            hint += "; its cells may be empty if it was not measured"
        raise refusal(source, 1, f"column '{missing[0]}' is missing{hint}")
    for name in COLUMNS:
        if names.count(name) > 1:
            raise refusal(source, 1, f"column '{name}' is there {names.count(name)} times")
    return {name: names.index(name) for name in COLUMNS}


class _RowCells:
    """The cells of one row, taken out by column with a check."""

    def __init__(self, cells: list[str], places: dict[str, int], source: str, number: int) -> None:
        self._cells, self._places = cells, places
        self._source, self.number = source, number
        if len(cells) <= max(places.values()):
            raise refusal(source, number, f"it has only {len(cells)} cells; is the table cut off?")

    def wrong(self, column: str, expected: str) -> TableError:
        return refusal(
            self._source,
            self.number,
            f"'{column}' is '{self.text(column)}'; expected {expected}",
        )

    def text(self, column: str) -> str:
        return self._cells[self._places[column]].strip()

    def number_of(self, column: str) -> float:
        text = self.text(column)
        if text.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            raise self.wrong(
                column, "a finite number; leave a stop without a value out, with its line"
            )
        if not _NUMBER.fullmatch(text):
            comma = " (with a point, not a comma)" if "," in text else ""
            raise self.wrong(column, f"a number{comma}")
        return float(text)

    def whole(self, column: str) -> int:
        if not _WHOLE.fullmatch(self.text(column)):
            raise self.wrong(column, "a whole number from 0")
        return int(self.text(column))

    def one_of(self, column: str, known: tuple[str, ...]) -> str:
        if self.text(column) not in known:
            raise self.wrong(column, "one of " + ", ".join(known))
        return self.text(column)

    def environment(self, column: str) -> float:
        if self.text(column).lower() in ("", "nan"):
            return float("nan")
        low, high, meaning = _PLAUSIBLE[column]
        value = self.number_of(column)
        if not low <= value <= high:
            raise self.wrong(column, meaning)
        return value


def _row(cells: _RowCells) -> Row:
    kind = cells.one_of("kind", tuple(LINE_NAMES))
    line = cells.one_of("line", LINE_NAMES[kind])
    order = ""
    if kind == STEP_DIAGONAL:
        order = cells.one_of("order", move_orders(line))
    elif cells.text("order"):
        raise cells.wrong("order", f"nothing for a line of kind {kind}")
    which = Pass(
        kind,
        line,
        order,
        cells.whole("repeat"),
        cells.one_of("direction", (FORWARD, BACKWARD)),
    )
    return Row(
        number=cells.number,
        time=cells.number_of("time_s"),
        which=which,
        stop=cells.whole("stop"),
        position=(cells.number_of("x_m"), cells.number_of("y_m"), cells.number_of("z_m")),
        reading=cells.number_of("reading_m"),
        environment=Environment(*(cells.environment(name) for name in ENVIRONMENT_COLUMNS)),
    )
