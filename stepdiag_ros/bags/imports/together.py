"""Several files, each a test of another axis or diagonal, as one measurement.

Lasers that measure one line at a time write a file for each: ``Diagonal 1.RTL`` to ``Diagonal
4.RTL`` are one test of ISO 230-6 (Renishaw, laser diagonal testing, "Data analysis - stage 2").
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import nan

import numpy as np

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports.imported import Imported
from stepdiag_ros.bags.table_plan import plan_mapping, yaml_text
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.text.intake import parse_yaml

_NO_TIMES = (
    "the files do not state the time between their measurements, so the times of the stops are"
    " not known; the order of the lines is that of the files"
)


def together(parts: Sequence[tuple[str, Imported]]) -> Imported:
    """Make one measurement of several, in the order in which they are given.

    Args:
        parts: name of the file, and what it holds.

    Raises:
        TableError: two are the same line, their boxes differ, or one holds no lines; names the
            files.
    """
    first_name, first = parts[0]
    if len(parts) == 1:
        return first
    groups: list[Mapping[str, object]] = []
    lines: list[MeasuredLine] = []
    course: dict[str, object] = {}
    remarks: dict[str, list[str]] = {}
    seen: dict[tuple[str, str], str] = {}
    begin = 0
    for name, one in parts:
        if not one.lines:
            raise TableError(f"{name} holds no lines; only tests of lines can be combined")
        for kind in {(line.line.kind, line.line.name) for line in one.lines}:
            if kind in seen:
                raise TableError(
                    f"{seen[kind]} and {name} are both given as {kind[1]}. State for each file"
                    " its axis or diagonal (--axis)"
                )
            seen[kind] = name
        _same_box(first_name, first, name, one)
        plan = parse_yaml(one.plan_text, name)
        groups += plan["lines"]
        course = {key: plan[key] for key in ("overrun_m",) if key in plan}
        lines += [_moved(line, begin, len(lines) + place) for place, line in enumerate(one.lines)]
        begin += len(plan_from_text(one.plan_text, name).lines)
        for remark in one.remarks:
            remarks.setdefault(remark, []).append(_tested(one))
    said = [
        remark if len(of) == len(parts) else f"{', '.join(of)}: {remark}"
        for remark, of in remarks.items()
    ]
    if any(np.all(np.isfinite(line.time)) for _, one in parts for line in one.lines):
        said.append(_NO_TIMES)
    names = ", ".join(_tested(one) for _, one in parts)
    mapping = plan_mapping(f"imported: positioning of {names}", first.volume, groups, course)
    return Imported(
        format=", ".join(dict.fromkeys(one.format for _, one in parts)),
        volume=first.volume,
        plan_text=yaml_text(mapping),
        lines=tuple(lines),
        machine_text=first.machine_text,
        facts=_facts(parts),
        remarks=tuple(said),
        further=first.further,
    )


def _tested(one: Imported) -> str:
    return ", ".join(dict.fromkeys(line.line.name for line in one.lines))


def _moved(line: MeasuredLine, begin: int, order: int) -> MeasuredLine:
    """Return a line at its place in the plan and in the order of all; its time is not known."""
    return replace(
        line,
        line_index=begin + line.line_index,
        end_time=order,
        time=np.full(len(line.time), nan),
    )


def _same_box(first_name: str, first: Imported, name: str, one: Imported) -> None:
    if one.volume.blocks != first.volume.blocks:
        raise TableError(
            f"{name} has {one.volume.blocks + 1} targets, {first_name} has"
            f" {first.volume.blocks + 1}; the lines of one measured box have the same number"
        )
    if one.volume != first.volume:
        raise TableError(
            f"{name} and {first_name} do not state the box in which they were measured. State it:"
            " --box X0 Y0 Z0 X1 Y1 Z1 (its corners in machine coordinates, m)"
        )


def _facts(parts: Sequence[tuple[str, Imported]]) -> dict[str, str]:
    """Return facts that all files share under their names, and the others for each line."""
    facts: dict[str, str] = {}
    for key in dict.fromkeys(key for _, one in parts for key in one.facts):
        told = [(_tested(one), one.facts[key]) for _, one in parts if key in one.facts]
        if len(told) == len(parts) and len({text for _, text in told}) == 1:
            facts[key] = told[0][1]
        else:
            facts.update({f"{line}: {key}": text for line, text in told})
    return facts
