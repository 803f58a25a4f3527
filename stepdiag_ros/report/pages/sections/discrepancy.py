"""The story of model and run: do they agree, where not, what closes the gap, what is left."""

from typing import Any

from stepdiag_ros.evaluation.diagnosis import DiagnosisReport
from stepdiag_ros.evaluation.not_testable import not_testable_sentences
from stepdiag_ros.metrology.discrepancy.findings import AMBIGUOUS, NOT_TESTABLE, UNEXPLAINED
from stepdiag_ros.plots.places import FLAT, HALF, WIDE
from stepdiag_ros.report.documents.diagnosis import diagnosis_document
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.diagnosis import (
    description_sentences,
    extension_sentences,
    findings_table,
    findings_title,
    gap_table,
    group_sentences,
    known_sentences,
    limits_table,
    model_words,
    noise_sentence,
    physics_sentences,
    rivals_words,
    runners_up_tables,
)
from stepdiag_ros.report.tables.proposal import pairs_table
from stepdiag_ros.text.table import with_rows
from stepdiag_ros.words.diagnosis import MEANING
from stepdiag_ros.words.proposal import proposed_sentences

_CLOSES = {AMBIGUOUS: "What would close it", UNEXPLAINED: "What closes a part of it"}
"""Heading above the effects that were found, where they are not simply named."""


def _tell(material: Material) -> SectionContent | str:
    report = material.diagnosis
    if report is None:
        return material.why_not("diagnosis")
    diagnosis, found = report.diagnosis, report.findings
    drawings = {}
    if diagnosis.verdict != NOT_TESTABLE:
        drawings["gap"] = Drawing(
            "gap_map",
            (diagnosis,),
            "The gap at every stop: what the run measured less what the model gives there.",
            {"title": ""},
            place=HALF,
        )
    if diagnosis.where and drawings:
        drawings["where"] = Drawing(
            "gap_where",
            (diagnosis,),
            "The gap split in several ways; the dashed line is the noise of a stop.",
            {"title": ""},
            place=FLAT,
        )
    if diagnosis.description is not None and diagnosis.findings:
        drawings["dependences"] = Drawing(
            "gap_dependences",
            (diagnosis,),
            "The formula over each quantity on which it depends, and the readings less all else.",
            {"title": ""},
        )
    if found:
        drawings["candidates"] = Drawing(
            "gap_candidates",
            (diagnosis,),
            "What each candidate closes of the gap.",
            {"title": ""},
            place=WIDE,
        )
    if report.held_out is not None:
        drawings["held_out"] = Drawing(
            "held_out",
            (report.held_out,),
            "Readings that took no part in the fit, predicted without and with the effects.",
            {"title": ""},
            place=WIDE,
        )
    return SectionContent(story_of(report), drawings)


def story_of(report: DiagnosisReport) -> dict[str, Any]:
    """Return what a page tells of a diagnosis: its words and its tables, by name."""
    diagnosis, found = report.diagnosis, report.findings
    return {
        "verdict": diagnosis.verdict,
        # What the free values of the model take up whole is no gap that could be looked at.
        "testable": diagnosis.verdict != NOT_TESTABLE,
        "sentence": diagnosis.sentence,
        "meaning": MEANING.get(diagnosis.verdict, ""),
        "noise": noise_sentence(diagnosis),
        "known": known_sentences(diagnosis),
        "rivals": rivals_words(report),
        "next": proposed_sentences(report),
        "pairs": with_rows([pairs_table(report.proposal)]),
        "closes": _CLOSES.get(diagnosis.verdict, "What closes it"),
        "model": model_words(report),
        "where": list(diagnosis.where),
        "description": description_sentences(diagnosis),
        "findings": with_rows([findings_table(found, findings_title(diagnosis))] if found else []),
        "physics": [*physics_sentences(found), *group_sentences(found)],
        "runners_up": with_rows(runners_up_tables(found)),
        "gap": with_rows([gap_table(report)]),
        "where_after": list(diagnosis.where_after),
        "proof": extension_sentences(report),
        "limits": with_rows([limits_table(report)]),
        "not_testable": not_testable_sentences(report),
    }


def _document(material: Material) -> dict[str, Any] | None:
    return None if material.diagnosis is None else diagnosis_document(material.diagnosis)


SECTION = ReportSection("discrepancy", "Does the model explain the run?", 110, _tell, _document)
