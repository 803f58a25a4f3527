"""The nine error curves with their uncertainty, by the methods beside each other."""

from typing import Any

from stepdiag_ros.evaluation.report import (
    Report,
    frame_sentences,
    method_title,
    short_title,
)
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.plots.places import HALF, WIDE
from stepdiag_ros.report.documents.run import report_document
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.run import curve_tables, fit_table, setup_table, translation_tables
from stepdiag_ros.text.numbers import OF_READINGS
from stepdiag_ros.text.table import with_rows
from stepdiag_ros.words.positioning import uneven_reason

_BESIDE = ("conventional", "setup_robust")
"""Methods that are drawn beside each other."""


def _tell(material: Material) -> SectionContent | str:
    report = material.report
    preferred = report.preferred()
    if material.uneven:
        return uneven_reason(material.uneven)
    if preferred is None:
        methods: dict[str, list[str]] = {}
        for method, why in report.refused.items():
            methods.setdefault(why.rstrip("."), []).append(method_title(method))
        reasons = [f"{', '.join(names)}: {why}." for why, names in methods.items()]
        return " ".join(["The measured lines are not enough for any method.", *reasons])
    results = report.ordered_results()
    drawings = {
        "curves": Drawing(
            "error_curves",
            (preferred,),
            f"Error curves by {short_title(preferred.method)}; bands: 95 %"
            f"{'; dotted: the true errors of the simulated machine' if report.truth else ''}.",
            {"title": "", "truth": report.truth},
            place=WIDE,
        )
    }
    both = [one for one in results if one.method in _BESIDE]
    if len(both) == len(_BESIDE):
        drawings["methods"] = Drawing(
            "error_curves",
            (both,),
            "The conventional formulation (Wang), which takes laser and mirror as perfectly"
            " aligned, beside the setup-robust one (Ibaraki & Hata). Where they differ, setup"
            " errors look like errors of the machine.",
            {"title": ""},
            place=HALF,
        )
    tables = [
        *translation_tables(report),
        fit_table(report, with_equality=False),
    ]
    return SectionContent(
        {
            "tables": with_rows(tables),
            "nodes": with_rows([*curve_tables(preferred), *curve_tables(preferred, True)]),
            "nodes_title": f"All nodes, {method_title(preferred.method)}, {OF_READINGS}",
            "setups": with_rows([setup_table(preferred)]),
            "frames": _frames(report, material.recorded.plan.tracker is not None),
            "remarks": _remarks(report),
        },
        drawings,
    )


def _frames(report: Report, by_tracker: bool) -> list[str]:
    of_what = (
        "of the readings."
        if by_tracker
        else "of the readings, of plausible rotations and of the laser's scale; the budget has all"
        " known sources, and the first page the larger of the two."
    )
    return [
        "Errors are motions of the tool relative to the workpiece; E_YX is the error in Y as X"
        f" moves (ISO 230-1). ±: expanded uncertainty U, {COVERAGE_FACTOR:g} standard uncertainties"
        f" (95 %), {of_what}",
        *frame_sentences(report.ordered_results()),
    ]


def _remarks(report: Report) -> list[str]:
    said = []
    for result in report.ordered_results():
        said += [f"{method_title(result.method)}: {text.rstrip('.')}." for text in result.remarks]
    said += [
        f"{method_title(method)}: not solved, {reason.rstrip('.')}."
        for method, reason in report.refused.items()
    ]
    return said


def _document(material: Material) -> dict[str, Any]:
    return report_document(material.report, material.lead)


SECTION = ReportSection("curves", "Error curves", 30, _tell, _document, by_tracker=True)
