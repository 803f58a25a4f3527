"""Monte Carlo over all sources through the solver itself, and the check of the linear budget."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.jcgm101 import (
    VALIDATION_SHARE,
    TrialOutcome,
    Validation,
    monte_carlo,
    validate,
)

_ROWS = 500
"""Trials that are drawn together: what a processor's cache holds of a day's readings."""


@dataclass(frozen=True)
class BudgetCheck:
    """A budget checked by Monte Carlo; vectors have one entry a quantity of the budget.

    Attributes:
        outcome: of the Monte Carlo method.
        validation: comparison of the linear budget with it.
        digits: significant digits of the standard uncertainties that count.
    """

    outcome: TrialOutcome
    validation: Validation
    digits: int


def check_budget(
    budget: Budget,
    digits: int = 1,
    most_trials: int = 400_000,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> BudgetCheck:
    """Propagate the distributions of all known sources and compare with the linear budget.

    Each trial draws every source, changes the readings by what it does to them, and solves them by
    the method itself; a straightness is taken between the nodes where it is largest in that trial.

    Args:
        budget: of a result.
        digits: significant digits of the standard uncertainties that count, 1 or 2.
        most_trials: where the adaptive procedure stops, settled or not.
        seed: of the random numbers.
        progress: called with the part (0..1) of the most trials that is done.

    Raises:
        ValueError: an argument is out of range.
    """
    found = budget.sensitivity
    by_direct = np.nan_to_num(found.estimator.by_direct())

    def sample(count: int, rng: np.random.Generator) -> Vector:
        drawn = np.empty((count, len(found.quantities)))
        for start in range(0, count, _ROWS):
            rows = min(_ROWS, count - start)
            excess = np.tile(found.observations.excess, (rows, 1))
            true = np.zeros((rows, len(found.quantities)))
            for source in budget.sources:
                if source.known and source.standard_uncertainty > 0.0:
                    effect, changes = source.draw(rows, rng)
                    excess += effect
                    for place, quantity in enumerate(found.quantities):
                        true[:, place] += changes.get(quantity.name, 0.0)
            curves = found.estimator.curves(excess)
            if by_direct.size:
                curves += rng.standard_normal((rows, by_direct.shape[1])) @ by_direct.T
            drawn[start : start + rows] = found.of_curves(curves) - true
        return drawn

    outcome = monte_carlo(
        sample, budget.coverage, digits, most_trials, seed, VALIDATION_SHARE, progress
    )
    return BudgetCheck(
        outcome,
        validate(found.values, budget.expanded, outcome, budget.standard_uncertainty, digits),
        digits,
    )
