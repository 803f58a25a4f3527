"""A run with a tracker as a page and as a JSON document."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stepdiag_ros import schemas
from stepdiag_ros.bags.passes import completeness_of, incomplete_sentences
from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.evaluation.tracker import TrackerReport, grid_report, reports_of_run
from stepdiag_ros.metrology.discrepancy.findings import CONSISTENT, NOT_TESTABLE, UNEXPLAINED
from stepdiag_ros.metrology.tracker.joint import NAMES, JointEstimate
from stepdiag_ros.metrology.tracker.readings import SEVEN_LINES
from stepdiag_ros.metrology.tracker.run_result import is_grid
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.report.documents.run import report_document
from stepdiag_ros.report.documents.tracker import tracker_document
from stepdiag_ros.report.pages.given import Given
from stepdiag_ros.report.pages.material import Material, unsolved
from stepdiag_ros.report.pages.page import (
    Fact,
    Lead,
    page,
)
from stepdiag_ros.report.pages.pictures import Drawing, Drawn, Studio
from stepdiag_ros.report.pages.section import SectionContent, ToldSection
from stepdiag_ros.report.pages.sections import measurement, sections
from stepdiag_ros.report.pages.tracker_facts import stations_in
from stepdiag_ros.report.tables.positioning import target_table
from stepdiag_ros.report.tables.tracker import (
    departures_table,
    joint_table,
    lines_table,
    location_table,
    separation_table,
    squareness_rows,
)
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.schemas.tracker_report import Document, Summary, Tracker
from stepdiag_ros.text.table import Table, with_rows
from stepdiag_ros.words.positioning import decimals_of
from stepdiag_ros.words.tracker import joint_values, sentences_of

_TITLE = "Errors of a machine tool with a tracking interferometer: report of a measurement"
_HEADLINES = {
    UNEXPLAINED: "Something happened in a pass: it departs from all others.",
    NOT_TESTABLE: "Whether the passes agree with each other cannot be tested.",
    CONSISTENT: "Every pass agrees with all others.",
}
"""Verdict → headline; the worst first."""
_TOGETHER = "From all readings together"
_TONES = {UNEXPLAINED: "bad", NOT_TESTABLE: "neutral", CONSISTENT: "good"}


class TrackerHandover:
    """What is handed over of a run with a tracker.

    Args:
        material: what every report tells of a run; its report has the error curves of a grid.
        stations: what the seven lines of each station say; empty of a grid.

    Attributes:
        pictures: section's name → picture's name → picture, once ``draw`` was called.
    """

    def __init__(self, material: Material, stations: tuple[TrackerReport, ...]) -> None:
        self._material, self._stations = material, stations
        self.pictures: Mapping[str, Mapping[str, Drawn]] = {}
        shown = (one.told(material) for one in sections() if one.by_tracker)
        self._told = [one for one in shown if isinstance(one.content, SectionContent)]
        for number, report in enumerate(stations, start=1):
            self._told += _parts_of(report, number if len(stations) > 1 else 0)

    @classmethod
    def of_run(
        cls,
        recorded: RecordedRun,
        given: Given,
        progress: Callable[[float], None],
        warn: Callable[[str], None],
    ) -> "TrackerHandover":
        """Evaluate a recorded run with a tracker.

        Args:
            recorded: the run.
            given: what the bag cannot know.
            progress: told how far the reading has come, 0..1.
            warn: told in a sentence if the lines are not those that were recorded.

        Raises:
            ValueError: the run cannot be evaluated; names the bag.
        """
        known = unsolved(recorded, "the run was measured with a tracker")
        if is_grid(recorded.plan):
            grid = grid_report(recorded, progress, warn=warn)
            known = replace(known, results=grid.results, refused={}, truth=grid.truth)
            return cls(Material(recorded, replace(known, remarks=grid.remarks), given), ())
        stations = reports_of_run(recorded, progress, warn=warn, description=given.conditions)
        return cls(Material(recorded, known, given), stations)

    @property
    def lead(self) -> Lead:
        """Return what stands on top: do the passes agree, which errors, what is incomplete."""
        recorded = self._material.recorded
        missing = incomplete_sentences(completeness_of(recorded, self._material.measurement))
        if not self._stations:
            result = self._material.report.results[0]
            headline = f"Error curves of the machine, from {result.lines} stations of the tracker."
            said = ["χ² in the chapter below shows whether the readings agree with each other."]
            return Lead("open" if missing else "neutral", headline, (*missing, *said))
        found = [report.verdict for report in self._stations]
        worst = next(name for name in _HEADLINES if name in {one.name for one in found})
        tone = "open" if missing and _TONES[worst] != "bad" else _TONES[worst]
        several = len(self._stations) > 1
        said, facts = list(missing), []
        for report, verdict in zip(self._stations, found, strict=True):
            where = f"Station {report.station}: " if several else ""
            joint = None if report.result is None else report.result.joint
            sentences = [verdict.sentence, *_not_in_it(report)]
            if joint is not None:
                sentences += _size_sentences(joint)
                for name, text in joint_values(joint):
                    words = name if name.startswith("scale") else f"squareness {name}"
                    facts.append(Fact(f"{where}{words}", text))
            said += [f"{where}{text}" for text in sentences]
        return Lead(tone, _HEADLINES[worst], tuple(said), tuple(facts))

    def draw(self, atelier: Studio) -> None:
        """Have all pictures drawn.

        Raises:
            OSError: the process that draws has ended.
        """
        for one in self._told:
            atelier.ask(one.name, one.drawings)
        self.pictures = atelier.fetch_all()

    def html(self, for_print: bool = False) -> str:
        """Return the page as HTML text with everything in it.

        Args:
            for_print: lay it out on pages of paper alone.
        """
        recorded, report = self._material.recorded, self._material.report
        chapters = [one.chapter(self.pictures.get(one.name, {}), for_print) for one in self._told]
        run = recorded.run_id or recorded.path.name
        return page(
            _TITLE,
            ", ".join(one for one in (report.machine, recorded.plan.name, run) if one),
            self.lead,
            chapters,
            f"run {run}, bag SHA-256 {self._material.sha256[:16] or 'unknown'}…",
            for_print,
        )

    def document(self) -> dict[str, Any]:
        """Return the report as a mapping that ``json`` can write: SI, unknown is null."""
        recorded, report, lead = self._material.recorded, self._material.report, self.lead
        tracker = recorded.plan.tracker
        assert tracker is not None and measurement.SECTION.document is not None
        content = Document(
            run_id=recorded.run_id or None,
            machine=report.machine or None,
            chain=report.chain or None,
            plan=recorded.plan.name or None,
            simulated=report.simulated,
            summary=Summary(headline=lead.headline, sentences=lead.sentences),
            measurement=measurement.SECTION.document(self._material),
            tracker=part_of(
                Tracker,
                tracker,
                places={name: list(at) for name, at in stations_in(recorded.plan).items()},
            ),
            stations=[tracker_document(one) for one in self._stations],
            grid=None if self._stations else report_document(report),
        )
        return schemas.document("tracker_report", content)


def _not_in_it(report: TrackerReport) -> list[str]:
    """Return what of the seven lines of a station was not measured, or was left out."""
    assert report.result is not None
    there = {test.name.lower() for test in report.result.located.tests}
    missing = [name for name in SEVEN_LINES if name not in there]
    said = [f"Not measured from here: {', '.join(missing)}."] if missing else []
    return said + [f"{text}." for text in report.left_out]


def _size_sentences(joint: JointEstimate) -> list[str]:
    """Say which of the errors the readings tell from zero."""
    expanded = COVERAGE_FACTOR * joint.standard_uncertainty
    if not np.all(np.isfinite(expanded)):
        return ["How sure these values are is unknown."]
    told = [
        name for name, one, u in zip(NAMES, joint.values, expanded, strict=True) if abs(one) > u
    ]
    meaning = f"±: U, {COVERAGE_FACTOR:g} standard uncertainties (95 %)."
    if not told:
        return [f"None of the values below is larger than its U. {meaning}"]
    return [f"Larger than their U: {', '.join(told)}. {meaning}"]


def _parts_of(report: TrackerReport, number: int) -> list[ToldSection]:
    result = report.result
    assert result is not None
    where = f", station {report.station}" if number else ""
    key = f"-{number}" if number else ""
    joint = result.joint
    errors = [
        squareness_rows(result),
        separation_table(result.separations),
    ]
    # Its own title is wider than the table.
    together = (
        []
        if joint is None
        else [replace(joint_table(joint, report.truth), title=f"{_TOGETHER}{where}")]
    )
    best = result.corrected or result.located
    return [
        _part(
            f"errors{key}",
            f"Positioning and squareness{where}",
            tables=(*together, *_views(where, *errors)),
        ),
        _part(
            f"passes{key}",
            f"Does every pass agree with all others?{where}",
            sentences=(f"{report.verdict.name}: {report.verdict.sentence}",),
            tables=_views(where, None if joint is None else departures_table(joint)),
        ),
        _part(
            f"lines{key}",
            f"The lines by ISO 230-2 and ISO 230-6{where}",
            {
                "lines": Drawing(
                    "tracker_deviations",
                    (report,),
                    "Mean deviations along each line, with the tracker where the places alone put"
                    " it and where all readings put it.",
                    {"title": ""},
                )
            },
            tables=_views(where, lines_table(result)),
            folded_title="Every line at its targets",
            folded=_views(where, *(target_table(test, decimals_of([test])) for test in best.tests)),
        ),
        _part(
            f"location{key}",
            f"Where the tracker stood{where}",
            {
                "location": Drawing(
                    "tracker_residuals",
                    (report,),
                    "Residuals of the places that located the tracker.",
                    {"title": ""},
                )
            },
            tables=_views(where, location_table(report.location)),
        ),
        _part(
            f"trust{key}",
            f"What the figures mean, and how sure they are{where}",
            sentences=sentences_of(report),
        ),
    ]


def _part(
    key: str, title: str, drawings: Mapping[str, Drawing] | None = None, **values: Any
) -> ToldSection:
    return ToldSection(key, title, SectionContent(values, drawings or {}))


def _views(where: str, *tables: Table | None) -> tuple[Table, ...]:
    """Return those tables that are there; of several stations each title says of which it is."""
    return tuple(replace(view, title=f"{view.title}{where}") for view in with_rows(tables))
