"""What the years of machines show, as a JSON document."""

from collections.abc import Sequence
from dataclasses import fields
from datetime import datetime
from math import isfinite
from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.archive.histories import FigureHistory, MachineHistory, date_of
from stepdiag_ros.metrology.trends.trend import LEVEL, Trend
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.schemas.trends import Change, Crossing, Document, Figure, Machine
from stepdiag_ros.words.trends import remarks


def trends_document(place: str, machines: Sequence[MachineHistory]) -> dict[str, Any]:
    """Return histories as a mapping that ``json`` can write; SI, ``null`` where not known.

    Args:
        place: of the archive.
        machines: in the order in which they stand in the document.
    """
    content = Document(
        place=place, change_level=LEVEL, machines=[_machine(one) for one in machines]
    )
    return schemas.document("trends", content)


def _machine(machine: MachineHistory) -> Machine:
    return part_of(
        Machine,
        machine,
        first=_stamp(machine.first),
        last=_stamp(machine.last),
        figures=[_figure(one) for one in machine.figures],
        remarks=remarks(machine),
    )


def _figure(figure: FigureHistory) -> Figure:
    trend = figure.trend
    given = {one.name for one in fields(Trend)} & {one.name for one in fields(Figure)}
    content = {name: getattr(trend, name) for name in given}
    return part_of(
        Figure,
        figure,
        **{
            **content,
            "times": [_stamp(one) for one in figure.times],
            "expanded_uncertainties": figure.expanded,
            "other_boxes": figure.other_boxes,
            "adjusted": trend.adjusted.tolist(),
            "line": trend.line.tolist(),
            "line_expanded_uncertainties": trend.line_expanded.tolist(),
            "unknown": trend.unknown or None,
            "level_expanded_uncertainty": trend.level_expanded,
            "slope_expanded_uncertainty": trend.slope_expanded,
            "per_kelvin_expanded_uncertainty": trend.per_kelvin_expanded,
            "grows": trend.grows(),
            "temperature_degC": trend.temperature,
            "between_runs": trend.between,
            "changes": [
                part_of(
                    Change,
                    one,
                    not_before=_stamp(date_of(one.earliest)),
                    not_after=_stamp(date_of(one.latest)),
                    expanded_uncertainty=one.expanded,
                )
                for one in trend.changes
            ],
            "crossing": _crossing(trend),
        },
    )


def _crossing(trend: Trend) -> Crossing:
    ends = [
        f"{date_of(trend.last + one):%Y-%m-%d}" if isfinite(one) else None
        for one in (trend.crossing.earliest, trend.crossing.latest)
    ]
    return Crossing(outlook=trend.crossing.outlook.name, earliest=ends[0], latest=ends[1])


def _stamp(time: datetime) -> str:
    return time.isoformat(timespec="seconds")
