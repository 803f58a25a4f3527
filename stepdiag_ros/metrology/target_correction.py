"""Targets that a machine with known errors must be sent to, so that its tool comes where it should.

The tool of a machine that is sent to q is at q + e(q). To bring it to a wanted place w, q must be
w - e(q), which is found by repetition: q ← w - e(q) comes nearer by the factor of the steepest
slope of e, some 1e-5 for a machine tool, so that a few steps reach the last digit.

A map holds in the measured box alone. Beyond its edge the correction of the nearest place of the
box goes on unchanged, as in the tables of controls: it does not jump where a run-up leaves the box,
and claims nothing there.
"""

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

STEPS = 50
REACHED = 1e-12
"""m: two steps that differ by less are the same place."""


def held_errors(error_map: VolumetricMap, positions: Vector) -> Vector:
    """Return the errors at places, beyond the box those of the nearest place of it.

    Args:
        error_map: of the machine.
        positions: machine coordinates, m, shape (n, 3).

    Returns:
        m, shape (n, 3); NaN where the map has no error for a place of the box.
    """
    return error_map.errors(error_map.nearest(positions))


def target_for(error_map: VolumetricMap, wanted: Vector) -> Vector:
    """Return where to send the machine so that its tool comes to the wanted places.

    Args:
        error_map: of the machine.
        wanted: machine coordinates, m, shape (n, 3).

    Returns:
        m, shape (n, 3); NaN where the error is not known.

    Raises:
        ValueError: the errors change so fast with the position that no target can be found.
    """
    places = np.asarray(wanted, dtype=np.float64)
    target = places - held_errors(error_map, places)
    for _ in range(STEPS):
        further: Vector = places - held_errors(error_map, target)
        moved = np.abs(further - target)
        target = further
        if not np.any(moved > REACHED):
            return target
    raise Refusal(
        "no target can be found: the errors change faster with the position than any machine's",
        fault="failed",
    )


def place_of(error_map: VolumetricMap, target: Vector) -> Vector:
    """Return where the tool is when the machine has been sent to a target: q + e(q).

    Args:
        error_map: of the machine.
        target: machine coordinates, m, shape (n, 3).

    Returns:
        m, shape (n, 3); NaN where the error is not known.
    """
    sent = np.asarray(target, dtype=np.float64)
    place: Vector = sent + held_errors(error_map, sent)
    return place
