"""Compensation tables, and what they leave, as a JSON document."""

import hashlib
from dataclasses import asdict

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.compensation import CompensationReport
from stepdiag_ros.schemas.compensation import Change, Document, File
from stepdiag_ros.schemas.origin import origin_of
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.words.compensation import uncorrected


def compensation_json(report: CompensationReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known (schema ``compensation``)."""
    remainder = report.remainder
    content = Document(
        control=report.control.name,
        title=report.control.title,
        format_source=report.control.source,
        origin=origin_of(asdict(report.identified.origin)),
        settings=report.layout.settings,
        spacing=report.layout.spacing or None,
        reference=report.layout.reference,
        on_top_of=report.on_top_of or None,
        files=[
            File(name=name, sha256=hashlib.sha256(text.encode()).hexdigest())
            for name, text in report.files.items()
        ],
        corrects=report.control.corrects,
        uncorrected=uncorrected(report),
        says=report.control.says,
        remarks=report.identified.remarks,
        places=remainder.places,
        places_known=remainder.known,
        rms_standard_uncertainty=remainder.rms_uncertainty,
        changes=[part_of(Change, one) for one in remainder.changes],
    )
    return schemas.json_text(schemas.document("compensation", content))
