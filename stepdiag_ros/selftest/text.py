"""The record of a self-test as text: a line or more for each problem, the platform, the verdict."""

import math
import re
from collections.abc import Sequence

from stepdiag_ros.selftest.problems import KINDS
from stepdiag_ros.selftest.record import FAILED, PASSED, Check, SelftestRecord, SolvedProblem, worst
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.table import Column, Table

RECORD = re.compile(rb"\Astepdiag self-test of |\"urn:stepdiag_ros:selftest:")
"""What the head of every written record contains, as text or as JSON."""
_UNIT = {"1": ""}


def print_record(record: SelftestRecord, console: PlainConsole, every_check: bool = False) -> None:
    """Print a record.

    Args:
        record: of a self-test.
        console: on which.
        every_check: all comparisons of each problem; else the one nearest to its limit, and those
            that fail.
    """
    console.print(f"stepdiag self-test of {record.date}, seed {record.seed}")
    for name, text in record.platform.items():
        console.print(f"  {name:15s} {text}")
    console.print()
    table = Table(
        "",
        [
            Column("", number=True, wraps=True),
            Column("problem, and its comparison nearest to the limit", wraps=True),
            Column("deviation", number=True),
            Column("limit", number=True),
            Column("why this limit", wraps=True),
            Column(""),
        ],
    )
    for problem in record.problems:
        _add(table, problem, every_check)
    console.print(table)
    for line in summary(record):
        console.print(line)


def _add(table: Table, problem: SolvedProblem, every_check: bool) -> None:
    meaning = KINDS.get(problem.kind)
    title = f"{problem.kind}: {meaning}" if meaning else problem.kind
    verdict = PASSED if problem.passed else FAILED
    table.add_row(str(problem.number), title, "", "", problem.description, verdict)
    for check in _shown(problem.checks, every_check):
        table.add_row(
            "",
            f"  {check.what}",
            _quantity(check.deviation, check.unit),
            _quantity(check.limit, check.unit),
            check.why,
            "" if check.passed else FAILED,
        )
    if problem.failure:
        table.add_row("", f"  no answer: {problem.failure}", "", "", "", FAILED)


def _shown(checks: Sequence[Check], every_check: bool) -> list[Check]:
    if every_check:
        return list(checks)
    nearest = worst(checks)
    return [check for check in checks if check is nearest or not check.passed]


def _quantity(value: float, unit: str) -> str:
    text = f"{value:.2g}" if math.isfinite(value) else "no number"
    return f"{text} {_UNIT.get(unit, unit)}".rstrip()


def summary(record: SelftestRecord) -> list[str]:
    """Return the verdict in sentences."""
    checks = sum(len(problem.checks) for problem in record.problems)
    failed = [str(problem.number) for problem in record.problems if not problem.passed]
    lines = [
        f"{len(record.problems)} problems, {checks} comparisons, {record.seconds:.1f} s; chance"
        f" fails right software with a probability of at most {record.false_alarm:.2g}."
    ]
    if failed:
        lines.append(f"{FAILED}: problem {', '.join(failed)}.")
    else:
        lines.append(f"{PASSED}: every answer is within its limit.")
    return lines
