"""Pictures of measurements with a tracker, by the names of their files."""

from typing import TYPE_CHECKING

from stepdiag_ros.evaluation.tracker import TrackerReport
from stepdiag_ros.plots.tracker import tracker_deviations, tracker_residuals

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


def draw_tracker(report: TrackerReport) -> "dict[str, Picture]":
    """Return all pictures of a report by the name of their file without ending."""
    pictures = {"tracker_location": tracker_residuals(report)}
    if report.result is not None:
        pictures["seven_lines"] = tracker_deviations(report)
    return pictures
