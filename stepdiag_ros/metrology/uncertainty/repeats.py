"""What repeated passes show: scatter of single readings, and drift from pass to pass.

Passes of one setup in one direction stop at the same places, so that their differences hold nothing
of the machine but what does not repeat. Each pass is compared with the mean of its likes: offset
and slope along the line are drift (of the zero, of the scale, of the machine's warmth), what is
left is repeatability. Hysteresis between the directions repeats and is in neither.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.observations import Integers, Observations


@dataclass(frozen=True)
class Repeats:
    """Components of variance of repeated passes (method of moments).

    Attributes:
        reading: standard deviation of a single reading about its pass, m; NaN without repeats.
        reading_freedom: its degrees of freedom.
        offset: standard deviation of a pass's offset, m, beyond what the readings' scatter explains
            (0 if nothing is); NaN without repeats.
        slope: standard deviation of a pass's slope along the line, m/m; 0 and NaN as of the offset.
        pass_freedom: degrees of freedom of offset and slope.
        centre: mean displacement of each reading's line, m, about which slopes turn, shape (n,).
    """

    reading: float
    reading_freedom: float
    offset: float
    slope: float
    pass_freedom: int
    centre: Vector


def repeats_of(measurement: Measurement, observations: Observations) -> Repeats:
    """Return what the repeated passes of a measurement show."""
    directions = np.array(
        [measurement.lines[number].line.direction == "forward" for number in observations.passes]
    )
    cell = 2 * observations.setup + directions
    group, _ = observations.groups()
    nan = float("nan")
    centre = np.zeros(len(cell))
    squares, freedom, passes_freedom = 0.0, 0.0, 0
    offsets = slopes = expected_offsets = expected_slopes = 0.0
    for one in np.unique(cell):
        here = np.flatnonzero(cell == one)
        centre[here] = np.mean(observations.displacement[here])
        way = observations.displacement[here] - centre[here]
        left = _beyond_mean(observations.displacement[here], group[here])
        passes = observations.passes[here]
        lines = [
            _straight(way[passes == number], left[passes == number])
            for number in np.unique(passes)
            if np.count_nonzero(passes == number) > 2
        ]
        # The mean of the passes was taken from these passes: one of them tells nothing new.
        new = len(lines) - 1
        if new < 1:
            continue
        share = new / len(lines)
        squares += sum(float(line.rest @ line.rest) for line in lines)
        freedom += share * sum(len(line.rest) - 2 for line in lines)
        passes_freedom += new
        offsets += float(np.sum((_column(lines, 0) - np.mean(_column(lines, 0))) ** 2))
        slopes += float(np.sum((_column(lines, 1) - np.mean(_column(lines, 1))) ** 2))
        expected_offsets += share * float(np.sum(_column(lines, 2)))
        expected_slopes += share * float(np.sum(_column(lines, 3)))
    if passes_freedom == 0 or freedom <= 0:
        return Repeats(nan, 0.0, nan, nan, 0, centre)
    variance = squares / freedom
    return Repeats(
        reading=float(np.sqrt(variance)),
        reading_freedom=freedom,
        offset=float(np.sqrt(max(offsets - variance * expected_offsets, 0.0) / passes_freedom)),
        slope=float(np.sqrt(max(slopes - variance * expected_slopes, 0.0) / passes_freedom)),
        pass_freedom=passes_freedom,
        centre=centre,
    )


def _beyond_mean(values: Vector, group: Integers) -> Vector:
    """Return values less the mean of their group."""
    _, number = np.unique(group, return_inverse=True)
    number = number.reshape(-1)
    mean = np.bincount(number, values) / np.bincount(number)
    beyond: Vector = values - mean[number]
    return beyond


class _Straight(NamedTuple):
    """A least-squares line through a pass: offset at way zero, slope, their variances, residuals.

    The variances are for a scatter of the readings of 1 m.
    """

    offset: float
    slope: float
    offset_variance: float
    slope_variance: float
    rest: Vector


def _straight(way: Vector, values: Vector) -> _Straight:
    middle, mean = float(np.mean(way)), float(np.mean(values))
    centred = way - middle
    power = float(centred @ centred)
    slope = float(centred @ values) / power
    offset = mean - slope * middle
    return _Straight(
        offset,
        slope,
        1.0 / len(way) + middle**2 / power,
        1.0 / power,
        values - offset - slope * way,
    )


def _column(lines: list[_Straight], place: int) -> Vector:
    return np.array([line[place] for line in lines], dtype=np.float64)
