"""From the catalogue of an archive to what the years of each machine show."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from math import hypot, inf, isfinite, nan, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from stepdiag_ros.archive.stated import FIGURES, FILE, LARGEST, Stated
from stepdiag_ros.metrology.geometry import CURVES, SQUARENESS, moving_axis
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.spelling import nearest, suggestion
from stepdiag_ros.metrology.trends.crossing import Outlook
from stepdiag_ros.metrology.trends.series import Series
from stepdiag_ros.metrology.trends.trend import LEVEL, Trend, trend_of
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR

if TYPE_CHECKING:
    from stepdiag_ros.archive.catalogue import Catalogue

UNNAMED = "unnamed"
_TRAVELS = """
select coalesce(machine, ?) as machine, name,
    max(list_max(position_m) - list_min(position_m)) as travel
from curves where name in ('E_XX', 'E_YY', 'E_ZZ') group by all
"""
_NAMES = "select distinct name from figures where kind in ('volume', 'effect', 'result')"
_BOXES = f"""
select bag_sha256, run_id, name, min(list_min(position_m)) as low, max(list_max(position_m)) as high
from curves where name in ('E_XX', 'E_YY', 'E_ZZ') and relied_on and len(position_m) > 0
    and ? in ('', coalesce(machine, '{UNNAMED}'))
group by all
"""
Box = Mapping[int, tuple[float, float]]
"""Axis, 0 to 2 → first and last position that was measured, m; unknown axes are left out."""
_SAME_BOX = 0.01
"""Ends of two boxes may differ by this share of a side, and are the same box."""
_ORDER = (Outlook.OUTSIDE, Outlook.MAYBE_OUTSIDE, Outlook.INTERVAL)
_YEAR = timedelta(days=365.2425)
_FIRST = datetime(1970, 1, 1, tzinfo=timezone.utc)
_ROWS = f"""
select f.time, f.machine, f.run_id, f.bag_sha256, kind, f.method, name, unit, value,
    standard_uncertainty, scatter_standard_uncertainty, expanded_uncertainty, layout,
    instrument, instrument_serial_number,
    weather_station, material_temperature_degC, material_temperature_range_K
from figures f join runs r on f.bag_sha256 = r.bag_sha256
    and f.run_id is not distinct from r.run_id
where f.time is not null and isfinite(value) and relied_on
    and ? in ('', coalesce(f.machine, '{UNNAMED}'))
    and (kind in ('volume', 'effect') or kind = 'result' and not starts_with(name, 'tilt '))
