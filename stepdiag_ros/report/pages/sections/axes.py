"""Positioning of the axes by ISO 230-2."""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from stepdiag_ros.evaluation.positioning import PositioningReport
from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest
from stepdiag_ros.report.documents.positioning import positioning_json
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.positioning import parameter_table, target_table
from stepdiag_ros.words.positioning import decimals_of, sentences


def _tell(material: Material) -> SectionContent | str:
    report = material.positioning
    if report is None:
        return material.why_not("positioning")
    tests = [test for test in report.tests if not is_diagonal(test.kind)]
    if not tests:
        return "No axis was measured along its own line, as ISO 230-2 asks for."
    decimals = decimals_of(report.tests)
    axes = [
        {
            "letter": test.name,
            "parameters": replace(parameter_table(test, None, decimals), title=""),
            "runs": f"{test.runs[0]} runs forward, {test.runs[1]} backward",
            "standard": test.standard,
            "targets": [target_table(test, decimals)],
            "picture": f"axis_{number}",
        }
        for number, test in enumerate(tests)
    ]
    drawings = {
        f"axis_{number}": Drawing(
            "iso230_2", (test,), f"{test.standard}, axis {test.name}.", {"title": ""}
        )
        for number, test in enumerate(tests)
    }
    return SectionContent(
        {"axes": axes, "sentences": [*_general(report), *remarks_of(tests)]}, drawings
    )


def _general(report: PositioningReport) -> list[str]:
    """Return what holds of all tests alike."""
    return sentences(replace(report, tests=()))


def remarks_of(tests: Sequence[PositioningTest]) -> list[str]:
    """Return the remarks about some tests, those of several tests once."""
    about: dict[str, list[str]] = {}
    for test in tests:
        for remark in test.remarks:
            about.setdefault(remark, []).append(test.setup or test.name)
    return [f"{', '.join(names)}: {remark}." for remark, names in about.items()]


def _document(material: Material) -> dict[str, Any] | None:
    if material.positioning is None:
        return None
    made: dict[str, Any] = json.loads(positioning_json(material.positioning))
    return made


SECTION = ReportSection("axes", "Positioning of the axes (ISO 230-2)", 60, _tell, _document)
