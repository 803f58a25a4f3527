"""Positioning of the axes by ISO 230-2."""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from stepdiag_ros.evaluation.positioning import PositioningReport
from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest
from stepdiag_ros.plots.places import FLAT
from stepdiag_ros.report.documents.positioning import positioning_json
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.positioning import parameters_table, target_table
from stepdiag_ros.words.positioning import decimals_of, sentences

_MOST_COLUMNS = 4
"""Axes in one table; further ones have a table of their own."""


def _tell(material: Material) -> SectionContent | str:
    report = material.positioning
    if report is None:
        return material.why_not("positioning")
    tests = [test for test in report.tests if not is_diagonal(test.kind)]
    if not tests:
        return "No axis was measured along its own line, as ISO 230-2 asks for."
    decimals = decimals_of(report.tests)
    several = [tests[at : at + _MOST_COLUMNS] for at in range(0, len(tests), _MOST_COLUMNS)]
    drawing = Drawing(
        "iso230_2_graphs",
        (tests,),
        f"{tests[0].standard}: deviation of the mean of each direction, ±2 s; 0 at the first"
        " target.",
        {"title": ""},
        place=FLAT,
    )
    return SectionContent(
        {
            "parameters": [parameters_table(some, decimals) for some in several],
            "targets": [target_table(test, decimals) for test in tests],
            "sentences": [*_general(report), *remarks_of(tests)],
        },
        {"axes": drawing},
    )


def _general(report: PositioningReport) -> list[str]:
    """Return what holds of all tests alike."""
    return sentences(replace(report, tests=()))


def remarks_of(tests: Sequence[PositioningTest]) -> list[str]:
    """Return the remarks about some tests, those of several tests once."""
    about: dict[str, list[str]] = {}
    for test in tests:
        for remark in test.remarks:
            about.setdefault(remark, []).append(test.label)
    return [f"{', '.join(names)}: {remark}." for remark, names in about.items()]


def _document(material: Material) -> dict[str, Any] | None:
    if material.positioning is None:
        return None
    made: dict[str, Any] = json.loads(positioning_json(material.positioning))
    return made


SECTION = ReportSection("axes", "Positioning of the axes (ISO 230-2)", 60, _tell, _document)
