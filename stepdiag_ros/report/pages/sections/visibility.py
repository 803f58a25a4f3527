"""What these lines determine of each of the 21 errors."""

from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.run import visibility_sentences, visibility_table
from stepdiag_ros.text.table import with_rows


def _tell(material: Material) -> SectionContent | str:
    found = material.report.visibility
    if found is None:
        return "What these lines determine was not computed."
    any_size = ", where rotations may be of any size" if found.chain else ""
    drawing = Drawing(
        "visibility",
        (found,),
        f"What these lines determine of each error{any_size}.",
        {"title": ""},
    )
    return SectionContent(
        {
            "tables": with_rows([visibility_table(found)]),
            "sentences": visibility_sentences(found, material.report.ordered_results()),
        },
        {"visibility": drawing},
    )


SECTION = ReportSection("visibility", "What these lines determine", 100, _tell)
