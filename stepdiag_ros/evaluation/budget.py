"""The uncertainty budget of a solved run, and U of its largest error, the same wherever stated."""

from dataclasses import dataclass, replace
from math import nan
from pathlib import Path

import numpy as np

from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.evaluation.solving import one_thread
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy
from stepdiag_ros.metrology.uncertainty.budget import Budget, make_budget
from stepdiag_ros.metrology.uncertainty.coverage import Expanded, larger
from stepdiag_ros.metrology.uncertainty.instrument import Instrument
from stepdiag_ros.metrology.uncertainty.largest_error import (
    LargestErrorBudget,
    budget_of_largest_error,
)
from stepdiag_ros.metrology.uncertainty.monte_carlo import BudgetCheck
from stepdiag_ros.metrology.uncertainty.source import ANGULAR, MATERIAL

NOTHING_STATED = Instrument()
"""Laser, air and setup of which nobody stated anything."""


@dataclass(frozen=True)
class BudgetReport:
    """What is shown of a budget.

    Attributes:
        budget: by the GUM.
        check: by Monte Carlo; None if it was not asked for.
        run_id: identity of the run; empty if it has none.
        bag: the file.
        remarks: about the run as a whole.
    """

    budget: Budget
    check: BudgetCheck | None = None
    run_id: str = ""
    bag: Path | None = None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class LargestErrorUncertainty:
    """How well the longest error vector in the volume is known.

    Attributes:
        of_readings: U of the result itself: of the readings, of rotations as far as they leave them
            open, and of the laser's scale, m; NaN if not known.
        budget: what the sources of the budget make of it; None without a budget or a value.
    """

    of_readings: Expanded
    budget: LargestErrorBudget | None

    @property
    def of_budget(self) -> Expanded:
        """Return U by the budget, m; NaN if not known."""
        return Expanded() if self.budget is None else self.budget.expanded

    @property
    def expanded(self) -> Expanded:
        """Return the U that is stated: the larger of the two, m; NaN if not known."""
        return larger(self.of_readings, self.of_budget)


def budget_of(
    report: Report,
    instrument: Instrument = NOTHING_STATED,
    expansion: float = nan,
    material_temperature: float | None = None,
) -> Budget:
    """Return the uncertainty budget of the method to rely on.

    Args:
        report: of a run, with its lines.
        instrument: what is known of laser, air and setup.
        expansion: coefficient that the lines were corrected with, 1/K; NaN if they were not.
        material_temperature: that they were corrected with instead of the recorded one, degC.

    Raises:
        ValueError: there is no result to rely on, or no budget can be made of its method; one
            sentence.
    """
    preferred = report.preferred()
    if preferred is None or report.measurement is None:
        raise Refusal(
            "no method could be used on these lines: there is no budget", fault="undetermined"
        )
    with one_thread():
        return make_budget(
            report.measurement,
            instrument,
            preferred.method,
            expansion=expansion,
            material_temperature=material_temperature,
        )


def with_budget(
    report: Report, expansion: float = nan, material_temperature: float | None = None
) -> Report:
    """Return a report with the budget of what nobody stated anything about; see ``budget_of``.

    Where no budget can be made, the report is returned as it is.
    """
    try:
        budget = budget_of(report, NOTHING_STATED, expansion, material_temperature)
    except ValueError:
        return report
    return replace(report, budget=budget)


def uncertainty_of_largest(
    report: Report, found: VolumetricAccuracy, budget: Budget | None
) -> LargestErrorUncertainty:
    """Return how well the longest error vector in the volume is known.

    Args:
        report: of the run.
        found: the vector, by the method to rely on.
        budget: of this method; None without one.
    """
    of_readings = Expanded.of_normal(found.standard_uncertainty)
    preferred = report.preferred()
    if preferred is None or budget is None or not found.value > 0.0:
        return LargestErrorUncertainty(of_readings, None)
    made = budget_of_largest_error(preferred, found, budget, report.chain, report.plausible)
    return LargestErrorUncertainty(of_readings, made)


def shown_rotations(budget: Budget | None, expected: float) -> float:
    """Return how large the readings show rotations where that is more than expected, rad; NaN.

    Args:
        budget: takes the larger of the two; None without one.
        expected: standard deviation of each angle at the end of its travel, rad.
    """
    sources = () if budget is None else budget.sources
    sizes = [one.standard_uncertainty for one in sources if one.group == ANGULAR]
    return next((size for size in sizes if size > expected), nan)


def lacks_material(budget: Budget | None) -> bool:
    """Say whether readings were corrected to 20 °C and nobody stated how well that is known."""
    sources = () if budget is None else budget.sources
    return any(one.group == MATERIAL and not one.known for one in sources)


def is_lower_bound(budget: Budget | None) -> bool:
    """Say whether U by a budget is a lower bound: a source that acts is not known."""
    return budget is None or bool(np.any(budget.at_least))
