"""Tables for Siemens SINUMERIK 840D and its family: ENC_COMP for positioning, CEC for the others.

Source: Siemens, SINUMERIK 840D sl / 828D Function Manual Extended Functions, K3 "Compensations"
(6FC5397-1BP40-3BA1, 03/2013), sections 4.4.1 to 4.4.4 "Interpolatory compensation"; the older
edition 6FC5397-1BP10-2BA0 for the term "compensation value". From there: ``$AA_ENC_COMP[e,N,AXi]``
with _STEP, _MIN, _MAX and _IS_MODULO, ``$AN_CEC[t,N]`` with _INPUT_AXIS, _OUTPUT_AXIS, _STEP, _MIN,
_MAX, _DIRECTION, _MULT_BY_TABLE and _IS_MODULO; linear between evenly spaced points, the first and
the last value hold beyond them; zero at the reference point; a positive value moves the axis in the
negative direction; a table is read only while its compensation is switched off; the 828D has eight
CEC tables of 200 points.

What is not said in public so plainly: the sign of a CEC value. The manual has one definition of a
compensation value for both methods, so the same sign is taken; the text beside the tables says how
to try it.
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
from stepdiag_ros.metrology.geometry import AXES, TRANSLATIONS, Vector, moving_axis
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.text.controls import NUMBER, Comment

ENC_FILE = "AX_EEC.INI"
CEC_FILE = "NC_CEC.INI"
LARGEST = 1e-3
"""m: of what MD32720 $MA_CEC_MAX_SUM lets through at most by default."""
COMMENT = Comment("; ")
_DIRECTIONS = {+1: "positive", -1: "negative", 0: "both"}
_ENTRY = re.compile(r"\$A(A_ENC_COMP|N_CEC)(_[A-Z_]+)?\s*\[([^\]]*)\]\s*=\s*\(?\s*([^\s;)]+)\s*\)?")


class _Siemens:
    name = "siemens"
    title = "Siemens SINUMERIK 840D sl, 828D (ENC_COMP, CEC)"
    settings = (
        ControlSetting("axes", "X1,Y1,Z1", "machine axis names of X, Y, Z"),
        ControlSetting(
            "encoder", 0, "index of the measuring system: 0 the first, 1 the second", high=1
        ),
        ControlSetting("digits", 5, "decimals of a value in mm", low=3, high=7),
        ControlSetting(
            "points",
            200,
            "most points of a table: MD38000 $MA_MM_ENC_COMP_MAX_POINTS, MD18342"
            " $MN_MM_CEC_MAX_POINTS",
            low=2,
            high=5000,
        ),
        ControlSetting("tables", 8, "most CEC tables (828D: 8)", low=0, high=62),
        ControlSetting("first_table", 0, "index of the first CEC table that is written", high=61),
        ControlSetting(
            "reversal",
            "none",
            "tables: CEC tables, one a direction, correct the reversal error at each place; none:"
            " it is left to MD32450 $MA_BACKLASH",
            choices=("none", "tables"),
        ),
    )
    corrects = TRANSLATIONS
    says = (
        "ENC_COMP corrects positioning, CEC tables straightness and squareness; angular errors,"
        " which act by levers, stay uncorrected",
        "a positive value moves the axis in the negative direction; for CEC the manual says so"
        " only in general: try one table alone with SD41310 $SN_CEC_TABLE_WEIGHT = 1, and if the"
        " error has doubled, the weight is -1",
        "first save a series start-up file of the present data, and set MD38000"
        " $MA_MM_ENC_COMP_MAX_POINTS and MD18342 $MN_MM_CEC_MAX_POINTS to the number of points,"
        " which formats the static memory",
        "tables can be loaded only while MD32700 $MA_ENC_COMP_ENABLE and MD32710 $MA_CEC_ENABLE"
        " are 0; then set both to 1, reset, and reference the axes",
        "positions are machine coordinates in mm (MD10240 metric)",
    )
    source = "Siemens, Function Manual Extended Functions, K3 (6FC5397-1BP40-3BA1), section 4.4"
    grammar: ClassVar[dict[str, tuple[str, ...]]] = {
        "|".join(map(re.escape, (ENC_FILE, CEC_FILE))): (
            r"%_N_(AX_EEC|NC_CEC)_INI",
            r"CHANDATA\(1\)",
            COMMENT.pattern,
            rf"\$AA_ENC_COMP(_[A-Z]+)*\[[01],([0-9]{{1,4}},)?{AXIS}\]={NUMBER}",
            rf"\$AN_CEC(_[A-Z]+)*\[[0-9]{{1,3}}(,[0-9]{{1,4}})?\]=({NUMBER}|\({AXIS}\))",
            "M17",
        )
    }

    def holds_reversal(self, settings: Mapping[str, Any]) -> bool:
        """Say whether the tables correct reversal errors (see ``Control``)."""
        return bool(settings["reversal"] == "tables")

    def write(self, identified: Identified, layout: Layout) -> Files:
        """Return AX_EEC.INI and NC_CEC.INI."""
        comments = "".join(f"{line}\n" for line in layout.comments(COMMENT))
        files = {ENC_FILE: self._encoder(identified, layout, comments)}
        cross = self._cross(identified, layout, comments)
        return files | ({CEC_FILE: cross} if cross else {})

    def _encoder(self, identified: Identified, layout: Layout, comments: str) -> str:
        chosen = layout.settings
        lines = [f"%_N_AX_EEC_INI\nCHANDATA(1)\n{comments}"]
        for axis, name in enumerate(axis_names(chosen["axes"])):
            positions = table_positions(identified, axis, layout)
            added = wanted(identified, axis, axis, positions, layout, 0)
            _check(positions, added, chosen["points"], f"ENC_COMP of {name}")
            key = f"{chosen['encoder']},{{}}{name}"
            lines += _points("$AA_ENC_COMP", key, positions, added, chosen["digits"])
            lines.append(f"$AA_ENC_COMP_IS_MODULO[{key.format('')}]=0\n")
        return "".join([*lines, "M17\n"])

    def _cross(self, identified: Identified, layout: Layout, comments: str) -> str:
        chosen = layout.settings
        names = axis_names(chosen["axes"])
        wishes = [
            (AXES.index(curve[2]), moving_axis(curve), 0)
            for curve in TRANSLATIONS
            if curve[2] != curve[3]
        ]
        if chosen["reversal"] == "tables":
            wishes += [(axis, axis, sense) for axis in identified.reversal for sense in (+1, -1)]
        refuse_long(
            len(wishes),
            chosen["tables"],
            "the CEC compensation",
            "say how many tables the control has, with --set tables=N",
        )
        lines = [f"%_N_NC_CEC_INI\nCHANDATA(1)\n{comments}"]
        for index, (error, axis, sense) in enumerate(wishes, chosen["first_table"]):
            positions = table_positions(identified, axis, layout)
            added = wanted(identified, error, axis, positions, layout, sense)
            if error == axis:
                # ENC_COMP has the mean of both directions already.
                added = added - wanted(identified, error, axis, positions, layout, 0)
            what = f"CEC table {index} ({names[error]} by {names[axis]})"
            _check(positions, added, chosen["points"], what)
            title = f"{names[error]} by {names[axis]}, direction: {_DIRECTIONS[sense]}"
            lines += [f"{line}\n" for line in COMMENT.lines(title)]
            lines += _points("$AN_CEC", f"{index}{{}}", positions, added, chosen["digits"])
            lines += [
                f"$AN_CEC_INPUT_AXIS[{index}]=({names[axis]})\n",
                f"$AN_CEC_OUTPUT_AXIS[{index}]=({names[error]})\n",
                f"$AN_CEC_DIRECTION[{index}]={sense}\n",
                f"$AN_CEC_MULT_BY_TABLE[{index}]=0\n",
                f"$AN_CEC_IS_MODULO[{index}]=0\n",
            ]
        return "".join([*lines, "M17\n"]) if wishes else ""

    def read(self, files: Mapping[str, str]) -> TableSet:
        """Return what the control does with the tables in these files.

        Only their order says which axes are X, Y and Z: ``write`` has them in this order.
        """
        entries: dict[tuple[str, str], dict[str, str]] = {}
        values: dict[tuple[str, str], dict[int, float]] = {}
        for name in (ENC_FILE, CEC_FILE):
            _collect(files.get(name, ""), name, entries, values)
        if not values:
            raise ValueError(f"there is no table in {ENC_FILE} or {CEC_FILE}")
        axes = [key for kind, key in values if kind == "A_ENC_COMP"]
        if len(axes) != len(AXES):
            raise Refusal(
                f"{ENC_FILE} has tables of {', '.join(axes) or 'no axis'}: state one of each axis,"
                " in the order X, Y, Z",
                fault="missing",
                about=ENC_FILE,
            )
        tables = []
        for (kind, key), points in values.items():
            entry = entries[(kind, key)]
            where = f"${'A' + kind}[{key}]"
            positions = _grid(entry, len(points), where)
            if sorted(points) != list(range(len(points))):
                raise ValueError(f"{where}: a point is missing")
            # A positive value moves the axis in the negative direction.
            added = -np.array([points[index] for index in range(len(points))]) / IN_MILLI
            if kind == "A_ENC_COMP":
                axis = axes.index(key)
                tables.append(ControlTable(axis, axis, positions, added, added))
                continue
            moving = _axis(entry.get("_INPUT_AXIS", ""), axes, where)
            corrected = _axis(entry.get("_OUTPUT_AXIS", ""), axes, where)
            sense = int(entry.get("_DIRECTION", "0"))
            nothing = np.zeros(len(added))
            forward, backward = (
                added if sense >= 0 else nothing,
                added if sense <= 0 else nothing,
            )
            tables.append(ControlTable(moving, corrected, positions, forward, backward))
        return TableSet(tuple(tables))


def _points(variable: str, key: str, positions: Vector, added: Vector, digits: int) -> list[str]:
    """Return the lines of points, spacing and ends; ``key`` has a place for the point's number."""
    table = key.endswith("{}")
    lines = []
    for number, value in enumerate((-added * IN_MILLI).tolist()):
        index = key.format(f",{number}" if table else f"{number},")
        # Adding zero makes a rounded -0.00000 a 0.00000.
        lines.append(f"{variable}[{index}]={round(value, digits) + 0.0:.{digits}f}\n")
    bare = key.format("")
    step = (positions[-1] - positions[0]) / (len(positions) - 1)
    return [
        *lines,
        f"{variable}_STEP[{bare}]={step * IN_MILLI:.9f}\n",
        f"{variable}_MIN[{bare}]={positions[0] * IN_MILLI:.6f}\n",
        f"{variable}_MAX[{bare}]={positions[-1] * IN_MILLI:.6f}\n",
    ]


