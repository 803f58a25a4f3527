"""Tests by ISO 230-2 and ISO 230-6 as a person and a program read them: text and JSON.

The JSON is SI; what is not known is ``null``. The text gives µm, with U for k = 2 as the standards
state it.
"""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.positioning import PositioningReport, Published
from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.metrology.standards.iso230_2 import PARAMETERS, PositioningTest
from stepdiag_ros.metrology.standards.iso230_6 import (
    DiagonalGroup,
)
from stepdiag_ros.report.tables import PlainConsole, new_table
from stepdiag_ros.text.numbers import MICRO, UNKNOWN, plain, with_uncertainty

if TYPE_CHECKING:
    pass

MEANINGS = {
    "A": "bidirectional accuracy of positioning",
    "A↑": "unidirectional accuracy, forward",
    "A↓": "unidirectional accuracy, backward",
    "R": "bidirectional repeatability",
    "R↑": "unidirectional repeatability, forward",
    "R↓": "unidirectional repeatability, backward",
    "E": "bidirectional systematic error",
    "E↑": "unidirectional systematic error, forward",
    "E↓": "unidirectional systematic error, backward",
    "M": "mean bidirectional error",
    "B": "reversal error",
    "mean B": "mean reversal error",
}
_DIGITS = 4
"""Significant digits of the largest parameter where no uncertainty says how many there are."""


def decimals_of(tests: Sequence[PositioningTest]) -> int:
    """Return the decimals, in µm, that show the largest parameter of some tests to four digits."""
    values = [abs(value) for test in tests for value in test.parameters.values()]
    largest = max((value for value in values if math.isfinite(value)), default=0.0) * MICRO
    if largest == 0:
        return 2
    return min(max(_DIGITS - 1 - math.floor(math.log10(largest)), 1), 6)


def written(value: float, uncertainty: float, decimals: int) -> str:
    """Write a value with its expanded uncertainty (both m) in µm, or to decimals without one."""
    if not math.isfinite(value):
        return UNKNOWN
    if not math.isfinite(uncertainty):
        return f"{plain(value * MICRO, decimals)} ± {UNKNOWN}"
    value_text, uncertainty_text = with_uncertainty(value * MICRO, uncertainty * MICRO)
    return f"{value_text} ± {uncertainty_text}"


def head_of(uncertainties: Iterable[float]) -> str:
    """Return the head of a column of values; it says once what would else stand in each row."""
    known = any(math.isfinite(one) for one in uncertainties)
    return "value ± U / µm" if known else f"value / µm, U {UNKNOWN}"


def cell_below(value: float, uncertainty: float, decimals: int, head: str) -> str:
    """Write a value (m) in µm as the head of its column says; see ``head_of``."""
    if UNKNOWN in head:
        return plain(value * MICRO, decimals)
    return written(value, uncertainty, decimals)


def parameter_table(test: PositioningTest, published: Published | None, decimals: int) -> Table:
    """Return the parameters of a test; beside published figures, if there are any."""
    head = head_of(test.expanded_uncertainty.values())
    more = () if published is None else ("published / µm", "")
    table = new_table(
        f"{test.standard}, {_subject(test)}: {test.runs[0]} runs forward, {test.runs[1]} backward",
        "",
        "",
        head,
        *more,
    )
    table.columns[1].justify = "left"
    for name in PARAMETERS:
        value = test.parameters[name]
        shown = cell_below(value, test.expanded_uncertainty[name], decimals, head)
        cells = [name, MEANINGS[name], shown]
        if published is not None and name in published.values:
            cells.append(plain(published.values[name] * MICRO, decimals))
            cells.append("agrees" if published.agrees(name, value) else "DIFFERS")
        table.add_row(*cells)
    return table


def target_table(test: PositioningTest, decimals: int) -> Table:
    """Return what was found at each target, in µm."""
    table = new_table(
        f"{_subject(test)}: at the targets, µm",
        "target / mm",
        "mean ↑",
        "mean ↓",
        "reversal B_i",
        "s ↑",
        "s ↓",
        "R_i",
    )
    table.columns[0].justify = "right"
    columns = (
        test.mean_forward,
        test.mean_backward,
        test.reversal,
        test.deviation_forward,
        test.deviation_backward,
        test.repeatability,
    )
    for row, target in enumerate(test.target):
        table.add_row(
            plain(target * 1e3, 3), *(plain(column[row] * MICRO, decimals) for column in columns)
        )
    return table


def group_tables(group: DiagonalGroup, decimals: int) -> list[Table]:
    """Return the two tables of the ISO 230-6 report page (RL, "final report")."""
    head = head_of([group.systematic_uncertainty, group.reversal_uncertainty])
    result = new_table(f"ISO 230-6: {group.place}", "Name", head)
    result.add_row(
        "Sys dev (E_d)",
        cell_below(group.systematic_deviation, group.systematic_uncertainty, decimals, head),
    )
    result.add_row(
        "Reversal (B_d)",
        cell_below(group.reversal_value, group.reversal_uncertainty, decimals, head),
    )
    each = new_table("", "Test", "Reversal (B) / µm", "Sys dev (E) / µm")
    every = head_of(test.expanded_uncertainty[name] for test in group.tests for name in ("B", "E"))
    for label, test in zip(group.labels, group.tests, strict=True):
        each.add_row(
            f"{test.setup or test.name} ({label})",
            *(
                cell_below(test.parameters[name], test.expanded_uncertainty[name], decimals, every)
                for name in ("B", "E")
            ),
        )
    return [result, each]


