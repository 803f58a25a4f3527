"""The readings: which were taken, how far they repeat, and what they differ from nominal."""

import math
from itertools import takewhile
from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.bags.passes import pass_name
from stepdiag_ros.metrology.measurement import Reading, SettledStop
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.plots.places import FLAT
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.page import Fact
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.text.numbers import two_digits
from stepdiag_ros.text.table import Table, new_table

_STOPS_SHOWN = 3
_LATE_NS = 1_000_000_000
"""Readings are looked for so long before and after the stops that are shown."""
NO_REPEATS = "No line was measured twice in one direction: how far readings repeat is unknown."
_ELSEWHERE = (
    "The scatter of repeated passes was not computed: it needs three or more stops at nodes of the"
    " measured box. The section on ISO 230-2 states how far the readings repeat: R, and s at every"
    " target."
)


def _table(material: Material) -> Table:
    heads = ("line", "passes planned", "measured", "complete", "stops", "rejected", "repeated")
    table = new_table("Passes and stops", *heads)
    for one in material.taken:
        counts = (one.planned, one.measured, one.complete, one.stops, one.rejected, one.again)
        table.add_row(one.name, *map(str, counts))
    return table


def _repeat_facts(material: Material) -> list[Fact]:
    found = material.repeats
    if not math.isfinite(found.reading):
        return []
    scatter = two_digits(found.reading * IN_MICRO)

    def beyond(value: float, unit: str) -> str:
        if value == 0.0:
            return "no more than that scatter explains"
        return f"{two_digits(value * IN_MICRO)} {unit} beyond that (standard deviation)"

    return [
        Fact(
            "Scatter of a reading",
            f"{scatter} µm (standard deviation, {found.reading_freedom:,.0f} degrees of freedom)",
        ),
        Fact("Offset from pass to pass", beyond(found.offset, "µm")),
        Fact("Slope from pass to pass", beyond(found.slope, "µm/m")),
    ]


def _few_stops(material: Material) -> tuple[list[Reading], tuple[SettledStop, ...]] | None:
    """Return a few stops that follow each other at the run's beginning, and the readings there.

    Returns:
        None where the bag holds no stops or no readings.
    """
    stops = material.recorded.stops
    few: tuple[SettledStop, ...] = ()
    for first in range(len(stops)):
        few = stops[first : first + _STOPS_SHOWN]
        # At the first stop of a pass the counter was just zeroed.
        if few[0].command.stop > 0 and len({_pass_of(one) for one in few}) == 1:
            break
    if len(few) < _STOPS_SHOWN:
        return None
    late = few[-1].window_end + _LATE_NS
    early = min(few[0].in_position_time, few[0].window_start) - _LATE_NS
    readings = [
        one
        for one in takewhile(lambda one: one.time <= late, material.recorded.readings())
        if one.time >= early
    ]
    return (readings, few) if readings else None


def _pass_of(stop: SettledStop) -> tuple[int, int]:
    return stop.command.line_index, stop.command.attempt


def _tell(material: Material) -> SectionContent | str:
    if not material.measurement.lines:
        return "No line was finished."
    measurement = material.measurement
    drawings = {
        "lines": Drawing(
            "line_errors",
            (measurement,),
            "Readings less nominal displacement along every line.",
            {"title": ""},
            place=FLAT,
        )
    }
    shown = _few_stops(material)
    if shown is not None:
        drawings["settling"] = Drawing(
            "settling",
            shown,
            f"Readings in time at {_STOPS_SHOWN} stops of line {pass_name(shown[1][0].line)}, with"
            " the windows whose mean is the value of the stop; each stop enlarged.",
            {"title": ""},
            place=FLAT,
        )
    repeated = _repeat_facts(material)
    if repeated:
        drawings["repeatability"] = Drawing(
            "repeatability",
            (measurement,),
            "Every pass less the mean of the passes of its setup.",
            {"title": ""},
            place=FLAT,
        )
    return SectionContent(
        {
            "taken": _table(material),
            "repeats": repeated,
            "no_repeats": [] if repeated else [_ELSEWHERE if material.repeated else NO_REPEATS],
        },
        drawings,
    )


def _document(material: Material) -> dict[str, Any]:
    repeats = material.repeats
    return {
        "lines": [
            {
                "name": one.name,
                "passes_planned": one.planned,
                "passes_measured": one.measured,
                "passes_complete": one.complete,
                "stops": one.stops,
                "stops_rejected": one.rejected,
                "begun_anew": one.again,
            }
            for one in material.taken
        ],
        "repeats": {
            "standard_deviation_of_a_reading": schemas.number(repeats.reading),
            "degrees_of_freedom": repeats.reading_freedom,
            "standard_deviation_of_offsets": schemas.number(repeats.offset),
            "standard_deviation_of_slopes": schemas.number(repeats.slope),
        },
    }


SECTION = ReportSection("readings", "Readings and repeatability", 20, _tell, _document)
