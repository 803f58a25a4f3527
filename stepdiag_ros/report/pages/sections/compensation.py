"""What compensation would leave of the errors."""

import json
from typing import Any

from stepdiag_ros.compensation.permission import DESPITE, permission
from stepdiag_ros.compensation.remaining import COMPUTED
from stepdiag_ros.metrology.discrepancy.findings import AMBIGUOUS, DESCRIBED, NAMED, UNEXPLAINED
from stepdiag_ros.plots.places import HALF
from stepdiag_ros.report.documents.compensation import compensation_json
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.compensation import change_table
from stepdiag_ros.text.table import with_rows
from stepdiag_ros.words.compensation import limit_words, uncorrected

_NOT_YET = {
    DESCRIBED: "Do not install these tables: the run shows something without a name that the error"
    " curves do not contain, and a part of it may stand in the tables as an error of an axis. Find"
    " its cause first.",
    UNEXPLAINED: "Do not install these tables: the run shows something that the error curves do not"
    " contain, and a part of it may stand in the tables as an error of an axis. Find its cause"
    " first.",
    AMBIGUOUS: "Do not install these tables yet: the run shows more than the error curves, several"
    " effects may be the cause, and a part of it may stand in the tables as an error of an axis."
    " Measure first what distinguishes them.",
    NAMED: "Install these tables only when the named effects were seen to and the machine was"
    " measured again: a part of them may stand in the tables as an error of an axis.",
}
"""Verdict → why the tables of this run are not to be used."""


def _tell(material: Material) -> SectionContent | str:
    report = material.compensation
    if report is None:
        return material.why_not("compensation")
    drawing = Drawing(
        "compensation",
        (report.remainder, report.control),
        f"What tables for {report.control.title} would leave.",
        {"title": ""},
        place=HALF,
    )
    return SectionContent(
        {
            "control": report.control.title,
            "not_yet": not_yet(material),
            "tables": with_rows(
                [change_table("Computed, before and after", report.remainder.changes)]
            ),
            "computed": " ".join(one for one in (COMPUTED, limit_words(report)) if one),
            "uncorrected": [f"{text}." for text in uncorrected(report)],
            "command": f"stepdiag compensate {material.recorded.path.name}"
            f" --for {report.control.name}",
        },
        {"compensation": drawing},
    )


def not_yet(material: Material) -> str:
    """Return why tables of this run are not to be used; empty if nothing speaks against them."""
    made = material.compensation
    if made is None or not permission(made.identified, made.control, made.layout.settings).refusal:
        return ""
    why = _NOT_YET.get(made.identified.verdict.name, "")
    return f"{why} 'stepdiag compensate' refuses to write them without {DESPITE}."


def _document(material: Material) -> dict[str, Any] | None:
    if material.compensation is None:
        return None
    made: dict[str, Any] = json.loads(compensation_json(material.compensation))
    return made


SECTION = ReportSection("compensation", "What compensation would leave", 120, _tell, _document)
