"""Volumetric accuracies as a JSON document."""

from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.volumetric import VolumetricReport
from stepdiag_ros.metrology.standards.volumetric import (
    MACHINES_OF_RL,
    PLANAR_MACHINE_OF_RL,
    VolumetricAccuracy,
    volumetric_accuracy,
)
from stepdiag_ros.words.volumetric import DEFINITION


def _accuracy(found: VolumetricAccuracy) -> dict[str, Any]:
    return {
        "value": schemas.number(found.value),
        "standard_uncertainty": schemas.number(found.standard_uncertainty),
        "position": [schemas.number(value) for value in found.position],
        "vector": [schemas.number(value) for value in found.vector],
        "frame": found.frame,
        "remarks": list(found.remarks),
    }


def volumetric_json(report: VolumetricReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known."""
    content = {
        "source": report.source or None,
        "run_id": report.run_id or None,
        "definition": DEFINITION,
        "methods": {method: _accuracy(found) for method, found in report.accuracies.items()},
        "examples": {
            one.name: {
                "linear_error": list(one.linear_error),
                "E_d": one.diagonal_result,
                "volumetric_accuracy": volumetric_accuracy(one.errors).value,
            }
            for one in (*MACHINES_OF_RL, PLANAR_MACHINE_OF_RL)
        },
    }
    return schemas.json_text(schemas.document("volumetric", content))
