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
        "location": schemas.plain(_location(report.location)),
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
    return schemas.document("tracker_result", document)


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
    return tracker_figures.Curve(
        label=one.label, distance=one.distance.tolist(), deviation=one.deviation.tolist()
    )


def _location(location: Location) -> tracker_figures.Location:
    fit = location.adjustment
    return part_of(
        tracker_figures.Location,
        fit,
        position=location.position.tolist(),
        start_length=location.start_length,
        covariance=location.covariance.tolist(),
        linear=location.linear.tolist(),
        residuals=fit.residuals.tolist(),
        standardised_residuals=fit.standardised.tolist(),
        dilution=location.dilution,
        warnings=location.warnings,
    )


def _joint_document(joint: JointEstimate, truth: Vector | None) -> dict[str, Any]:
    return {
        "names": list(NAMES),
        "values": schemas.numbers(joint.values),
        "truth": None if truth is None else schemas.numbers(truth),
        "covariance": [schemas.numbers(row) for row in joint.covariance],
        "position": schemas.numbers(joint.position),
        "start_length": schemas.number(joint.start_length),
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
                "chi_squared": schemas.number(one.chi_squared),
                "degrees_of_freedom": one.degrees_of_freedom,
                "p_value": schemas.number(one.p_value),
                "rms": schemas.number(one.rms),
            }
            for one in joint.passes
        ],
    }


def _separation_document(one: AxisSeparation) -> dict[str, Any]:
    return {
        "scale": one.scale,
        "lean": one.lean,
        "covariance": [schemas.numbers(row) for row in one.covariance],
        "correlation": schemas.number(one.correlation),
        "towards": schemas.numbers(one.towards),
        "offset": one.offset,
        "along": one.along,
        "residuals": schemas.numbers(one.residuals),
    }


def _lines_document(lines: LineEvaluation) -> dict[str, Any]:
    return {
        "tests": [
            {
                "name": test.name,
                "standard": test.standard,
                "target": schemas.numbers(test.target),
                "mean_forward": schemas.numbers(test.mean_forward),
                "mean_backward": schemas.numbers(test.mean_backward),
                "parameters": {name: schemas.number(v) for name, v in test.parameters.items()},
                "expanded_uncertainty": {
                    name: schemas.number(v) for name, v in test.expanded_uncertainty.items()
                },
            }
            for test in lines.tests
        ],
        "slopes": {
            slope.name: {
                "value": schemas.number(slope.slope),
                "standard_uncertainty": schemas.number(slope.standard_uncertainty),
            }
            for slope in lines.slopes
        },
        "squareness": {
            one.name: {
                "value": schemas.number(one.value),
                "standard_uncertainty": schemas.number(one.standard_uncertainty),
            }
            for one in lines.squareness
        },
        "closure": schemas.number(lines.closure),
        "closure_standard_uncertainty": schemas.number(lines.closure_uncertainty),
    }
