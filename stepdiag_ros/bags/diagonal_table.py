"""Reads lengths of diagonals from a plain CSV: a single reading at each end is enough.

The columns are ``diagonal,start_x_mm,start_y_mm,start_z_mm,finish_x_mm,finish_y_mm,finish_z_mm,
length_mm`` and, where known, ``uncertainty_um`` (standard uncertainty of the length) and
``same_approach`` (``yes`` if both ends were read after a move in the same direction, ``no`` if
not). Diagonals are named as everywhere: ppp npp pnp ppn, pp0 np0 p0p n0p 0pp 0np.
"""

from pathlib import Path

from stepdiag_ros.bags.plain_table import PlainRow, read_rows
from stepdiag_ros.metrology.geometry import BODY_DIAGONALS, FACE_DIAGONALS
from stepdiag_ros.metrology.standards.diagonal_squareness import DiagonalLength

_ENDS = ("start", "finish")
COLUMNS = (
    "diagonal",
    *(f"{end}_{axis}_mm" for end in _ENDS for axis in "xyz"),
    "length_mm",
)
OPTIONAL = ("uncertainty_um", "same_approach")
_APPROACH = {"yes": True, "no": False, "": None}


def read_diagonal_table(path: str | Path) -> tuple[DiagonalLength, ...]:
    """Read the lengths in a table.

    Raises:
        TableError: not there, not readable or contradictory; names row, column and reason.
    """
    return tuple(_length(row) for row in read_rows(path, COLUMNS, OPTIONAL))


def _length(row: PlainRow) -> DiagonalLength:
    name = row.one_of("diagonal", (*BODY_DIAGONALS, *FACE_DIAGONALS))
    places = []
    for end in _ENDS:
        x, y, z = (1e-3 * row.number(f"{end}_{axis}_mm") for axis in "xyz")
        places.append((x, y, z))
    measured = 1e-3 * row.number("length_mm")
    uncertainty = 1e-6 * row.number("uncertainty_um") if row.text("uncertainty_um") else None
    if uncertainty is not None and uncertainty <= 0:
        raise row.wrong(
            "uncertainty_um", "more than 0, or an empty cell where it is not known", "out_of_range"
        )
    nominal = DiagonalLength(name, places[0], places[1], 0.0).nominal
    if abs(measured - nominal) > 0.01 * nominal:
        raise row.wrong(
            "length_mm",
            f"a length near the nominal one of {1e3 * nominal:.3f}, that of its ends",
            fault="mismatch",
        )
    return DiagonalLength(
        line=name,
        start=places[0],
        finish=places[1],
        error=measured - nominal,
        standard_uncertainty=float("nan") if uncertainty is None else uncertainty,
        same_approach=_APPROACH[row.one_of("same_approach", tuple(_APPROACH))],
    )
