"""An uncertainty budget as a JSON document."""

from typing import Any

import numpy as np

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.budget import BudgetReport
from stepdiag_ros.metrology.uncertainty.monte_carlo import Check
from stepdiag_ros.metrology.uncertainty.source import Source


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
        "standard_uncertainty": schemas.number(source.standard_uncertainty),
        "unit": source.unit,
        "evaluation": source.evaluation,
        "distribution": source.distribution,
        "degrees_of_freedom": schemas.number(source.degrees_of_freedom),
        "correlation": source.correlation,
        "note": source.note,
    }


def _quantity_document(report: BudgetReport, row: int) -> dict[str, Any]:
    budget = report.budget
    quantity = budget.sensitivity.quantities[row]
    document: dict[str, Any] = {
        "name": quantity.name,
        "unit": quantity.unit,
        "value": schemas.number(budget.sensitivity.values[row]),
        "contributions": {
            source.name: schemas.number(budget.contributions[number, row])
            for number, source in enumerate(budget.sources)
        },
        "standard_uncertainty": schemas.number(budget.standard_uncertainty[row]),
        "lower_bound_only": bool(budget.at_least[row]),
        "degrees_of_freedom": schemas.number(budget.degrees_of_freedom[row]),
        "coverage_factor": schemas.number(budget.coverage_factor[row]),
        "expanded_uncertainty": schemas.number(budget.expanded[row]),
    }
    if report.check is not None:
        outcome, validation = report.check.outcome, report.check.validation
        document["monte_carlo"] = {
            "estimate": schemas.number(outcome.estimate[row]),
            "standard_uncertainty": schemas.number(outcome.standard_uncertainty[row]),
            "interval": [schemas.number(outcome.low[row]), schemas.number(outcome.high[row])],
            "shortest_interval": [
                schemas.number(outcome.shortest_low[row]),
                schemas.number(outcome.shortest_high[row]),
            ],
            "settled": bool(outcome.settled[row]),
            "d_low": schemas.number(validation.low_difference[row]),
            "d_high": schemas.number(validation.high_difference[row]),
            "tolerance": schemas.number(validation.tolerance[row]),
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
