"""What a figure is made of: level, trend, temperature, season, instruments, and changes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.trends.fitting import Fit, fit, left_over
from stepdiag_ros.metrology.trends.series import Series

FREE = 5
"""Degrees of freedom that must stay; what the runs are too few for is left out."""
_SEASONS = 1.5
"""Years of history from which on a yearly wave and a trend are distinguished."""
_KNOWN = 0.5
"""Part of the runs that must have a temperature."""

Kind = Literal["step", "bend", "alone"]


@dataclass(frozen=True, order=True)
class Place:
    """A change that a history may have.

    Attributes:
        first: number of the first run after it, from 0; of a run that stands alone, that run.
        kind: ``step`` of the level, ``bend`` of the trend, or one run that stands ``alone``.
    """

    first: int
    kind: Kind


def columns_of(places: Sequence[Place], years: Vector) -> Vector:
    """Return runs × places: the column of each; level and trend are those after the last change."""
    runs = np.arange(len(years))[:, None]
    at = np.array([one.first for one in places], int)
    kinds = np.array([one.kind for one in places], str)
    middle = 0.5 * (years[at - 1] + years[at])
    columns: Vector = np.select(
        [kinds == "alone", kinds == "step"],
        [np.asarray(runs == at, float), -np.asarray(runs < at, float)],
        np.maximum(middle - years[:, None], 0.0),
    )
    return columns


@dataclass(frozen=True)
class Design:
    """What is fitted to a series, before changes; rows beyond the runs are knowledge.

    Attributes:
        names: of the columns: ``level``, ``trend``, ``event``, ``instrument``, ``temperature``,
            ``season``, ``systematic`` (of the layout of the last run), ``layout`` (of another one,
            less that); of a whole design also the kinds of changes, and ``rate``.
        matrix: rows × columns.
        values: of each row.
        own: variance of each row that is known.
        varies: 1 for a run, 0 for another row.
        temperature: at which the level holds, °C; NaN where none is known.
        left_out: names of what the runs do not determine.
    """

    names: tuple[str, ...]
    matrix: Vector
    values: Vector
    own: Vector
    varies: Vector
    temperature: float
    left_out: tuple[str, ...]

    def fitted(self) -> Fit:
        """Return the fit of all columns."""
        return fit(self.matrix, self.values, self.own, self.varies)

    def known(self, columns: NDArray[np.bool_], uncertainty: float | Vector) -> "Design":
        """Return the design with rows that say: these columns are 0 with a standard uncertainty.

        Args:
            columns: whether each column is meant.
            uncertainty: of their coefficients, above 0; one for all, or of each.
        """
        rows = np.eye(self.matrix.shape[1])[columns]
        more = np.zeros(len(rows))
        return replace(
            self,
            matrix=np.vstack([self.matrix, rows]),
            values=np.concatenate([self.values, more]),
            own=np.concatenate([self.own, more + np.square(uncertainty)]),
            varies=np.concatenate([self.varies, more]),
        )


def design_of(series: Series, events: Sequence[int] = (), coefficient: float = 0.0) -> Design:
    """Return level, trend and what else runs differ in, as far as the runs determine it.

    Args:
        series: at least two runs.
        events: numbers of the runs before which the machine has changed in another figure, so that
            this one may have changed too.
        coefficient: of temperature, per K: by it the uncertainty of a temperature is one of the
            value.
    """
    runs = len(series)
    temperature, uncertain, mean = _temperature(series)
    names, columns, left_out = ["level"], [np.ones(runs)], []
    offsets = list(_systematic(series))  # which are known beforehand, and need no runs
    for name, group in _further(series, temperature, events):
        if name == "instrument" and series.instrument_uncertainty > 0.0:
            offsets += [(name, one, series.instrument_uncertainty) for one in group.T]
            continue
        basis = np.linalg.qr(np.column_stack(columns))[0]
        determined = bool(np.all(left_over(group, basis)[1]))
        room = runs - len(columns) - group.shape[1] >= FREE or name == "trend"
        if determined and room:
            columns.extend(group.T)
            names.extend([name] * group.shape[1])
        else:
            left_out.append(name)
    names.extend(name for name, _, _ in offsets)
    matrix = np.column_stack([*columns, *(one for _, one, _ in offsets)])
    own = np.nan_to_num(series.uncertainty) ** 2 + (coefficient * uncertain) ** 2
    made = Design(
        tuple(names),
        matrix,
        series.values,
        own,
        np.ones(runs),
        mean,
        tuple(dict.fromkeys(left_out)),
    )
    if not offsets:
        return made
    known = np.arange(len(names)) >= len(columns)
    return made.known(known, np.array([uncertainty for _, _, uncertainty in offsets]))


def _systematic(series: Series) -> Iterator[tuple[str, Vector, float]]:
    """Yield what all runs of a layout share: name and column of it, and its standard uncertainty.

    The level contains the error of the last layout, however many runs there are. That of another
    layout may be anything within its own uncertainty. So a change of layout does not look like a
    step of the machine, and a second layout does not make the level better known.
    """
    layouts = np.array(series.layouts)
    of_each = {
        one: float(np.sqrt(np.mean(np.nan_to_num(series.systematic[layouts == one]) ** 2)))
        for one in sorted(set(series.layouts))
    }
    last = of_each.pop(series.layouts[-1])
    if last > 0.0:
        yield "systematic", np.ones(len(series)), last
    for name, other in of_each.items():
        if max(last, other) > 0.0:
            yield "layout", np.asarray(layouts == name, float), float(np.hypot(last, other))


def _temperature(series: Series) -> tuple[Vector, Vector, float]:
    """Return temperatures less their mean, their standard uncertainties, and the mean.

    A run without a temperature has the mean, with the standard deviation of all as uncertainty.
    """
    known = np.isfinite(series.temperature)
    if np.count_nonzero(known) < _KNOWN * len(series):
        return np.zeros(len(series)), np.zeros(len(series)), float("nan")
    mean = float(np.mean(series.temperature[known]))
    spread = float(np.std(series.temperature[known]))
    uncertain = np.where(known, np.nan_to_num(series.temperature_uncertainty), spread)
    return np.where(known, series.temperature - mean, 0.0), uncertain, mean


def _further(
    series: Series, temperature: Vector, events: Sequence[int]
) -> Iterator[tuple[str, Vector]]:
    """Yield what may be fitted beside the level, the most important first."""
    years = series.years
    yield "trend", (years - years[-1])[:, None]
    for event in events:
        yield "event", columns_of([Place(event, "step")], years)
    names = sorted(set(series.instruments))
    of_each = np.array([[one == name for name in names] for one in series.instruments], float)
    if series.instrument_uncertainty > 0.0:
        yield "instrument", of_each
    elif len(names) > 1 and series.instrument_uncertainty != 0.0:
        yield "instrument", (of_each - np.mean(of_each, axis=0))[:, 1:]
    if np.any(temperature != 0.0):
        yield "temperature", temperature[:, None]
    if years[-1] - years[0] > _SEASONS:
        angle = 2.0 * np.pi * years
        yield "season", np.column_stack([np.sin(angle), np.cos(angle)])


def with_changes(design: Design, places: Sequence[Place], years: Vector) -> Design:
    """Return the design with a column for each change, which has the name of its kind."""
    more = np.zeros((len(design.values), len(places)))
    more[: len(years)] = columns_of(places, years)
    names = (*design.names, *(one.kind for one in places))
    return replace(design, names=names, matrix=np.column_stack([design.matrix, more]))


def with_rates(design: Design, steps: Sequence[Place], years: Vector, rate: float) -> Design:
    """Return the design with a trend that may be another after each step.

    What has worn may wear in another way after it was hit or repaired. That is known beforehand:
    the rate has changed by about its own size, or not.

    Args:
        design: with the changes.
        steps: at which the rate may have changed.
        years: of the runs.
        rate: size of the trend.
    """
    made = with_changes(design, [Place(one.first, "bend") for one in steps], years)
    names = (*design.names, *("rate" for _ in steps))
    rates = np.array([name == "rate" for name in names])
    return replace(made, names=names).known(rates, rate)
