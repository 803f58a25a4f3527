"""The plan that a run table was measured by, and the table's passes as lines of that plan.

The case file takes precedence; the table supplies what the case file does not state.
"""

from collections.abc import Mapping, Sequence
from itertools import groupby, product
from typing import Any, NamedTuple

import numpy as np
import yaml

from stepdiag_ros.bags.case import Case
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.table_lines import TableSetup, passes_of, setups_of, volume_of
from stepdiag_ros.bags.table_rows import TableRow, refusal
from stepdiag_ros.metrology.checking import UNKNOWN
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import COURSE_KEYS, STEP_DIAGONAL, Line, Plan, Volume
from stepdiag_ros.metrology.refusal import fields_of
from stepdiag_ros.metrology.units import NANOSECONDS


class _Pass(NamedTuple):
    setup: str
    line: Line
    stops: tuple[TableRow, ...]


def plan_mapping(
    name: str,
    volume: Volume,
    groups: Sequence[Mapping[str, Any]],
    told: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return a plan, as its file has it, that measures lines of which the result is at hand.

    Args:
        name: of the plan, in words.
        volume: the measured box.
        groups: the plan's ``lines``, as a plan file has them.
        told: keys of a plan file that are known (``COURSE_KEYS``); they take precedence.
    """
    course = {"name": name, "feed_m_per_s": UNKNOWN, "lines": list(groups), **(told or {})}
    box = {
        "origin_m": list(volume.origin),
        "step_m": list(volume.step),
        "blocks": volume.blocks,
    }
    ordered = {key: course[key] for key in COURSE_KEYS if key in course}
    return {"name": ordered.pop("name"), **box, **ordered}


def yaml_text(mapping: Mapping[str, Any]) -> str:
    """Return a mapping as YAML."""
    return str(yaml.safe_dump(dict(mapping), sort_keys=False, default_flow_style=None))


class PlannedLines(NamedTuple):
    """What the rows of a table come to.

    Attributes:
        plan: that the lines were measured by.
        text: of the plan, YAML.
        lines: measured, in the order of the table.
        setups: number of setups.
    """

    plan: Plan
    text: str
    lines: tuple[MeasuredLine, ...]
    setups: int


def planned_lines(
    name: str,
    rows: list[TableRow],
    case: Case,
    overrun: float,
    source: str,
    step_overrun: float = 0.0,
) -> PlannedLines:
    """Return the lines in the rows of a table, and the plan that they were measured by.

    Args:
        name: of the plan, where the case does not state it.
        rows: of the table.
        case: what is known beside it.
        overrun: how far beyond its first stop each line but a step diagonal was begun, m; NaN if
            that is not known. A column of the table goes before it.
        source: of the table, for the text of an error.
        step_overrun: the same of step diagonals, along the diagonal.

    Raises:
        TableError: rows contradict each other, the box or the plan, or the case says something of
            the plan that no plan can have; names the row or the key.
    """
    passes = passes_of(rows, source)
    volume = case.volume or volume_of(passes, source)
    together = case.one_alignment_per_diagonal
    told = "lines" in case.plan
    plan = _plan(plan_mapping(name, volume, (), case.plan), case) if told else None
    setups = setups_of(passes, volume, source, together, plan.lines if plan else ())
    groups = _groups(setups, together)
    mapping = plan_mapping(name, volume, [group.entry() for group in groups], case.plan)
    plan = plan or _plan(mapping, case)
    found = [_Pass(one.identity, line, stops) for one in setups for line, stops in one.lines]
    places = (
        _places_in_plan(found, plan, source) if told else _places_in_groups(groups, found, source)
    )
    lines = tuple(
        _measured(
            one,
            place,
            case.reading_noise,
            step_overrun if one.line.kind == STEP_DIAGONAL else overrun,
        )
        for one, place in zip(found, places, strict=True)
    )
    return PlannedLines(plan, yaml_text(mapping), lines, len(setups))


def _plan(mapping: Mapping[str, Any], case: Case) -> Plan:
    try:
        return Plan.from_mapping(mapping, case.source or "the plan of the table")
    except ValueError as error:
        raise TableError(str(error), **fields_of(error)) from None


def _measured(one: _Pass, index: int, reading_noise: float, overrun: float) -> MeasuredLine:
    told, stops = one.stops[0].told, one.stops
    return MeasuredLine(
        line=one.line,
        line_index=index,
        attempt=told.attempt or 1,
        setup=one.setup,
        time=np.array([row.time for row in stops]),
        end_time=_end_time(stops[-1]),
        target=np.array([row.position for row in stops]),
        displacement=np.array([row.reading for row in stops]),
        standard_uncertainty=np.array(
            [
                reading_noise if row.standard_uncertainty is None else row.standard_uncertainty
                for row in stops
            ]
        ),
        environment=np.array([row.environment for row in stops], dtype=np.float64),
        overrun=overrun if told.overrun is None else told.overrun,
    )


def _end_time(last: TableRow) -> int:
    # Where no time is known (imported tables), lines keep their order: a nanosecond for each row.
    return round(last.time * NANOSECONDS) if np.isfinite(last.time) else last.number


class _Group(NamedTuple):
    """Lines that one entry of a plan's ``lines`` describes: what one setup has of one line."""

    lines: tuple[Line, ...]

    @property
    def orders(self) -> list[str]:
        return list(dict.fromkeys(line.order for line in self.lines))

    @property
    def repeats(self) -> int:
        return 1 + max(line.repeat for line in self.lines)

    @property
    def directions(self) -> list[str]:
        return list(dict.fromkeys(line.direction for line in self.lines))

    def ways(self) -> list[tuple[str, int, str]]:
        """Return order, repeat and direction of the lines that the plan makes of the entry."""
        return list(product(self.orders, range(self.repeats), self.directions))

    def entry(self) -> dict[str, object]:
        """Return the entry of the plan."""
        first = self.lines[0]
        made: dict[str, object] = {"kind": first.kind, "names": [first.name]}
        if first.order:
            made["orders"] = self.orders
        if any(first.offset):
            made["offset_m"] = list(first.offset)
        if any(first.mirror_offset):
            made["mirror_offset_m"] = list(first.mirror_offset)
        return {**made, "repeats": self.repeats, "directions": self.directions}


def _groups(setups: Sequence[TableSetup], one_alignment: bool) -> list[_Group]:
    def family(line: Line) -> tuple[object, ...]:
        together = one_alignment and line.kind == STEP_DIAGONAL
        order = "" if together else line.order
        return line.kind, line.name, line.offset, line.mirror_offset, order

    return [
        _Group(tuple(lines))
        for setup in setups
        for _, lines in groupby((line for line, _ in setup.lines), key=family)
    ]


def _places_in_groups(groups: Sequence[_Group], passes: Sequence[_Pass], source: str) -> list[int]:
    """Return the places of the passes in the plan whose ``lines`` are these groups."""
    for one in passes:
        if one.stops[0].told.line_index is not None:
            raise refusal(
                source,
                one.stops[0].number,
                "'line_index' counts the lines of a plan, but no plan is given. Copy the 'lines'"
                " of the plan into a case.yaml beside the table, or leave the column out",
                fault="undetermined",
            )
    places: list[int] = []
    begin = 0
    for group in groups:
        ways = group.ways()
        places += [
            begin + ways.index((one.order, one.repeat, one.direction)) for one in group.lines
        ]
        begin += len(ways)
    return places


def _places_in_plan(passes: Sequence[_Pass], plan: Plan, source: str) -> list[int]:
    """Return the places of the passes in a plan that was given."""
    free = dict(enumerate(plan.lines))
    places = []
    for one in passes:
        row, told = one.stops[0], one.stops[0].told.line_index
        fitting = [place for place, line in free.items() if line == one.line]
        place = fitting[0] if told is None and fitting else told
        if place is None or place not in fitting:
            known = one.line in plan.lines
            why = "is measured more often than the plan says" if known else "is not in the plan"
            at = "" if told is None else f" at the place {told} of 'line_index'"
            raise refusal(
                source,
                row.number,
                f"'{one.line}' {why}{at} ('lines' of the case file)",
                fault="mismatch",
            )
        del free[place]
        places.append(place)
    return places
