"""An uncertainty budget and what it was made of."""

from dataclasses import dataclass
from pathlib import Path

from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.monte_carlo import BudgetCheck


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
