"""The summary that a customer signs: the worst place, errors, conformity, conditions."""

import math
from collections.abc import Mapping
from typing import Any

from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.places import WIDE
from stepdiag_ros.report.pages.lead import (
    EXCEEDS,
    KEEPS,
    NOT_ASKED,
    OPEN,
    ToleranceJudgement,
    judge,
    verdict_words,
)
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.page import Chapter, Fact, chapter
from stepdiag_ros.report.pages.pictures import Drawing, Drawn
from stepdiag_ros.report.pages.section import SectionContent
from stepdiag_ros.report.pages.sections.measurement import (
    condition_facts,
    origin_facts,
    temperature_words,
)
from stepdiag_ros.text.extent import moved_axes
from stepdiag_ros.text.numbers import UNKNOWN, with_expanded
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS

KEY = "summary"
DECISIONS = {
    KEEPS: "the machine conforms",
    EXCEEDS: "the machine does not conform",
    OPEN: "no decision is possible",
    NOT_ASKED: "none: no limit was agreed",
}
DECISION_RULE = (
    "ISO 14253-1: conforms if the largest error + U is within the limit, does not if the largest"
    " error - U is beyond it"
)
TITLE_OF_ERRORS = "Errors over the travel, peak to peak (ISO 230-1)"
_SIGNED_BY = ("Measured by", "Checked by", "Accepted for the customer by")


def summary_of(material: Material) -> SectionContent:
    """Return what the summary shows below its headline and sentences."""
    preferred, accuracy = material.report.preferred(), material.accuracy
    drawings = {}
    if preferred is not None and accuracy is not None and math.isfinite(accuracy.value):
        drawings["worst"] = Drawing(
            "worst_error",
            (preferred, material.report.chain),
            "The measured volume with its largest error; each wall shows the largest error in"
            " front of it.",
            {"title": "", "expanded_uncertainty": material.expanded_uncertainty},
            place=WIDE,
        )
    given = material.given
    signed = dict(zip(_SIGNED_BY, (given.operator, "", given.customer), strict=True))
    values: dict[str, Any] = {
        "errors": _errors(material),
        "sign": f"Sign of an angle: {SIGN_DEFINITIONS['rotation']}.",
        "conformity": _conformity(material),
        "conditions": [*condition_facts(material), *origin_facts(material)],
        "signed": signed,
    }
    return SectionContent(values, drawings)


def summary_chapter(
    content: SectionContent, pictures: Mapping[str, Drawn], for_print: bool
) -> Chapter:
    """Lay the summary out; ``pictures`` are its own by name."""
    return chapter(KEY, "Summary", ["summary.html"], content.values, pictures, for_print)


def _errors(material: Material) -> Table:
    """Return all single errors, those that are not determined as unknown."""
    table = new_table(
        f"{TITLE_OF_ERRORS}, U (95 %){': a lower bound' if material.lower_bound else ''}",
        "error",
        "",
        "value ± U / µm",
        "angle with sign ± U / µm/m",
        "travel / mm",
    )
    table.columns[1].number = False
    moved = moved_axes(line.line for line in material.measurement.lines)
    for one in material.single_errors:
        # Of a squareness, the axis that is out of square.
        axis = one.name[3:] or one.name[2]
        travel = f"{one.travel * IN_MILLI:.0f}" if axis in moved else "not moved"
        known = math.isfinite(one.value)
        size = with_expanded(one.value, one.expanded_uncertainty, IN_MICRO) if known else UNKNOWN
        angle = ""
        if known and math.isfinite(one.angle):
            angle = with_expanded(one.angle, one.expanded_uncertainty / one.travel, IN_MICRO)
        what = one.words.replace(f" {one.name}", "")
        table.add_row(one.name, what, size, angle, travel)
    return table


def _conformity(material: Material) -> list[Fact]:
    judged = judge(material)
    asked = judged.verdict != NOT_ASKED
    return [
        Fact("Largest error allowed", judged.limit if asked else "not agreed"),
        Fact("Largest error ± U (95 %)", judged.size),
        Fact("What the value is", _value(material)),
        Fact("Temperature", temperature_words(material)),
        Fact("Decision rule", DECISION_RULE),
        Fact("Decision", _decision(material, judged)),
        Fact("Model and run", verdict_words(material)),
        Fact("Method", _method(material)),
    ]


def _value(material: Material) -> str:
    """Say of what the largest error is, and which errors are not in it."""
    directions = material.lead.directions
    how = {0: "", 1: f", {directions[0] if directions else ''} only"}.get(
        len(directions), ", mean of both directions"
    )
    without = "reversal error, repeatability and drift are not in it"
    return f"longest error vector at the nodes of the measured box, at the mirror{how}; {without}"


def _decision(material: Material, judged: ToleranceJudgement) -> str:
    """Say what is signed, with the reservation of the first page and what it is about."""
    decision = DECISIONS[judged.verdict]
    if not judged.reservation:
        return decision
    said = f"{decision}{judged.reservation}"
    if judged.lower_bound:
        known = material.given.instrument_source
        about = "of the instrument nothing was stated"
        if known:
            about = f"unknown: {material.unknown_sources}"
        said += f" ({about})"
    return f"{said}. {judged.basis}" if judged.basis else said


def _method(material: Material) -> str:
    preferred = material.report.preferred()
    return UNKNOWN if preferred is None else method_title(preferred.method)
