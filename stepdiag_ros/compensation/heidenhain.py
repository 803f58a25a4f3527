"""Tables for Heidenhain controls: one ``.COM`` an axis, and the ``.CMA`` that assigns them.

Source: HEIDENHAIN, Technical Manual MANUALplus 620 (01/2012), section 6.10.3 "Nonlinear axis error
compensation" (columns AXISPOS, BACKLASH and those of the corrected axes; positions from the machine
datum; the .CMA has a column for each axis and a column ACTIVE), and Technical Manual TNC 407, 415,
425 (01.98), sections 1.6.3 and 1.6.4 and PLC module 9095 (an error is positive where the travel is
too long; at most 256 entries; at most 1/64 of the spacing from one entry to the next). A table
X.COM holds, by the position of X, how wrong X, Y and Z are: positioning, straightness and
squareness.

What the public manuals do not print is the frame of the table files of these controls (the lines
before and after the rows, the widths of columns), nor whether BACKLASH holds a value or a
difference. So the rows here are those of the manual, in the frame that Heidenhain's other tables
have, and BACKLASH stays empty: make an empty table on the control and compare before copying.
"""

import re
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from stepdiag_ros.compensation.applied import ControlTable, TableSet
from stepdiag_ros.compensation.control import (
    AXIS,
    ControlSetting,
    Files,
    Layout,
    axis_names,
    refuse_large,
    refuse_long,
    table_positions,
    wanted,
)
from stepdiag_ros.compensation.identified import Identified
from stepdiag_ros.metrology.geometry import TRANSLATIONS, Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.text.controls import NUMBER

MOST_ENTRIES = 256
STEEPEST = 1.0 / 64.0
"""Most that a correction may change from one entry to the next, as a part of the spacing."""
LARGEST = 1e-3
"""m."""
ASSIGNMENT = "CONFIG.CMA"


class _Heidenhain:
    name = "heidenhain"
    title = "Heidenhain TNC, MANUALplus (.COM, .CMA)"
    settings = (
        ControlSetting("axes", "X,Y,Z", "names of X, Y, Z in the control (CfgAxes/axisList)"),
        ControlSetting("digits", 4, "decimals of a value in mm", low=3, high=6),
    )
    corrects = TRANSLATIONS
    says = (
        "each table corrects positioning, and straightness and squareness of the others to it;"
        " angular errors need KinematicsComp",
        "reversal errors stay uncorrected: the public manuals do not say what the column BACKLASH"
        " holds; see MP_backLash",
        "a value is the error with its sign, positive where the travel is too long; the control"
        " takes it off",
        "the lines around the rows are not public: compare with an empty table made on the control",
    )
    source = (
        "HEIDENHAIN, Technical Manual MANUALplus 620, section 6.10.3; Technical Manual TNC"
        " 407/415/425, sections 1.6.3 and 1.6.4"
    )
    grammar: ClassVar[dict[str, tuple[str, ...]]] = {
        re.escape(ASSIGNMENT): (
            rf"BEGIN {re.escape(ASSIGNMENT)} MM",
            rf"NR +ACTIVE( +{AXIS}){{3}}",
            rf"0 +\*( +{AXIS}\.COM){{3}}",
            r"\[END\]",
        ),
        rf"{AXIS}\.COM": (
            rf"BEGIN {AXIS}\.COM MM",
            rf"NR +AXISPOS( +{AXIS}){{3}}",
            rf"[0-9]{{1,3}}( +{NUMBER}){{4}}",
            r"\[END\]",
        ),
    }

    def holds_reversal(self, _settings: Mapping[str, Any]) -> bool:
        """Say whether the tables correct reversal errors (see ``Control``)."""
        return False

    def write(self, identified: Identified, layout: Layout) -> Files:
        """Return X.COM, Y.COM, Z.COM and CONFIG.CMA."""
        names = axis_names(layout.settings["axes"])
        digits = layout.settings["digits"]
        files: Files = {}
        for axis, name in enumerate(names):
            positions = table_positions(identified, axis, layout)
            refuse_long(len(positions), MOST_ENTRIES, f"{name}.COM", "ask for a wider --spacing")
            errors = []
            for error in range(3):
                added = wanted(identified, error, axis, positions, layout, 0)
                refuse_large(added, LARGEST, f"{name}.COM, column {names[error]}")
                _refuse_steep(positions, added, f"{name}.COM, column {names[error]}")
                errors.append(-added)
            files[f"{name}.COM"] = _table(name, names, positions, errors, digits)
        files[ASSIGNMENT] = _assignment(names)
        return files

    def read(self, files: Mapping[str, str]) -> TableSet:
        """Return what the control does with the tables that CONFIG.CMA makes active."""
        if ASSIGNMENT not in files:
            raise ValueError(f"there is no {ASSIGNMENT} among these files")
        titles, rows = _rows(files[ASSIGNMENT], ASSIGNMENT)
        names = titles[2:]
        active = [row for row in rows if len(row) > 1 and row[1] == "*"]
        if len(names) != 3 or len(active) != 1:
            raise ValueError(f"{ASSIGNMENT}: expected three axes and one active line")
        tables = []
        for axis, file in enumerate(active[0][2:]):
            if file not in files:
                raise ValueError(f"{ASSIGNMENT} names {file}, which is not there")
            columns, entries = _rows(files[file], file)
            try:
                numbers = np.array([[float(value) for value in row[1:]] for row in entries])
                positions = numbers[:, columns.index("AXISPOS") - 1] / IN_MILLI
                for error, name in enumerate(names):
                    # The control takes the error off.
                    added = -numbers[:, columns.index(name) - 1] / IN_MILLI
                    tables.append(ControlTable(axis, error, positions, added, added))
            except (ValueError, IndexError) as wrong:
                raise Refusal(f"{file}: {wrong}", fault="missing") from None
        return TableSet(tuple(tables))


