"""The pictures of a report, by the names of their files."""

from typing import TYPE_CHECKING

import numpy as np

from stepdiag_ros.evaluation.budget import is_lower_bound, uncertainty_of_largest
from stepdiag_ros.evaluation.report import Report, robust_to_setup
from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.plots.angles import squareness
from stepdiag_ros.plots.curves import error_curves
from stepdiag_ros.plots.lines import repeatability
from stepdiag_ros.plots.stamps import stamp
from stepdiag_ros.plots.worst_place import worst_error
from stepdiag_ros.words.squareness import SignDefinition

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

    from stepdiag_ros.metrology.solvers.result import VolumetricErrors


def draw_all(
    report: Report, definition: SignDefinition = "rotation", all_methods: bool = False
) -> "dict[str, Picture]":
    """Return all pictures of a report by the name of their file without ending.

    Args:
        report: of a run.
        definition: sign definition of squareness.
        all_methods: draw also the methods beside each other. The conventional result, which setup
            errors can make a hundred times larger than the rest and which then sets the scale, has
            a picture of its own.
    """
    pictures: dict[str, Picture] = {}
    results = report.ordered_results()
    said = stamp(run_id=report.run_id, plan=report.plan)
    preferred = report.preferred()
    if preferred is not None:
        found = of_result(preferred, report.chain, report.plausible)
        worst = worst_error(
            preferred,
            report.chain,
            expanded_uncertainty=uncertainty_of_largest(
                report, found, report.budget
            ).expanded.value,
            which=_which(report),
            stamp=said,
        )
        if worst is not None:
            pictures["worst_error"] = worst
        pictures["error_curves"] = error_curves(preferred, truth=report.truth, stamp=said)
    if all_methods:
        pictures.update(_methods_beside(report, said))
    turning = with_rotations(results)
    if turning:
        pictures["rotations"] = error_curves(turning, ROTATIONS, truth=report.truth, stamp=said)
    if results:
        pictures["squareness"] = squareness(
            results, truth=report.truth, definition=definition, stamp=said
        )
    if report.measurement is not None:
        passes = repeatability(report.measurement, stamp=said)
        if passes is not None:
            pictures["repeatability"] = passes
    return pictures


def _which(report: Report) -> str:
    """Say which U of the largest error it is."""
    if report.budget is None:
        return "of the readings"
    return "U is a lower bound" if is_lower_bound(report.budget) else ""


def _methods_beside(report: Report, said: str) -> "dict[str, Picture]":
    results = report.ordered_results()
    robust = robust_to_setup(results)
    shown = {"error_curves_by_method": robust} if len(robust) > 1 else {}
    if 0 < len(robust) < len(results):
        shown["error_curves_with_conventional"] = list(results)
    return {
        name: error_curves(some, truth=report.truth, stamp=said) for name, some in shown.items()
    }


def with_rotations(results: "tuple[VolumetricErrors, ...]") -> "list[VolumetricErrors]":
    """Return the results that determine a rotation over the whole travel."""
    return [
        one
        for one in results
        if any(
            name in ROTATIONS and np.all(np.isfinite(curve)) for name, curve in one.curves.items()
        )
    ]
