"""Compensation tables as a person and a program read them: what they correct and leave."""

import math
from collections.abc import Sequence

from stepdiag_ros.compensation.remaining import COMPUTED, BeforeAndAfter
from stepdiag_ros.evaluation.compensation import CompensationReport
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import UNKNOWN
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.changes import ratio
from stepdiag_ros.words.compensation import figure_name, limit_words, size_words, uncorrected

NOT_INSTALLED = (
    "Nothing was installed. Keep the present tables, load the files by hand, and measure again."
)


def print_compensation(report: CompensationReport, console: PlainConsole) -> None:
    """Print what was written and what it leaves."""
    console.sentence(f"Compensation tables for {report.control.title}")
    overruled = report.identified.origin.despite_verdict
    if overruled:
        console.sentence(
            f"Made despite the verdict {overruled}. The effect stays, and part of it is in these"
            " tables."
        )
    for line in report.identified.origin.lines():
        console.sentence(f"  {line}")
    console.sentence(f"  files: {', '.join(report.files)}")
    warning = report.identified.warning
    if warning:
        console.print()
        console.sentence(f"Do not install these tables: {warning}.")
    console.print()
    console.print(change_table("What the tables change", report.remainder.changes))
    console.print()
    remainder = report.remainder
    console.sentence(COMPUTED)
    if remainder.known < remainder.places:
        console.sentence(
            f"Of {remainder.places} places in the volume {remainder.known} have a known error;"
            " the others are not in the figures."
        )
    limit = limit_words(report)
    if limit and not warning:
        console.sentence(limit)
    for title, sentences in (
        ("Not corrected:", uncorrected(report)),
        ("To know:", report.control.says),
        ("About the result:", [one for one in report.identified.remarks if one != warning]),
    ):
        if sentences:
            console.print()
            console.sentence(title)
            for text in sentences:
                console.sentence(f"- {text}")
    console.print()
    console.sentence(f"Format by: {report.control.source}.")
    console.sentence(NOT_INSTALLED)


def change_table(title: str, changes: Sequence[BeforeAndAfter]) -> Table:
    """Return figures before and after, and of each whether the control has a table for it."""
    table = new_table(
        title, "", "before", "after, computed", "times smaller", "corrected by a table"
    )
    for one in changes:
        told = "yes" if one.corrected else "no"
        before, after = size_words(one.before, one.unit), size_words(one.after, one.unit)
        table.add_row(figure_name(one), before, after, _times(one), told)
    return table


def _times(one: BeforeAndAfter) -> str:
    if math.isnan(one.factor) or not math.isfinite(one.after):
        return UNKNOWN if math.isnan(one.before) or math.isnan(one.after) else "-"
    return ratio(one.factor)