def _assignment(names: list[str]) -> str:
    """Return the table that makes each axis's table the active one."""
    titles = "".join(f"{name:<12}" for name in names)
    tables = "".join(f"{f'{name}.COM':<12}" for name in names)
    rows = [f"{'NR':<4}{'ACTIVE':<8}{titles}", f"{0:<4}{'*':<8}{tables}"]
    return "\n".join([f"BEGIN {ASSIGNMENT} MM", *(row.rstrip() for row in rows), "[END]", ""])


def _table(
    name: str, names: list[str], positions: Vector, errors: list[Vector], digits: int
) -> str:
    widths = 14
    titles = ["AXISPOS", *names]
    lines = [
        f"BEGIN {name}.COM MM",
        f"{'NR':<5}" + "".join(f"{title:>{widths}}" for title in titles),
    ]
    for number, position in enumerate(positions.tolist()):
        row = [f"{position * IN_MILLI:.{max(digits, 5)}f}"]
        row += [f"{round(one[number] * IN_MILLI, digits) + 0.0:+.{digits}f}" for one in errors]
        lines.append(f"{number:<5}" + "".join(f"{value:>{widths}}" for value in row))
    return "\n".join([*lines, "[END]", ""])


def _rows(text: str, name: str) -> tuple[list[str], list[list[str]]]:
    lines = [line.split() for line in text.splitlines() if line.strip()]
    if len(lines) < 4 or lines[0][:1] != ["BEGIN"] or lines[-1] != ["[END]"]:
        raise Refusal(
            f"{name}: expected BEGIN, a line of titles, rows and [END]", fault="malformed"
        )
    return lines[1], lines[2:-1]


def _refuse_steep(positions: Vector, added: Vector, what: str) -> None:
    steps = np.abs(np.diff(added)) / np.diff(positions)
    if np.any(steps > STEEPEST):
        raise ValueError(
            f"{what}: the correction changes by more than 1/64 of the spacing between two entries,"
            " which the control does not take"
        )


CONTROL = _Heidenhain()
