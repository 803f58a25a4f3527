"""Readings freed of their noise as far as repeats allow, for effects that depend on the reading.

An effect that goes by the phase of the light takes it from the reading, and so from the reading's
own noise: what it would change and what the reading scatters are then related although nothing
acts. Each pass alone hides little of this relation, but it adds up over many passes, until an
effect is named in a run that has none. Passes over the same stops in the same sense differ by their
offset, by a slope and by noise; without the last the phase is known well enough, and is nobody's
own.
"""

from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector

_ROUNDS = 3


def steadied(stops: Stops) -> Stops:
    """Return the stops with readings of which each is made from all passes over its place.

    Of a setup whose passes are not repeated in a sense, readings stay as they are.

    Args:
        stops: of a run.
    """
    readings = stops.displacement.copy()
    forward = np.array([line.direction == "forward" for line in stops.lines])
    cell = 2 * stops.setup + forward[stops.pass_index]
    for one in np.unique(cell):
        here = np.flatnonzero(cell == one)
        passes, row = np.unique(stops.pass_index[here], return_inverse=True)
        if len(passes) < 2:
            continue
        table = np.full((len(passes), int(stops.number[here].max()) + 1), np.nan)
        table[row, stops.number[here]] = readings[here]
        readings[here] = _without_noise(table)[row, stops.number[here]]
    return replace(stops, displacement=readings)


def _without_noise(table: Vector) -> Vector:
    """Return what passes (rows) have in common at their places, with each pass's straight line.

    Unknown values stay unknown; so does a place that no pass determines.
    """
    known = np.isfinite(table)
    straight = np.zeros_like(table)
    for _ in range(_ROUNDS):
        told = known.any(axis=0)
        common = np.full(table.shape[1], np.nan)
        common[told] = np.nansum((table - straight)[:, told], axis=0) / known[:, told].sum(axis=0)
        for number, good in enumerate(known):
            if np.count_nonzero(good) > 2:
                left = (table[number] - common)[good]
                slope, offset = np.polyfit(common[good], left, 1)
                straight[number] = offset + slope * np.where(told, common, 0.0)
            elif good.any():
                straight[number] = np.mean((table[number] - common)[good])
    steady: Vector = np.where(known, common + straight, np.nan)
    return steady
