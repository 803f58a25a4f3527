"""A run as a run table and its case file: the way back of ``bags.table``.

The documented columns and keys are written always. What an import cannot derive from them alone
(another setup, an overrun, a rejected stop, the rest of the plan …) stands in optional columns and
keys, and only then.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isnan
from operator import attrgetter
from typing import Any

import numpy as np

from stepdiag_ros.bags.case import FACTS, SIMULATED_CELL, Case, is_assumed_name
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.bags.table_plan import planned_lines
from stepdiag_ros.bags.table_rows import (
    COLUMNS,
    OPTIONAL_COLUMNS,
    SETTLED,
    PassColumns,
    PassKey,
    TableRow,
)
from stepdiag_ros.metrology.checking import UNKNOWN
from stepdiag_ros.metrology.measurement import Environment, MeasuredLine, latest_attempts
from stepdiag_ros.metrology.plan import COURSE_KEYS, Line
from stepdiag_ros.metrology.plausible import ROTATIONS_KEY, size_of
from stepdiag_ros.text.intake import parse_yaml

TABLE_NAME = "run"
_FARTHEST = 1000.0
"""m: no dead path is as long."""
_LINES = ("lines", "repeats", "directions")
"""Keys of a plan file that say which lines there are."""
_FIELDS = {
    "line_index": "line_index",
    "attempt": "attempt",
    "setup": "setup",
    "overrun_m": "overrun",
    "mirror_offset_m": "line.mirror_offset",
    "standard_uncertainty_m": "standard_uncertainty",
}
"""Optional column → field of a measured line."""


@dataclass(frozen=True)
class WrittenTable:
    """A run table and its case file.

    Attributes:
        columns: of the table.
        rows: of the table; every one has a value for each column.
        case: contents of the case file.
        refused: why the table cannot be imported again; empty if it can.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    case: Case
    refused: str = ""


def run_table_of(run: RecordedRun) -> WrittenTable:
    """Return the run table of the last attempt at each line, in the order of measurement.

    Args:
        run: with at least one line.
    """
    lines = _in_order(latest_attempts(run.lines))
    plan = parse_yaml(run.plan_text, f"{run.path}: plan")
    plain = _case(run, lines, plan)
    whole = replace(plain, plan={**plain.plan, **{key: plan[key] for key in _LINES if key in plan}})
    refused = ""
    for case in (plain, whole):
        columns = _needed(lines, case)
        try:
            found, planned = _imported(lines, case, columns)
        except TableError as error:
            refused = str(error)
            continue
        if planned == run.plan.lines and not _differing(lines, found):
            return WrittenTable((*COLUMNS, *columns), _rows_of(lines, columns), case)
    return WrittenTable((*COLUMNS, *columns), _rows_of(lines, columns), whole, refused)


def _in_order(lines: tuple[MeasuredLine, ...]) -> tuple[MeasuredLine, ...]:
    """Return the lines in the order of measurement."""
    timed = all(np.isfinite(line.time[0]) for line in lines)
    return tuple(sorted(lines, key=lambda one: float(one.time[0]) if timed else one.end_time))


def _case(run: RecordedRun, lines: Sequence[MeasuredLine], plan: Mapping[str, Any]) -> Case:
    """Return what a case file says of a run, without the ``lines`` of the plan."""
    known = {key: plan[key] for key in COURSE_KEYS if key in plan and key not in _LINES}
    # What an import would write into the plan by itself.
    assumed = {"name": f"imported from {TABLE_NAME}.csv", "feed_m_per_s": UNKNOWN}
    machine = run.machine
    noises = {float(value) for line in lines for value in line.standard_uncertainty}
    dead_path = machine.get("dead_path_m", float("nan"))
    if not isinstance(dead_path, int | float) or not abs(dead_path) < _FARTHEST:
        dead_path = float("nan")
    name = machine.get("name", "")
    told = {one: run.told_by_source[one] for one in FACTS if one in run.told_by_source}
    if isinstance(name, str) and name and not is_assumed_name(name):
        told = {"machine": name, **told}
    if run.simulated_cell:  # what was simulated must not come back as measured
        told = {**told, SIMULATED_CELL: run.simulated_cell}
    return Case(
        chain=run.chain,
        rotations=size_of(machine[ROTATIONS_KEY]) if ROTATIONS_KEY in machine else None,
        volume=run.volume,
        dead_path=float(dead_path),
        reading_noise=noises.pop() if len(noises) == 1 else float("nan"),
        mirror_on=str(machine.get("mirror_on", "")),
        laser_on=str(machine.get("laser_on", "")),
        plan={key: value for key, value in known.items() if assumed.get(key) != value},
        facts=told,
    )


