"""Random machines with every kind of error at once, and what a tracker reads on them.

Made with nothing of the estimators but their data classes: rigid bodies by ``machine_lengths``, and
on top of the lengths what differs between passes.
"""

from dataclasses import dataclass, replace

import numpy as np
from cells_for_tests import make_cell

from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.forward import ErrorCurves
from stepdiag_ros.metrology.geometry import CHAINS, ROTATIONS, SQUARENESS, TRANSLATIONS, Vector
from stepdiag_ros.metrology.plan import FORWARD
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.campaign import grid_readings
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.lengths import machine_lengths
from stepdiag_ros.metrology.tracker.readings import (
    LOCATE,
    TrackerReading,
    measured,
    points_of,
    stations_of,
)
from stepdiag_ros.metrology.tracker.seven_lines import make_test

TRACKER = Tracker(minimum_range=0.1)
LARGE = Box(np.zeros(3), np.array([0.8, 0.5, 0.4]))
SMALL = Box(np.zeros(3), np.full(3, 0.12))
PLACES = {
    "corner": (LARGE, (0.0, 0.0, 0.0)),
    "beside": (LARGE, (0.05, 0.04, -0.12)),
    "outside": (LARGE, (-0.15, -0.12, 0.1)),
    "far corner": (LARGE, (0.9, 0.55, 0.4)),
    "small": (SMALL, (-0.15, 0.15, -0.15)),
    "small corner": (SMALL, (-0.02, -0.02, -0.02)),
}
"""Name → volume and tracker: lines along the beam, and up to 45° off it."""


@dataclass(frozen=True)
class Measured:
    """One measured machine.

    Attributes:
        cell: the machine.
        readings: of the seven lines.
        place: of the tracker, by name in ``PLACES``.
    """

    cell: SimulatedCell
    readings: tuple[TrackerReading, ...]
    place: str


