"""Mapping files: what the columns of somebody else's table mean (YAML, see config/imports)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from stepdiag_ros.bags.case import facts_of
from stepdiag_ros.bags.table_rows import ENVIRONMENT_COLUMNS
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES, STEP_ORDERS
from stepdiag_ros.metrology.machine import told_rotations
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    COURSE_KEYS,
    FORWARD,
    LARGEST_OVERRUN,
    LINE_NAMES,
    Volume,
)
from stepdiag_ros.metrology.refusal import Refusal

AXIS, LINES, READINGS = "axis", "lines", "readings"
TABLES = (AXIS, LINES, READINGS)

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9, "in": 25.4e-3}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0}
_TEMPERATURES = {"degC": (1.0, 0.0), "K": (1.0, -273.15), "degF": (5.0 / 9.0, -160.0 / 9.0)}
AIR_UNITS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "air_temperature_degC": _TEMPERATURES,
    "air_pressure_Pa": {
        "Pa": (1.0, 0.0),
        "hPa": (100.0, 0.0),
        "mbar": (100.0, 0.0),
        "kPa": (1000.0, 0.0),
        "mmHg": (133.322387415, 0.0),
    },
    "relative_humidity": {"ratio": (1.0, 0.0), "percent": (0.01, 0.0)},
    "material_temperature_degC": _TEMPERATURES,
}
"""Column → unit → factor and what is added, to the unit of the run table; its first unit if none is
stated."""
DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "spaces": " "}
"""Name in a mapping file → the sign between two cells."""

_COLUMNS = {
    AXIS: ("target", "deviation", "position", "run", "direction", "time"),
    LINES: (
        "line",
        "order",
        "run",
        "direction",
        "stop",
        "reading",
        "deviation",
        "time",
        "x",
        "y",
        "z",
        "setup",
        "attempt",
        "overrun",
        "uncertainty",
        *ENVIRONMENT_COLUMNS,
    ),
    READINGS: ("time", "reading"),
}
_UNITS = {
    "target": LENGTHS,
    "deviation": LENGTHS,
    "position": LENGTHS,
    "reading": LENGTHS,
    "x": LENGTHS,
    "y": LENGTHS,
    "z": LENGTHS,
    "overrun": LENGTHS,
    "uncertainty": LENGTHS,
    "time": TIMES,
}


@dataclass(frozen=True)
class RunColumn:
    """One column that holds a whole run of an axis: its name, direction, and number of the run."""

    column: str
    direction: str
    run: int


@dataclass(frozen=True)
class TableMapping:
    """What a mapping file says; see ``config/imports`` for each key in words.

    Attributes:
        table: one of ``TABLES``.
        encoding: of the text.
        delimiter: between cells; a space for any number of spaces and tabs.
        decimal: sign in numbers.
        skip_rows: lines before the names of the columns, or before the data.
        header: a line with the names of the columns stands before the data.
        end: a line that begins with this ends the data; empty if they go on to the end.
        rejected: what stands for the reading of a stop that was rejected; None if nothing does.
        columns: meaning → name of the column, or its number from 1 as text.
        runs: columns that hold a whole run each.
        ignored: names of columns that nothing is taken from.
        units: meaning → factor to SI.
        air_units: column of air or material → its entry of ``AIR_UNITS``.
        sign: 1, or -1 where the file's sign of readings or deviations is the other way round.
        words: word of the file, in small letters → direction.
        axis: X, Y or Z; empty if the user has to say it.
        standing: machine coordinates of the axes that stand, m; None if not known.
        overrun: how far beyond its first target each run along an axis was begun, m; 0 if it was
            not, NaN if that is not known.
        step_overrun: the same of step diagonals, along the diagonal, m; NaN: 0 if ``overrun`` is
            0, else unknown.
        volume: of the lines; None for other tables.
        line: name of the line where no column states it.
        order: of the moves of a step diagonal where no column states it.
        direction: of all rows where no column states it.
        plan: keys of a plan file that hold for the lines (``COURSE_KEYS``), as they stand there.
        chain: order of the axes from workpiece to tool; empty if not known.
        rotations: plausible size of the axes' rotations, rad (``metrology.plausible``); None if
            unknown.
        compensated: the readings are compensated for the air.
        environment: that held during the whole measurement.
        facts: name → text.
        text: of the file.
    """

    table: str
    encoding: str
    delimiter: str
    decimal: str
    skip_rows: int
    header: bool
    end: str
    rejected: str | None
    columns: Mapping[str, str]
    runs: tuple[RunColumn, ...] = ()
    ignored: tuple[str, ...] = ()
    units: Mapping[str, float] = field(default_factory=dict)
    air_units: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sign: float = 1.0
    words: Mapping[str, str] = field(default_factory=dict)
    axis: str = ""
    standing: tuple[float, float, float] | None = None
    overrun: float = math.nan
    step_overrun: float = math.nan
    volume: Volume | None = None
    line: str = ""
    order: str = ""
    direction: str = ""
    plan: Mapping[str, Any] = field(default_factory=dict)
    chain: str = ""
    rotations: float | None = None
    compensated: bool = False
    environment: Environment = field(default_factory=Environment)
    facts: Mapping[str, str] = field(default_factory=dict)
    text: str = ""


def mapping_of(parsed: Any, source: str, text: str) -> TableMapping:
    """Make a mapping from parsed YAML.

    Args:
        parsed: the mapping.
        source: what the user calls the file.
        text: of the file.

    Raises:
        ValueError: names the file, the key, what is wrong and what is expected.
    """
    top = Section(parsed, source)
    if "table" not in parsed and "blocks" in parsed:
        raise Refusal(
            f"{source} describes the run of a run table, not columns: give it as --case, without"
            " --mapping",
            fault="wrong_kind",
            aspect="case",
        )
    table = top.names("table", TABLES)[0]
    layout = top.section("text")
    columns = _columns(top, table)
    runs = _runs(top) if table == AXIS and "runs" in top.keys() else ()  # noqa: SIM118
    given: dict[str, Any] = {
        "encoding": layout.text("encoding", default="utf-8-sig"),
        "delimiter": DELIMITERS[layout.names("delimiter", tuple(DELIMITERS), default="comma")[0]],
        "decimal": {"point": ".", "comma": ","}[
            layout.names("decimal", ("point", "comma"), default="point")[0]
        ],
        "skip_rows": layout.integer("skip_rows", low=0, high=100000, default=0),
        "header": layout.flag("header", default=True),
        "end": layout.text("end", default=""),
        "rejected": layout.text("rejected") if _has(layout, "rejected") else None,
    }
    layout.finish()
    if given["delimiter"] == "," and given["decimal"] == ",":
        raise Refusal(
            f"{source}: text: a comma cannot be both delimiter and decimal sign. Change one of"
            " them",
            fault="mismatch",
        )
    made = TableMapping(
        table=table,
        columns=columns,
        runs=runs,
        ignored=top.texts("ignored", default=()),
        **_units(top, columns, runs),
        sign=float(top.integer("sign", low=-1, high=1, default=1)),
        words=_words(top),
        chain="".join(top.names("chain", AXES, default=AXES)) if _has(top, "chain") else "",
        rotations=told_rotations(top),
        environment=_environment(top),
        facts=facts_of(top),
        text=text,
        **given,
        **_of_table(top, table),
    )
    top.finish()
    if made.sign == 0.0:
        raise Refusal(f"{source}: 'sign' is 0; expected 1 or -1", fault="out_of_range")
    _check_columns(made, source)
    return made


def _has(section: Section, key: str) -> bool:
    return key in section.keys()  # noqa: SIM118


def _columns(top: Section, table: str) -> dict[str, str]:
    section = top.section("columns")
    made = {}
    for name in section.keys():  # noqa: SIM118
        if name not in _COLUMNS[table]:
            known = ", ".join(_COLUMNS[table])
            raise Refusal(
                f"{section.source}: unknown column '{name}'; there are {known}", fault="unknown"
            )
        made[name] = _column(section, name)
    section.finish()
    return made


def _column(section: Section, key: str) -> str:
    """Return the name of a column, or its number from 1 as text."""
    try:
        return str(section.integer(key, low=1, high=10000))
    except ValueError:
        return section.text(key)


def _runs(top: Section) -> tuple[RunColumn, ...]:
    made = []
    for section in top.sections("runs"):
        made.append(
            RunColumn(
                column=_column(section, "column"),
                direction=section.names("direction", (FORWARD, BACKWARD))[0],
                run=section.integer("run", low=0, high=9999),
            )
        )
        section.finish()
    return tuple(made)


def _units(top: Section, columns: Mapping[str, str], runs: tuple[RunColumn, ...]) -> dict[str, Any]:
    section = top.section("units")
    needed = [name for name in columns if name in _UNITS]
    if runs:
        needed.append("deviation")
    for name in section.keys():  # noqa: SIM118
        if name in {*_UNITS, *AIR_UNITS} - {*needed, *columns}:
            raise Refusal(
                f"{section.source}: '{name}' has a unit, but no column. State the column under"
                " 'columns'",
                fault="missing",
                about=name,
            )
    units = {name: _UNITS[name][section.names(name, tuple(_UNITS[name]))[0]] for name in needed}
    air = {
        name: known[section.names(name, tuple(known), default=next(iter(known)))[0]]
        for name, known in AIR_UNITS.items()
        if name in columns
    }
    section.finish()
    return {"units": units, "air_units": air}


def _words(top: Section) -> dict[str, str]:
    section = top.section("directions")
    made = {FORWARD: FORWARD, BACKWARD: BACKWARD}
    for direction in (FORWARD, BACKWARD):
        if _has(section, direction):
            word = section.text(direction).strip().lower()
            if word in made and made[word] != direction:
                raise Refusal(
                    f"{section.source}: '{word}' stands for both directions", fault="twice"
                )
            made[word] = direction
    section.finish()
    return made


def _environment(top: Section) -> Environment:
    section = top.section("environment")
    unknown = float("nan")

    def value(key: str, low: float, high: float) -> float:
        return unknown if section.unknown(key) else section.number(key, low, high)

    made = Environment(
        air_temperature=value("air_temperature_degC", -50.0, 100.0),
        air_pressure=value("air_pressure_Pa", 20e3, 130e3),
        relative_humidity=value("relative_humidity", 0.0, 1.0),
        material_temperature=value("material_temperature_degC", -50.0, 100.0),
    )
    section.finish()
    return made


def _overrun(top: Section, key: str = "overrun_m") -> float:
    return math.nan if top.unknown(key) else top.number(key, 0.0, LARGEST_OVERRUN)


def _plan(top: Section) -> dict[str, Any]:
    """Return the mapping's keys of the plan; the code that makes the plan checks the values."""
    section = top.section("plan")
    if _has(section, "overrun_m"):
        raise Refusal(
            f"{section.source}: 'overrun_m' stands beside 'plan', not in it", fault="mismatch"
        )
    section.flag("one_alignment_per_diagonal", default=False)
    made = section.given(COURSE_KEYS)
    section.finish()
    return made


