"""Squareness from diagonals as a JSON document."""

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.squareness import SquarenessReport
from stepdiag_ros.metrology.forward import SQUARENESS_DEFINITIONS
from stepdiag_ros.metrology.standards.diagonal_squareness import DiagonalSquareness
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.schemas.squareness import Angle, Document
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS, sign


def squareness_json(report: SquarenessReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known."""
    result = report.result
    content = Document(
        source=report.source,
        sign_definitions={
            name: SQUARENESS_DEFINITIONS[words] for name, words in SIGN_DEFINITIONS.items()
        },
        squareness=tuple(_angle(one) for one in result.values),
        mean_length_error=result.mean_length_error,
        mean_length_standard_uncertainty=result.mean_length_uncertainty,
        closure=result.closure,
        closure_standard_uncertainty=result.closure_uncertainty,
        remarks=result.remarks,
        warnings=(report.warning,),
    )
    return schemas.json_text(schemas.document("squareness", content))


def _angle(one: DiagonalSquareness) -> Angle:
    return part_of(
        Angle,
        one,
        rotation=sign(one.name, "rotation") * one.value,
        angle=sign(one.name, "angle") * one.value,
    )
