"""Text in the cells of a CSV file that somebody may open in a spreadsheet.

A spreadsheet executes a cell that begins with ``=``, ``+``, ``-`` or ``@`` as a formula (OWASP,
"CSV Injection"). Names, reasons and sentences of a bag may come from anybody; an apostrophe before
such a text keeps it a text, and is taken off again when the table is read. Numbers are never
guarded.
"""

import csv
import unicodedata
from collections.abc import Iterable, Sequence

_GUARD = "'"


class _Rows(list[str]):
    def write(self, row: str) -> None:
        self.append(f"{row[:-2]}\n")


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Return rows as the text of a CSV file, every row ended by a line feed."""
    made = _Rows()
    # Up to Python 3.12 a cell with a carriage return is quoted only if rows end with one.
    csv.writer(made, lineterminator="\r\n").writerows(rows)
    return "".join(made)


def guarded(text: str) -> str:
    """Return the cell of a text: the text itself, or with an apostrophe before it."""
    return _GUARD + text if _acts(text) else text


def unguarded(cell: str) -> str:
    """Return the text of a cell: the inverse of ``guarded``."""
    return cell[1:] if cell.startswith(_GUARD) and _acts(cell) else cell


def _acts(text: str) -> bool:
    """Say whether a text begins as a formula, behind whatever a spreadsheet may leave out."""
    rest = text.lstrip(_GUARD)
    if rest[:1] in ("\t", "\r", "\n"):
        return True
    seen = (c for c in rest if c.isprintable() and not c.isspace())
    # Some read the full-width forms as well.
    return unicodedata.normalize("NFKC", next(seen, "")) in ("=", "+", "-", "@")
