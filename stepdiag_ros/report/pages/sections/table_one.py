"""What proves the software: the paper's Table 1, and results bit-identical to recorded ones."""

from typing import Any

from stepdiag_ros.report.documents.experiment import experiment_document
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.experiment import table_one_table
from stepdiag_ros.report.tables.run import equality_table
from stepdiag_ros.text.table import with_rows

ABOUT = (
    "By the definitions of Ibaraki & Hata 2010, section 4.1: positioning is the error at the end of"
    " the travel, not peak to peak; straightness is the largest variation"
    " from the least-squares line; squareness is the angle over the travel of the axis that is out"
    " of square, positive where the angle between the positive axes is smaller than 90°."
)


def _tell(material: Material) -> SectionContent | str:
    equal, found = equality_table(material.report), material.experiment
    if found is None:
        why = material.why_not("experiment")
        return why if equal is None else SectionContent({"tables": [equal], "sentences": [why]})
    views = with_rows([table_one_table(found), equal])
    return SectionContent({"tables": views, "sentences": [ABOUT]})


def _document(material: Material) -> dict[str, Any] | None:
    return None if material.experiment is None else experiment_document(material.experiment)


SECTION = ReportSection(
    "table_one", "Proofs of the software", 40, _tell, _document, about_software=True
)