order by f.machine nulls last, f.time, f.bag_sha256
"""
"""Figures that are followed: those with a sign and an uncertainty, and the largest error. A tilt is
of mirror and laser, not of the machine."""


_Figure = tuple[str, str]
"""Kind and name."""
_NEAR = 2
"""Runs between the dates that two figures give to one event, at most."""


@dataclass(frozen=True)
class FigureHistory:
    """A figure of a machine over its runs.

    Attributes:
        kind: ``volume``, ``result`` or ``effect``, as in the catalogue.
        name: of the figure.
        unit: of its values.
        times: when each run was made.
        values: of each run.
        expanded: U of each value, NaN where not known.
        trend: what they show.
        tolerance: largest magnitude that the owner allows; NaN if none is stated.
        other_methods: number of runs that are left out, since another method solved them.
        other_boxes: number of runs that are left out, since they measured another box than the
            newest, and the figure depends on the box.
    """

    kind: str
    name: str
    unit: str
    times: tuple[datetime, ...]
    values: Sequence[float]
    expanded: Sequence[float]
    trend: Trend
    tolerance: float
    other_methods: int
    other_boxes: int = 0


@dataclass(frozen=True)
class MachineHistory:
    """A machine over its runs.

    Attributes:
        name: of the machine in the archive.
        runs: number of runs with a date and a figure.
        first: when the first was made.
        last: when the last was made.
        instruments: names of those that measured it; empty texts where no bag states one.
        figures: of the machine.
        without_temperature: number of runs whose bag states none.
        scale_known: the owner states the uncertainty of the scale of each instrument.
    """

    name: str
    runs: int
    first: datetime
    last: datetime
    instruments: tuple[str, ...]
    figures: tuple[FigureHistory, ...]
    without_temperature: int
    scale_known: bool


@dataclass(frozen=True)
class HistoryOfRun:
    """The history of the machine that a run has measured.

    Attributes:
        place: of the archive.
        contains_run: the run is a part of it.
        machine: the history.
    """

    place: str
    contains_run: bool
    machine: MachineHistory


def date_of(years: float) -> datetime:
    """Return the date of a time in a series."""
    return _FIRST + years * _YEAR


def urgency(figure: FigureHistory) -> tuple[float, ...]:
    """Return what is smaller the more a figure needs attention.

    Of figures outside, the one that exceeds its tolerance by the largest factor comes first; of
    those that will leave it, the one that leaves it first.
    """
    trend = figure.trend
    outlook = trend.crossing.outlook
    rank = _ORDER.index(outlook) if outlook in _ORDER else len(_ORDER)
    until = trend.crossing.earliest if outlook is Outlook.INTERVAL else inf
    if outlook in (Outlook.OUTSIDE, Outlook.MAYBE_OUTSIDE):
        until = -abs(trend.level) / figure.tolerance
    growth = abs(trend.slope) / trend.slope_expanded if trend.grows() else 0.0
    return (rank, until, not trend.changed_lately(), -growth)


def machine_urgency(machine: MachineHistory) -> tuple[tuple[float, ...], float]:
    """Return what is smaller the more a machine needs attention."""
    levels = [one.trend.level for one in machine.figures if one.name == LARGEST]
    largest = max((one for one in levels if isfinite(one)), default=-inf)
    return min(map(urgency, machine.figures)), -largest


def histories(
    catalogue: "Catalogue",
    machine: str = "",
    progress: Callable[[float, str], None] | None = None,
) -> list[MachineHistory]:
    """Return the history of each machine, or of one.

    Args:
        catalogue: of the archive.
        machine: name in the archive; empty: all.
        progress: called with the part that is done (0..1), and the name of the last machine.

    Raises:
        ValueError: a part is damaged, a tolerance is stated of an unknown figure, or there is no
            such machine; lists the existing ones.
    """
    _refuse_unknown_figures(catalogue)
    rows = catalogue.ask(_ROWS, [machine])
    if machine and not rows:
        known = [one["machine"] for one in catalogue.ask("select distinct machine from runs")]
        names = ", ".join(sorted(name or UNNAMED for name in known))
        raise Refusal(
            f"{catalogue.place.url} has no dated figure of a machine '{machine}'; its machines are:"
            f" {names or 'none'}",
            fault="not_found",
            about=machine,
        )
    travels: dict[str, dict[str, float]] = {}
    for one in catalogue.ask(_TRAVELS, [UNNAMED]) if catalogue.stated.scales else ():
        travels.setdefault(one["machine"], {})[one["name"]] = one["travel"]
    boxes: dict[tuple[str, str | None], dict[int, tuple[float, float]]] = {}
    for one in catalogue.ask(_BOXES, [machine]):
        axis, run = moving_axis(one["name"]), (one["bag_sha256"], one["run_id"])
        boxes.setdefault(run, {})[axis] = (one["low"], one["high"])
    number = len({row["machine"] for row in rows})
    found = []
    for history in histories_of(rows, catalogue.stated, travels, boxes):
        found.append(history)
        if progress is not None:
            progress(len(found) / number, history.name)
    return found


def _refuse_unknown_figures(catalogue: "Catalogue") -> None:
    """Refuse a tolerance of an unknown figure, which nothing would ever be compared with.

    The size of an effect is named as the effect is, which may be of another package.
    """
    named = {figure for limits in catalogue.stated.tolerances.values() for figure in limits}
    odd = sorted(figure for figure in named if figure not in FIGURES and ": " not in figure)
    if not odd:
        return
    known = {one["name"] for one in catalogue.ask(_NAMES)}
    for figure in odd:
        if figure not in known:
            listed = f"its figures are {', '.join(sorted(known))}"
            raise Refusal(
                f"{catalogue.place.url}/{FILE}: tolerances: there is no figure '{figure}';"
                f" {suggestion(nearest(figure, known.union(FIGURES)), listed)}",
                fault="unknown",
                about=figure,
                where=f"{catalogue.place.url}/{FILE}",
            )


def history_of_run(catalogue: "Catalogue", sha256: str, machine: str) -> HistoryOfRun:
    """Return the history of the machine that a run has measured.

    Args:
        catalogue: of the archive.
        sha256: of the run's bag, which need not be in the archive.
        machine: its name in the bag.

    Raises:
        ValueError: a part is damaged, or the archive has no dated figure of the machine; lists
            those that it has.
    """
    query = "select machine, bag_sha256 = ? as same from runs where same or machine_stated = ?"
    found = catalogue.ask(f"{query} order by same desc limit 1", [sha256, machine])
    name = found[0]["machine"] if found else machine
    (history,) = histories(catalogue, name or UNNAMED)
    return HistoryOfRun(catalogue.place.url, bool(found and found[0]["same"]), history)


def histories_of(
    rows: Iterable[Mapping[str, Any]],
    stated: Stated,
    travels: Mapping[str, Mapping[str, float]],
    boxes: Mapping[tuple[str, str | None], Box] | None = None,
) -> Iterator[MachineHistory]:
    """Yield the history of each machine.

    Args:
        rows: of figures, each with what is known of its run, in the order of their dates.
        stated: by the owner.
        travels: machine → ``E_XX``, ``E_YY``, ``E_ZZ`` → travel that was measured, m.
        boxes: SHA-256 of the bag and identity of the run → the box that it measured; a run whose
            box is not known is taken for one of the newest box.
    """
    machines: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        machines.setdefault(row["machine"] or UNNAMED, []).append(row)
    for name, own in machines.items():
        yield _history(name, own, stated, travels.get(name, {}), boxes or {})


def _history(
    name: str,
    rows: Sequence[Mapping[str, Any]],
    stated: Stated,
    travels: Mapping[str, float],
    boxes: Mapping[tuple[str, str | None], Box],
) -> MachineHistory:
    figures: dict[tuple[str, str], dict[Any, Mapping[str, Any]]] = {}
    runs: dict[Any, Mapping[str, Any]] = {}
    for row in rows:
        # A run may be in two bags, such as a copy that was closed properly.
        identity = row["run_id"] or row["bag_sha256"]
        runs.setdefault(identity, row)
        figures.setdefault((row["kind"], row["name"]), {}).setdefault(identity, row)
    instruments = tuple(sorted({_instrument(one) for one in runs.values()}))
    known = [stated.scales[one] for one in instruments if one in stated.scales]
    scale = max(known) if len(known) == len(instruments) else nan
    tolerances = {**stated.tolerances.get("", {}), **stated.tolerances.get(name, {})}
    usual = {key: _of_usual_method([*own.values()]) for key, own in figures.items()}
    kept = {key: _of_newest_box(own, boxes, axes_of(key[1])) for key, own in usual.items()}
    series = {key: series_of(own, scale * _length(*key, travels)) for key, own in kept.items()}
    limits = {key: tolerances.get(key[1], nan) for key in figures}
    trends = _trends(series, limits)
    return MachineHistory(
        name,
        len(runs),
        rows[0]["time"],
        rows[-1]["time"],
        instruments,
        tuple(
            FigureHistory(
                *key,
                kept[key][0]["unit"],
                tuple(row["time"] for row in kept[key]),
                series[key].values.tolist(),
                (COVERAGE_FACTOR * series[key].whole_uncertainty).tolist(),
                trend,
                limits[key],
                len(figures[key]) - len(usual[key]),
                len(usual[key]) - len(kept[key]),
            )
            for key, trend in trends.items()
        ),
        sum(one["material_temperature_degC"] is None for one in runs.values()),
        isfinite(scale),
    )


def _trends(
    series: Mapping[_Figure, Series], limits: Mapping[_Figure, float]
) -> dict[_Figure, Trend]:
    """Return what each figure of a machine shows, knowing when others have changed."""
    level = LEVEL / len(series)
    trends = {key: trend_of(one, level, limits[key]) for key, one in series.items()}
    steps = {
        key: [
            (one.e_n, float(series[key].years[one.run]))
            for one in trend.changes
            if one.kind == "step"
        ]
        for key, trend in trends.items()
    }
    events: list[float] = []
    near = _runs_apart([*series.values()])
    for _, year in sorted((one for own in steps.values() for one in own), reverse=True):
        if not any(near(year, one) for one in events):
            events.append(year)
    for key, one in series.items():
        others = [year for year in events if not any(near(year, own) for _, own in steps[key])]
        if others:
            trends[key] = trend_of(one, level, limits[key], others)
    return trends


def _runs_apart(series: Sequence[Series]) -> Callable[[float, float], bool]:
    """Return what says whether two dates are so few runs apart that they may be of one event."""
    every = np.unique(np.concatenate([one.years for one in series]))

    def near(one: float, other: float) -> bool:
        return abs(int(np.searchsorted(every, one) - np.searchsorted(every, other))) <= _NEAR

    return near


def _length(kind: str, figure: str, travels: Mapping[str, float]) -> float:
    """Return the length that an error of scale acts on, m; NaN where it is not known.

    Straightness and angles do not depend on it. A diagonal is at most that of the box.
    """
    what, _, curve = figure.partition(" ")
    if kind == "result" and (what in SQUARENESS or what.startswith(("straightness", "angular"))):
        return 0.0
    if what == "positioning":
        return travels.get(curve, nan)
    if what == "diagonal" or kind == "volume":
        return hypot(*travels.values()) if len(travels) == len("XYZ") else nan
    return nan


def _of_usual_method(rows: list[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the rows by the method that most have; of two of them the one that was used last.

    Two methods may differ by more than their uncertainties: setup errors act on each otherwise.
    """
    methods = [row["method"] for row in rows]
    usual = max(reversed(methods), key=methods.count)
    return [row for row in rows if row["method"] == usual]


