"""The uncertainty budget by its sources."""

from dataclasses import replace
from typing import Any

from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.plots.places import HALF
from stepdiag_ros.report.documents.budget import budget_document
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.tables.budget import (
    budget_table,
    curves_table,
    largest_error_table,
    sources_table,
)
from stepdiag_ros.text.numbers import with_uncertainty
from stepdiag_ros.text.table import Table, with_rows
from stepdiag_ros.words.budget import figure_groups


def _tell(material: Material) -> SectionContent | str:
    report = material.budget
    if report is None:
        return material.why_not("budget")
    budget = report.budget
    groups = figure_groups(budget)
    known = material.given.instrument_source
    said = [
        f"By the GUM (JCGM 100), {method_title(budget.method)}, with all correlations. Each number"
        " is what one source alone would do to the result; they add in squares. Sources that are"
        " not known, do not act, or round to zero, are in the list of the inputs alone.",
        f'Laser, air, material and setup: as stated by the instrument file "{known}".'
        if known
        else "No instrument file states laser, air, material and setup (--instrument), so that the"
        " sums contain only what the readings show of themselves and the angular errors; every U is"
        " a lower bound.",
    ]
    drawings = {}
    if groups:
        drawings["budget"] = Drawing(
            "budget",
            (budget,),
            "Combined standard uncertainty of each result; a colour's share of a bar is its share"
            " of the variance.",
            {"title": ""},
            place=HALF,
        )
    return SectionContent(
        {
            "sources": with_rows([sources_table(budget)]),
            "tables": [
                _without_idle_rows(budget_table(budget, title, rows))
                for title, rows in groups.items()
            ]
            + _largest_tables(material),
            "nodes": with_rows(curves_table(budget)),
            "sentences": said,
            "remarks": [*_of_largest_error(material), *budget.remarks],
        },
        drawings,
    )


def _largest_tables(material: Material) -> list[Table]:
    made, largest = material.budget, material.budget_of_largest_error
    if made is None or largest is None:
        return []
    return [_without_idle_rows(largest_error_table(made.budget, largest))]


def _of_largest_error(material: Material) -> list[str]:
    """Say how the uncertainty of the first page follows from the table of the largest error."""
    largest = material.budget_of_largest_error
    if largest is None:
        return []
    of_budget, of_readings = (
        with_uncertainty(0.0, one.value * IN_MICRO)[1]
        for one in (largest.expanded, material.expanded_of_readings)
    )
    return [
        "The largest error is a sum of curve values at one place. A source changes them together,"
        " so that its effects partly cancel. That the true one may be elsewhere or point another"
        " way is a contribution of its own. The"
        f" first page shows the larger of this U, {of_budget} µm, and U of the readings,"
        f" {of_readings} µm."
    ]


def _without_idle_rows(view: Table) -> Table:
    """Return a table without the sources that act on nothing that it shows."""
    kept = [
        number
        for number, row in enumerate(view.rows)
        if not all(cell == "-" or _rounds_to_zero(cell) for cell in row[1:])
    ]
    ends = {place for place, number in enumerate(kept) if number in view.section_ends}
    return replace(view, rows=[view.rows[number] for number in kept], section_ends=ends)


def _rounds_to_zero(cell: str) -> bool:
    return set(cell) <= set("0.")


def _document(material: Material) -> dict[str, Any] | None:
    return None if material.budget is None else budget_document(material.budget)


SECTION = ReportSection("uncertainty", "Uncertainty budget", 90, _tell, _document)
