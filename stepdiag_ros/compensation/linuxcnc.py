"""Tables for LinuxCNC: one ``COMP_FILE`` a joint, positioning alone.

Source: LinuxCNC, Integrator Manual, "INI Configuration", section "[JOINT_<num>]", COMP_FILE and
COMP_FILE_TYPE. Found by trying it on LinuxCNC 2.9: three numbers a line, ``nominal forward
reverse``, in machine units, nominal strictly rising, at most 256 lines; linear between lines and
constant beyond them; read at start only; BACKLASH is ignored where there is a table. Type 0: the
columns are the positions that were measured for the nominal one; type 1: they are added to the
motor's command. A comment or header would silently end the table, so the file has neither:
the origin stands in the text beside it.
"""

import re
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from stepdiag_ros.compensation.applied import ControlTable, TableSet
from stepdiag_ros.compensation.control import (
    INCH,
    ControlSetting,
    Files,
    Layout,
    refuse_large,
    refuse_long,
    table_positions,
    wanted,
)
from stepdiag_ros.compensation.identified import Identified
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.text.controls import NUMBER, Comment

MOST_LINES = 256
LARGEST = 1e-3
"""m: no ball screw is that wrong; a larger correction is a mistake in units."""
INI = "joints.ini"
COMMENT = Comment("# ")
_UNITS = {"mm": 1e-3, "inch": INCH}
_DIGITS = {"mm": 7, "inch": 9}
"""Decimals: 0.1 nm or less, so that rounding is not a source of error."""


class _LinuxCnc:
    name = "linuxcnc"
    title = "LinuxCNC (COMP_FILE)"
    settings = (
        ControlSetting("units", "mm", "machine units of the joint", choices=("mm", "inch")),
        ControlSetting(
            "type",
            1,
            "COMP_FILE_TYPE: 1: the columns are added to the command; 0: they are the measured"
            " positions",
            high=1,
        ),
        ControlSetting("joints", "0,1,2", "numbers of the joints of X, Y, Z"),
    )
    corrects = ("E_XX", "E_YY", "E_ZZ")
    says = (
        "one table a joint, forward and reverse; BACKLASH of a joint is ignored where it has a"
        " table, and what BACKLASH corrected must be in the table",
        "there is no table for straightness, squareness or angles: these need target correction by"
        " the bridge or a rewritten NC program",
        "the tables are for trivial kinematics, where joint and axis are the same",
    )
    source = 'LinuxCNC, Integrator Manual, "INI Configuration", section "[JOINT_<num>]"'
    grammar: ClassVar[dict[str, tuple[str, ...]]] = {
        r"[xyz]\.comp": (rf"{NUMBER}( {NUMBER}){{2}}",),
        re.escape(INI): (
            COMMENT.pattern,
            "",
            r"\[JOINT_[0-9]{1,2}\]",
            r"COMP_FILE = [xyz]\.comp",
            "COMP_FILE_TYPE = [01]",
        ),
    }

    def holds_reversal(self, _settings: Mapping[str, Any]) -> bool:
        """Say whether the tables correct reversal errors (see ``Control``)."""
        return True

    def write(self, identified: Identified, layout: Layout) -> Files:
        """Return x.comp, y.comp, z.comp, and the lines for the INI file."""
        chosen = layout.settings
        unit, digits = _UNITS[chosen["units"]], _DIGITS[chosen["units"]]
        joints = _joints(chosen["joints"])
        files: Files = {}
        ini = []
        for axis, letter in enumerate(AXES):
            positions = table_positions(identified, axis, layout)
            refuse_long(
                len(positions),
                MOST_LINES,
                f"the table of {letter}",
                "ask for a wider --spacing",
            )
            columns = [positions]
            for sense in (+1, -1):
                added = wanted(identified, axis, axis, positions, layout, sense)
                refuse_large(added, LARGEST, f"the table of {letter}")
                columns.append(added if chosen["type"] else positions - added)
            rows = np.stack(columns, axis=1) / unit
            name = f"{letter.lower()}.comp"
            files[name] = "".join(
                " ".join(f"{value:.{digits}f}" for value in row) + "\n" for row in rows.tolist()
            )
            ini.append(
                f"[JOINT_{joints[axis]}]\nCOMP_FILE = {name}\nCOMP_FILE_TYPE = {chosen['type']}\n"
            )
        notes = layout.comments(COMMENT, f"machine units: {chosen['units']}")
        files[INI] = "\n".join([*notes, "", *ini])
        return files

    def read(self, files: Mapping[str, str]) -> TableSet:
        """Return what LinuxCNC does with the tables that the lines of the INI file name."""
        unit, kinds = _UNITS["mm"], dict[str, int]()
        if INI in files:
            unit, kinds = _told(files[INI])
        tables = []
        for axis, letter in enumerate(AXES):
            name = f"{letter.lower()}.comp"
            if name in files:
                rows = _rows(files[name], name) * unit
                kind = kinds.get(name, 1)
                forward, backward = rows[:, 1], rows[:, 2]
                if kind == 0:
                    forward, backward = rows[:, 0] - forward, rows[:, 0] - backward
                tables.append(ControlTable(axis, axis, rows[:, 0], forward, backward))
        if not tables:
            raise ValueError("there is no x.comp, y.comp or z.comp among these files")
        return TableSet(tuple(tables))


def _joints(given: Any) -> list[int]:
    numbers = [part.strip() for part in str(given).split(",")]
    if len(numbers) != len(AXES) or not all(re.fullmatch("[0-9]{1,2}", part) for part in numbers):
        raise Refusal(
            f"joints is '{given}'; expected three numbers, such as 0,1,2",
            fault="malformed",
            aspect="joints",
        )
    return [int(part) for part in numbers]


def _told(ini: str) -> tuple[float, dict[str, int]]:
    """Return the machine unit, m, and the type of each file, from the lines for the INI file."""
    unit, kinds, name = 1e-3, {}, ""
    for line in ini.splitlines():
        key, _, value = line.partition("=")
        if line.startswith("# machine units:"):
            unit = _UNITS.get(line.partition(":")[2].strip(), 1e-3)
        elif key.strip() == "COMP_FILE":
            name = value.strip()
        elif key.strip() == "COMP_FILE_TYPE":
            kinds[name] = int(value)
    return unit, kinds


def _rows(text: str, name: str) -> Vector:
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        try:
            row = [float(part) for part in line.split()]
        except ValueError:
            row = []
        if len(row) != 3:
            raise Refusal(
                f"{name} line {number}: expected nominal, forward and reverse",
                fault="malformed",
                aspect="line",
            )
        if rows and row[0] <= rows[-1][0]:
            raise Refusal(
                f"{name} line {number}: the nominal position does not rise", fault="out_of_order"
            )
        rows.append(row)
    if not 1 <= len(rows) <= MOST_LINES:
        raise ValueError(f"{name} has {len(rows)} lines; LinuxCNC takes 1 to {MOST_LINES}")
    return np.array(rows)


CONTROL = _LinuxCnc()
