"""Displacement along body and face diagonals by ISO 230-6."""

from stepdiag_ros.plots.places import HALF
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.pages.sections.axes import remarks_of
from stepdiag_ros.report.tables.positioning import group_tables, target_table
from stepdiag_ros.text.table import with_rows
from stepdiag_ros.words.positioning import decimals_of


def _tell(material: Material) -> SectionContent | str:
    report = material.positioning
    if report is None:
        return material.why_not("positioning")
    if not report.groups:
        return "No diagonal was measured completely, so there is nothing to say by ISO 230-6."
    decimals = decimals_of(report.tests)
    groups = [
        {
            "place": group.place,
            "tables": with_rows(group_tables(group, decimals)),
            "targets": [target_table(test, decimals) for test in group.tests],
            "sentences": [f"{remark}." for remark in group.remarks],
            "picture": f"group_{number}",
        }
        for number, group in enumerate(report.groups)
    ]
    drawings = {
        f"group_{number}": Drawing(
            "iso230_6_graphs", (group,), f"ISO 230-6, {group.place}.", {"title": ""}, place=HALF
        )
        for number, group in enumerate(report.groups)
    }
    tests = [test for group in report.groups for test in group.tests]
    said = [*remarks_of(tests), *report.warnings]
    return SectionContent({"groups": groups, "sentences": said}, drawings)


SECTION = ReportSection("diagonals", "Displacement along diagonals (ISO 230-6)", 70, _tell)
