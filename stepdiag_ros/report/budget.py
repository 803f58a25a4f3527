"""An uncertainty budget as tables and as JSON; the physics is in ``metrology.uncertainty``."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.budget import BudgetReport
from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.metrology.geometry import AXES, SQUARENESS
from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.monte_carlo import Check
from stepdiag_ros.metrology.uncertainty.source import Source
from stepdiag_ros.report.squareness import SIGN_DEFINITIONS
from stepdiag_ros.report.tables import PlainConsole, new_table
from stepdiag_ros.text.numbers import MICRO, UNKNOWN, plain, with_uncertainty

_UNITS = {
    "m": ("µm", MICRO),
    "rad": ("µrad", MICRO),
    "relative": ("µm/m", MICRO),
    "m/m": ("µm/m", MICRO),
    "1/K": ("µm/(m K)", MICRO),
    "K": ("K", 1.0),
    "Pa": ("Pa", 1.0),
    "1": ("", 1.0),
}
"""Unit of an input → how people read it, and the factor."""


_KINDS = {
    "squareness": "Squareness",
    "positioning": "Positioning error at the end of the travel",
    "diagonal": "Displacement error over body diagonals",
    "straightness": "Straightness",
    "angular": "Angular error motions",
}
"""First word of a figure's name (squareness has none of its own) → title of its table."""


def figure_groups(budget: Budget) -> dict[str, list[int]]:
    """Return the figures of a budget by their kind: title → places of its quantities."""
    found: dict[str, list[int]] = {}
    for kind, title in _KINDS.items():
        rows = [
            row
            for row, quantity in enumerate(budget.sensitivity.quantities)
            if not quantity.curve and _kind(quantity.name) == kind
        ]
        if rows:
            found[title] = rows
    return found


def _kind(name: str) -> str:
    return "squareness" if name in SQUARENESS else name.split(" ")[0]


def short_name(name: str) -> str:
    """Return a figure's name for the head of a narrow column: ``positioning E_XX`` → ``E_XX``."""
    return name.split(" ")[-1]