def any_size(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a size between two, all orders of magnitude alike."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def any_machine(rng: np.random.Generator, box: Box) -> SimulatedCell:
    """Return a machine whose travel is the box or up to a third more, of any chain."""
    room = (box.high - box.low) * rng.uniform(0.0, 0.15, (2, 3))
    low, high = box.low - room[0], box.high + room[1]
    squareness = [15e-6 * float(rng.standard_normal()) for _ in SQUARENESS]
    cell = make_cell(
        chain=str(rng.choice(CHAINS)),
        seed=int(rng.integers(2**31)),
        low=low,
        high=high,
        positioning=any_size(rng, 0.3e-6, 3e-6),
        size=any_size(rng, 0.2e-6, 1.5e-6),
        rotation=any_size(rng, 1e-6, 10e-6),
        squareness=squareness,
        tilt=0.0,
        held=0.0,
    )
    return cell if rng.random() < 0.5 else replace(cell, errors=bowed(rng, cell.errors))


def bowed(rng: np.random.Generator, errors: ErrorCurves) -> ErrorCurves:
    """Return other curves of the same size, bows and kinks in place of waves."""
    curves, bent, kinds = {}, {}, {}
    for index, name in enumerate((*TRANSLATIONS, *ROTATIONS)):
        axis, column = (index % 9) // 3, index % 3 + 3 * (index // 9)
        values = errors.values[axis][:, column]
        share = np.linspace(-1.0, 1.0, len(values))
        curves[name] = np.polyfit(share, values, 1)[0] * share
        kinds[name] = "rotation" if column > 2 else str(axis == column)
        bent.setdefault(kinds[name], []).append(np.var(values - curves[name]))
        one, two, three = rng.standard_normal(3)
        kink = np.abs(share - rng.uniform(-0.8, 0.8))
        shape = one * share**2 + 0.5 * two * (share**3 - 0.6 * share) + 0.5 * three * kink
        curves[name] = np.stack([curves[name], 2.0 * (shape - shape.mean())])
    for name, (straight, shape) in curves.items():
        curves[name] = straight + float(np.sqrt(np.mean(bent[kinds[name]]))) * shape
    return ErrorCurves.from_curves(errors.nodes, curves)


def measure(
    rng: np.random.Generator, cell: SimulatedCell, place: str, **how: int
) -> tuple[TrackerReading, ...]:
    """Return the readings of a seven-line test; what differs between passes is on them."""
    box, at = PLACES[place]
    station = np.array(at)
    planned = make_test(box, station, TRACKER, **how).readings()
    points = points_of(planned)
    lengths = machine_lengths(points, station, cell.errors, cell.chain)
    known = TRACKER.uncertainty(lengths)
    repeatability = rng.uniform(0.0, 0.15e-6)
    read = lengths + np.hypot(known, repeatability) * rng.standard_normal(len(lengths))
    unit = (points - station) / lengths[:, None]
    read += np.sum(unit * _lost_motion(rng, planned, points), axis=1)
    zero, air = rng.uniform(0.05e-6, 0.25e-6), rng.uniform(0.0, 0.2e-6)
    passes = [
        (one.line,) if one.line == LOCATE else (one.line, one.run, one.direction) for one in planned
    ]
    read += 0.2e-6 * rng.standard_normal() * lengths
    for found in dict.fromkeys(passes):
        inside = np.array([one == found for one in passes])
        shift, scale = zero * rng.standard_normal(), air * rng.standard_normal()
        read = read + inside * (shift + scale * lengths)
    return measured(planned, read - read[0], known)


def _lost_motion(
    rng: np.random.Generator, planned: tuple[TrackerReading, ...], points: Vector
) -> Vector:
    """Return by how much each axis stops short in the sense in which it came, m, shape (n, 3)."""
    lost = rng.normal(0.0, 0.4e-6, 3)
    made = np.zeros(points.shape)
    for line in dict.fromkeys(one.line for one in planned):
        rows = np.array([one.line == line for one in planned])
        if line == LOCATE:
            made[rows] = 0.5 * np.sign(rng.standard_normal((rows.sum(), 3)))
            continue
        stops = np.array([one.stop for one in planned])
        start = points[rows & (stops == 0)][0]
        end = points[rows & (stops == stops[rows].max())][0]
        sense = [0.5 if one.direction == FORWARD else -0.5 for one in planned if one.line == line]
        made[rows] = np.outer(sense, np.sign(end - start))
    return made * lost


def any_measurement(seed: int, place: str, **how: int) -> Measured:
    """Return a random machine measured from a place."""
    rng = np.random.default_rng([seed, sorted(PLACES).index(place)])
    cell = any_machine(rng, PLACES[place][0])
    return Measured(cell, measure(rng, cell, place, **how), place)


STATIONS = ((-0.1, -0.1, -0.1), (0.9, -0.1, -0.15), (0.4, 0.6, -0.1), (-0.15, 0.6, 0.5))


def wandering_grid(
    rng: np.random.Generator, cell: SimulatedCell, nodes: int = 4
) -> tuple[TrackerReading, ...]:
    """Return readings of a grid from four stations; zero and air differ from row to row."""
    stations = [np.array(station) for station in STATIONS]
    planned = grid_readings(LARGE, stations, TRACKER, nodes)
    common = 0.2e-6 * rng.standard_normal()
    made: list[TrackerReading] = []
    for group, station in zip(stations_of(planned).values(), stations, strict=True):
        lengths = machine_lengths(points_of(group), station, cell.errors, cell.chain)
        known = TRACKER.uncertainty(lengths)
        spread = np.hypot(known, rng.uniform(0.0, 0.15e-6))
        read = lengths * (1.0 + common) + spread * rng.standard_normal(len(lengths))
        zero, air = rng.uniform(0.05e-6, 0.25e-6), rng.uniform(0.0, 0.2e-6)
        rows = np.array([one.stop // nodes for one in group])
        shifts, scales = rng.standard_normal((2, nodes * nodes))
        read += zero * shifts[rows] + air * scales[rows] * lengths
        made += measured(group, read - read[0], known)
    return tuple(made)
