"""Figures as functions, in one look: each takes the project's data classes and returns a figure.

Matplotlib is imported when a function is first asked for, not before.
"""

from importlib import import_module
from typing import Any

from stepdiag_ros.metrology.geometry import CURVES, ROTATIONS, TRANSLATIONS
from stepdiag_ros.plots.stamps import stamp

_HOMES = {
    "budget": "budgets",
    "budget_curves": "budgets",
    "changes": "two_runs",
    "compensation": "compensations",
    "curves_before_after": "curves",
    "error_curves": "curves",
    "gap_along_lines": "discrepancy",
    "gap_candidates": "discrepancy",
    "gap_dependences": "dependences",
    "gap_figures": "discrepancy",
    "gap_map": "discrepancy",
    "gap_where": "discrepancy",
    "held_out": "discrepancy",
    "angles_with_repeats": "experiment",
    "direct_comparison": "experiment",
    "motion_with_repeats": "experiment",
    "frontier": "frontiers",
    "block_displacements": "lines",
    "line_errors": "lines",
    "readings": "lines",
    "settling": "lines",
    "repeatability": "lines",
    "plan": "plans",
    "dots_of": "saving",
    "png_bytes": "saving",
    "save": "saving",
    "svg_text": "saving",
    "squareness": "angles",
    "squareness_sensitivity": "angles",
    "iso230_2": "standards",
    "iso230_2_graphs": "standards",
    "iso230_6": "standards",
    "iso230_6_graphs": "standards",
    "tracker_deviations": "tracker",
    "tracker_document": "tracker",
    "tracker_residuals": "tracker",
    "tracker_space": "tracker",
    "visibility": "verdicts",
    "diagonals_alone": "volumes",
    "volume": "volumes",
    "weather": "air",
    "worst_error": "worst_place",
    "years_of_machine": "trends",
}
"""Function → module of this package; no module has the name of a function, which it would hide."""
__all__ = ["CURVES", "ROTATIONS", "TRANSLATIONS", "stamp", *_HOMES]


def __getattr__(name: str) -> Any:
    """Return a function of one of the modules, which is imported only now."""
    if name not in _HOMES:
        raise AttributeError(f"stepdiag_ros.plots has no figure '{name}'")
    return getattr(import_module(f"stepdiag_ros.plots.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
