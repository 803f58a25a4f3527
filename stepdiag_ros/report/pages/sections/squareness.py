"""The squareness of the axes, with its sign drawn."""

import math
from typing import Any

from stepdiag_ros.metrology.forward import AXES_OF
from stepdiag_ros.plots.places import WIDE
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.run import squareness_table
from stepdiag_ros.text.table import with_rows
from stepdiag_ros.words.squareness import LEAST_SQUARES_LINES, SIGN_DEFINITIONS


def _tell(material: Material) -> SectionContent | str:
    report = material.report
    preferred = report.preferred()
    if preferred is None:
        return "Squareness is unknown: the measured lines are not enough for any method."
    known = any(
        figure.name in AXES_OF and math.isfinite(figure.value)
        for result in report.results
        for figure in result.figures
    )
    if not known:
        return "Squareness is unknown: the measured lines do not determine it."
    drawing = Drawing(
        "squareness",
        ([preferred],),
        "How the axes stand to each other, the angle exaggerated.",
        {"title": "", "truth": report.truth},
        place=WIDE,
    )
    return SectionContent(
        {
            "tables": with_rows([squareness_table(report, "rotation")]),
            "sentences": [
                f"Sign: {SIGN_DEFINITIONS['rotation']}. C0Y: Y to X, B0Z: Z to X, A0Z: Z to Y."
                " ±: of the readings, of plausible rotations and of the laser's scale; the budget"
                " has all known sources.",
                LEAST_SQUARES_LINES,
            ],
        },
        {"squareness": drawing},
    )


def _document(material: Material) -> dict[str, Any] | None:
    preferred = material.report.preferred()
    if preferred is None:
        return None
    return {"method": preferred.method, "sign": SIGN_DEFINITIONS["rotation"]}


SECTION = ReportSection("squareness", "Squareness", 50, _tell, _document)
