"""An uncertainty budget as tables and as JSON; the physics is in ``metrology.uncertainty``."""

import math
from collections.abc import Sequence

import numpy as np

from stepdiag_ros.evaluation.budget import BudgetReport
from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.largest_error import LargestErrorBudget
from stepdiag_ros.metrology.uncertainty.monte_carlo import BudgetCheck
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import UNKNOWN, plain, with_uncertainty
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.budget import UNITS, figure_groups, short_name, unit_of
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS


def sources_table(budget: Budget) -> Table:
    """Return what was taken into account: every input with its standard uncertainty."""
    table = new_table(
        "What is known of the inputs",
        "input",
        "u",
        "unit",
        "type",
        "distribution",
        "ν",
        "correlation",
    )
    for source in budget.sources:
        unit, factor = UNITS[source.unit]
        size = source.standard_uncertainty * factor
        table.add_row(
            source.name,
            f"{size:.3g}" if math.isfinite(size) else UNKNOWN,
            unit,
            source.evaluation,
            source.distribution,
            _freedom(source.degrees_of_freedom),
            source.correlation,
        )
    return table


def budget_table(budget: Budget, title: str, rows: Sequence[int]) -> Table:
    """Return the contributions of known sources to some quantities of one kind, and their sum.

    Args:
        budget: of a result.
        title: of the table.
        rows: places of the quantities.
    """
    quantities = budget.sensitivity.quantities
    unit = unit_of(quantities[rows[0]].name, quantities[rows[0]].unit)
    table = new_table(
        f"{title}: standard uncertainty by source, {unit}",
        "",
        *(short_name(quantities[row].name) for row in rows),
    )
    table.whole_title = True
    for number, source in enumerate(budget.sources):
        if source.known:
            table.add_row(source.name, *(_size(budget.contributions[number, row]) for row in rows))
    table.add_section()
    combined, expanded, lower = budget.standard_uncertainty, budget.expanded, budget.at_least
    table.add_row("combined u", *(_bound(lower[row]) + _size(combined[row]) for row in rows))
    table.add_row("effective ν", *(_freedom(budget.degrees_of_freedom[row]) for row in rows))
    table.add_row("coverage factor k", *(plain(budget.coverage_factor[row], 2) for row in rows))
    table.add_row(
        f"expanded U ({budget.coverage:.4g})",
        *(_bound(lower[row]) + _expanded(expanded[row]) for row in rows),
    )
    table.add_row(
        "result", *(_result(budget.sensitivity.values[row], expanded[row]) for row in rows)
    )
    return table


def largest_error_table(budget: Budget, largest: LargestErrorBudget) -> Table:
    """Return the contributions of known sources to the largest error in the volume, and their sum.

    Args:
        budget: of a result.
        largest: of the largest error of that result.
    """
    table = new_table("Largest error: standard uncertainty by source, µm", "", "volume")
    table.whole_title = True
    for source, size in zip(budget.sources, largest.contributions, strict=True):
        if source.known:
            table.add_row(source.name, _size(float(size)))
    table.add_row("another place or direction", _size(largest.elsewhere))
    table.add_section()
    lower, expanded = _bound(largest.at_least), largest.expanded.value
    table.add_row("combined u", lower + _size(largest.standard_uncertainty))
    table.add_row("effective ν", _freedom(largest.degrees_of_freedom))
    table.add_row("coverage factor k", plain(largest.coverage_factor, 2))
    table.add_row(f"expanded U ({budget.coverage:.4g})", lower + _expanded(expanded))
    table.add_row("result", _result(largest.value, expanded))
    return table


def curves_table(budget: Budget) -> list[Table]:
    """Return the expanded uncertainty of every curve at every node: one table an axis."""
    found = {
        (quantity.curve, quantity.node): row
        for row, quantity in enumerate(budget.sensitivity.quantities)
        if quantity.curve
    }
    volume = budget.sensitivity.observations.volume
    tables = []
    for axis, letter in enumerate(AXES):
        names = [name for name in budget.sensitivity.estimator.names if name[3] == letter]
        table = new_table(
            f"Expanded uncertainty U ({budget.coverage:.4g}) of the errors as {letter} moves",
            f"{letter} / mm",
            *(f"{name} / {'µrad' if name[2] in 'ABC' else 'µm'}" for name in names),
        )
        table.columns[0].number = True
        for node, position in enumerate(volume.nodes(axis)):
            cells = []
            for name in names:
                row = found.get((name, node))
                if row is None:
                    cells.append("-")
                else:
                    cells.append(_bound(budget.at_least[row]) + _expanded(budget.expanded[row]))
            table.add_row(plain(position * IN_MILLI, 3), *cells)
        tables.append(table)
    return tables


