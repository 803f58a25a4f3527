"""From a series to what its owner wants to know: level, trend, changes, limits, and until when."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import nan

import numpy as np
from scipy.special import stdtrit

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.trends.changes import Search
from stepdiag_ros.metrology.trends.columns import (
    Design,
    Kind,
    Place,
    design_of,
    with_changes,
    with_rates,
)
from stepdiag_ros.metrology.trends.crossing import NOT_ASKED, Crossing, Outlook, crossing
from stepdiag_ros.metrology.trends.fitting import Fit
from stepdiag_ros.metrology.trends.series import Series
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_PROBABILITY

FEWEST = 8
"""Runs without which a history shows nothing."""
LEVEL = 0.02
"""Chance of a false change in the whole history of a machine, at most."""
CROSSING_PROBABILITY = 0.90
LIMITS_PROBABILITY = 0.9973
"""That the next run of an unchanged machine is between the control limits."""

_LINE = ("level", "trend", "event", "step", "bend", "rate")
_ASIDE = ("temperature", "season", "instrument", "systematic", "layout")
_DOUBT = 0.5
"""Chance of a false change at which a change counts as possible, though it is not reported."""
_LATELY = 4
"""Runs from a change to the last, at most, for which it is news."""
_REACH = 2.0
"""A trend may be drawn ahead for so many times the length of the history."""
_WANDERS = 3.0
"""Standard deviations of the correlation of neighbours beyond which it is not chance."""


@dataclass(frozen=True)
class Change:
    """A change in a history.

    Attributes:
        kind: ``step`` of the level, ``bend`` of the trend, or one run that stands ``alone``.
        run: number of the first run after it, from 0.
        earliest: years of the last run before which it was not yet, with 95 % confidence.
        latest: years of the first run at which it surely was.
        size: in the unit of the figure; of a bend per year.
        expanded: uncertainty U of the size.
        e_n: size over U: beyond 1 it is not explained by the uncertainty.
    """

    kind: Kind
    run: int
    earliest: float
    latest: float
    size: float
    expanded: float

    @property
    def e_n(self) -> float:
        """Return the size over its expanded uncertainty, ISO/IEC 17043."""
        return abs(self.size) / self.expanded


@dataclass(frozen=True)
class Trend:
    """What a history shows; numbers are NaN where it does not show them.

    Attributes:
        runs: number of runs.
        last: years of the last run; NaN without one.
        unknown: why level and trend are not known, in a word: ``runs`` are too few, or all are of
            one ``time``; empty if they are known.
        level: of the figure at the last run, at the mean temperature, beyond the yearly wave.
        level_expanded: its U.
        slope: change per year.
        slope_expanded: its U.
        per_kelvin: change with the temperature.
        per_kelvin_expanded: its U.
        temperature: at which the level holds, °C.
        between: standard deviation from run to run, beyond the runs' own uncertainties.
        changes: steps and bends, and runs that stand alone, in the order of their dates.
        limits: control limits, between which the next run is if nothing changes.
        line: level at each run without temperature, season and instrument.
        line_expanded: its U.
        adjusted: values without temperature, season and instrument.
        left_out: names of what the runs do not determine.
        degrees_of_freedom: that the uncertainties rest on.
        crossing: when the figure leaves its tolerance.
    """

    runs: int
    last: float
    unknown: str = ""
    level: float = nan
    level_expanded: float = nan
    slope: float = nan
    slope_expanded: float = nan
    per_kelvin: float = nan
    per_kelvin_expanded: float = nan
    temperature: float = nan
    between: float = nan
    changes: tuple[Change, ...] = ()
    limits: tuple[float, float] = (nan, nan)
    line: Vector = field(default_factory=partial(np.empty, 0))
    line_expanded: Vector = field(default_factory=partial(np.empty, 0))
    adjusted: Vector = field(default_factory=partial(np.empty, 0))
    left_out: tuple[str, ...] = ()
    degrees_of_freedom: int = 0
    crossing: Crossing = NOT_ASKED

    def changed(self) -> tuple[Change, ...]:
        """Return the changes that last, without the runs that stand alone."""
        return tuple(one for one in self.changes if one.kind != "alone")

    def changed_lately(self) -> bool:
        """Say whether a change is so late that few runs have followed it."""
        return any(one.run >= self.runs - _LATELY for one in self.changed())

    def grows(self) -> bool:
        """Say whether the size of the figure grows, beyond U."""
        away = self.slope if self.level >= 0.0 else -self.slope
        return away > self.slope_expanded


def trend_of(
    series: Series, level: float = LEVEL, tolerance: float = nan, events: Sequence[float] = ()
) -> Trend:
    """Return what a series shows.

    Args:
        series: of a figure.
        level: chance of a false change in it, at most; of several figures of a machine each has its
            part of the whole.
        tolerance: largest magnitude that the figure may have; NaN: none is stated.
        events: years of the first run after each change of the machine that other figures show.
            What is too small to be found may have changed then, too.
    """
    told = NOT_ASKED if np.isnan(tolerance) else Crossing(Outlook.UNKNOWN)
    last = float(series.years[-1]) if len(series) else nan
    if len(series) < FEWEST:
        return Trend(len(series), last, "runs", crossing=told)
    firsts = np.unique(np.searchsorted(series.years, np.asarray(events)))
    hit = [int(one) for one in firsts if 0 < one < len(series)]
    design = design_of(series, hit)
    if "trend" in design.left_out:
        return Trend(len(series), last, "time", crossing=told)
    search = Search(design, series.years, level)
    places = search.changes([])
    if "temperature" in design.names:
        # By the first fit it is known how much of a temperature's uncertainty a value has.
        at = design.names.index("temperature")
        search.design = design_of(series, hit, float(search.fitted(places).coefficients[at]))
        places = search.changes(places)
    trend = _with_changes(series, search, places, hit, tolerance)
    if trend.crossing.outlook is Outlook.INTERVAL:
        trend = replace(trend, crossing=_doubted(series, search, places, hit, tolerance, trend))
    if (
        trend.crossing.outlook is not Outlook.NOT_ASKED
        and Place(len(series) - 1, "alone") in places
    ):
        trend = replace(trend, crossing=Crossing(Outlook.LAST_ALONE))
    return replace(trend, changes=_changes(series, places, search.fitted(places), search))


def _with_changes(
    series: Series, search: Search, places: list[Place], hit: list[int], tolerance: float
) -> Trend:
    """Return the trend with some changes; after a step the rate may be another one."""
    now = search.fitted(places)
    steps = [Place(one, "step") for one in hit] if "event" in search.design.names else []
    steps += [one for one in places if one.kind == "step"]
    rate = max(abs(float(now.coefficients[1])), float(np.sqrt(now.covariance[1, 1])))
    whole = with_changes(search.design, places, series.years)
    return _trend(series, with_rates(whole, steps, series.years, rate), tolerance)


def _doubted(
    series: Series,
    search: Search,
    places: list[Place],
    hit: list[int],
    tolerance: float,
    trend: Trend,
) -> Crossing:
    """Return what is known of the crossing if changes that are not sure may have happened, too.

    A change that is too small to be reported bends the line all the same, the last one most of all.
    """
    may = Search(search.design, series.years, _DOUBT).changes(places)
    if may == places:
        return trend.crossing
    other = _with_changes(series, search, may, hit, tolerance).crossing
    earliest = min(trend.crossing.earliest, other.earliest)
    if other.outlook is not Outlook.INTERVAL:
        return Crossing(Outlook.MAYBE_CHANGED, earliest)
    return Crossing(Outlook.INTERVAL, earliest, max(trend.crossing.latest, other.latest))


def _trend(series: Series, design: Design, tolerance: float) -> Trend:
    now = design.fitted()
    wide = _factor(now, COVERAGE_PROBABILITY) * np.sqrt(np.diag(now.covariance))
    runs = len(series)
    lines = np.array([name in _LINE for name in design.names])
    aside = np.array([name in _ASIDE for name in design.names])
    columns = design.matrix[:runs]
    line = columns[:, lines]
    covariance = now.covariance[np.ix_(lines, lines)]
    spread = np.sqrt(np.einsum("ij,jk,ik->i", line, covariance, line))
    trend = Trend(
        runs,
        float(series.years[-1]),
        level=float(now.coefficients[0]),
        level_expanded=float(wide[0]),
        slope=float(now.coefficients[1]),
        slope_expanded=float(wide[1]),
        temperature=design.temperature,
        between=now.between,
        limits=_limits(series, design, now),
        line=line @ now.coefficients[lines],
        line_expanded=_factor(now, COVERAGE_PROBABILITY) * spread,
        adjusted=series.values - columns[:, aside] @ now.coefficients[aside],
        left_out=design.left_out,
        degrees_of_freedom=now.degrees_of_freedom,
        crossing=_crossing(series, now, tolerance),
    )
    if "temperature" not in design.names:
        return trend
    at = design.names.index("temperature")
    return replace(
        trend, per_kelvin=float(now.coefficients[at]), per_kelvin_expanded=float(wide[at])
    )


def _factor(now: Fit, probability: float) -> float:
    return float(stdtrit(now.degrees_of_freedom, 0.5 + 0.5 * probability))


def _changes(series: Series, places: list[Place], now: Fit, search: Search) -> tuple[Change, ...]:
    found = []
    factor = _factor(now, COVERAGE_PROBABILITY)
    for number, place in enumerate(places, len(now.coefficients) - len(places)):
        first = last = place.first
        if place.kind != "alone":
            first, last = search.span(place, [one for one in places if one != place])
        found.append(
            Change(
                place.kind,
                place.first,
                float(series.years[first if place.kind == "alone" else first - 1]),
                float(series.years[last]),
                float(now.coefficients[number]),
                float(factor * np.sqrt(now.covariance[number, number])),
            )
        )
    return tuple(found)


def _limits(series: Series, design: Design, now: Fit) -> tuple[float, float]:
    """Return between what the next run is, at the mean temperature, with a usual uncertainty.

    What is systematic in the last run is so in the next.
    """
    next_run = np.array([name in ("level", "systematic") for name in design.names], float)
    usual = float(np.median(np.nan_to_num(series.uncertainty)))
    half = _factor(now, LIMITS_PROBABILITY) * float(
        np.sqrt(next_run @ now.covariance @ next_run + now.between**2 + usual**2)
    )
    return float(now.coefficients[0]) - half, float(now.coefficients[0]) + half


def _crossing(series: Series, now: Fit, tolerance: float) -> Crossing:
    if np.isnan(tolerance):
        return NOT_ASKED
    factor = _factor(now, CROSSING_PROBABILITY)
    reach = _REACH * float(series.years[-1] - series.years[0])
    slope, covariance = float(now.coefficients[1]), now.covariance[:2, :2]
    found = crossing(float(now.coefficients[0]), slope, covariance, tolerance, factor, reach)
    if found.outlook is Outlook.INTERVAL and _wanders(now.residuals[: len(series)]):
        return Crossing(Outlook.WANDERS)
    return found


def _wanders(residuals: Vector) -> bool:
    """Say whether neighbours deviate together, beyond chance."""
    together = float(residuals[1:] @ residuals[:-1]) / float(residuals @ residuals)
    return together * float(np.sqrt(len(residuals))) > _WANDERS
