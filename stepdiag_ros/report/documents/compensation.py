"""Compensation tables, and what they leave, as a JSON document."""

import hashlib
from dataclasses import asdict
from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.compensation.remaining import Change
from stepdiag_ros.evaluation.compensation import CompensationReport
from stepdiag_ros.words.compensation import uncorrected


def compensation_json(report: CompensationReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known (schema ``compensation``)."""
    remainder = report.remainder
    content = {
        "control": report.control.name,
        "title": report.control.title,
        "format_source": report.control.source,
        "origin": {key: text or None for key, text in asdict(report.identified.origin).items()},
        "settings": dict(report.layout.settings),
        "spacing": report.layout.spacing or None,
        "reference": list(report.layout.reference),
        "on_top_of": report.on_top_of or None,
        "files": [
            {"name": name, "sha256": hashlib.sha256(text.encode()).hexdigest()}
            for name, text in report.files.items()
        ],
        "corrects": list(report.control.corrects),
        "uncorrected": uncorrected(report),
        "says": list(report.control.says),
        "remarks": list(report.identified.remarks),
        "places": remainder.places,
        "places_known": remainder.known,
        "rms_standard_uncertainty": schemas.number(remainder.rms_uncertainty),
        "changes": [
            {**change_document(one), "corrected": one.corrected} for one in remainder.changes
        ],
    }
    return schemas.json_text(schemas.document("compensation", content))


def change_document(one: Change) -> dict[str, Any]:
    """Return a figure before and after for a JSON document."""
    return {
        "name": one.name,
        "unit": one.unit,
        "before": schemas.number(one.before),
        "after": schemas.number(one.after),
    }