def check_table(budget: Budget, check: BudgetCheck) -> Table:
    """Return the comparison of the linear budget with Monte Carlo for all figures (JCGM 101, 8)."""
    table = new_table(
        f"Monte Carlo, {check.outcome.trials:,} trials (JCGM 101), µm or µrad",
        "",
        "u GUM",
        "u MC",
        "interval by the GUM",
        "interval by MC",
        "d_low",
        "d_high",
        "δ",
        "GUM valid",
    )
    outcome, validation = check.outcome, check.validation
    for rows in figure_groups(budget).values():
        for row in rows:
            value, wide = budget.sensitivity.values[row], budget.expanded[row]
            table.add_row(
                budget.sensitivity.quantities[row].name,
                _size(budget.standard_uncertainty[row], 3),
                _size(outcome.standard_uncertainty[row], 3),
                f"{_size(value - wide, 3)} .. {_size(value + wide, 3)}",
                f"{_size(outcome.low[row], 3)} .. {_size(outcome.high[row], 3)}",
                _size(validation.low_difference[row], 3),
                _size(validation.high_difference[row], 3),
                f"{validation.tolerance[row] * IN_MICRO:.3g}",
                "pass" if validation.passed[row] else "FAIL",
            )
    return table


def check_sentences(check: BudgetCheck) -> list[str]:
    """Say whether the Monte Carlo method settled, and what it says of the linear budget."""
    outcome = check.outcome
    failed = int(np.count_nonzero(~check.validation.passed))
    count = len(check.validation.passed)
    settled = bool(np.all(outcome.settled))
    words = [
        f"Monte Carlo: {outcome.trials:,} trials in {outcome.blocks} blocks; "
        + (
            f"all results have settled within δ/5 for {check.digits} significant digit"
            f"{'s' if check.digits > 1 else ''} of u (JCGM 101, 7.9 and 8.2)."
            if settled
            else f"{int(np.count_nonzero(~outcome.settled))} of {count} results had NOT settled "
            "within δ/5 (JCGM 101, 8.2) when the trials ran out; --trials allows more."
        ),
        f"The linear budget is validated (d_low, d_high ≤ δ; JCGM 101, 8.1) for {count - failed} of"
        f" {count} results (figures and curve values).",
    ]
    if failed:
        words.append(
            "Where it is not, the interval by Monte Carlo is the one to use. The usual cases are a"
            " result that one rectangular input rules, whose interval is narrower, and a"
            " straightness near its noise, whose largest deviation lies where chance puts it."
        )
    return words


def print_budget(report: BudgetReport, console: PlainConsole) -> None:
    """Print a budget, and its check by Monte Carlo if there is one."""
    budget = report.budget

    heading = (
        ("Run", report.run_id),
        ("Bag", "" if report.bag is None else str(report.bag)),
        ("Method", method_title(budget.method)),
        ("Known", budget.instrument),
    )
    for name, text in heading:
        if text:
            console.sentence(f"{name + ':':<9}{text}")
    console.print()
    tables = [sources_table(budget)]
    tables += [budget_table(budget, title, rows) for title, rows in figure_groups(budget).items()]
    tables += curves_table(budget)
    if report.check is not None:
        tables.append(check_table(budget, report.check))
    for table in tables:
        console.print(table)
        console.print()
    remarks = [f"Run: {remark}" for remark in report.remarks]
    checked = [] if report.check is None else check_sentences(report.check)
    if not all(source.known for source in budget.sources):
        checked.append(
            "To state what is not known, copy config/instruments/demo.yaml, enter the values of"
            " your certificates, and give the copy with --instrument."
        )
    sign = f"Squareness sign: {SIGN_DEFINITIONS['rotation']}."
    for text in (*remarks, sign, *budget.remarks, *checked):
        console.sentence(text)


def _freedom(freedom: float) -> str:
    return f"{math.floor(freedom + 1e-9):,}" if math.isfinite(freedom) and freedom < 1e6 else "∞"


def _bound(lower: bool) -> str:
    return "≥ " if lower else ""


def _expanded(uncertainty: float) -> str:
    """Write an expanded uncertainty in millionths of SI to two significant digits (GUM 7.2.6)."""
    return with_uncertainty(0.0, uncertainty * IN_MICRO)[1]


def _result(value: float, expanded_uncertainty: float) -> str:
    """Write a result in millionths of SI to the digits that its uncertainty leaves."""
    return with_uncertainty(value * IN_MICRO, expanded_uncertainty * IN_MICRO)[0]


def _size(value: float, decimals: int = 4) -> str:
    """Write a quantity of a result in millionths of SI; what does not act at all is a dash."""
    return "-" if value == 0.0 else plain(value * IN_MICRO, decimals)
