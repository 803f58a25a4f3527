"""From the material to the files of the report: HTML page, PDF and JSON document."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from stepdiag_ros import schemas
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.report.files import make_folder, whole_file
from stepdiag_ros.report.pages.lead import ToleranceJudgement, judge, lead_of, what_to_do
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.page import Lead, page
from stepdiag_ros.report.pages.pictures import Drawn, Studio
from stepdiag_ros.report.pages.section import SectionContent, ToldSection
from stepdiag_ros.report.pages.sections import sections
from stepdiag_ros.report.pages.summary import DECISION_RULE, KEY, summary_chapter, summary_of

TITLE = "Volumetric errors of a machine tool: report of a measurement"
NAMES = {"html": "report.html", "pdf": "report.pdf", "json": "report.json"}
"""Format → name of its file."""
FORMATS = tuple(NAMES)


@dataclass(frozen=True)
class Handover:
    """A report that is ready to be laid out.

    Attributes:
        lead: of its first page.
        summary: what stands before the sections.
        told: sections in their order.
        pictures: section's name → picture's name → picture.
        footer: identity of the run.
        subtitle: what was measured.
    """

    lead: Lead
    summary: SectionContent
    told: Sequence[ToldSection]
    pictures: Mapping[str, Mapping[str, Drawn]]
    footer: str
    subtitle: str

    def html(self, for_print: bool = False) -> str:
        """Return the page."""
        chapters = [one.chapter(self.pictures.get(one.name, {}), for_print) for one in self.told]
        summary = summary_chapter(self.summary, self.pictures.get(KEY, {}), for_print)
        return page(
            TITLE, self.subtitle, self.lead, chapters, self.footer, for_print, summary=summary
        )


def prepare(
    material: Material,
    atelier: Studio,
    tell: Callable[[str], None],
    meanwhile: Callable[[], None] | None = None,
) -> Handover:
    """Let every section tell its part, and have its pictures drawn.

    Args:
        material: what the report is made of.
        atelier: where pictures are drawn.
        tell: told which section is at work.
        meanwhile: further work, done while pictures are drawn.

    Raises:
        OSError: the process that draws has ended.
    """
    told = []
    for section in sections():
        tell(section.title)
        one = section.told(material)
        if one.content != "":
            told.append(one)
            atelier.ask(section.name, one.drawings)
    lead, summary = lead_of(material), summary_of(material)
    atelier.ask(KEY, summary.drawings)
    tell("pictures")
    if meanwhile is not None:
        meanwhile()
    run = material.recorded.run_id or material.recorded.path.name
    plan = material.recorded.plan.name
    return Handover(
        lead=lead,
        summary=summary,
        told=told,
        pictures=atelier.fetch_all(),
        footer=f"run {run}, bag SHA-256 {material.sha256[:16] or 'unknown'}…",
        subtitle=", ".join(one for one in (material.report.machine, plan, run) if one),
    )


def _known(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as JSON knows them."""
    return {
        name: value if isinstance(value, str | bool) else schemas.number(value)
        for name, value in values.items()
    }


def _decision(material: Material, judged: ToleranceJudgement) -> dict[str, Any]:
    """Return the decision on the largest error in the volume with all that it rests on."""
    accuracy, verdict = material.accuracy, material.lead.verdict
    known = accuracy is not None and math.isfinite(accuracy.value)
    return {
        "quantity": "largest_error_in_volume",
        "decision": judged.verdict,
        "rule": DECISION_RULE,
        **_known(
            {
                "value": judged.value,
                "expanded_uncertainty": judged.expanded_uncertainty,
                "coverage_factor": material.expanded.coverage_factor,
                "lower_bound": judged.lower_bound,
                "limit": judged.tolerance,
                "guard_band": judged.guard_band,
            }
        ),
        "position": None
        if accuracy is None or not known
        else dict(zip(AXES, map(float, accuracy.position), strict=True)),
        "diagnosis": verdict.name,
        "tested": judged.tested,
        "basis": judged.basis or None,
    }


def report_document_of(material: Material) -> dict[str, Any]:
    """Return the report as a mapping that ``json`` can write: SI, unknown is null."""
    lead = lead_of(material)
    judged = judge(material)
    content = {
        "run_id": material.recorded.run_id or None,
        "summary": {
            "headline": lead.headline,
            "sentences": list(lead.sentences),
            "recording": [flaw.as_dict() for flaw in material.report.recording],
            **_known(asdict(judged)),
            "decisions": [_decision(material, judged)],
            "single_errors": [_known(asdict(one)) for one in material.single_errors],
            "what_to_do": what_to_do(material, judged),
        },
        "sections": {
            section.name: section.document(material)
            for section in sorted(sections(), key=lambda one: one.order)
            if section.document is not None
        },
    }
    return schemas.document("report", content)


class LaidOut(Protocol):
    """A report that is ready to be laid out."""

    @property
    def pictures(self) -> Mapping[str, Mapping[str, Drawn]]:
        """Return section's name → picture's name → picture."""
        ...

    def html(self, for_print: bool = False) -> str:
        """Return the page, on a screen or for print."""
        ...


def write(
    document: Callable[[], Mapping[str, Any]],
    handover: LaidOut | None,
    folder: Path,
    formats: Sequence[str],
    tell: Callable[[str], None],
    further: Mapping[Path, Callable[[], bytes]] = MappingProxyType({}),
) -> list[Path]:
    """Write the files of the report, in place of earlier ones.

    All of them are made before the first is written.

    Args:
        document: returns the JSON document; only called if it is wanted.
        handover: the page; None where only the JSON document is written.
        folder: made if it is not there.
        formats: of ``NAMES``.
        tell: told which file is at work.
        further: files beside those of the formats: path → makes the content.

    Returns:
        The files, in the order of ``formats``, then the further ones.

    Raises:
        ValueError: the folder cannot be made or written to, or PDF cannot be made here.
        OSError: a file cannot be written.
    """
    for place in (folder, *(path.parent for path in further)):
        make_folder(place)
    made: dict[Path, bytes] = {}
    # A certificate may be refused, so it comes before the pages, which take longer.
    certified = {path: make() for path, make in further.items()}
    # The PDF is laid out while pictures are drawn, for which the HTML page has to wait.
    for one in sorted(formats, key=("pdf", "json", "html").index):
        tell(NAMES[one])
        path = folder / NAMES[one]
        if one == "json":
            made[path] = (schemas.json_text(document()) + "\n").encode()
        elif handover is not None:
            if one == "html":
                made[path] = handover.html().encode()
            else:
                from stepdiag_ros.report.pages.pdf import pdf_of

                pictures = [
                    one for chapter in handover.pictures.values() for one in chapter.values()
                ]
                made[path] = pdf_of(handover.html(for_print=True), pictures)
    wanted = [path for path in (folder / NAMES[one] for one in formats) if path in made]
    for path in (*wanted, *certified):
        with whole_file(path) as partial:
            partial.write_bytes((made | certified)[path])
    return [*wanted, *certified]