def _subject(test: PositioningTest) -> str:
    what = "diagonal" if is_diagonal(test.kind) else "axis"
    return f"{what} {test.name}"


def sentences(report: PositioningReport) -> list[str]:
    """Return what the reader must know, in words."""
    said = [
        "Deviations are measured less commanded positions; ↑ forward, ↓ backward."
        " U: expanded uncertainty of measurement, k = 2 (ISO 230-2 annex A, ISO/TR 230-9)."
    ]
    if report.unknown:
        said.append(
            f"U is unknown where it needs what is not known: {', '.join(report.unknown)}"
            " (name them in a file: --uncertainty)."
        )
    if report.published is not None:
        differing = [
            f"{name} (published {plain(report.published.values[name] * MICRO, decimals)} µm, by"
            f" the standard {plain(test.parameters[name] * MICRO, decimals)} µm)"
            for test in report.tests
            for decimals in (decimals_of([test]),)
            for name in PARAMETERS
            if name in report.published.values
            and not report.published.agrees(name, test.parameters[name])
        ]
        if differing:
            said.append(f"Published figures that depart from ISO 230-2: {'; '.join(differing)}.")
    for test in report.tests:
        said.extend(f"{test.setup or test.name}: {remark}." for remark in test.remarks)
    for group in report.groups:
        said.extend(f"{remark}." for remark in group.remarks)
    said.extend(report.warnings)
    return said


def print_positioning(report: PositioningReport, console: PlainConsole) -> None:
    """Print a report: tables, then sentences."""

    def sentence(text: str) -> None:
        console.print(text, width=console.text_width, soft_wrap=console.text_width is None)

    sentence(f"Source: {report.source}" + (f" (run {report.run_id})" if report.run_id else ""))
    console.print()
    tables: list[Table] = []
    decimals = decimals_of(report.tests)
    for group in report.groups:
        tables.extend(group_tables(group, decimals))
    for test in report.tests:
        if not is_diagonal(test.kind):
            tables.append(parameter_table(test, report.published, decimals))
        tables.append(target_table(test, decimals))
    for table in tables:
        console.print(table)
        console.print()
    for setup, same in report.equals_recorded.items():
        if not same:
            sentence(f"{setup}: NOT the same numbers as the result recorded in the bag.")
    for text in sentences(report):
        sentence(text)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _numbers(values: Any) -> list[float | None]:
    return [_number(value) for value in np.asarray(values, dtype=np.float64)]


def entry_of(test: PositioningTest, report: PositioningReport) -> dict[str, Any]:
    """Return the entry of one test."""
    published = None
    if report.published is not None:
        published = {
            name: {
                "value": value,
                "agrees": report.published.agrees(name, test.parameters[name]),
            }
            for name, value in report.published.values.items()
        }
    return {
        "standard": test.standard,
        "name": test.name,
        "kind": test.kind,
        "setup": test.setup,
        "runs": {"forward": test.runs[0], "backward": test.runs[1]},
        "target": _numbers(test.target),
        "mean_forward": _numbers(test.mean_forward),
        "mean_backward": _numbers(test.mean_backward),
        "reversal": _numbers(test.reversal),
        "s_forward": _numbers(test.deviation_forward),
        "s_backward": _numbers(test.deviation_backward),
        "repeatability": _numbers(test.repeatability),
        "parameters": {
            name: {
                "value": _number(value),
                "expanded_uncertainty": _number(test.expanded_uncertainty[name]),
            }
            for name, value in test.parameters.items()
        },
        "published": published,
        "equals_recorded": report.equals_recorded.get(test.setup),
        "remarks": list(test.remarks),
    }


def positioning_json(report: PositioningReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known."""
    content = {
        "source": report.source,
        "run_id": report.run_id or None,
        "coverage_factor": 2.0,
        "tests": [entry_of(test, report) for test in report.tests],
        "diagonals": [
            {
                "place": group.place,
                "E_d": _number(group.systematic_deviation),
                "B_d": _number(group.reversal_value),
                "expanded_uncertainty_E_d": _number(group.systematic_uncertainty),
                "expanded_uncertainty_B_d": _number(group.reversal_uncertainty),
                "tests": [
                    {"label": label, "diagonal": test.name, "setup": test.setup}
                    for label, test in zip(group.labels, group.tests, strict=True)
                ],
                "remarks": list(group.remarks),
            }
            for group in report.groups
        ],
        "uncertainty_not_known": list(report.unknown),
        "warnings": list(report.warnings),
    }
    return schemas.json_text(schemas.document("iso230", content))
