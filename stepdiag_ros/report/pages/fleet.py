"""The machines of an archive as one page: worst first, each with its runs and trends."""

import os
import re
from collections.abc import Sequence
from datetime import datetime
from math import isfinite
from pathlib import Path
from typing import Any
from urllib.parse import quote

from stepdiag_ros import schemas
from stepdiag_ros.archive.fleet import REPORTS, WORST_FIRST, FleetMachine, FleetRun
from stepdiag_ros.archive.histories import FigureHistory, MachineHistory, urgency
from stepdiag_ros.archive.place import Place
from stepdiag_ros.archive.stated import LARGEST
from stepdiag_ros.metrology.standards.conformity import Conformity
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.report.pages.page import environment
from stepdiag_ros.words.fleet import (
    STATES,
    beside_words,
    change_words,
    headline,
    judged_words,
    largest_words,
    outlook_words,
    overdue,
    sentences,
    verdict_words,
)
from stepdiag_ros.words.trends import (
    change_sentence,
    crossing_sentence,
    crossing_words,
    now_words,
    remarks,
    unit_words,
    value_words,
)

FLEET_PAGE = re.compile(rb'content="stepdiag_ros .*<title>Machines of ', re.DOTALL)
"""What the head of every page contains."""
MOST_RUNS = 100
"""Of a machine in the page; `stepdiag archive list` has all."""
_TONES = {
    Conformity.NOT_WITHIN: "bad",
    Conformity.UNDECIDED: "open",
    Conformity.WITHIN: "good",
    Conformity.NOT_ASKED: "neutral",
}
_DAY = "%Y-%m-%d"


def fleet_page(
    place: Place,
    machines: Sequence[FleetMachine],
    every: int | None,
    made: datetime,
    file: Path,
) -> str:
    """Return the page as HTML text with everything in it.

    Args:
        place: of the archive.
        machines: worst first.
        every: days between runs; None: not stated.
        made: when the archive was read.
        file: that the page will be; links to reports are relative to its folder.
    """
    known: dict[str, int] = {}
    details = [_details(one, place, file, known) for one in machines]
    worst = machines[0].state
    content = {
        "place": place.url,
        "root": place.address("").rstrip("/"),
        "reports": REPORTS,
        "local": place.is_local,
        "made": made.isoformat(timespec="seconds"),
        "every": every,
        "machines": [_overview(one, every) for one in machines],
    }
    states = [{"word": STATES[one], "tone": _TONES[one]} for one in WORST_FIRST]
    return (
        environment()
        .get_template("fleet/page.html")
        .render(
            place=place.url,
            made=f"{made:%Y-%m-%d %H:%M} UTC",
            tone=_TONES[worst],
            headline=headline(machines),
            sentences=sentences(machines, every, made),
            runs=sum(len(one.runs) for one in machines),
            content=content | {"states": states},
            details=details,
            remarks=[*known],
            late=[overdue(one, every, made) for one in machines],
        )
    )


def _overview(machine: FleetMachine, every: int | None) -> dict[str, Any]:
    """Return what a row of the page shows."""
    newest, due = machine.newest, machine.due(every)
    limit = next((one.tolerance for one in machine.judged if one.name == LARGEST), None)
    return {
        "name": machine.name,
        "serial": machine.serial_number,
        "last": "" if newest is None or newest.time is None else f"{newest.time:{_DAY}}",
        "due": "" if due is None else f"{due:{_DAY}}",
        "verdict": verdict_words(newest),
        "worst": largest_words(newest),
        "limit": "" if limit is None else f"{limit * IN_MICRO:.10g}",
        "beside": beside_words(machine),
        "state": WORST_FIRST.index(machine.state),
        "outlook": outlook_words(machine),
        "changed": change_words(machine),
        "runs": len(machine.runs),
        **_curve(machine.history, limit),
    }


def _curve(history: MachineHistory | None, limit: float | None) -> dict[str, Any]:
    """Return the largest error of the last runs, µm over days, and its limits."""
    figures = () if history is None else history.figures
    for figure in figures:
        if figure.name == LARGEST:
            times, values = figure.times[-MOST_RUNS:], figure.values[-MOST_RUNS:]
            return {
                "days": [(one - times[0]).days for one in times],
                "sizes": [_micro(one) for one in values],
                "band": [_micro(one) for one in figure.trend.limits],
                "tolerance": None if limit is None else _micro(limit),
            }
    return {"days": [], "sizes": [], "band": [None, None], "tolerance": None}


def _micro(value: float) -> float | None:
    return schemas.number(round(value * IN_MICRO, 3))


def _details(
    machine: FleetMachine, place: Place, file: Path, known: dict[str, int]
) -> dict[str, Any]:
    """Return what a machine shows when it is opened.

    Args:
        machine: any.
        place: of the archive.
        file: that the page will be.
        known: sentences that several machines share → their number; gains those of this one.
    """
    history = machine.history
    figures = () if history is None else sorted(history.figures, key=urgency)
    changes = sorted(
        (
            (change.latest, change_sentence(one, change))
            for one in figures
            for change in one.trend.changes
        ),
        reverse=True,
    )
    limits = [] if history is None else remarks(history)
    return {
        "judged": [judged_words(one) for one in machine.judged],
        "figures": [_figure(one) for one in figures],
        "changes": [sentence for _, sentence in changes],
        "unknown": [*filter(None, map(crossing_sentence, figures))],
        "remarks": [known.setdefault(one, len(known)) for one in limits],
        "runs": [_run(one, place, file) for one in machine.runs[:MOST_RUNS]],
    }


def _figure(figure: FigureHistory) -> list[str]:
    trend = figure.trend
    now = now_words(figure)
    a_year = value_words(figure, trend.slope, trend.slope_expanded)
    return [figure.name, unit_words(figure), now, a_year, crossing_words(trend)]


def _run(run: FleetRun, place: Place, file: Path) -> list[str]:
    """Return date, identity, verdict, largest error, report, and where its bag is."""
    date = "" if run.time is None else f"{run.time:%Y-%m-%d %H:%M}"
    return [
        date,
        run.run_id,
        run.problem or verdict_words(run),
        largest_words(run) if isfinite(run.largest) else "",
        _link(run.report, place, file),
        run.bag,
        "" if run.alone else "several",
    ]


def _link(report: str, place: Place, file: Path) -> str:
    """Return the address of a report for a link in the page; empty without a report."""
    if not report or not place.is_local:
        return place.address(report) if report else ""
    return quote(os.path.relpath(place.address(report), file.resolve().parent))
