"""The experiment of Table 1: results of the translational methods beside direct measurements."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.metrology.comparison import DirectComparison, compare_directly
from stepdiag_ros.metrology.direct import DirectMeasurement
from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.repeats import RepeatResults, solve_repeats, split_repeats
from stepdiag_ros.metrology.setup_errors import (
    SetupError,
    SetupSensitivity,
    conventional_sensitivity,
    setup_errors,
)
from stepdiag_ros.metrology.solvers import solvers
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors
from stepdiag_ros.metrology.solvers.soons import AngleUncertainty, angle_uncertainty
from stepdiag_ros.metrology.table_one import TableOneRow, table_one

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
        setups: setup errors of the three diagonals; empty where they are undetermined.
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
    table: tuple[TableOneRow, ...]
    setups: tuple[SetupError, ...]
    sensitivity: tuple[SetupSensitivity, ...]
    displacement_uncertainty: float
    angles: Mapping[str, AngleUncertainty]
    direct: DirectMeasurement | None = None
    comparisons: tuple[DirectComparison, ...] = ()

    def translational(self) -> tuple[VolumetricErrors, ...]:
        """Return the results that determine all nine translations, in the order of the report."""
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
        formulation, or no method that determines all nine curves, as where a face alone was
        measured.

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
        repeats, _ = solve_repeats(measurement, [name for name in methods if name in solvers()])
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
