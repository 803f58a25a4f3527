"""The pictures of an uncertainty budget, by the names of their files."""

from typing import TYPE_CHECKING

from stepdiag_ros.evaluation.budget import BudgetReport
from stepdiag_ros.plots.budgets import budget, budget_curves
from stepdiag_ros.plots.stamps import stamp

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


def draw_budget(report: BudgetReport) -> "dict[str, Picture]":
    """Return all pictures of a budget by the name of their file without ending."""
    said = stamp(run_id=report.run_id)
    return {
        "budget": budget(report.budget, stamp=said),
        "budget_curves": budget_curves(report.budget, stamp=said),
    }
