"""Reads the table of a direct measurement; its form is that of ``direct``."""

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.direct import (
    COLUMNS,
    NEEDED_COLUMNS,
    REFLECTOR_COLUMNS,
    STANDING_COLUMNS,
    DirectCurve,
    DirectMeasurement,
    DirectPlace,
    DirectSquareness,
)
from stepdiag_ros.metrology.forward import OVER_90_DEGREES, RIGHT_HANDED, SQUARENESS_DEFINITIONS
from stepdiag_ros.metrology.geometry import CURVES, SQUARENESS
from stepdiag_ros.metrology.refusal import Refusal

_DEFINITIONS = {"rotation": RIGHT_HANDED, "angle": OVER_90_DEGREES}


@dataclass(frozen=True)
class _Value:
    row: int
    name: str
    position: float
    repeat: int
    value: float
    uncertainty: float
    place: DirectPlace


def read_direct(text: str, source: str) -> DirectMeasurement:
    """Read the table of a direct measurement; its form is that of the module.

    Args:
        text: of the table.
        source: what the user calls it, for the text of an error.

    Raises:
        ValueError: names the source, the row and what is wrong; row 1 is the file's first line.
    """
    lines = text.splitlines()
    notes = tuple(line.lstrip("# ").rstrip() for line in lines if line.startswith("#"))
    numbered = [
        (number, line)
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("#")
    ]
    if not numbered:
        raise Refusal(
            f"{source}: the table is empty; expected the columns {', '.join(COLUMNS)}",
            fault="too_few",
            aspect="header",
        )
    header = [cell.strip() for cell in next(csv.reader([numbered[0][1]]))]
    for column in NEEDED_COLUMNS:
        if column not in header:
            raise Refusal(
                f"{source}: the column '{column}' is missing; expected {', '.join(COLUMNS)}",
                fault="missing",
            )
    for column in header:
        if column not in COLUMNS or header.count(column) > 1:
            raise Refusal(
                f"{source}: unknown or repeated column '{column}'; expected {', '.join(COLUMNS)}",
                fault="unknown",
            )
    values = [
        _value(number, line, header, f"{source}, row {number}") for number, line in numbered[1:]
    ]
    if not values:
        raise Refusal(
            f"{source}: the table has no values, only a header", fault="too_few", aspect="values"
        )
    by_name: dict[str, list[_Value]] = {}
    for value in values:
        by_name.setdefault(value.name, []).append(value)
    return DirectMeasurement(
        curves={name: _curve(by_name[name], source) for name in CURVES if name in by_name},
        squareness={
            name: _squareness(by_name[name], source) for name in SQUARENESS if name in by_name
        },
        notes=notes,
    )


def _value(number: int, line: str, header: list[str], where: str) -> _Value:
    cells = [cell.strip() for cell in next(csv.reader([line]))]
    if len(cells) != len(header):
        raise Refusal(
            f"{where}: {len(cells)} values for {len(header)} columns",
            fault="too_few",
            aspect="cells",
        )
    row = dict(zip(header, cells, strict=True))
    name = row["name"]
    if name not in CURVES and name not in SQUARENESS:
        raise Refusal(
            f"{where}: '{name}' is not an error; use a curve such as E_XX, E_YX, E_AX or a"
            f" squareness ({', '.join(SQUARENESS)})",
            fault="unknown",
        )
    factor = 1.0
    definition = row.get("definition", "")
    if name in SQUARENESS:
        if definition not in _DEFINITIONS:
            raise Refusal(
                f"{where}: the definition of {name} is '{definition}'; expected rotation"
                " (right-handed, ISO 230-1) or angle (positive where it is larger than 90°)",
                fault="unknown",
            )
        factor = SQUARENESS_DEFINITIONS[_DEFINITIONS[definition]][name]
        if row["position_m"]:
            raise Refusal(
                f"{where}: {name} is a squareness and has no position; leave it empty",
                fault="too_many",
            )
    elif definition:
        raise Refusal(
            f"{where}: {name} is a curve and has no definition; leave it empty", fault="too_many"
        )
    repeat = row.get("repeat", "") or "0"
    if not (repeat.isascii() and repeat.isdigit()):
        raise Refusal(
            f"{where}: repeat is '{repeat}'; expected a whole number from 0", fault="malformed"
        )
    uncertainty = math.nan
    if row.get("standard_uncertainty", ""):
        uncertainty = _number(row["standard_uncertainty"], "standard_uncertainty", where)
        if uncertainty <= 0.0:
            raise Refusal(
                f"{where}: standard_uncertainty is {uncertainty:g}; expected more than 0, or"
                " nothing where it is unknown",
                fault="out_of_range",
            )
    position = 0.0 if name in SQUARENESS else _number(row["position_m"], "position_m", where)
    value = factor * _number(row["value"], "value", where)
    if abs(value) > 0.1:
        raise Refusal(
            f"{where}: value is {row['value']}; expected an error in m or rad, at most 0.1",
            fault="out_of_range",
        )
    return _Value(number, name, position, int(repeat), value, uncertainty, _place(row, where))


