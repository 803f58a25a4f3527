"""The evaluation of Ibaraki & Hata 2010, section 4: what it is made of, as text and as JSON.

Table 1, the setup errors and the sensitivity of the conventional formulation to them, the angular
errors with the uncertainty that eq. (29) warns of, the spread over the repeats, and the comparison
with directly measured errors. SI in the JSON; what is not known is ``null``.
"""

from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.experiment import Experiment
from stepdiag_ros.metrology.comparison import (
    COVERAGE,
    CurveComparison,
    DirectComparison,
)
from stepdiag_ros.metrology.repeats import RepeatResults
from stepdiag_ros.metrology.table_one import Entry, Row
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS, angle_of, sign


def experiment_json(experiment: Experiment) -> str:
    """Return the evaluation as JSON text."""
    return schemas.json_text(experiment_document(experiment))


def experiment_document(experiment: Experiment) -> dict[str, Any]:
    """Return the evaluation as a mapping that ``json`` can write."""
    content = {
        "run_id": experiment.report.run_id or None,
        "squareness_definitions": dict(SIGN_DEFINITIONS),
        "table_1": [_row(row) for row in experiment.table],
        "setup_errors": {
            setup.line: {
                "displacement_per_block": schemas.numbers(setup.displacement),
                "displacement_uncertainty": schemas.numbers(setup.displacement_uncertainty),
                "angles": schemas.numbers(setup.angles),
                "angle_uncertainty": schemas.numbers(setup.angle_uncertainty),
                "setups": setup.setups,
            }
            for setup in experiment.setups
        },
        "conventional_sensitivity": {
            one.curve: {
                "gain": one.gain,
                "by_diagonal_m_per_rad": dict(one.by_line),
                "worst_m_per_rad": one.worst,
            }
            for one in experiment.sensitivity
        },
        "displacement_uncertainty": schemas.number(experiment.displacement_uncertainty),
        "angle_uncertainty": {name: vars(size) for name, size in experiment.angles.items()},
        "repeats": {
            method: {name: _spread(found, name) for name in found.results[0].curves}
            for method, found in experiment.repeats.items()
        },
        "comparisons": [_comparison(one) for one in experiment.comparisons],
    }
    return schemas.document("comparison", content)


def _row(row: Row) -> dict[str, Any]:
    document: dict[str, Any] = {
        "label": row.label,
        "name": row.name,
        "travel": row.travel,
        "measured": _entry(row.measured),
        "estimated": {method: _entry(entry) for method, entry in row.estimated.items()},
    }
    if row.name[0] != "E":
        document["by_definition_rad"] = {
            definition: {
                "measured": None
                if row.measured is None
                else schemas.number(angle_of(row, row.measured) * sign(row.name, definition)),
                "estimated": {
                    method: schemas.number(angle_of(row, entry) * sign(row.name, definition))
                    for method, entry in row.estimated.items()
                },
            }
            for definition in SIGN_DEFINITIONS
        }
    return document


def _entry(entry: Entry | None) -> dict[str, float | None] | None:
    if entry is None:
        return None
    return {
        "value": schemas.number(entry.value),
        "standard_uncertainty": schemas.number(entry.standard_uncertainty),
    }


def _spread(found: RepeatResults, name: str) -> dict[str, list[float | None]]:
    spread = found.spread(name)
    return {
        "mean": schemas.numbers(spread.mean),
        "low": schemas.numbers(spread.low),
        "high": schemas.numbers(spread.high),
        "standard_deviation": schemas.numbers(spread.standard_deviation),
    }


def _comparison(one: DirectComparison) -> dict[str, Any]:
    return {
        "method": one.method,
        "coverage_factor": COVERAGE,
        "curves": {curve.name: _curve(curve) for curve in one.curves},
        "squareness": {
            angle.name: {
                "identified": schemas.number(angle.identified),
                "identified_uncertainty": schemas.number(angle.identified_uncertainty),
                "direct": schemas.number(angle.direct),
                "direct_uncertainty": schemas.number(angle.direct_uncertainty),
                "difference": schemas.number(angle.difference),
                "normalised_error": schemas.number(angle.normalised_error),
            }
            for angle in one.squareness
        },
        "not_compared": dict(one.not_compared),
    }


def _curve(curve: CurveComparison) -> dict[str, Any]:
    return {
        "unit": curve.unit,
        "reference": curve.reference,
        "positions": schemas.numbers(curve.positions),
        "identified": schemas.numbers(curve.identified),
        "identified_uncertainty": schemas.numbers(curve.identified_uncertainty),
        "direct": schemas.numbers(curve.direct),
        "direct_uncertainty": schemas.numbers(curve.direct_uncertainty),
        "difference": schemas.numbers(curve.difference),
        "normalised_error": schemas.numbers(curve.normalised_error),
    }
