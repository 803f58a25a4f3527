"""Tests by ISO 230-2 and ISO 230-6 as a person and a program read them: text and JSON.

The JSON is SI; what is not known is ``null``. The text gives µm, with U for k = 2 as the standards
state it.
"""

from collections.abc import Sequence

from stepdiag_ros.evaluation.positioning import PositioningReport, Published
from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.metrology.standards.iso230_2 import PARAMETERS, PositioningTest
from stepdiag_ros.metrology.standards.iso230_6 import DiagonalGroup
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import plain
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.positioning import cell_below, decimals_of, head_of, sentences, subject_of

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


def parameter_table(test: PositioningTest, published: Published | None, decimals: int) -> Table:
    """Return the parameters of a test; beside published figures, if there are any."""
    head = head_of(test.expanded_uncertainty.values())
    more = () if published is None else ("published / µm", "")
    table = new_table(
        f"{test.standard}, {subject_of(test)}: {test.runs[0]} runs forward,"
        f" {test.runs[1]} backward",
        "",
        "",
        head,
        *more,
    )
    table.columns[1].number = False
    for name in PARAMETERS:
        value = test.parameters[name]
        shown = cell_below(value, test.expanded_uncertainty[name], decimals, head)
        cells = [name, MEANINGS[name], shown]
        if published is not None and name in published.values:
            cells.append(plain(published.values[name] * IN_MICRO, decimals))
            cells.append("agrees" if published.agrees(name, value) else "DIFFERS")
        table.add_row(*cells)
    return table


def parameters_table(tests: Sequence[PositioningTest], decimals: int) -> Table:
    """Return the parameters of several axes, a column each."""
    head = head_of(one for test in tests for one in test.expanded_uncertainty.values())
    table = new_table(f"{tests[0].standard}: {head}", "", "", *(test.label for test in tests))
    table.columns[1].number = False
    for name in PARAMETERS:
        cells = (
            cell_below(test.parameters[name], test.expanded_uncertainty[name], decimals, head)
            for test in tests
        )
        table.add_row(name, MEANINGS[name], *cells)
    runs = (f"{test.runs[0]} forward, {test.runs[1]} backward" for test in tests)
    table.add_row("runs", "", *runs)
    return table


def target_table(test: PositioningTest, decimals: int) -> Table:
    """Return what was found at each target, in µm."""
    table = new_table(
        f"{subject_of(test)}: at the targets, µm",
        "target / mm",
        "mean ↑",
        "mean ↓",
        "reversal B_i",
        "s ↑",
        "s ↓",
        "R_i",
    )
    table.columns[0].number = True
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
            plain(target * IN_MILLI, 3),
            *(plain(column[row] * IN_MICRO, decimals) for column in columns),
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
            f"{test.label} ({label})",
            *(
                cell_below(test.parameters[name], test.expanded_uncertainty[name], decimals, every)
                for name in ("B", "E")
            ),
        )
    return [result, each]


def print_positioning(report: PositioningReport, console: PlainConsole) -> None:
    """Print a report: tables, then sentences."""
    console.sentence(
        f"Source: {report.source}" + (f" (run {report.run_id})" if report.run_id else "")
    )
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
            console.sentence(f"{setup}: NOT the same numbers as the result recorded in the bag.")
    for text in sentences(report):
        console.sentence(text)