def _place(row: Mapping[str, str], where: str) -> DirectPlace:
    def point(columns: tuple[str, ...], untold: float) -> tuple[float, float, float]:
        x, y, z = (
            _number(row[column], column, where) if row.get(column) else untold for column in columns
        )
        return x, y, z

    return DirectPlace(point(STANDING_COLUMNS, math.nan), point(REFLECTOR_COLUMNS, 0.0))


def _one_place(values: list[_Value], source: str) -> DirectPlace:
    """Return where an error was measured, which must be the same in all its rows."""
    first = values[0]
    for value in values:
        # NaN is not told, and equals only itself.
        if repr(value.place) != repr(first.place):
            raise Refusal(
                f"{source}, row {value.row}: {value.name} was measured at another place than in row"
                f" {first.row}; give each file one place for an error",
                fault="mismatch",
            )
    return first.place


def _number(text: str, column: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise Refusal(f"{where}: {column} is '{text}'; expected a number", fault="malformed")
    return value


def _curve(values: list[_Value], source: str) -> DirectCurve:
    name = values[0].name
    table: dict[int, dict[float, _Value]] = {}
    for value in values:
        own = table.setdefault(value.repeat, {})
        if value.position in own:
            raise Refusal(
                f"{source}, row {value.row}: {name} at {value.position:g} m in repeat"
                f" {value.repeat} appears already in row {own[value.position].row}",
                fault="twice",
            )
        own[value.position] = value
    positions = sorted(next(iter(table.values())))
    for repeat, own in table.items():
        if sorted(own) != positions:
            raise Refusal(
                f"{source}: {name} has other positions in repeat {repeat} than in repeat"
                f" {next(iter(table))}; give every repeat the same",
                fault="mismatch",
            )
    if len(positions) < 3:
        raise Refusal(
            f"{source}: {name} has {len(positions)} positions; three are needed to see a shape",
            fault="too_few",
            aspect="positions",
        )
    uncertainty = [
        max(own[position].uncertainty for own in table.values()) for position in positions
    ]
    known = [all(math.isfinite(own[p].uncertainty) for own in table.values()) for p in positions]
    return DirectCurve(
        name=name,
        positions=np.array(positions),
        values=np.array(
            [[table[repeat][position].value for position in positions] for repeat in sorted(table)]
        ),
        stated_uncertainty=np.where(known, uncertainty, np.nan),
        place=_one_place(values, source),
    )


def _squareness(values: list[_Value], source: str) -> DirectSquareness:
    name = values[0].name
    seen: dict[int, int] = {}
    for value in values:
        if value.repeat in seen:
            raise Refusal(
                f"{source}, row {value.row}: {name} in repeat {value.repeat} appears already in"
                f" row {seen[value.repeat]}",
                fault="twice",
            )
        seen[value.repeat] = value.row
    uncertainties = [value.uncertainty for value in values]
    known = all(math.isfinite(value) for value in uncertainties)
    return DirectSquareness(
        name=name,
        values=np.array([value.value for value in sorted(values, key=lambda one: one.repeat)]),
        stated_uncertainty=max(uncertainties) if known else math.nan,
        place=_one_place(values, source),
    )