def _of_table(top: Section, table: str) -> dict[str, Any]:
    """Return the keys that one kind of table has."""
    if table == AXIS:
        standing = top.vector("standing_m") if _has(top, "standing_m") else None
        axis = top.names("axis", AXES)[0] if _has(top, "axis") else ""
        return {"standing": standing, "axis": axis, "overrun": _overrun(top)}
    if table == READINGS:
        return {"compensated": top.flag("compensated")}
    box = top.section("volume")
    volume = Volume(
        origin=box.vector("origin_m"),
        step=box.vector("step_m", low=1e-6, high=10.0),
        blocks=box.integer("blocks", low=1, high=1000),
    )
    box.finish()
    made: dict[str, Any] = {"volume": volume, "overrun": _overrun(top), "plan": _plan(top)}
    made["step_overrun"] = _overrun(top, "overrun_of_step_diagonals_m")
    names = sorted({name for of_kind in LINE_NAMES.values() for name in of_kind})
    for key, known in (
        ("line", tuple(names)),
        ("order", STEP_ORDERS),
        ("direction", (FORWARD, BACKWARD)),
    ):
        made[key] = top.names(key, known)[0] if _has(top, key) else ""
    return made


def _check_columns(made: TableMapping, source: str) -> None:
    """Refuse a mapping that is incomplete or states a value twice."""

    def one_of(*names: str) -> None:
        found = [name for name in names if name in made.columns]
        if len(found) != 1:
            words = " or ".join(f"'{name}'" for name in names)
            raise Refusal(f"{source}: columns: exactly one of {words} is needed", fault="missing")

    if made.table == AXIS:
        one_of("target")
        if made.runs:
            for name in ("deviation", "position", "run", "direction", "time"):
                if name in made.columns:
                    raise Refusal(
                        f"{source}: columns: '{name}' does not go with 'runs', which has a column"
                        " for each run",
                        fault="mismatch",
                    )
        else:
            one_of("deviation", "position")
    elif made.table == LINES:
        one_of("reading", "deviation")
        if len({"x", "y", "z"}.intersection(made.columns)) not in (0, 3):
            raise ValueError(f"{source}: columns: x, y and z go together")
        if not made.line:
            one_of("line")
        for name in ("line", "order", "direction"):
            if getattr(made, name) and name in made.columns:
                raise Refusal(
                    f"{source}: '{name}' is given twice: by a column and for all rows. Remove one"
                    " of them",
                    fault="twice",
                )
    else:
        one_of("time")
        one_of("reading")
    if not made.header:
        named = [*made.columns.values(), *(run.column for run in made.runs)]
        for name in named:
            if not name.isdigit():
                raise Refusal(
                    f"{source}: without a header the columns are numbers from 1, not '{name}'",
                    fault="malformed",
                )
