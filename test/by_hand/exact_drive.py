"""Readings without noise of a mirror that stands at given places along the beam, one by one."""

from itertools import pairwise

import numpy as np

from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.rest_matching import places_of

RATE = 20.0


def plan_of(*names, step=(0.01, 0.01, 0.01), blocks=3, repeats=1, directions="forward"):
    """Return a plan of linear lines or step diagonals, at 50 mm/s."""
    kind = "linear" if len(names[0]) == 1 else "step_diagonal"
    return Plan.from_mapping(
        {
            "name": "driven exactly",
            "step_m": list(step),
            "blocks": blocks,
            "repeats": repeats,
            "directions": directions.split(),
            "feed_m_per_s": 0.05,
            "lines": [{"kind": kind, "names": list(names)}],
            "sampling": {"settle_s": 0.1, "window_s": 0.3, "dwell_s": 1.0},
        },
        "plan",
    )


def stays_of(plan):
    """Return displacements (m) and dwells (s) of a plan's places, in order."""
    places = places_of(plan, range(len(plan.lines)))
    return [(place.displacement, 1.0 * len(place.stops)) for place in places]


def driven(stays, feed=0.05):
    """Return the readings of a mirror that goes from place to place and stands at each.

    Args:
        stays: displacement (m) and dwell (s) of each place.
        feed: of the moves, m/s.
    """
    times, values = [0.0], [stays[0][0]]
    for (before, _), (level, dwell) in pairwise([stays[0], *stays]):
        if level != before:
            times.append(times[-1] + 0.1 + abs(level - before) / feed)
            values.append(level)
        times.append(times[-1] + dwell)
        values.append(level)
    when = np.arange(0.0, times[-1], 1.0 / RATE)
    return [
        Reading(round(time * 1e9), number, np.nan, value, np.nan, 0, Environment())
        for number, (time, value) in enumerate(
            zip(when.tolist(), np.interp(when, times, values).tolist(), strict=True)
        )
    ]
