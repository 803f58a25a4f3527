"""From a series to what its owner wants to know: level, trend, changes, limits, and until when."""

from dataclasses import dataclass, field, replace
from functools import partial
from math import nan

import numpy as np
from scipy.stats import t as student

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.trends.changes import Search
from stepdiag_ros.metrology.trends.columns import Design, Kind, Place, columns_of, design_of
from stepdiag_ros.metrology.trends.crossing import NOT_ASKED, Crossing, Told, crossing
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


def trend_of(series: Series, level: float = LEVEL, tolerance: float = nan) -> Trend:
    """Return what a series shows.

    Args:
        series: of a figure.
        level: chance of a false change in it, at most; of several figures of a machine each has its
            part of the whole.
        tolerance: largest magnitude that the figure may have; NaN: none is stated.
    """
    told = NOT_ASKED if np.isnan(tolerance) else Crossing(Told.UNKNOWN)
    last = float(series.years[-1]) if len(series) else nan
    if len(series) < FEWEST:
        return Trend(len(series), last, "runs", crossing=told)
    design = design_of(series)
    if "trend" in design.left_out:
        return Trend(len(series), last, "time", crossing=told)
    if "temperature" in design.names:
        # By the first fit it is known how much of a temperature's uncertainty a value has.
        first = _searched(design, series, level)[1]
        at = design.names.index("temperature")
        design = design_of(series, float(first.coefficients[at]))
    places, now, search = _searched(design, series, level)
    return _trend(series, design, places, now, search, tolerance)


def _searched(design: Design, series: Series, level: float) -> tuple[list[Place], Fit, Search]:
    search = Search(design, series.years, level)
    places = search.changes()
    return places, search.fitted(places), search


def _trend(
    series: Series,
    design: Design,
    places: list[Place],
    now: Fit,
    search: Search,
    tolerance: float,
) -> Trend:
    spread = np.sqrt(np.diag(now.covariance))
    factor = float(student.ppf(0.5 + 0.5 * COVERAGE_PROBABILITY, now.degrees_of_freedom))
    runs, width = len(series), len(design.names)
    known = {name: number for number, name in enumerate(design.names)}
    lasting = [number for number, place in enumerate(places, width) if place.kind != "alone"]
    lines = [0, 1, *lasting]
    columns = np.column_stack([design.matrix[:runs], columns_of(places, series.years)])
    aside = [number for number in range(1, width) if number != 1]
    line = columns[:, lines] @ now.coefficients[lines]
    wide = np.einsum(
        "ij,jk,ik->i", columns[:, lines], now.covariance[np.ix_(lines, lines)], columns[:, lines]
    )
    trend = Trend(
        runs,
        float(series.years[-1]),
        level=float(now.coefficients[0]),
        level_expanded=float(factor * spread[0]),
        slope=float(now.coefficients[1]),
        slope_expanded=float(factor * spread[1]),
        temperature=design.temperature,
        between=now.between,
        changes=_changes(series, places, now, search, factor),
        limits=_limits(series, now),
        line=line,
        line_expanded=factor * np.sqrt(wide),
        adjusted=series.values - columns[:, aside] @ now.coefficients[aside],
        left_out=design.left_out,
        degrees_of_freedom=now.degrees_of_freedom,
    )
    if "temperature" in known:
        at = known["temperature"]
        trend = replace(
            trend,
            per_kelvin=float(now.coefficients[at]),
            per_kelvin_expanded=float(factor * spread[at]),
        )
    return replace(trend, crossing=_crossing(series, now, tolerance))


def _changes(
    series: Series, places: list[Place], now: Fit, search: Search, factor: float
) -> tuple[Change, ...]:
    found = []
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


def _limits(series: Series, now: Fit) -> tuple[float, float]:
    """Return between what the next run is, at the mean temperature, with a usual uncertainty."""
    usual = float(np.median(np.nan_to_num(series.uncertainty)))
    factor = float(student.ppf(0.5 + 0.5 * LIMITS_PROBABILITY, now.degrees_of_freedom))
    half = factor * float(np.sqrt(now.covariance[0, 0] + now.between**2 + usual**2))
    return float(now.coefficients[0]) - half, float(now.coefficients[0]) + half


def _crossing(series: Series, now: Fit, tolerance: float) -> Crossing:
    if np.isnan(tolerance):
        return NOT_ASKED
    factor = float(student.ppf(0.5 + 0.5 * CROSSING_PROBABILITY, now.degrees_of_freedom))
    reach = _REACH * float(series.years[-1] - series.years[0])
    slope, covariance = float(now.coefficients[1]), now.covariance[:2, :2]
    found = crossing(float(now.coefficients[0]), slope, covariance, tolerance, factor, reach)
    if found.told is Told.INTERVAL and _wanders(now.residuals[: len(series)]):
        return Crossing(Told.WANDERS)
    return found


def _wanders(residuals: Vector) -> bool:
    """Say whether neighbours deviate together, beyond chance."""
    together = float(residuals[1:] @ residuals[:-1]) / float(residuals @ residuals)
    return together * float(np.sqrt(len(residuals))) > _WANDERS
