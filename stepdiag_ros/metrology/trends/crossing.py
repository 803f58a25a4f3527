"""When a straight line with its uncertainty leaves a tolerance, as an interval.

The interval is that of E. C. Fieller, Some problems in interval estimation, J. R. Stat. Soc. B 16
(1954) 175: all times at which the line, within its uncertainty, may be on the limit.
"""

from dataclasses import dataclass
from enum import Enum
from math import inf, nan

import numpy as np

from stepdiag_ros.metrology.geometry import Vector

_SURE = 0.5
"""Part of the slope that its uncertainty may be. Among slopes that are hardly beyond theirs are too
many that chance has made steep: Finney asks for g far below 1, and here g is 0.25 at most."""


class Outlook(Enum):
    """What is known of the time when a figure leaves its tolerance."""

    NOT_ASKED = "no tolerance is stated"
    UNKNOWN = "the history does not determine a trend"
    OUTSIDE = "it is outside already"
    MAYBE_OUTSIDE = "it may be outside already: its uncertainty reaches beyond the tolerance"
    INTERVAL = "it will be outside between the two dates"
    NO_TREND = "the trend may be zero, or is not known to half its size"
    TOO_FAR = "the end of the interval is too far ahead for so short a history"
    LAST_ALONE = "the last run stands alone: a change, or a slip; measure again"
    MAYBE_CHANGED = "a change that is not sure may have come: with it, there is no interval"
    WANDERS = "the figure wanders: its deviations from the line hang together"


@dataclass(frozen=True)
class Crossing:
    """When a figure leaves its tolerance.

    Attributes:
        outlook: what is known.
        earliest: lower end of the interval, years from now, at most as far as the line may be
            drawn: until then the figure stays within. NaN if not known.
        latest: its upper end; NaN if not known.
    """

    outlook: Outlook
    earliest: float = nan
    latest: float = nan


NOT_ASKED = Crossing(Outlook.NOT_ASKED)


def crossing(
    level: float, slope: float, covariance: Vector, limit: float, factor: float, reach: float
) -> Crossing:
    """Return when a line leaves ±limit.

    Args:
        level: value now.
        slope: its change per year.
        covariance: of both, 2 × 2.
        limit: above 0, in the unit of the level.
        factor: coverage factor of the interval.
        reach: years ahead for which the line may be drawn.
    """
    wide = factor * float(np.sqrt(covariance[0, 0]))
    if abs(level) - wide > limit:
        return Crossing(Outlook.OUTSIDE)
    if abs(level) + wide > limit:
        return Crossing(Outlook.MAYBE_OUTSIDE)
    limits = (limit, -limit)
    roots = [_roots(level - one, slope, covariance, factor) for one in limits]
    first = min((time for pair in roots for time in pair if time > 0.0), default=inf)
    earliest = min(first, reach)
    if _SURE * abs(slope) <= factor * float(np.sqrt(covariance[1, 1])):
        return Crossing(Outlook.NO_TREND, earliest)
    latest = max(roots[0 if slope > 0.0 else 1])
    if latest > reach:
        return Crossing(Outlook.TOO_FAR, earliest)
    return Crossing(Outlook.INTERVAL, first, latest)


def _roots(gap: float, slope: float, covariance: Vector, factor: float) -> list[float]:
    """Return when the border of a line's uncertainty is where the gap is closed."""
    known = factor**2 * covariance
    found = np.roots(
        [
            slope**2 - known[1, 1],
            2.0 * (gap * slope - known[0, 1]),
            gap**2 - known[0, 0],
        ]
    )
    return [float(one.real) for one in found if abs(one.imag) < 1e-9 * abs(one)]
