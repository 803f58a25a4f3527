"""Squareness from diagonals as a JSON document."""

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.squareness import SquarenessReport
from stepdiag_ros.metrology.forward import SQUARENESS_DEFINITIONS
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS, sign


def squareness_json(report: SquarenessReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known."""
    result = report.result
    content = {
        "source": report.source,
        "sign_definitions": {
            name: dict(SQUARENESS_DEFINITIONS[words]) for name, words in SIGN_DEFINITIONS.items()
        },
        "squareness": [
            {
                "name": one.name,
                "diagonals": list(one.diagonals),
                **{
                    definition: schemas.number(sign(one.name, definition) * one.value)
                    for definition in SIGN_DEFINITIONS
                },
                "theta": schemas.number(one.theta),
                "standard_uncertainty": schemas.number(one.standard_uncertainty),
            }
            for one in result.values
        ],
        "mean_length_error": schemas.number(result.mean_length_error),
        "mean_length_standard_uncertainty": schemas.number(result.mean_length_uncertainty),
        "closure": schemas.number(result.closure),
        "closure_standard_uncertainty": schemas.number(result.closure_uncertainty),
        "remarks": list(result.remarks),
        "warnings": [report.warning],
    }
    return schemas.json_text(schemas.document("squareness", content))
