"""Small tables that a person or another program made: CSV with a header, checked cell by cell."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from stepdiag_ros.bags.csv_cells import unguarded
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.table_rows import read_text, refusal
from stepdiag_ros.metrology.refusal import Fault
from stepdiag_ros.metrology.spelling import nearest, suggestion


class PlainRow:
    """One row of a table; every refusal names the file, the row and the column.

    Args:
        source: what the user calls the table.
        number: line of the file, the header being 1.
        cells: column → text.
    """

    def __init__(self, source: str, number: int, cells: dict[str, str]) -> None:
        self.source, self.row, self._cells = source, number, cells

    def wrong(self, column: str, expected: str, fault: Fault) -> TableError:
        """Return the error that refuses a cell."""
        found = self._cells[column]
        return refusal(
            self.source, self.row, f"'{column}' is '{found}'; expected {expected}", fault, column
        )

    def text(self, column: str) -> str:
        """Return the text of a cell."""
        return self._cells[column]

    def number(self, column: str) -> float:
        """Return the number in a cell; raises ``TableError`` if it is not a finite number."""
        try:
            value = float(self._cells[column])
        except ValueError:
            comma = " (with a point, not a comma)" if "," in self._cells[column] else ""
            raise self.wrong(column, f"a number{comma}", fault="malformed") from None
        if not math.isfinite(value):
            raise self.wrong(
                column, "a finite number; leave a run without a value out", fault="out_of_range"
            )
        return value

    def whole(self, column: str) -> int:
        """Return the whole number from 0 in a cell; raises ``TableError`` for another text."""
        if not (self._cells[column].isascii() and self._cells[column].isdigit()):
            raise self.wrong(column, "a whole number from 0", fault="malformed")
        return int(self._cells[column])

    def one_of(self, column: str, known: Sequence[str]) -> str:
        """Return the name in a cell; raises ``TableError`` if it is not a known one."""
        if self._cells[column] not in known:
            raise self.wrong(
                column, "one of " + ", ".join(name or "nothing" for name in known), fault="unknown"
            )
        return self._cells[column]


def read_rows(
    path: str | Path, columns: Sequence[str], optional: Sequence[str] = ()
) -> list[PlainRow]:
    """Return the rows of a table, at least one; empty lines are passed over.

    Args:
        path: the CSV.
        columns: that must be there.
        optional: that may be there; their cells are empty if not.

    Raises:
        TableError: not there, not readable, a column is missing, unknown or there twice, or a row
            has another number of cells than the header.
    """
    source = str(path)
    reader = csv.reader(io.StringIO(read_text(Path(path)), newline=""), strict=True)
    try:
        header = [name.strip() for name in next(reader, [])]
        _check_header(source, header, columns, optional)
        rows = []
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) != len(header):
                hint = "; is there a decimal comma?" if len(cells) > len(header) else ""
                raise refusal(
                    source,
                    reader.line_num,
                    f"it has {len(cells)} cells under {len(header)} columns{hint}",
                    fault="too_many",
                )
            named = dict.fromkeys(optional, "")
            named.update(
                (name, unguarded(cell.strip())) for name, cell in zip(header, cells, strict=True)
            )
            rows.append(PlainRow(source, reader.line_num, named))
    except csv.Error as error:
        raise refusal(source, reader.line_num, f"this is not CSV ({error})") from None
    if not rows:
        raise TableError(
            f"{source} has no rows, so it contains no measurement", fault="too_few", aspect="row"
        )
    return rows


def _meant(
    name: str, header: Sequence[str], columns: Sequence[str], optional: Sequence[str]
) -> str:
    """Ask whether a column that is there is a misspelling of one that is missing."""
    near = nearest(name, [one for one in header if one not in (*columns, *optional)])
    return f"; there is an unknown column '{near}': {suggestion(name)}" if near else ""


def _check_header(
    source: str, header: list[str], columns: Sequence[str], optional: Sequence[str]
) -> None:
    if len(header) == 1 and (";" in header[0] or "\t" in header[0]):
        raise refusal(
            source,
            1,
            "the columns are not separated by commas; save it with commas",
            fault="wrong_kind",
            aspect="delimiter",
        )
    for name in columns:
        if name not in header:
            raise refusal(
                source,
                1,
                f"column '{name}' is missing{_meant(name, header, columns, optional)}; needed are"
                f" {', '.join(columns)}",
                fault="missing",
            )
    for name in header:
        if name not in (*columns, *optional):
            raise refusal(source, 1, f"there is an unknown column '{name}'", fault="unknown")
        if header.count(name) > 1:
            raise refusal(
                source, 1, f"column '{name}' is there {header.count(name)} times", fault="twice"
            )