def axes_of(figure: str) -> tuple[int, ...]:
    """Return the axes whose measured travel a figure depends on, 0 to 2.

    A squareness error or the size of an effect does not depend on it; the largest error in the
    volume and a diagonal depend on all.
    """
    what, _, curve = figure.partition(" ")
    if figure == LARGEST or what == "diagonal":
        return (0, 1, 2)
    return (moving_axis(curve),) if curve in CURVES else ()


def _of_newest_box(
    rows: list[Mapping[str, Any]],
    boxes: Mapping[tuple[str, str | None], Box],
    axes: Sequence[int],
) -> list[Mapping[str, Any]]:
    """Return the rows of the runs that measured the box of the last one along some axes."""
    own = [boxes.get((row["bag_sha256"], row["run_id"]), {}) for row in rows if boxes]
    if not own:
        return rows
    return [row for row, box in zip(rows, own, strict=True) if _same_box(box, own[-1], axes)]


def _same_box(one: Box, newest: Box, axes: Sequence[int]) -> bool:
    return all(
        abs(end - other) <= _SAME_BOX * (newest[axis][1] - newest[axis][0])
        for axis in axes
        if axis in one and axis in newest
        for end, other in zip(one[axis], newest[axis], strict=True)
    )


def series_of(rows: Sequence[Mapping[str, Any]], shared: float) -> Series:
    """Return the rows of one figure as a series.

    The temperature of a run is as uncertain as it varied from stop to stop (rectangular).

    Args:
        rows: of the figure.
        shared: standard uncertainty of the figure by what the runs of an instrument share; NaN if
            not known: then the history alone determines how instruments differ.
    """
    whole = [
        _number(row["expanded_uncertainty"]) / COVERAGE_FACTOR
        if row["standard_uncertainty"] is None
        else float(row["standard_uncertainty"])
        for row in rows
    ]
    scatter = [_number(row["scatter_standard_uncertainty"]) for row in rows]
    own = np.fmin(whole, scatter)  # what is not separated may all differ from run to run
    return Series(
        np.array([(row["time"] - _FIRST) / _YEAR for row in rows]),
        np.array([row["value"] for row in rows], float),
        own,
        np.array([_number(row["material_temperature_degC"]) for row in rows]),
        np.array([_number(row["material_temperature_range_K"]) for row in rows]) / sqrt(12.0),
        # A scale that is stated is that of the laser, whichever sensors it is compensated by.
        [_instrument(row) if shared >= 0.0 else _sensors(row) for row in rows],
        shared,
        np.sqrt(np.square(whole) - np.square(own)),
        [str(row["layout"] or "") for row in rows],
    )


def _sensors(row: Mapping[str, Any]) -> str:
    """Return what the error of a run's scale depends on: its instrument and weather station."""
    return f"{_instrument(row)} with {row['weather_station'] or ''}"


def _instrument(row: Mapping[str, Any]) -> str:
    return str(row["instrument_serial_number"] or row["instrument"] or "")


def _number(value: float | None) -> float:
    return nan if value is None else float(value)
