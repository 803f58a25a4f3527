"""The years of the machine, by the archive that the run is compared with."""

from dataclasses import replace
from typing import Any

from stepdiag_ros.plots.places import WIDE
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.text.table import with_rows

_DRAWN = 6
"""Figures that are drawn, the most urgent ones."""


def _tell(material: Material) -> SectionContent | str:
    given = material.given.history
    if given is None:
        return ""
    from stepdiag_ros.archive.histories import urgency
    from stepdiag_ros.report.tables.trends import figures_table
    from stepdiag_ros.words.trends import (
        change_sentences,
        effects_sentence,
        history_sentence,
        limitations,
    )

    history = given.machine
    worst = sorted(history.figures, key=urgency)[:_DRAWN]
    unknown = all(one.trend.unknown for one in history.figures)
    alone = (
        [] if given.contains_run else ["This run is not in the archive: the history is without it."]
    )
    return SectionContent(
        {
            "sentences": [f"{history_sentence(history)}.", *alone, effects_sentence(history)],
            "tables": with_rows([figures_table(history)]),
            "changes": change_sentences(history),
            "limitations": limitations(history),
        },
        {}
        if unknown
        else {
            "years": Drawing(
                "years_of_machine",
                (replace(history, figures=tuple(worst)),),
                "The figures that need attention first. Bars: U (95 %) of each run; band: U of the"
                " level.",
                {"title": ""},
                place=WIDE,
            )
        },
    )


def _document(material: Material) -> dict[str, Any] | None:
    given = material.given.history
    if given is None:
        return None
    from stepdiag_ros.report.documents.trends import trends_document

    return trends_document(given.place, [given.machine])


SECTION = ReportSection("history", "History of the machine", 125, _tell, _document)
