"""The evaluation of Ibaraki & Hata 2010, section 4: what it is made of, as text and as JSON.

Table 1, the setup errors and the sensitivity of the conventional formulation to them, the angular
errors with the uncertainty that eq. (29) warns of, the spread over the repeats, and the comparison
with directly measured errors. SI in the JSON; what is not known is ``null``.
"""

import io
import math
from typing import Any

import numpy as np

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.experiment import Experiment
from stepdiag_ros.metrology.comparison import (
    COVERAGE,
    CurveComparison,
    DirectComparison,
)
from stepdiag_ros.metrology.repeats import RepeatResults
from stepdiag_ros.metrology.table_one import Entry, Row
from stepdiag_ros.report.squareness import SIGN_DEFINITIONS, sign


def experiment_texts(experiment: Experiment) -> dict[str, str]:
    """Return the files ``table_1.txt`` and ``table_1.json`` by their names."""
    from stepdiag_ros.report.experiment_tables import print_experiment
    from stepdiag_ros.report.tables import make_console

    text = io.StringIO()
    print_experiment(experiment, make_console(text))
    return {"table_1.txt": text.getvalue(), "table_1.json": experiment_json(experiment) + "\n"}


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
                "displacement_per_block": _numbers(setup.displacement),
                "displacement_uncertainty": _numbers(setup.displacement_uncertainty),
                "angles": _numbers(setup.angles),
                "angle_uncertainty": _numbers(setup.angle_uncertainty),
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
        "displacement_uncertainty": _number(experiment.displacement_uncertainty),
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
                else _number(angle_of(row, row.measured) * sign(row.name, definition)),
                "estimated": {
                    method: _number(angle_of(row, entry) * sign(row.name, definition))
                    for method, entry in row.estimated.items()
                },
            }
            for definition in SIGN_DEFINITIONS
        }
    return document


def angle_of(row: Row, entry: Entry) -> float:
    """Return the right-handed rotation (rad) of a squareness that Table 1 gives over the travel."""
    from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES

    return SQUARENESS_SLOPES[row.name][0] * entry.value / row.travel


def _entry(entry: Entry | None) -> dict[str, float | None] | None:
    if entry is None:
        return None
    return {
        "value": _number(entry.value),
        "standard_uncertainty": _number(entry.standard_uncertainty),
    }


def _spread(found: RepeatResults, name: str) -> dict[str, list[float | None]]:
    spread = found.spread(name)
    return {
        "mean": _numbers(spread.mean),
        "low": _numbers(spread.low),
        "high": _numbers(spread.high),
        "standard_deviation": _numbers(spread.standard_deviation),
    }


def _comparison(one: DirectComparison) -> dict[str, Any]:
    return {
        "method": one.method,
        "coverage_factor": COVERAGE,
        "curves": {curve.name: _curve(curve) for curve in one.curves},
        "squareness": {
            angle.name: {
                "identified": _number(angle.identified),
                "identified_uncertainty": _number(angle.identified_uncertainty),
                "direct": _number(angle.direct),
                "direct_uncertainty": _number(angle.direct_uncertainty),
                "difference": _number(angle.difference),
                "normalised_error": _number(angle.normalised_error),
            }
            for angle in one.squareness
        },
        "not_compared": dict(one.not_compared),
    }


def _curve(curve: CurveComparison) -> dict[str, Any]:
    return {
        "unit": curve.unit,
        "reference": curve.reference,
        "positions": _numbers(curve.positions),
        "identified": _numbers(curve.identified),
        "identified_uncertainty": _numbers(curve.identified_uncertainty),
        "direct": _numbers(curve.direct),
        "direct_uncertainty": _numbers(curve.direct_uncertainty),
        "difference": _numbers(curve.difference),
        "normalised_error": _numbers(curve.normalised_error),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _numbers(values: Any) -> list[float | None]:
    return [_number(value) for value in np.asarray(values, dtype=np.float64)]
