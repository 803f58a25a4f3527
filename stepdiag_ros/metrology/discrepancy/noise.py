"""The noise of a reading from the repeats, and how it is correlated from stop to stop.

What repeats of a pass do not share is noise, but for what changes between them: a drift, growth,
a slip. Of the difference of two repeats a parabola over the stops is therefore taken away; the rest
is noise of short duration. A slip or a jump in one pass makes one series conspicuous, which is left
out. Where passes are not repeated, a forward and a backward pass are compared in the same way, and
a constant for each axis that moved last is taken away too. What the rounding of readings adds to
all repeats of a stop alike (see ``rounding``) no repeat shows; it counts as noise nevertheless.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Baseline
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.rounding import NEGLIGIBLE, shared_rounding
from stepdiag_ros.metrology.units import IN_MICRO

REPEATS = "the differences of repeated passes"
DIRECTIONS = "the differences of forward and backward passes"
STATED = "the uncertainty stated beside the readings; no pass is repeated"

_ENOUGH = 30
"""Degrees of freedom below which forward and backward passes are compared too."""
LEAST_STOPS = 5
"""Of a repeated pass that shows noise: a parabola takes three, and one of the rest says little."""
_LARGEST_CORRELATION = 0.6
"""What changes more slowly than that is not noise but an effect."""
_CONSPICUOUS = 3.5
"""Standard deviations of a series' mean square, above the median of all, that leave it out."""


@dataclass(frozen=True)
class Noise:
    """Noise of a reading.

    Attributes:
        size: standard deviation, m; NaN if unknown.
        freedom: degrees of freedom.
        correlation: from stop to stop of a pass, first-order autoregressive.
        source: in words.
        shown: share of the variance that differences of passes show; 0 if it was not taken from
            them.
    """

    size: float
    freedom: float
    correlation: float
    source: str
    shown: float


@dataclass(frozen=True)
class _Series:
    """A contrast of passes with variance one reading's, and the shapes taken away from it."""

    values: Vector
    shapes: Vector


def estimate_noise(baseline: Baseline, gap: Vector, stops: Stops, stated: float) -> Noise:
    """Estimate the noise.

    Args:
        baseline: of the run.
        gap: measured minus simulated, with whatever is known so far, m, shape (n,).
        stops: of the run.
        stated: standard uncertainty beside the readings, m; NaN if unknown.
    """
    whole = baseline.spread(gap / baseline.weight)
    by_pass = [whole[stops.pass_index == index] for index in range(len(stops.lines))]
    series = list(_repeats(by_pass, stops))
    source = REPEATS
    if sum(_freedom(one) for one in series) < _ENOUGH:
        both = list(_directions(by_pass, stops))
        if both:
            source = DIRECTIONS if not series else f"{REPEATS}, and {DIRECTIONS}"
        series += both
    series = [one for one in series if _freedom(one) >= 2]
    if not series:
        known = float(stated) if np.isfinite(stated) and stated > 0.0 else float("nan")
        stated_one = Noise(known, 1000.0 if np.isfinite(known) else 0.0, 0.0, STATED, 0.0)
        return _with_rounding(stated_one, baseline.step, 1.0)
    series = _quiet(series)
    correlation = _correlation(series)
    squares = sum(float(np.sum(_left(one) ** 2)) for one in series)
    expected = sum(_expected(one, correlation)[0] for one in series)
    freedom = float(sum(_freedom(one) for one in series))
    noise = Noise(float(np.sqrt(squares / expected)), freedom, correlation, source, 1.0)
    return _with_rounding(noise, baseline.step, _passes_by_a_stop(stops))


def _with_rounding(noise: Noise, step: float, passes: float) -> Noise:
    """Add what all readings at a stop share, so that their mean has it in full."""
    shared = np.sqrt(passes) * shared_rounding(noise.size, step)
    if not shared >= NEGLIGIBLE * noise.size:
        return noise
    size = float(np.hypot(noise.size, shared))
    return replace(
        noise,
        size=size,
        source=f"{noise.source}; and readings in steps of {step * IN_MICRO:g} µm",
        shown=noise.shown * (noise.size / size) ** 2,
    )


def _passes_by_a_stop(stops: Stops) -> float:
    """Return how many passes come by a stop, forward and backward, on average."""
    setups = [int(stops.setup[stops.pass_index == index][0]) for index in range(len(stops.lines))]
    lines = {(setup, line.order) for setup, line in zip(setups, stops.lines, strict=True)}
    return len(stops.lines) / len(lines)


