"""Volumetric accuracies of methods."""

from dataclasses import dataclass

from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy


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
