"""Volumetric accuracies as a JSON document."""

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.volumetric import VolumetricReport
from stepdiag_ros.metrology.standards.volumetric import (
    MACHINES_OF_RL,
    PLANAR_MACHINE_OF_RL,
    volumetric_accuracy,
)
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.schemas.volumetric import Accuracy, Document, Example
from stepdiag_ros.words.volumetric import DEFINITION


def volumetric_json(report: VolumetricReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known."""
    content = Document(
        source=report.source or None,
        run_id=report.run_id or None,
        definition=DEFINITION,
        methods={method: part_of(Accuracy, found) for method, found in report.accuracies.items()},
        examples={
            one.name: Example(
                linear_error=one.linear_error,
                E_d=one.diagonal_result,
                volumetric_accuracy=volumetric_accuracy(one.errors).value,
            )
            for one in (*MACHINES_OF_RL, PLANAR_MACHINE_OF_RL)
        },
    )
    return schemas.json_text(schemas.document("volumetric", content))
