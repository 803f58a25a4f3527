"""Two measurements of one machine beside each other, as a page."""

from dataclasses import replace
from math import isfinite

from stepdiag_ros.compensation.identified import Origin
from stepdiag_ros.evaluation.changes import ChangesReport
from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.report.pages.page import Fact, Lead, chapter, page
from stepdiag_ros.report.pages.pictures import Drawing, Drawn, draw
from stepdiag_ros.report.tables.changes import curve_table, figure_table, node_table
from stepdiag_ros.text.numbers import UNKNOWN, plus_minus
from stepdiag_ros.text.table import Table, new_table, with_rows
from stepdiag_ros.words.changes import (
    BETTER,
    OTHER,
    WORSE,
    changed_words,
    curve_words,
    joint_words,
    meaning,
    moved_words,
    place_words,
    remarks_of,
    uncertainty_words,
    verdict,
)

_TONES = {BETTER: "good", WORSE: "bad"}
_TITLE = "Two measurements of one machine"
_UNBROKEN = "\N{NO-BREAK SPACE}"


class ChangesPage:
    """The page, on a screen and for print; its pictures are drawn once.

    Args:
        report: what is shown.

    Attributes:
        pictures: of the page, by name.
    """

    def __init__(self, report: ChangesReport) -> None:
        self._report = report
        self.pictures = _pictures(report)

    def html(self, for_print: bool = False) -> str:
        """Return the page as HTML text with everything in it.

        Args:
            for_print: lay it out on pages of paper alone.
        """
        report, changes = self._report, self._report.changes
        contents = (
            (
                "changes",
                "What changed",
                "figures",
                {
                    "sentences": [
                        *changed_words(changes),
                        *curve_words(changes),
                        *moved_words(changes),
                    ],
                    "figures": replace(figure_table(changes, _UNBROKEN), title=""),
                },
            ),
            (
                "measurements",
                "The two measurements",
                "measurements",
                {"origins": _origins(report), "remarks": remarks_of(report)},
            ),
            (
                "curves",
                "The error curves",
                "curves",
                {
                    "curves": replace(curve_table(changes), title=""),
                    "nodes": with_rows(node_table(one) for one in changes.curves),
                },
            ),
            (
                "trust",
                "What the figures mean, and how sure they are",
                "trust",
                {"sentences": [*meaning(changes), *uncertainty_words(report)]},
            ),
        )
        before, after = report.before.origin, report.after.origin
        return page(
            _TITLE,
            after.machine or before.machine or "machine without a name",
            _lead(report),
            [
                chapter(key, title, (f"changes/{name}.html",), values, self.pictures, for_print)
                for key, title, name, values in contents
            ],
            f"runs {before.run_id or UNKNOWN} and {after.run_id or UNKNOWN}",
            for_print,
        )


def _pictures(report: ChangesReport) -> dict[str, Drawn]:
    changes = report.changes
    wanted = {
        "translations": ("Every curve before and after, and E_n at every node", None),
        "rotations": ("Angular errors before and after, and E_n at every node", ROTATIONS),
    }
    drawn = {}
    for name, (caption, names) in wanted.items():
        turning = names is not None
        if any((one.name in ROTATIONS) == turning for one in changes.curves):
            drawing = Drawing("changes", (changes, names), f"{caption}.", {"title": ""})
            made = draw(drawing, f"picture:{name}")
            if made is not None:
                drawn[name] = made
    return drawn


def _lead(report: ChangesReport) -> Lead:
    changes = report.changes
    found = verdict(changes)
    sentences = [found.sentence, *filter(None, [joint_words(changes)])]
    if found.kind == OTHER:
        sentences += changed_words(changes)
    shown = [("rms error in the volume", changes.rms, (None, None))]
    shown.append(("worst place", changes.worst, tuple(changes.worst_places)))
    facts = []
    for title, one, places in shown:
        for when, value, spread, place in (
            ("before", one.before, one.before_uncertainty, places[0]),
            ("after", one.after, one.after_uncertainty, places[1]),
        ):
            if isfinite(value):
                where = "" if place is None else f" at {place_words(place)}"
                text = f"{plus_minus(value, spread, IN_MICRO)} µm{where}"
                facts.append(Fact(f"{title}, {when}", text))
    return Lead(_TONES.get(found.kind, "neutral"), found.headline, tuple(sentences), tuple(facts))


def _origins(report: ChangesReport) -> Table:
    table = new_table("", "", "before", "after")
    for column in table.columns:
        column.number = False
    both = (report.before.origin, report.after.origin)
    rows = {
        "file": "file",
        "run": "run_id",
        "measured": "run_time",
        "machine": "machine",
        "plan": "plan",
        "software of the run": "software_version",
        "SHA-256 of the file": "sha256",
    }
    for title, name in rows.items():
        table.add_row(title, *(_known(one, name) for one in both))
    table.add_row("method", *(method_title(one.method) for one in both))
    table.add_row("instrument file", *(name or "none given" for name in report.instruments))
    return table


def _known(origin: Origin, name: str) -> str:
    text: str = getattr(origin, name)
    if name == "sha256":
        # Two of them have no room beside each other in one line.
        text = "\n".join(text[start : start + 32] for start in range(0, len(text), 32))
    return text or UNKNOWN
