"""A table of texts, which a terminal and a page lay out each in its own way."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace


@dataclass
class Column:
    """The head of a column and how its cells stand.

    Attributes:
        header: above it.
        number: its cells are numbers, which stand on the right.
        wraps: a terminal may break its cells into lines.
        widest: characters in a line of a terminal; None for as many as there is room for.
    """

    header: str
    number: bool = False
    wraps: bool = False
    widest: int | None = None


@dataclass
class Table:
    """A table.

    Attributes:
        title: above it; may be empty.
        columns: from left to right.
        rows: texts of the cells; a line break in a text stays one.
        section_ends: indices of the rows under which a line is drawn.
        whole_title: on a terminal the table is at least as wide as its title.
        gap: blanks between columns on a terminal.
    """

    title: str
    columns: list[Column]
    rows: list[tuple[str, ...]] = field(default_factory=list)
    section_ends: set[int] = field(default_factory=set)
    whole_title: bool = False
    gap: int = 2
    """With two blanks the tables fit into a terminal of 80."""

    def add_row(self, *cells: str) -> None:
        """Add a row.

        Raises:
            ValueError: it has more or fewer cells than there are columns.
        """
        if len(cells) != len(self.columns):
            raise ValueError(f"{len(cells)} cells for {len(self.columns)} columns")
        self.rows.append(cells)

    def add_section(self) -> None:
        """Draw a line under the last row."""
        self.section_ends.add(len(self.rows) - 1)

    def folded(self, width: int) -> "list[Table]":
        """Return the table in parts that fit a width; each part begins with the first column.

        Args:
            width: characters of a line.
        """
        wide = self._widths()
        parts: list[list[int]] = [[]]
        for place in range(1, len(self.columns)):
            if parts[-1] and wide[0] + sum(wide[one] for one in parts[-1]) + wide[place] > width:
                parts.append([])
            parts[-1].append(place)
        if len(parts) == 1:
            return [self]
        return [
            replace(
                self,
                title=self.title if part is parts[0] else "",
                columns=[self.columns[place] for place in (0, *part)],
                rows=[tuple(row[place] for place in (0, *part)) for row in self.rows],
                whole_title=False,
            )
            for part in parts
        ]

    @property
    def least_width(self) -> int:
        """Return in how many characters a line of all columns fits."""
        return sum(self._widths())

    def _widths(self) -> list[int]:
        return [self._width(place) + self.gap for place in range(len(self.columns))]

    def _width(self, place: int) -> int:
        """Return how wide a column is at least; one that wraps, as wide as its longest word."""
        column = self.columns[place]
        cells = [column.header, *(row[place] for row in self.rows)]
        return max(len(part) for cell in cells for part in
                   (cell.split() or [""] if column.wraps else cell.split("\n")))  # fmt: skip


def new_table(title: str, *headers: str) -> Table:
    """Return an empty table of numbers; the first column has their names, on the left."""
    return Table(title, [Column(one, number=place > 0) for place, one in enumerate(headers)])


def with_rows(tables: Iterable[Table | None]) -> list[Table]:
    """Return those tables that are there and have rows."""
    return [table for table in tables if table is not None and table.rows]
