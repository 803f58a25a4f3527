"""The JSON of a report, whose schema is ``result``: SI everywhere, unknown is ``null``."""

from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.lead import RunLead, lead_of
from stepdiag_ros.evaluation.report import Report, Truth, TruthComparison, compare_with_truth
from stepdiag_ros.metrology import visibility as visibilities
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.report.documents.lead import lead_document
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.schemas.visibility import Verdict, Visibility
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS


def method_document(result: VolumetricErrors, report: Report) -> dict[str, Any]:
    """Return one method's entry of the document."""
    comparison = turns = None
    if report.truth is not None:
        found = compare_with_truth(result, report.truth)
        comparison = _comparison_document(found)
        turned = compare_with_truth(result, report.truth, rotations=True)
        if turned.points:
            turns = _comparison_document(turned)
    return {
        "frame": result.frame,
        "lines": result.lines,
        "nodes": dict(zip(AXES, result.nodes, strict=True)),
        "curves": result.curves,
        "standard_uncertainty": result.standard_uncertainty,
        "figures": {
            figure.name: {
                "value": figure.value,
                "standard_uncertainty": figure.standard_uncertainty,
                "unit": figure.unit,
            }
            for figure in result.figures
        },
        "chi_squared": result.chi_squared,
        "degrees_of_freedom": result.degrees_of_freedom,
        "not_determined": result.not_determined,
        "remarks": result.remarks,
        "equals_recorded": report.equals_recorded.get(result.method),
        "comparison_with_truth": comparison,
        "comparison_of_rotations": turns,
    }


def _comparison_document(found: TruthComparison) -> dict[str, Any]:
    return {
        "rms": found.rms,
        "largest_deviation": found.largest,
        "points": found.points,
        "coverage_95": found.coverage,
        "points_with_uncertainty": found.points_with_uncertainty,
    }


def direct_document(measurement: Measurement | None) -> list[dict[str, Any]]:
    """Return the files of what was measured directly and went into a solve."""
    direct = None if measurement is None else measurement.direct
    return [
        {"file": file.name, "sha256": file.sha256, "errors": file.errors}
        for file in (() if direct is None else direct.files)
    ]


def visibility_part(visibility: visibilities.Visibility) -> Visibility:
    """Return a visibility table as a part of a document."""
    return part_of(
        Visibility,
        visibility,
        chain=visibility.chain or None,
        errors={
            row.name: part_of(
                Verdict,
                row,
                part=row.part or None,
                standard_uncertainty_at_end=row.end,
                largest_standard_uncertainty=row.largest,
                inflation=row.condition,
            )
            for row in visibility.rows
        },
    )


def _truth_document(truth: Truth) -> dict[str, Any]:
    return {
        "curves": truth.curves,
        "figures": {
            figure.name: {"value": figure.value, "unit": figure.unit} for figure in truth.figures
        },
    }


def report_document(report: Report, lead: RunLead | None = None) -> dict[str, Any]:
    """Return the whole report as a mapping that ``json`` can write.

    Args:
        report: of the run.
        lead: its summary, where more is known than the report holds.

    Raises:
        ValueError: the true errors do not fit the results.
    """
    content = {
        "run": {
            "run_id": report.run_id or None,
            "plan": report.plan or None,
            "machine": report.machine or None,
            "chain": report.chain or None,
            "software_version": report.run_software_version or None,
            "simulated": report.simulated,
            "remarks": report.remarks,
        },
        "bag": None if report.bag is None else str(report.bag),
        "direct": direct_document(report.measurement),
        "squareness_sign": SIGN_DEFINITIONS["rotation"],
        "methods": {
            result.method: method_document(result, report) for result in report.ordered_results()
        },
        "not_solved": report.refused,
        "lead": lead_document(lead or lead_of(report)),
        "visibility": None if report.visibility is None else visibility_part(report.visibility),
        "truth": None if report.truth is None else _truth_document(report.truth),
    }
    return schemas.document("result", schemas.plain(content))


def report_json(report: Report) -> str:
    """Return the whole report as JSON text; see ``report_document``."""
    return schemas.json_text(report_document(report))