def _repeats(by_pass: list[Vector], stops: Stops) -> Iterator[_Series]:
    # Another order of the moves stops at other places: what two orders differ by has lost to the
    # fit of the baseline already, and is not pure error.
    groups: dict[tuple[int, str, str], list[int]] = {}
    for index, line in enumerate(stops.lines):
        setup = int(stops.setup[stops.pass_index == index][0])
        groups.setdefault((setup, line.order, line.direction), []).append(index)
    for members in groups.values():
        if len({len(by_pass[index]) for index in members}) > 1:
            continue
        values = np.array([by_pass[index] for index in members])
        here = np.all(np.isfinite(values), axis=0)
        shapes = _parabola(values.shape[1])[here]
        # Helmert's contrasts: independent, each with the variance of one reading.
        for last in range(1, len(members)):
            mean = np.mean(values[:last], axis=0)
            difference = (values[last] - mean) * np.sqrt(last / (last + 1.0))
            yield _Series(difference[here], shapes)


def _directions(by_pass: list[Vector], stops: Stops) -> Iterator[_Series]:
    waiting: dict[tuple[int, str, int], int] = {}
    for index, line in enumerate(stops.lines):
        rows = stops.pass_index == index
        key = (int(stops.setup[rows][0]), line.order, line.repeat)
        if key not in waiting:
            waiting[key] = index
            continue
        other = waiting.pop(key)
        if stops.lines[other].direction == line.direction:
            continue
        one, two = by_pass[other], by_pass[index][::-1]
        if len(one) != len(two):
            continue
        moved_one = stops.moved[stops.pass_index == other]
        moved_two = stops.moved[rows][::-1]
        here = np.isfinite(one) & np.isfinite(two)
        shapes = np.column_stack([_parabola(len(one)), moved_one != 0.0, moved_two != 0.0])
        yield _Series((one - two)[here] / np.sqrt(2.0), shapes[here].astype(np.float64))


def _parabola(count: int) -> Vector:
    u = np.linspace(-1.0, 1.0, count)
    return np.column_stack([np.ones(count), u, u * u])


def _projector(series: _Series) -> Vector:
    count = len(series.values)
    left, values, _ = np.linalg.svd(series.shapes, full_matrices=False)
    span = left[:, values > 1e-9 * values[0]] if count else left
    projector: Vector = np.eye(count) - span @ span.T
    return projector


def _freedom(series: _Series) -> int:
    return round(float(np.trace(_projector(series)))) if len(series.values) > 3 else 0


def _left(series: _Series) -> Vector:
    return _projector(series) @ series.values


def _quiet(series: list[_Series]) -> list[_Series]:
    """Leave out series that are much louder than the median: something happened in one pass."""
    squares = np.array([float(np.mean(_left(one) ** 2)) for one in series])
    freedom = np.array([_freedom(one) for one in series])
    counts = np.array([len(one.values) for one in series])
    each = squares * counts / freedom
    middle = float(np.sort(each)[len(each) // 2])
    limit = middle * (1.0 + _CONSPICUOUS * np.sqrt(2.0 / freedom) + 3.0 / freedom)
    return [one for one, value, most in zip(series, each, limit, strict=True) if value <= most]


def _expected(series: _Series, correlation: float) -> tuple[float, float]:
    """Return the expected sums of squares and of neighbours' products for unit variance."""
    projector = _projector(series)
    count = len(projector)
    apart = np.abs(np.arange(count)[:, None] - np.arange(count))
    noise = correlation**apart if correlation else np.eye(count)
    left = projector @ noise @ projector
    return float(np.trace(left)), float(np.trace(left, offset=1))


def _correlation(series: list[_Series]) -> float:
    """Return the correlation for which neighbours' products are as large as they should be."""
    products = squares = 0.0
    for one in series:
        left = _left(one)
        products += float(left[1:] @ left[:-1])
        squares += float(left @ left)
    if not squares > 0.0:
        return 0.0
    grid = np.linspace(-0.2, _LARGEST_CORRELATION, 17)
    ratios = []
    lengths: dict[bytes, tuple[int, _Series]] = {}
    for one in series:
        key = one.shapes.tobytes()
        lengths[key] = (lengths.get(key, (0, one))[0] + 1, one)
    for rho in grid:
        sums = np.zeros(2)
        for number, one in lengths.values():
            sums += number * np.array(_expected(one, float(rho)))
        ratios.append(sums[1] / sums[0])
    found = float(np.interp(products / squares, ratios, grid))
    # A memory that is overlooked makes slow shapes look real; one that is not there does no harm.
    return max(found, 0.0)
