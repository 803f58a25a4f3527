"""From single deviations to the lines of a test of an axis or a diagonal; refuses contradictions.

Every format that holds such a test (ISO 230-2, ISO 230-6) comes through here: the targets may lie
anywhere along the axis or the diagonal, and every run has each of them once.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from stepdiag_ros.bags.deviation_check import Deviation, check_deviations
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports.imported import Imported, ImportOptions
from stepdiag_ros.bags.imports.placing import DIAGONALS, Placed, placed
from stepdiag_ros.bags.table_plan import plan_mapping, yaml_text
from stepdiag_ros.bags.table_rows import refusal
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.measurement import Environment, MeasuredLine
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD
from stepdiag_ros.metrology.units import NANOSECONDS

SAME, ALTERNATING = "same", "alternating"
MOST_TARGETS = 1001
LONGEST = 100.0
OVERRUN_UNDETERMINED = (
    "the file does not state whether runs began beyond their first target, so the diagnosis uses"
    " no stop of a run before an axis's first move for the reversal error; B and mean B of ISO"
    " 230-2 contain all targets, and may be too small at the ends (state the distance with"
    " --overrun M; 0: they did not)"
)


class AxisRow(NamedTuple):
    """One deviation in a file.

    Attributes:
        row: line of the file.
        run: as the file counts them.
        target: commanded position, m.
        deviation: measured less commanded position, m.
        direction: ``forward`` or ``backward``; empty where the order of the rows determines it.
        time: s since the start of the test; NaN if not known.
    """

    row: int
    run: int
    target: float
    deviation: float
    direction: str = ""
    time: float = float("nan")


class _Run(NamedTuple):
    direction: str
    rows: tuple[AxisRow, ...]


def axis_name(told: str, options: ImportOptions, source: str) -> str:
    """Return which axis or diagonal was tested, one of ``placing.TESTED``.

    Args:
        told: by the file, for example ``X``, ``X-Axis`` or ``npp``; empty if nothing.
        options: of the user; they take precedence.
        source: of the file, for the text of an error.

    Raises:
        TableError: nobody says it.
    """
    if options.axis:
        return options.axis
    words = told.upper().replace("-", " ").replace("_", " ").replace(":", " ").split()
    found = {word for word in words if word in AXES}
    found |= {word[0] for word in words if len(word) == 2 and word[0] in AXES and word[1].isdigit()}
    found |= {word.lower() for word in words if word.lower() in DIAGONALS}
    if len(found) != 1:
        said = f"the file calls the axis '{told}'" if told else "the file does not name the axis"
        raise TableError(
            f"{source}: {said}; state it: --axis X, Y or Z, or the name of a diagonal (ppp, npp …)",
            fault="unknown",
            aspect="axis",
        )
    return found.pop()


def axis_test(
    source: str,
    format_name: str,
    axis: str,
    rows: Sequence[AxisRow],
    options: ImportOptions,
    environment: Environment | None = None,
    facts: Mapping[str, str] | None = None,
    remarks: Sequence[str] = (),
    further: Mapping[str, str] | None = None,
) -> Imported:
    """Make the lines of a test of one axis or diagonal.

    Args:
        source: of the file, for the text of an error.
        format_name: of the file, in words.
        axis: X, Y, Z or the name of a diagonal.
        rows: in the order of the file.
        options: of the user.
        environment: during the test; unknown if None.
        facts: that the file states.
        remarks: of the importer.
        further: files that the import was made with.

    Raises:
        TableError: runs are incomplete, doubled or out of order, their directions are not known, or
            the numbers have another unit; names file and row.
    """
    runs = _runs(source, rows, options.directions)
    targets = np.array(sorted({row.target for run in runs for row in run.rows}))
    _check_reach(source, targets)
    _check(source, runs, targets)
    where = placed(source, axis, targets, options)
    directions = list(dict.fromkeys(run.direction for run in runs))
    said = [*remarks, *where.remarks]
    if math.isnan(options.overrun) and len(directions) > 1:
        said.append(OVERRUN_UNDETERMINED)
    group: dict[str, object] = {"kind": where.line.kind, "names": [where.line.name]}
    if any(where.line.offset):
        group["offset_m"] = list(where.line.offset)
    group["repeats"] = max(_count(runs, direction) for direction in directions)
    group["directions"] = directions
    begun = {"overrun_m": options.overrun} if math.isfinite(options.overrun) else {}
    plan = plan_mapping(f"imported: positioning of {axis}", where.volume, [group], begun)
    return Imported(
        format=format_name,
        volume=where.volume,
        plan_text=yaml_text(plan),
        lines=_lines(
            runs, where, targets, directions, environment or Environment(), options.overrun
        ),
        facts=dict(facts or {}),
        remarks=tuple(said),
        further=dict(further or {}),
    )


def _count(runs: Sequence[_Run], direction: str) -> int:
    return sum(run.direction == direction for run in runs)


def _runs(source: str, rows: Sequence[AxisRow], directions: str) -> list[_Run]:
    """Group rows into runs in the order of the file, each in the order of its measurement."""
    if not rows:
        raise TableError(f"{source} has no deviations, so it contains no measurement")
    groups: dict[tuple[int, str], list[AxisRow]] = {}
    for row in rows:
        groups.setdefault((row.run, row.direction), []).append(row)
    senses = [_sense(source, group) for group in groups.values()]
    told = all(row.direction for row in rows)
    if not told and len(groups) > 1 and len(set(senses)) == 1:
        if not directions:
            raise TableError(
                f"{source}: all {len(groups)} runs list their targets in the same order. This"
                " leaves open whether every second run was measured in the opposite direction."
                f" State it: --directions {SAME} or {ALTERNATING}",
                fault="ambiguous",
            )
        if directions == ALTERNATING:
            senses = [-sense if place % 2 else sense for place, sense in enumerate(senses)]
    made = []
    for ((_, direction), group), sense in zip(groups.items(), senses, strict=True):
        way = direction or (FORWARD if sense > 0 else BACKWARD)
        ordered = sorted(group, key=lambda row: row.target, reverse=way == BACKWARD)
        made.append(_Run(way, tuple(ordered)))
    return made


def _sense(source: str, group: Sequence[AxisRow]) -> int:
    """Return 1 if the targets of a run ascend, -1 if they descend."""
    seen: dict[float, int] = {}
    for row in group:
        if row.target in seen:
            raise refusal(
                source,
                row.row,
                f"target {1e3 * row.target:g} mm appears twice in run {row.run}, first in row"
                f" {seen[row.target]}",
                fault="twice",
            )
        seen[row.target] = row.row
    if len(group) < 2:
        raise refusal(
            source, group[0].row, f"run {group[0].run} has a single target; two are needed"
        )
    sense = 1 if group[1].target > group[0].target else -1
    for before, row in pairwise(group):
        if (row.target - before.target) * sense < 0:
            raise refusal(
                source,
                row.row,
                f"the targets of run {row.run} turn back from {1e3 * before.target:g} mm to"
                f" {1e3 * row.target:g} mm; check the order of the rows",
                fault="out_of_order",
            )
    return sense


def _check(source: str, runs: Sequence[_Run], targets: Vector) -> None:
    length = float(targets[-1] - targets[0])
    known = set(targets)
    for run in runs:
        missing = sorted(known - {row.target for row in run.rows})
        if missing:
            raise refusal(
                source,
                run.rows[-1].row,
                f"run {run.rows[0].run} ({run.direction}) has no target {1e3 * missing[0]:g} mm;"
                " the file may be cut off. Complete the run or leave it out",
                fault="missing",
            )
        found = [Deviation(row.row, row.target, row.deviation) for row in run.rows]
        check_deviations(source, found, length)
        times = [row.time for row in run.rows]
        for row, before, after in zip(run.rows[1:], times, times[1:], strict=False):
            if after < before:
                raise refusal(
                    source,
                    row.row,
                    f"time goes back from {before:g} s to {after:g} s along the"
                    f" {run.direction} run {row.run}",
                )


def _check_reach(source: str, targets: Vector) -> None:
    if len(targets) > MOST_TARGETS:
        raise TableError(f"{source} has {len(targets)} targets; {MOST_TARGETS} are the most")
    length = float(targets[-1] - targets[0])
    if not 1e-4 <= length <= LONGEST or np.max(np.abs(targets)) > LONGEST:
        raise TableError(
            f"{source}: the targets reach from {1e3 * targets[0]:g} mm to {1e3 * targets[-1]:g} mm;"
            " check their unit",
            fault="out_of_range",
        )


def _lines(
    runs: Sequence[_Run],
    where: Placed,
    targets: Vector,
    directions: Sequence[str],
    environment: Environment,
    overrun: float,
) -> tuple[MeasuredLine, ...]:
    place_of = {float(target): place for place, target in enumerate(targets)}
    zero = where.along[place_of[runs[0].rows[0].target]]
    repeats = dict.fromkeys(directions, 0)
    made = []
    for number, run in enumerate(runs):
        line = replace(where.line, repeat=repeats[run.direction], direction=run.direction)
        repeats[run.direction] += 1
        stops = [place_of[row.target] for row in run.rows]
        # Deviations keep the zero that the file gives them: a reader finds its figures again.
        reading = [
            (where.along[stop] - zero) + row.deviation
            for stop, row in zip(stops, run.rows, strict=True)
        ]
        time = np.array([row.time for row in run.rows])
        known = bool(np.all(np.isfinite(time)))
        made.append(
            MeasuredLine(
                line=line,
                line_index=line.repeat * len(directions) + directions.index(line.direction),
                attempt=1,
                setup=line.setup,
                time=time,
                # Where no time is told, the lines keep their order: one nanosecond each.
                end_time=round(time[-1] * NANOSECONDS) if known else number,
                target=where.positions[stops],
                displacement=np.array(reading),
                standard_uncertainty=np.full(len(run.rows), np.nan),
                environment=np.tile(np.array(environment, dtype=np.float64), (len(run.rows), 1)),
                overrun=overrun,
            )
        )
    return tuple(made)