def _imported(
    lines: Sequence[MeasuredLine], case: Case, columns: Sequence[str] = ()
) -> tuple[tuple[MeasuredLine, ...], tuple[Line, ...]]:
    """Return what an import makes of the lines and of the plan.

    Args:
        lines: in the order of the table.
        case: beside the table.
        columns: optional ones that the table has.

    Raises:
        TableError: it would refuse the table.
    """
    source = f"{TABLE_NAME}.csv"
    rows = list(_rows(lines, columns))
    found = planned_lines(f"imported from {source}", rows, case, case.overrun, source)
    return found.lines, found.plan.lines


def _rows(lines: Sequence[MeasuredLine], columns: Sequence[str]) -> Iterator[TableRow]:
    number = 1
    for line in lines:
        which = line.line
        told = PassColumns(
            line_index=line.line_index if "line_index" in columns else None,
            attempt=line.attempt if "attempt" in columns else None,
            setup=line.setup if "setup" in columns else None,
            overrun=line.overrun if "overrun_m" in columns else None,
            mirror_offset=which.mirror_offset if "mirror_offset_m" in columns else None,
        )
        for stop, time in enumerate(line.time):
            number += 1
            x, y, z = (float(value) for value in line.target[stop])
            uncertainty = float(line.standard_uncertainty[stop])
            yield TableRow(
                number=number,
                time=float(time),
                which=PassKey(which.kind, which.name, which.order, which.repeat, which.direction),
                stop=stop,
                position=(x, y, z),
                reading=float(line.displacement[stop]),
                environment=Environment(*(float(value) for value in line.environment[stop])),
                told=told,
                standard_uncertainty=uncertainty if "standard_uncertainty_m" in columns else None,
            )


def _needed(lines: Sequence[MeasuredLine], case: Case) -> tuple[str, ...]:
    """Return the optional columns without which an import would not find the same lines."""
    try:
        found, _ = _imported(lines, case)
    except TableError:
        return OPTIONAL_COLUMNS
    needed = _differing(lines, found)
    if not all(line.complete for line in lines):
        needed.add("settled")
    return tuple(name for name in OPTIONAL_COLUMNS if name in needed)


def _differing(lines: Sequence[MeasuredLine], found: Sequence[MeasuredLine]) -> set[str]:
    """Return the optional columns that state how the lines differ from those found."""
    if len(lines) != len(found):
        return set(OPTIONAL_COLUMNS)
    pairs = list(zip(lines, found, strict=True))
    return {
        column
        for column, name in _FIELDS.items()
        for one, other in pairs
        if not _equal(*map(attrgetter(name), (one, other)))
    }


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, str):
        return bool(one == other)
    return np.array_equal(one, other, equal_nan=True)


def _rows_of(lines: Sequence[MeasuredLine], columns: Sequence[str]) -> tuple[tuple[Any, ...], ...]:
    return tuple(
        tuple(cells[name] for name in (*COLUMNS, *columns))
        for line in lines
        for cells in (_cells(line, stop) for stop in range(len(line.time)))
    )


def _cells(line: MeasuredLine, stop: int) -> dict[str, Any]:
    which = line.line
    values = (
        line.time[stop],
        which.kind,
        which.name,
        which.order,
        which.repeat,
        which.direction,
        stop,
        *line.target[stop],
        line.displacement[stop],
        *line.environment[stop],
    )
    return {
        **dict(zip(COLUMNS, values, strict=True)),
        "line_index": line.line_index,
        "attempt": line.attempt,
        "setup": line.setup,
        "overrun_m": line.overrun,
        "mirror_offset_m": " ".join(map(repr, which.mirror_offset)),
        "standard_uncertainty_m": line.standard_uncertainty[stop],
        "settled": SETTLED[int(isnan(line.displacement[stop]))],
    }
