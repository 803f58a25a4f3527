"""What a seven-line test will determine, and how well, before anything moves.

The estimators of the evaluation on the lengths of a perfect machine: their covariance does not
depend on the readings, to first order, so it is that of the measurement to come as far as the
lengths alone decide. The machine's repeatability and its other errors come on top.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.joint import NAMES, estimate
from stepdiag_ros.metrology.tracker.lengths import lengths
from stepdiag_ros.metrology.tracker.location import locate
from stepdiag_ros.metrology.tracker.machine_curves import SIZES
from stepdiag_ros.metrology.tracker.readings import measured, points_of
from stepdiag_ros.metrology.tracker.separation import separate
from stepdiag_ros.metrology.tracker.seven_lines import SevenLineTest


@dataclass(frozen=True)
class TrackerExpectation:
    """Standard uncertainties to come.

    Attributes:
        position: of the tracker's x, y, z from its places alone, m, shape (3,).
        joint: name in ``joint.NAMES`` → standard uncertainty, m/m or rad, or NaN if undetermined.
        separations: line along an axis → (u of scale, u of lean towards the tracker, correlation)
            from its readings alone, or in words why not.
        warnings: about the geometry of the places, in words.
    """

    position: Vector
    joint: dict[str, float]
    separations: dict[str, "tuple[float, float, float] | str"]
    warnings: tuple[str, ...]


def expect(test: SevenLineTest, tracker: Tracker, chain: str = "") -> TrackerExpectation:
    """Return how well a test will determine the tracker's place, positioning and squareness.

    Args:
        test: that is planned.
        tracker: its noise.
        chain: order of the axes from workpiece to tool; empty if not known: then the joint
            estimate's part is rough.

    Raises:
        PoorGeometry: the places do not locate the tracker.
        ValueError: the tracker has no stated noise, so there is no expectation.
    """
    if tracker.length_noise == 0 and tracker.length_proportional == 0:
        raise ValueError("a tracker without noise has no uncertainty to expect")
    places = lengths(test.locating, test.station)
    location = locate(test.locating, places - places[0], tracker.uncertainty(places))
    points = points_of(test.readings())
    every = lengths(points, test.station)
    try:
        ideal = measured(test.readings(), every - every[0], tracker.uncertainty(every))
        usual = [size.median for size in SIZES]
        made = estimate(ideal, test.station, float(every[0]), chain, sizes=usual)
        joint = dict(zip(NAMES, map(float, made.standard_uncertainty), strict=True))
    except PoorGeometry:
        joint = dict.fromkeys(NAMES, float("nan"))
    separations: dict[str, tuple[float, float, float] | str] = {}
    for line in test.lines:
        if len(line.name) > 1:
            continue
        targets = np.tile(line.targets, (2 * test.runs, 1))
        seen = lengths(targets, test.station)
        try:
            one = separate(
                targets,
                seen - places[0],
                tracker.uncertainty(seen),
                test.station,
                location.covariance,
                float(places[0]),
            )
        except PoorGeometry as error:
            separations[line.name] = str(error)
            continue
        separations[line.name] = (*one.standard_uncertainty, one.correlation)
    return TrackerExpectation(
        location.standard_uncertainty[:3],
        joint,
        separations,
        tuple(location.warnings),
    )