def unit_of(name: str, unit: str) -> str:
    """Return the unit in which people read a quantity; both are a millionth of SI."""
    if unit == "m":
        return "µm"
    return "µm/m" if name in SQUARENESS else "µrad"


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
        unit, factor = _UNITS[source.unit]
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
    """Return the contributions of all sources to some quantities of one kind, and what they make.

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
    table.min_width = len(str(table.title))
    for number, source in enumerate(budget.sources):
        table.add_row(source.name, *(_size(budget.contributions[number, row]) for row in rows))
    table.add_section()
    combined, expanded, lower = budget.standard_uncertainty, budget.expanded, budget.at_least
    table.add_row("combined u", *(_bound(lower[row]) + _size(combined[row]) for row in rows))
    table.add_row("effective ν", *(_freedom(budget.degrees_of_freedom[row]) for row in rows))
    table.add_row("coverage factor k", *(plain(budget.coverage_factor[row], 2) for row in rows))
    table.add_row(
        f"expanded U ({budget.coverage:.4g})",
        *(_bound(lower[row]) + _size(expanded[row]) for row in rows),
    )
    table.add_row(
        "result", *(_result(budget.sensitivity.values[row], expanded[row]) for row in rows)
    )
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
        table.columns[0].justify = "right"
        for node, position in enumerate(volume.nodes(axis)):
            cells = []
            for name in names:
                row = found.get((name, node))
                if row is None:
                    cells.append("-")
                else:
                    cells.append(_bound(budget.at_least[row]) + _size(budget.expanded[row]))
            table.add_row(plain(position * 1e3, 3), *cells)
        tables.append(table)
    return tables


def check_table(budget: Budget, check: Check) -> Table:
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
                f"{validation.tolerance[row] * MICRO:.3g}",
                "pass" if validation.passed[row] else "FAIL",
            )
    return table


def check_sentences(check: Check) -> list[str]:
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

    def sentence(text: str) -> None:
        console.print(text, width=console.text_width, soft_wrap=console.text_width is None)

    heading = (
        ("Run", report.run_id),
        ("Bag", "" if report.bag is None else str(report.bag)),
        ("Method", method_title(budget.method)),
        ("Known", budget.instrument),
    )
    for name, text in heading:
        if text:
            sentence(f"{name + ':':<9}{text}")
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
    sign = f"Squareness sign: {SIGN_DEFINITIONS['rotation']}."
    for text in (*remarks, sign, *budget.remarks, *checked):
        sentence(text)


def budget_document(report: BudgetReport) -> dict[str, Any]:
    """Return a budget as a mapping that ``json`` can write: SI, unknown is null."""
    budget = report.budget
    content = {
        "run_id": report.run_id or None,
        "bag": None if report.bag is None else str(report.bag),
        "method": budget.method,
        "instrument": budget.instrument,
        "coverage_probability": budget.coverage,
        "sources": [_source_document(source) for source in budget.sources],
        "quantities": [
            _quantity_document(report, row) for row in range(len(budget.sensitivity.quantities))
        ],
        "covariance": [[float(value) for value in row] for row in budget.covariance],
        "monte_carlo": None if report.check is None else _check_document(report.check),
        "remarks": [*report.remarks, *budget.remarks],
    }
    return schemas.document("budget", content)


def budget_json(report: BudgetReport) -> str:
    """Return a budget as JSON text; see ``budget_document``."""
    return schemas.json_text(budget_document(report))


def _source_document(source: Source) -> dict[str, Any]:
    return {
        "name": source.name,
        "group": source.group,
        "standard_uncertainty": _number(source.standard_uncertainty),
        "unit": source.unit,
        "evaluation": source.evaluation,
        "distribution": source.distribution,
        "degrees_of_freedom": _number(source.degrees_of_freedom),
        "correlation": source.correlation,
        "note": source.note,
    }


def _quantity_document(report: BudgetReport, row: int) -> dict[str, Any]:
    budget = report.budget
    quantity = budget.sensitivity.quantities[row]
    document: dict[str, Any] = {
        "name": quantity.name,
        "unit": quantity.unit,
        "value": _number(budget.sensitivity.values[row]),
        "contributions": {
            source.name: _number(budget.contributions[number, row])
            for number, source in enumerate(budget.sources)
        },
        "standard_uncertainty": _number(budget.standard_uncertainty[row]),
        "lower_bound_only": bool(budget.at_least[row]),
        "degrees_of_freedom": _number(budget.degrees_of_freedom[row]),
        "coverage_factor": _number(budget.coverage_factor[row]),
        "expanded_uncertainty": _number(budget.expanded[row]),
    }
    if report.check is not None:
        outcome, validation = report.check.outcome, report.check.validation
        document["monte_carlo"] = {
            "estimate": _number(outcome.estimate[row]),
            "standard_uncertainty": _number(outcome.standard_uncertainty[row]),
            "interval": [_number(outcome.low[row]), _number(outcome.high[row])],
            "shortest_interval": [
                _number(outcome.shortest_low[row]),
                _number(outcome.shortest_high[row]),
            ],
            "settled": bool(outcome.settled[row]),
            "d_low": _number(validation.low_difference[row]),
            "d_high": _number(validation.high_difference[row]),
            "tolerance": _number(validation.tolerance[row]),
            "gum_validated": bool(validation.passed[row]),
        }
    return document


def _check_document(check: Check) -> dict[str, Any]:
    return {
        "trials": check.outcome.trials,
        "blocks": check.outcome.blocks,
        "significant_digits": check.digits,
        "settled": bool(np.all(check.outcome.settled)),
        "gum_validated": bool(np.all(check.validation.passed)),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _freedom(freedom: float) -> str:
    return f"{math.floor(freedom + 1e-9):,}" if math.isfinite(freedom) and freedom < 1e6 else "∞"


def _bound(lower: bool) -> str:
    return "≥ " if lower else ""


def _result(value: float, expanded_uncertainty: float) -> str:
    """Write a result in millionths of SI to the digits that its uncertainty leaves."""
    return with_uncertainty(value * MICRO, expanded_uncertainty * MICRO)[0]


def _size(value: float, decimals: int = 4) -> str:
    """Write a quantity of a result in millionths of SI; what does not act at all is a dash."""
    return "-" if value == 0.0 else plain(value * MICRO, decimals)