def _check(positions: Vector, added: Vector, most: int, what: str) -> None:
    refuse_long(
        len(positions),
        most,
        what,
        "ask for a wider --spacing, or say with --set points=N how many are configured",
    )
    refuse_large(added, LARGEST, what)


def _collect(
    text: str,
    name: str,
    entries: dict[tuple[str, str], dict[str, str]],
    values: dict[tuple[str, str], dict[int, float]],
) -> None:
    for number, line in enumerate(text.splitlines(), 1):
        found = _ENTRY.match(line.strip())
        if found is None:
            if line.strip().startswith("$"):
                raise Refusal(
                    f"{name} line {number}: '{line.strip()}' is not understood",
                    fault="malformed",
                    aspect="line",
                )
            continue
        kind, suffix, index, value = found.groups()
        parts = [part.strip() for part in index.split(",")]
        encoder = kind == "A_ENC_COMP"
        key = (kind, parts[-1] if encoder else parts[0])
        entries.setdefault(key, {})
        if suffix:
            entries[key][suffix] = value
            continue
        try:
            values.setdefault(key, {})[int(parts[1])] = float(value)
        except (IndexError, ValueError):
            raise ValueError(f"{name} line {number}: '{line.strip()}' is not a point") from None


def _grid(entry: Mapping[str, str], points: int, where: str) -> Vector:
    try:
        low, high, step = (float(entry[key]) / IN_MILLI for key in ("_MIN", "_MAX", "_STEP"))
    except (KeyError, ValueError):
        raise ValueError(f"{where}: MIN, MAX and STEP are needed, as numbers") from None
    if points < 2 or abs(low + (points - 1) * step - high) > 1e-3 * step:
        raise Refusal(f"{where}: {points} points do not fit MIN, MAX and STEP", fault="mismatch")
    return np.linspace(low, high, points)


def _axis(name: str, axes: list[str], where: str) -> int:
    if name not in axes:
        raise ValueError(f"{where}: axis '{name}' has no ENC_COMP table beside it")
    return axes.index(name)


CONTROL = _Siemens()
