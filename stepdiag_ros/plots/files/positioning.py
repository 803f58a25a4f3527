"""Pictures of tests by ISO 230-2 and pages by ISO 230-6, by the names of their files."""

from typing import TYPE_CHECKING

from stepdiag_ros.evaluation.positioning import PositioningReport
from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.plots.stamps import stamp
from stepdiag_ros.plots.standards import iso230_2, iso230_6

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


def draw_positioning(report: PositioningReport) -> "dict[str, Picture]":
    """Return all pictures of a report by the name of their file without ending."""
    pictures: dict[str, Picture] = {}
    said = stamp(run_id=report.run_id)
    for test in report.tests:
        if not is_diagonal(test.kind):
            name = "".join(c if c.isalnum() else "_" for c in test.setup or test.name)
            pictures[f"iso230_2_{name}"] = iso230_2(test, stamp=said)
    for group in report.groups:
        name = group.place.replace(" ", "_")
        pictures[f"iso230_6_{name}"] = iso230_6(
            group, source=report.source, warnings=report.warnings, stamp=said
        )
    return pictures
