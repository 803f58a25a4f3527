"""Compensation tables as a person and a program read them: what they correct and leave."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.table import Table

from stepdiag_ros import schemas
from stepdiag_ros.compensation.remaining import Change
from stepdiag_ros.evaluation.compensation import CompensationReport
from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.report.tables import PlainConsole, new_table
from stepdiag_ros.text.numbers import ARC_SECONDS, MICRO, UNKNOWN, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

NOT_INSTALLED = (
    "Nothing was installed: load the files by hand, measure again, and keep what was there before."
)
COMPUTED = (
    "Before and after are computed from the files as written, with their rounding and spacing, for"
    " the errors that were found, both directions of approach; only a new measurement is a proof."
)
_DECIMALS = 3


def print_compensation(report: CompensationReport, console: PlainConsole) -> None:
    """Print what was written and what it leaves."""

    def sentence(text: str) -> None:
        console.print(text, width=console.text_width, soft_wrap=console.text_width is None)

    sentence(f"Compensation tables for {report.control.title}")
    overruled = report.identified.origin.despite_verdict
    if overruled:
        sentence(
            f"Made despite the verdict {overruled}. What acts stays, and part of it is in these"
            " tables."
        )
    for line in report.identified.origin.lines():
        sentence(f"  {line}")
    sentence(f"  files: {', '.join(report.files)}")
    warning = report.identified.warning
    if warning:
        console.print()
        sentence(f"Do not install these tables: {warning}.")
    console.print()
    console.print(change_table("What the tables change", report.remainder.changes))
    console.print()
    remainder = report.remainder
    sentence(COMPUTED)
    if remainder.known < remainder.places:
        sentence(
            f"Of {remainder.places} places in the volume {remainder.known} have a known error;"
            " the others are not in the figures."
        )
    if math.isfinite(remainder.rms_uncertainty) and not warning:
        sentence(
            f"The errors in the volume are known to {_value(remainder.rms_uncertainty, 'm')} (rms"
            " standard uncertainty): no compensation made from them is better than that."
        )
    for title, sentences in (
        ("Not corrected:", uncorrected(report)),
        ("To know:", report.control.says),
        ("About the result:", [one for one in report.identified.remarks if one != warning]),
    ):
        if sentences:
            console.print()
            sentence(title)
            for text in sentences:
                sentence(f"- {text}")
    console.print()
    sentence(f"Format by: {report.control.source}.")
    sentence(NOT_INSTALLED)


def change_table(title: str, changes: Sequence[Change], with_tables: bool = True) -> Table:
    """Return figures before and after.

    Args:
        title: of the table.
        changes: the figures.
        with_tables: say of each whether the control has a table for it.
    """
    more = ["corrected by a table"] if with_tables else []
    table = new_table(title, "", "before", "after", "times smaller", *more)
    for one in changes:
        told = ["yes" if one.corrected else "no"] if with_tables else []
        before, after = _value(one.before, one.unit), _value(one.after, one.unit)
        table.add_row(_words(one), before, after, _times(one), *told)
    return table


def uncorrected(report: CompensationReport) -> list[str]:
    """Say what the tables do not correct, sentence by sentence, in numbers where known."""
    said = [
        f"{_words(one)} stays: {_value(one.after, one.unit)}"
        for one in report.remainder.changes
        if not one.corrected and not one.name.startswith("volume")
    ]
    error_map = report.identified.error_map
    turning = [name for name in ROTATIONS if name in error_map.curves]
    volume = report.remainder.change("volume, rms")
    if turning and report.control.name != "generic":
        said.append(
            f"angular errors ({', '.join(turning)}) act by levers and stay; with them"
            f" {_value(volume.after, 'm')} rms are left in the volume"
        )
    if error_map.left_out:
        said.append(
            f"{', '.join(error_map.left_out)} were not estimated: what they do in the volume is"
            " neither corrected nor in these figures"
        )
    if error_map.unknown_curves:
        said.append(f"not determined by these lines: {', '.join(error_map.unknown_curves)}")
    return said


def _words(one: Change) -> str:
    """Return what a figure is; that of positioning is not the error at the end of the travel."""
    return (
        f"{one.name}, peak to peak with reversal"
        if one.name.startswith("positioning ")
        else one.name
    )


def _value(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return UNKNOWN
    if unit == "rad":
        return f'{plain(value * MICRO, 2)} µrad ({plain(value * ARC_SECONDS, 2)}")'
    return f"{plain(value * MICRO, _DECIMALS)} µm"


def _times(one: Change) -> str:
    if math.isnan(one.factor) or not math.isfinite(one.after):
        return UNKNOWN if math.isnan(one.before) or math.isnan(one.after) else "-"
    return "> 1000" if one.factor > 1000 else plain(one.factor, 1)


def draw_compensation(report: CompensationReport) -> "dict[str, Picture]":
    """Return all pictures of the tables by the name of their file without ending."""
    from stepdiag_ros.plots.compensations import compensation

    return {"what_remains": compensation(report.remainder, report.control)}


def compensation_json(report: CompensationReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known (schema ``compensation``)."""
    remainder = report.remainder
    content = {
        "control": report.control.name,
        "title": report.control.title,
        "format_source": report.control.source,
        "origin": {key: text or None for key, text in asdict(report.identified.origin).items()},
        "settings": dict(report.layout.settings),
        "spacing": report.layout.spacing or None,
        "reference": list(report.layout.reference),
        "on_top_of": report.on_top_of or None,
        "files": [
            {"name": name, "sha256": hashlib.sha256(text.encode()).hexdigest()}
            for name, text in report.files.items()
        ],
        "corrects": list(report.control.corrects),
        "uncorrected": uncorrected(report),
        "says": list(report.control.says),
        "remarks": list(report.identified.remarks),
        "places": remainder.places,
        "places_known": remainder.known,
        "rms_standard_uncertainty": _number(remainder.rms_uncertainty),
        "changes": [
            {**change_document(one), "corrected": one.corrected} for one in remainder.changes
        ],
    }
    return schemas.json_text(schemas.document("compensation", content))


def change_document(one: Change) -> dict[str, Any]:
    """Return a figure before and after for a JSON document."""
    return {
        "name": one.name,
        "unit": one.unit,
        "before": _number(one.before),
        "after": _number(one.after),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
