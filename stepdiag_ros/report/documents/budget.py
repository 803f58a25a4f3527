"""An uncertainty budget as a JSON document."""

from typing import Any

import numpy as np
from msgspec import UNSET

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.budget import BudgetReport
from stepdiag_ros.metrology.uncertainty.monte_carlo import BudgetCheck
from stepdiag_ros.schemas.budget import Document, MonteCarlo, Quantity, Source, Trial
from stepdiag_ros.schemas.parts import part_of


def budget_document(report: BudgetReport) -> dict[str, Any]:
    """Return a budget as a mapping that ``json`` can write: SI, unknown is null."""
    budget = report.budget
    content = Document(
        run_id=report.run_id or None,
        bag=None if report.bag is None else str(report.bag),
        method=budget.method,
        instrument=budget.instrument,
        coverage_probability=budget.coverage,
        sources=[part_of(Source, source) for source in budget.sources],
        quantities=[_quantity(report, row) for row in range(len(budget.sensitivity.quantities))],
        covariance=budget.covariance.tolist(),
        monte_carlo=None if report.check is None else _monte_carlo(report.check),
        remarks=[*report.remarks, *budget.remarks],
    )
    return schemas.document("budget", content)


def budget_json(report: BudgetReport) -> str:
    """Return a budget as JSON text; see ``budget_document``."""
    return schemas.json_text(budget_document(report))


def _quantity(report: BudgetReport, row: int) -> Quantity:
    budget = report.budget
    quantity = budget.sensitivity.quantities[row]
    return Quantity(
        name=quantity.name,
        unit=quantity.unit,
        value=budget.sensitivity.values[row],
        contributions={
            source.name: budget.contributions[number, row]
            for number, source in enumerate(budget.sources)
        },
        standard_uncertainty=budget.standard_uncertainty[row],
        lower_bound_only=budget.at_least[row],
        degrees_of_freedom=budget.degrees_of_freedom[row],
        coverage_factor=budget.coverage_factor[row],
        expanded_uncertainty=budget.expanded[row],
        monte_carlo=UNSET if report.check is None else _trial(report.check, row),
    )


def _trial(check: BudgetCheck, row: int) -> Trial:
    outcome, validation = check.outcome, check.validation
    return Trial(
        estimate=outcome.estimate[row],
        standard_uncertainty=outcome.standard_uncertainty[row],
        interval=[outcome.low[row], outcome.high[row]],
        shortest_interval=[outcome.shortest_low[row], outcome.shortest_high[row]],
        settled=outcome.settled[row],
        d_low=validation.low_difference[row],
        d_high=validation.high_difference[row],
        tolerance=validation.tolerance[row],
        gum_validated=validation.passed[row],
    )


def _monte_carlo(check: BudgetCheck) -> MonteCarlo:
    return MonteCarlo(
        trials=check.outcome.trials,
        blocks=check.outcome.blocks,
        significant_digits=check.digits,
        settled=bool(np.all(check.outcome.settled)),
        gum_validated=bool(np.all(check.validation.passed)),
    )
