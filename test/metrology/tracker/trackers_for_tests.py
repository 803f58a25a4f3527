"""Machines, places and readings that the tests of the tracker share."""

import numpy as np

from stepdiag_ros.metrology.forward import ErrorCurves
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.lengths import machine_lengths
from stepdiag_ros.metrology.tracker.readings import measured, points_of
from stepdiag_ros.metrology.tracker.seven_lines import make_test

BOX = Box(np.zeros(3), np.array([0.8, 0.5, 0.4]))
TRACKER = Tracker(minimum_range=0.1)
BESIDE = np.array([0.05, 0.04, -0.12])
"""Below the volume, so that X and Y cannot run along the beam."""
WITHIN = np.array([-0.15, -0.12, 0.1])
PLACES = np.array(
    [
        [0.0, 0.0, 0.0],
        [0.8, 0.0, 0.0],
        [0.0, 0.5, 0.0],
        [0.8, 0.5, 0.4],
        [0.0, 0.0, 0.4],
        [0.4, 0.25, 0.2],
        [0.8, 0.0, 0.4],
        [0.0, 0.5, 0.4],
    ]
)
SCALES = (10e-6, -5e-6, 7e-6)
SQUARENESS = {"C0Y": 12e-6, "B0Z": -8e-6, "A0Z": 15e-6}


def straight_machine(scales=SCALES, squareness=SQUARENESS):
    """Return a machine with scales and squareness alone, in the frame of the results."""
    nodes = [np.array([-1.0, 1.0])] * 3
    ends = np.array([-1.0, 1.0])
    curves = {f"E_{a}{a}": scale * ends for a, scale in zip("XYZ", scales, strict=True)}
    curves["E_XY"] = -squareness["C0Y"] * ends
    curves["E_XZ"] = squareness["B0Z"] * ends
    curves["E_ZY"] = -squareness["A0Z"] * ends
    return ErrorCurves.from_curves(nodes, curves)


def seven_line_readings(errors, station, noise=True, seed=0, tracker=TRACKER, **how):
    test = make_test(BOX, station, tracker, **how)
    readings = test.readings()
    lengths = machine_lengths(points_of(readings), station, errors, "YXZ")
    spread = tracker.uncertainty(lengths)
    rng = np.random.default_rng(seed)
    read = lengths + (spread * rng.standard_normal(len(lengths)) if noise else 0.0)
    return measured(readings, read - read[0], spread)
