"""Reads the house's own plain table of a test of one axis (``bags.axis_table``) for a bag."""

from stepdiag_ros.bags.axis_table import COLUMNS
from stepdiag_ros.bags.imports.axis_test import AxisRow, axis_name, axis_test
from stepdiag_ros.bags.imports.imported import Imported, ImportOptions
from stepdiag_ros.bags.imports.source import SourceFile
from stepdiag_ros.bags.plain_table import read_rows
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD
from stepdiag_ros.metrology.units import MILLI

NAME = "table of an axis test"


def recognises(source: SourceFile) -> bool:
    """Say whether the first line of a file names the columns of this table."""
    first = source.data[:200].removeprefix(b"\xef\xbb\xbf").lstrip().split(b"\n")[0]
    return {cell.strip() for cell in first.split(b",")} == {name.encode() for name in COLUMNS}


def read(source: SourceFile, options: ImportOptions) -> Imported:
    """Read the table.

    Raises:
        TableError: incomplete or contradictory; names file and row.
    """
    rows = []
    for row in read_rows(source.path, COLUMNS):
        target = row.number("target_mm")
        rows.append(
            AxisRow(
                row=row.row,
                run=row.whole("cycle"),
                target=target * MILLI,
                # Subtracted in mm, in which both are written exactly.
                deviation=(row.number("position_mm") - target) * MILLI,
                direction=row.one_of("direction", (FORWARD, BACKWARD)),
            )
        )
    axis = axis_name("", options, source.name)
    return axis_test(source.name, NAME, axis, rows, options)
