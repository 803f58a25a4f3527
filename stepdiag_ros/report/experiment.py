"""The evaluation of Ibaraki & Hata 2010, section 4: what it is made of, as text and as JSON.

Table 1, the setup errors and the sensitivity of the conventional formulation to them, the angular
errors with the uncertainty that eq. (29) warns of, the spread over the repeats, and the comparison
with directly measured errors. SI in the JSON; what is not known is ``null``.
"""

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepdiag_ros import schemas
from stepdiag_ros.metrology.comparison import (
    COVERAGE,
    CurveComparison,
    DirectComparison,
    compare_directly,
)
from stepdiag_ros.metrology.direct import DirectMeasurement
from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.repeats import RepeatResults, solve_repeats, split_repeats
from stepdiag_ros.metrology.setup_errors import (
    Sensitivity,
    SetupError,
    conventional_sensitivity,
    setup_errors,
)
from stepdiag_ros.metrology.solvers import SOLVERS
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors
from stepdiag_ros.metrology.solvers.soons import AngleUncertainty, angle_uncertainty
from stepdiag_ros.metrology.table_one import Entry, Row, table_one
from stepdiag_ros.report.content import Report
from stepdiag_ros.report.squareness import SIGN_DEFINITIONS, sign

ENOUGH_REPEATS = 3
"""So many repeats have a spread that is worth solving and drawing each alone."""


@dataclass(frozen=True)
class Experiment:
    """Everything that is shown of the evaluation.

    Attributes:
        report: of the run.
        measurement: its lines.
        repeats: method → results of each repeat alone; empty with fewer than ``ENOUGH_REPEATS``.
        table: Table 1.
        setups: setup errors of the three diagonals; empty where they cannot be told.
        sensitivity: of the conventional result to setup errors.
        displacement_uncertainty: standard uncertainty of a single move's displacement without
            repeats, m; NaN if unknown.
        angles: what that means for the angles that step diagonals show; empty if unknown.
        direct: what was measured directly; None if nothing was.
        comparisons: of each result that has something in common with it.
    """

    report: Report
    measurement: Measurement
    repeats: Mapping[str, RepeatResults]
    table: tuple[Row, ...]
    setups: tuple[SetupError, ...]
    sensitivity: tuple[Sensitivity, ...]
    displacement_uncertainty: float
    angles: Mapping[str, AngleUncertainty]
    direct: DirectMeasurement | None = None
    comparisons: tuple[DirectComparison, ...] = ()

    def translational(self) -> tuple[VolumetricErrors, ...]:
        """Return the results that tell all nine translations, in the order of the report."""
        return _translational(self.report)

    def comparison_to_draw(self) -> DirectComparison | None:
        """Return the comparison with the most curves, of equal ones the last; None without any."""
        best = max((len(one.curves) for one in self.comparisons), default=0)
        found = [one for one in self.comparisons if len(one.curves) == best]
        return found[-1] if best else None


def _translational(report: Report) -> tuple[VolumetricErrors, ...]:
    return tuple(
        result
        for result in report.ordered_results()
        if all(
            name in result.curves and np.all(np.isfinite(result.curves[name]))
            for name in TRANSLATIONS
        )
    )


def experiment_of(report: Report, direct: DirectMeasurement | None = None) -> Experiment | None:
    """Evaluate a report's measurement as Ibaraki & Hata do.

    Args:
        report: with its measurement.
        direct: measurements with artefacts.

    Returns:
        None where there is nothing to evaluate: no measurement, not the lines of the setup-robust
        formulation, or no method that tells all nine curves, as where a face alone was measured.

    Raises:
        ValueError: a direct curve reaches beyond the measured travel.
    """
    measurement = report.measurement
    methods = {result.method: result for result in report.ordered_results()}
    translational = {result.method: result for result in _translational(report)}
    if measurement is None or "setup_robust" not in methods or not translational:
        return None
    repeats: dict[str, RepeatResults] = {}
    if len(split_repeats(measurement)) >= ENOUGH_REPEATS:
        repeats, _ = solve_repeats(measurement, [name for name in methods if name in SOLVERS])
    try:
        setups = setup_errors(measurement)
    except NotDeterminable:
        setups = ()
    displacement = _displacement_uncertainty(measurement)
    angles: dict[str, AngleUncertainty] = {}
    if measurement.chain and "soons" in methods and math.isfinite(displacement):
        angles = angle_uncertainty(measurement.volume, measurement.chain, displacement)
    comparisons: tuple[DirectComparison, ...] = ()
    if direct is not None:
        compared = [compare_directly(result, direct) for result in methods.values()]
        comparisons = tuple(one for one in compared if one.curves or one.squareness)
    return Experiment(
        report=report,
        measurement=measurement,
        repeats=repeats,
        table=table_one(translational, direct),
        setups=setups,
        sensitivity=conventional_sensitivity(measurement.volume),
        displacement_uncertainty=displacement,
        angles=angles,
        direct=direct,
        comparisons=comparisons,
    )


def _displacement_uncertainty(measurement: Measurement) -> float:
    """Return the standard uncertainty of the difference of two stops of one pass, m."""
    stops = np.concatenate([line.standard_uncertainty for line in measurement.lines])
    known = stops[np.isfinite(stops)]
    return float(np.sqrt(2.0 * np.mean(known**2))) if known.size else math.nan


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
