"""The errors in the volume: the worst point, in numbers and as an exaggerated wireframe."""

import json
import math
from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.evaluation.volumetric import VolumetricReport
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.places import HALF
from stepdiag_ros.report.documents.volumetric import volumetric_json
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.page import Fact
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.volumetric import accuracy_table
from stepdiag_ros.text.numbers import plain, with_expanded
from stepdiag_ros.text.table import with_rows
from stepdiag_ros.words.volumetric import DEFINITION, NO_ERROR_ABOVE


def _volumetric(material: Material) -> VolumetricReport:
    return VolumetricReport(
        dict(material.accuracies), str(material.recorded.path), material.report.run_id
    )


def _tell(material: Material) -> SectionContent | str:
    preferred, found = material.report.preferred(), material.accuracy
    if preferred is None or found is None:
        return "The errors in the volume are unknown: the lines are not enough for any method."
    said = [
        DEFINITION,
        "± (95 %) of the largest error, wherever it is: in the table"
        f" {COVERAGE_FACTOR:g} standard uncertainties from the readings, plausible rotations and"
        " the laser's scale; above it, as on the first page, the larger of that and of U from all"
        f" sources that the budget knows{', so at least that' if material.lower_bound else ''}.",
        NO_ERROR_ABOVE,
    ]
    said += [
        f"{method_title(method)}: {remark}."
        for method, one in material.accuracies.items()
        for remark in one.remarks
    ]
    facts, drawings = [], {}
    if math.isfinite(found.value):
        place = ", ".join(plain(value * IN_MILLI, 1) for value in found.position)
        vector = ", ".join(plain(value * IN_MICRO, 2) for value in found.vector)
        size = with_expanded(found.value, material.expanded_uncertainty, IN_MICRO)
        facts = [
            Fact("Largest error", f"{size} µm"),
            Fact("at X, Y, Z", f"{place} mm"),
            Fact("error there in X, Y, Z", f"{vector} µm"),
            Fact(
                "Root mean square over the nodes of the volume",
                f"{plain(found.rms * IN_MICRO, 2)} µm",
            ),
        ]
        drawings["volume"] = Drawing(
            "volume",
            (preferred, material.report.chain),
            "The measured box and, exaggerated, what the machine makes of it; the worst point is"
            " marked.",
            {"title": ""},
            place=HALF,
        )
    tables = with_rows([accuracy_table(_volumetric(material))])
    return SectionContent(
        {
            "facts": facts,
            "method": method_title(preferred.method),
            "tables": tables,
            "sentences": said,
        },
        drawings,
    )


def _document(material: Material) -> dict[str, Any] | None:
    if not material.accuracies:
        return None
    found = material.accuracy
    return {
        "rms": {method: schemas.number(one.rms) for method, one in material.accuracies.items()},
        "worst": json.loads(volumetric_json(_volumetric(material))),
        "method": None if found is None else _method(material),
        "expanded_uncertainty": schemas.number(material.expanded_uncertainty),
    }


def _method(material: Material) -> str | None:
    preferred = material.report.preferred()
    return None if preferred is None else preferred.method


SECTION = ReportSection("volume", "Errors in the volume", 80, _tell, _document)
