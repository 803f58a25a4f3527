"""Measurements from several stations: their places, their simulation, and the points from them."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import AXES, SQUARENESS, TRANSLATIONS, Vector, moving_axis
from stepdiag_ros.metrology.plan import FORWARD, Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.summary import slope_weights
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.evaluation import locate_from
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.location import LEAST_POINTS, Location, locate
from stepdiag_ros.metrology.tracker.machine_curves import NODES, MeasuredBox
from stepdiag_ros.metrology.tracker.multilateration import Points, multilaterate
from stepdiag_ros.metrology.tracker.readings import (
    GRID,
    LOCATE,
    TrackerReading,
    changes_of,
    measured,
    points_of,
    stations_of,
    uncertainties_of,
)

_LEAST_NODES = 2
_MOST_NODES = 12


def grid_readings(
    box: Box, stations: Sequence[Vector], tracker: Tracker, nodes: int
) -> tuple[TrackerReading, ...]:
    """Return the places of a grid that each station can see, not yet measured.

    Neighbours follow each other: X runs to and fro within Y, and Y within Z.

    Args:
        box: that the grid fills.
        stations: rough places of the tracker, m.
        tracker: its limits.
        nodes: places along each axis, 2 to 12.

    Raises:
        PoorGeometry: a station sees too few places to be located from them.
        ValueError: another number of nodes.
    """
    if not _LEAST_NODES <= nodes <= _MOST_NODES:
        raise ValueError(f"{nodes} places along an axis; expected {_LEAST_NODES} to {_MOST_NODES}")
    sides = [np.linspace(box.low[axis], box.high[axis], nodes) for axis in range(3)]
    order = []
    for level, row in product(range(nodes), range(nodes)):
        rows = row if level % 2 == 0 else nodes - 1 - row
        columns = range(nodes) if (level * nodes + row) % 2 == 0 else range(nodes - 1, -1, -1)
        order += [(column, rows, level) for column in columns]
    made = []
    for number, station in enumerate(stations, start=1):
        seen = 0
        for stop, (x, y, z) in enumerate(order):
            place = np.array([sides[0][x], sides[1][y], sides[2][z]])
            if tracker.unseen(place, np.asarray(station)):
                continue
            seen += 1
            triple = (float(place[0]), float(place[1]), float(place[2]))
            made.append(TrackerReading(str(number), GRID, 1, FORWARD, stop, triple))
        if seen < LEAST_POINTS:
            raise PoorGeometry(
                f"station {number} sees {seen} places of the grid; {LEAST_POINTS} or more are"
                " needed; place it elsewhere",
                fault="too_few",
            )
    return tuple(made)


def simulate_readings(
    readings: Sequence[TrackerReading],
    stations: Sequence[Vector],
    tracker: Tracker,
    cell: SimulatedCell,
    seed: int = 0,
) -> tuple[TrackerReading, ...]:
    """Measure places on a simulated machine.

    Each station's counter is zeroed at its first place; that length has noise like any other.

    Args:
        readings: places, as planned.
        stations: true places of the tracker in the order in which the stations come, m.
        tracker: its noise.
        cell: the machine and the reflector's offset.
        seed: of the noise.

    Returns:
        the same readings with length changes and their standard uncertainties.

    Raises:
        ValueError: another number of stations than the readings have, or a place where the
            machine's errors are not given.
    """
    groups = stations_of(readings)
    if len(groups) != len(stations):
        raise Refusal(
            f"the table has {len(groups)} stations ({', '.join(groups)}), but {len(stations)}"
            " places of the tracker were given",
            fault="mismatch",
        )
    cell.require(points_of(readings), "the table of places")
    rng = np.random.default_rng(seed)
    made: list[TrackerReading] = []
    for group, station in zip(groups.values(), stations, strict=True):
        length = cell.length(points_of(group), station)
        spread = tracker.uncertainty(length)
        read = length + spread * rng.standard_normal(len(length))
        # The noise of the zero is a constant of the station, which every estimate leaves free.
        known = spread if np.all(spread > 0) else np.full(len(spread), np.nan)
        made += measured(group, read - read[0], known)
    return tuple(made)


def true_values(cell: SimulatedCell, box: MeasuredBox) -> Vector:
    """Return the true scales and squareness of a simulated machine in the order of ``joint.NAMES``.

    Args:
        cell: the machine.
        box: of the measured places, of which the joint estimate speaks.

    Raises:
        ValueError: the machine's curves do not reach as far.
    """
    step_x, step_y, step_z = (float(value) for value in box.side / (NODES - 1))
    x, y, z = (float(value) for value in box.low)
    volume = Volume((x, y, z), (step_x, step_y, step_z), NODES - 1)
    curves = cell.truth(volume)
    slopes = {
        name: float(slope_weights(volume.nodes(moving_axis(name))) @ curves[name])
        for name in TRANSLATIONS
    }
    made = [slopes[f"E_{letter}{letter}"] for letter in AXES]
    for name in SQUARENESS:
        factor, (first, second) = SQUARENESS_SLOPES[name]
        made.append(factor * (slopes[first] + slopes[second]))
    return np.array(made)


def rough_places(readings: Sequence[TrackerReading]) -> dict[str, Vector]:
    """Return station → rough place of the tracker from its own readings, m, shape (3,).

    Raises:
        PoorGeometry: a station cannot be located.
    """
    groups = stations_of(readings)
    return {name: _rough(name, group, group).position for name, group in groups.items()}


def _rough(
    name: str, readings: Sequence[TrackerReading], others: Sequence[TrackerReading]
) -> Location:
    """Locate a station from its places ``locate``, or else from other readings."""
    try:
        if sum(reading.line == LOCATE for reading in readings) >= LEAST_POINTS:
            return locate_from(readings)
        return locate(points_of(others), changes_of(others))
    except PoorGeometry as error:
        raise PoorGeometry(f"station {name}: {error}") from None


def points_from(readings: Sequence[TrackerReading]) -> Points:
    """Return multilaterated points from the readings ``grid`` of several stations.

    Rough places of the stations come from their readings ``locate``, or else from the grid itself;
    several readings of a place from one station count as their weighted mean.

    Raises:
        PoorGeometry: too few stations or points, or a station that cannot be located.
    """
    groups = stations_of(readings)
    grids = {
        name: [reading for reading in group if reading.line == GRID]
        for name, group in groups.items()
    }
    grids = {name: group for name, group in grids.items() if group}
    if not grids:
        raise PoorGeometry("there is no reading 'grid' to multilaterate")
    places = np.array(
        sorted({tuple(np.round(r.position, 9)) for group in grids.values() for r in group})
    )
    index = {tuple(place): row for row, place in enumerate(places)}
    changes = np.full((len(places), len(grids)), np.nan)
    spread = np.full(changes.shape, np.nan)
    rough, starts = [], []
    for column, (name, group) in enumerate(grids.items()):
        rows = np.array([index[tuple(np.round(r.position, 9))] for r in group])
        for row in np.unique(rows):
            chosen = rows == row
            values, uncertainty = changes_of(group)[chosen], uncertainties_of(group)[chosen]
            weight = 1.0 / uncertainty**2 if np.all(np.isfinite(uncertainty)) else None
            changes[row, column] = np.average(values, weights=weight)
            if weight is not None:
                spread[row, column] = 1.0 / np.sqrt(np.sum(weight))
        found = _rough(name, groups[name], group)
        rough.append(found.position)
        starts.append(found.start_length)
    return multilaterate(
        places, changes, spread, np.array(rough), np.array(starts), names=list(grids)
    )
