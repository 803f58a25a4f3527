"""What is not known: gathered from all other sections."""

from typing import Any

from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.pages.sections.readings import NO_REPEATS
from stepdiag_ros.words.positioning import uneven_reason

_GIVEN = {
    "customer": "the customer (--customer)",
    "operator": "who measured (--operator)",
    "place": "where it was measured (--place)",
    "serial": "the number of the machine (--serial)",
    "laser_certificate": "the laser's certificate (--laboratory)",
}


def unknowns(material: Material) -> dict[str, list[str]]:
    """Return what is not known: title → sentences; titles without any are not there."""
    given, report = material.given, material.report
    not_told = [words for name, words in _GIVEN.items() if not getattr(given, name)]
    if not given.instrument_source:
        not_told.append("how well laser, air, material and setup are known (--instrument)")
    if not given.tolerance > 0.0:
        not_told.append("which error is allowed (--tolerance)")
    lines = [
        f"{one.name}: {one.complete} of {one.planned} passes are complete."
        for one in material.taken
        if one.complete < one.planned
    ]
    preferred = report.preferred()
    if material.uneven:
        reason = uneven_reason(material.uneven)
        errors = [f"All error curves: {reason[:1].lower()}{reason[1:]}"]
    elif preferred is None:
        errors = ["All error curves: the lines are not enough for any method."]
    else:
        title = method_title(preferred.method)
        errors = [f"{title}: {text.rstrip('.')}." for text in preferred.not_determined]
    repeats = [] if material.repeats.reading_freedom > 0 or material.repeated else [NO_REPEATS]
    unsure = [] if material.budget is None else list(material.budget.budget.remarks)[:1]
    tests = [] if material.positioning is None else list(material.positioning.unknown)
    if tests:
        unsure.append(f"For the uncertainty of the ISO 230 tests: {', '.join(tests)}.")
    found = {
        "Not stated": [f"{words[:1].upper()}{words[1:]}." for words in not_told],
        "Not measured": [*lines, *repeats],
        "Not determined by the measured lines": errors,
        "Of the uncertainty": unsure,
        "Parts that this report lacks": list(dict.fromkeys(material.missing.values())),
        "Not in any figure": [
            "What the machine does outside the measured box, at other temperatures, loads or feeds,"
            " and what changes after the measurement.",
        ],
    }
    return {title: texts for title, texts in found.items() if texts}


def _tell(material: Material) -> SectionContent:
    return SectionContent({"groups": unknowns(material)})


def _document(material: Material) -> dict[str, Any]:
    return unknowns(material)


SECTION = ReportSection("unknown", "What is not known", 130, _tell, _document)
