"""Positioning, straightness and squareness over the travel, in the form of the paper's Table 1."""

from typing import Any

from stepdiag_ros.report.documents.experiment import experiment_document
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.experiment import table_one_table
from stepdiag_ros.text.table import with_rows

ABOUT = (
    "By the definitions of Ibaraki & Hata 2010, section 4.1: positioning is the error at the end of"
    " the travel, not peak to peak; straightness is the largest variation"
    " from the least-squares line; squareness is the angle over the travel of the axis that is out"
    " of square, positive where the angle between the positive axes is smaller than 90°."
)


def _tell(material: Material) -> SectionContent | str:
    if material.experiment is None:
        return material.why_not("experiment")
    view = with_rows([table_one_table(material.experiment)])
    return SectionContent({"tables": view, "sentences": [ABOUT]})


def _document(material: Material) -> dict[str, Any] | None:
    return None if material.experiment is None else experiment_document(material.experiment)


SECTION = ReportSection("table_one", "Table 1 of Ibaraki & Hata", 40, _tell, _document)
