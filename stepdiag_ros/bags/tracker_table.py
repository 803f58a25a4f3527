"""The table of a tracker's places and readings: CSV with a header, SI units, in order of time.

Columns: ``station`` (any name), ``line`` (locate, grid, x, y, z, xy, xz, yz, xyz), ``run`` (from
1), ``direction`` (forward or backward), ``stop`` (from 0 at the forward start), ``x_m``, ``y_m``,
``z_m`` (commanded), ``length_change_m`` (since the station's counter was zeroed), and, if known,
``standard_uncertainty_m``. In a plan the length changes are empty.
"""

import csv
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path

from stepdiag_ros.bags.csv_cells import csv_text, guarded, unguarded
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.table_rows import UNCERTAINTY, implausible, read_text, refusal
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD
from stepdiag_ros.metrology.refusal import Fault
from stepdiag_ros.metrology.tracker.readings import NAMES, TrackerReading

REQUIRED = (
    "station",
    "line",
    "run",
    "direction",
    "stop",
    "x_m",
    "y_m",
    "z_m",
    "length_change_m",
)
OPTIONAL = ("standard_uncertainty_m",)
COLUMNS = (*REQUIRED, *OPTIONAL)

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"\d{1,9}")
_LONGEST = 1000.0


def read_table(path: Path, *, planned: bool = False) -> tuple[TrackerReading, ...]:
    """Return the readings of a table.

    Args:
        path: the CSV.
        planned: length changes may be missing, as in a plan.

    Raises:
        TableError: the table cannot be read, or a cell is wrong; names the row and the column.
    """
    return parse_table(read_text(path), str(path), planned=planned)


def parse_table(text: str, source: str, *, planned: bool = False) -> tuple[TrackerReading, ...]:
    """Return the readings in a text; see ``read_table``.

    Raises:
        TableError: a column is missing or unknown, a cell is wrong, a reading is there twice, or
            there is no row; names the row and the column.
    """
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    readings: list[TrackerReading] = []
    seen: dict[tuple[object, ...], int] = {}
    try:
        header = [name.strip() for name in next(reader, None) or []]
        _check_header(header, source)
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) != len(header):
                hint = "; is there a decimal comma?" if len(cells) > len(header) else ""
                raise refusal(
                    source,
                    reader.line_num,
                    f"it has {len(cells)} cells under {len(header)} columns{hint}",
                    fault="malformed",
                    aspect="cell",
                )
            row = dict(zip(header, (unguarded(cell.strip()) for cell in cells), strict=True))
            reading = _reading(_Row(row, source, reader.line_num), planned)
            key = (reading.station, reading.line, reading.run, reading.direction, reading.stop)
            if key in seen:
                raise refusal(
                    source,
                    reader.line_num,
                    f"{reading} of station {reading.station} is there already in row {seen[key]}",
                    fault="twice",
                    aspect="reading",
                )
            seen[key] = reader.line_num
            readings.append(reading)
    except csv.Error as error:
        raise refusal(
            source,
            reader.line_num,
            f"this is not CSV ({error})",
            fault="malformed",
            aspect="quoting",
        ) from None
    if not readings:
        raise TableError(f"{source} has no rows", fault="too_few")
    return tuple(readings)


def table_text(readings: Sequence[TrackerReading]) -> str:
    """Return readings as the text of a table, every number with all its digits."""
    rows = (
        (
            guarded(reading.station),
            reading.line,
            reading.run,
            reading.direction,
            reading.stop,
            *map(repr, reading.position),
            _text(reading.change),
            _text(reading.uncertainty),
        )
        for reading in readings
    )
    return csv_text([COLUMNS, *rows])


def _text(value: float) -> str:
    return repr(value) if math.isfinite(value) else ""


def _check_header(header: list[str], source: str) -> None:
    if len(header) == 1 and (";" in header[0] or "\t" in header[0]):
        raise refusal(
            source,
            1,
            "the columns are not separated by commas; save it with commas",
            fault="wrong_kind",
            aspect="delimiter",
        )
    for name in REQUIRED:
        if name not in header:
            unknown = [other for other in header if other and other not in COLUMNS]
            hint = f"; there is an unknown column '{unknown[0]}'" if unknown else ""
            raise refusal(source, 1, f"column '{name}' is missing{hint}", fault="missing")
    for name in header:
        if name not in COLUMNS:
            raise refusal(
                source,
                1,
                f"unknown column '{name}'; known are {', '.join(COLUMNS)}",
                fault="unknown",
            )
        if header.count(name) > 1:
            raise refusal(
                source,
                1,
                f"column '{name}' is there {header.count(name)} times",
                fault="twice",
                aspect="column",
            )


class _Row:
    """The cells of one row, taken out by column with a check."""

    def __init__(self, cells: dict[str, str], source: str, number: int) -> None:
        self._cells, self._source, self._number = cells, source, number

    def text(self, column: str) -> str:
        return self._cells.get(column, "")

    def wrong(self, column: str, expected: str, fault: Fault) -> TableError:
        return refusal(
            self._source,
            self._number,
            f"'{column}' is '{self.text(column)}'; expected {expected}",
            fault,
            column,
        )

    def number(self, column: str, what: str) -> float:
        text = self.text(column)
        if not _NUMBER.fullmatch(text):
            raise self.wrong(column, f"{what}, a number with a point", fault="malformed")
        value = float(text)
        if not abs(value) <= _LONGEST:
            raise self.wrong(
                column, f"{what} within {_LONGEST:g} m; is it in millimetres?", fault="out_of_range"
            )
        return value

    def whole(self, column: str, low: int) -> int:
        text = self.text(column)
        if not _WHOLE.fullmatch(text) or int(text) < low:
            raise self.wrong(column, f"a whole number from {low}", fault="out_of_range")
        return int(text)

    def one_of(self, column: str, known: tuple[str, ...]) -> str:
        if self.text(column) not in known:
            raise self.wrong(column, "one of " + ", ".join(known), fault="unknown")
        return self.text(column)


def _reading(row: _Row, planned: bool) -> TrackerReading:
    if not row.text("station"):
        raise row.wrong("station", "a name for the tracker's place", fault="missing")
    change = math.nan
    if not planned or row.text("length_change_m"):
        change = row.number("length_change_m", "the measured length change in m")
    uncertainty = math.nan
    if row.text("standard_uncertainty_m"):
        uncertainty = row.number("standard_uncertainty_m", "a standard uncertainty in m")
        if uncertainty <= 0:
            raise row.wrong(
                "standard_uncertainty_m",
                "more than zero, or an empty cell if unknown",
                fault="out_of_range",
            )
        if expected := implausible(UNCERTAINTY, uncertainty):
            raise row.wrong(UNCERTAINTY, expected, fault="out_of_range")
    return TrackerReading(
        station=row.text("station"),
        line=row.one_of("line", NAMES),
        run=row.whole("run", 1),
        direction=row.one_of("direction", (FORWARD, BACKWARD)),
        stop=row.whole("stop", 0),
        position=(
            row.number("x_m", "a commanded position in m"),
            row.number("y_m", "a commanded position in m"),
            row.number("z_m", "a commanded position in m"),
        ),
        change=change,
        uncertainty=uncertainty,
    )
