"""A test with a tracker as JSON documents."""

from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.tracker import TrackerReport
from stepdiag_ros.metrology.forward import RIGHT_HANDED
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.tracker.document_figures import FigureCurve, FigureFive, FigureFour
from stepdiag_ros.metrology.tracker.evaluation import LineEvaluation
from stepdiag_ros.metrology.tracker.joint import NAMES, JointEstimate
from stepdiag_ros.metrology.tracker.location import Location
from stepdiag_ros.metrology.tracker.separation import AxisSeparation
from stepdiag_ros.schemas import tracker_figures
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.words.tracker import sentences_of


def tracker_json(report: TrackerReport) -> str:
    """Return the report as JSON text; see ``tracker_document``."""
    return schemas.json_text(tracker_document(report))


def tracker_document(report: TrackerReport) -> dict[str, Any]:
    """Return the report as a mapping that ``json`` can write; SI, null where not known."""
    document: dict[str, Any] = {
        "source": report.source,
        "station": report.station,
        "verdict": {"name": report.verdict.name, "sentence": report.verdict.sentence},
        "equals_recorded": report.equals_recorded,
        "location": _location(report.location),
    }
    result = report.result
    if result is not None:
        document |= {
            "squareness_sign": RIGHT_HANDED,
            "joint": None if result.joint is None else _joint_document(result.joint, report.truth),
            "lines_with_tracker_from_places": _lines_document(result.located),
            "lines_with_tracker_from_all_readings": (
                None if result.corrected is None else _lines_document(result.corrected)
            ),
            "separations": {
                name: {"refused": one} if isinstance(one, str) else _separation_document(one)
                for name, one in result.separations.items()
            },
        }
    document["sentences"] = sentences_of(report)
    return schemas.document("tracker_result", schemas.plain(document))


def figures_json(four: FigureFour, five: FigureFive) -> str:
    """Return the curves of ATLI Figs. 4 and 5 as JSON text; SI."""
    content = tracker_figures.Document(
        location_of_figure_5=_location(five.location),
        shift_of_figure_5=five.shift.tolist(),
        figure_4=[_curve(one) for one in (four.towards, four.away)],
        figure_5=[_curve(one) for one in (five.located, five.true_place)],
    )
    return schemas.json_text(schemas.document("tracker_figures", content))


def _curve(one: FigureCurve) -> tracker_figures.Curve:
    return part_of(tracker_figures.Curve, one)


def _location(location: Location) -> tracker_figures.Location:
    fit = location.adjustment
    return part_of(
        tracker_figures.Location,
        fit,
        position=location.position,
        start_length=location.start_length,
        covariance=location.covariance,
        linear=location.linear,
        standardised_residuals=fit.standardised,
        dilution=location.dilution,
        warnings=location.warnings,
    )


def _joint_document(joint: JointEstimate, truth: Vector | None) -> dict[str, Any]:
    return {
        "names": list(NAMES),
        "values": joint.values,
        "truth": truth,
        "covariance": joint.covariance,
        "position": joint.position,
        "start_length": joint.start_length,
        "sizes": joint.sizes,
        "chain": joint.machine.chain or None,
        "quantity": joint.machine.place,
        "frame": joint.machine.frame,
        "warnings": list(joint.warnings),
        "passes": [
            {
                "line": one.line,
                "run": one.run,
                "direction": one.direction,
                "chi_squared": one.chi_squared,
                "degrees_of_freedom": one.degrees_of_freedom,
                "p_value": one.p_value,
                "rms": one.rms,
            }
            for one in joint.passes
        ],
    }


def _separation_document(one: AxisSeparation) -> dict[str, Any]:
    return {
        "scale": one.scale,
        "lean": one.lean,
        "covariance": one.covariance,
        "correlation": one.correlation,
        "towards": one.towards,
        "offset": one.offset,
        "along": one.along,
        "residuals": one.residuals,
    }


def _lines_document(lines: LineEvaluation) -> dict[str, Any]:
    return {
        "tests": [
            {
                "name": test.name,
                "standard": test.standard,
                "target": test.target,
                "mean_forward": test.mean_forward,
                "mean_backward": test.mean_backward,
                "parameters": test.parameters,
                "expanded_uncertainty": test.expanded_uncertainty,
            }
            for test in lines.tests
        ],
        "slopes": {
            slope.name: {
                "value": slope.slope,
                "standard_uncertainty": slope.standard_uncertainty,
            }
            for slope in lines.slopes
        },
        "squareness": {
            one.name: {"value": one.value, "standard_uncertainty": one.standard_uncertainty}
            for one in lines.squareness
        },
        "closure": lines.closure,
        "closure_standard_uncertainty": lines.closure_uncertainty,
    }
