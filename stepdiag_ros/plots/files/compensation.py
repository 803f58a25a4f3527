"""The pictures of compensation tables, by the names of their files."""

from typing import TYPE_CHECKING

from stepdiag_ros.evaluation.compensation import CompensationReport

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


def draw_compensation(report: CompensationReport) -> "dict[str, Picture]":
    """Return all pictures of the tables by the name of their file without ending."""
    from stepdiag_ros.plots.compensations import compensation

    return {"what_remains": compensation(report.remainder, report.control)}
