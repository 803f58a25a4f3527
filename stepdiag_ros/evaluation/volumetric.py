"""Volumetric accuracies of methods."""

from dataclasses import dataclass

from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy, of_result


@dataclass(frozen=True)
class VolumetricReport:
    """What is shown of one source.

    Attributes:
        accuracies: method → volumetric accuracy of its error map; empty for the examples alone.
        source: file that the data came from; empty for the examples alone.
        run_id: identity of the run.
    """

    accuracies: dict[str, VolumetricAccuracy]
    source: str = ""
    run_id: str = ""


def accuracies_of(report: Report) -> dict[str, VolumetricAccuracy]:
    """Return the longest error vector in the volume by every method, in the order of reliance."""
    return {
        one.method: of_result(one, report.chain, report.plausible)
        for one in report.ordered_results()
    }
