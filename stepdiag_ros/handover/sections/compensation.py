"""What compensation would leave of the errors."""

import json
from typing import Any

from stepdiag_ros.handover.material import Material
from stepdiag_ros.handover.page import table_views
from stepdiag_ros.handover.pictures import Drawing
from stepdiag_ros.handover.section import Content, Section
from stepdiag_ros.report.compensation import COMPUTED, change_table, compensation_json


def _tell(material: Material) -> Content | str:
    report = material.compensation
    if report is None:
        return material.why_not("compensation")
    drawing = Drawing(
        "compensation",
        (report.remainder, report.control),
        f"What tables for {report.control.title} would leave.",
        {"title": ""},
    )
    return Content(
        {
            "control": report.control.title,
            "tables": table_views(
                [change_table("Computed, before and after", report.remainder.changes)]
            ),
            "computed": COMPUTED,
            "uncorrected": [f"{text}." for text in report.uncorrected()],
            "command": f"stepdiag compensate {material.recorded.path.name}"
            f" --for {report.control.name}",
        },
        {"compensation": drawing},
    )


def _document(material: Material) -> dict[str, Any] | None:
    if material.compensation is None:
        return None
    made: dict[str, Any] = json.loads(compensation_json(material.compensation))
    return made


SECTION = Section("compensation", "What compensation would leave", _tell, _document)
