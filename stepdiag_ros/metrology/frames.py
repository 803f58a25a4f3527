"""The frames of a measurement and where they are; the table is in the package's description."""

from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.forward import perpendiculars
from stepdiag_ros.metrology.geometry import Vector, beam_direction
from stepdiag_ros.metrology.plan import FORWARD, Line, Volume

MACHINE = "machine"
WORKPIECE = "workpiece"
TOOL = "tool"
MIRROR = "mirror"
LASER = "laser"
FRAMES = (MACHINE, WORKPIECE, TOOL, MIRROR, LASER)

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
NO_TURN: Quaternion = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Placement:
    """Where a frame is in its parent.

    Attributes:
        parent: name of the frame in which the rest is given.
        child: name of the frame.
        translation: of the child's origin, m.
        rotation: that turns the parent's axes into the child's: unit quaternion x, y, z, w.
    """

    parent: str
    child: str
    translation: Triple
    rotation: Quaternion = NO_TURN


def triple(values: Vector) -> Triple:
    """Return three numbers of an array as plain ones."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def beam_axes(direction: Vector) -> Vector:
    """Return the axes of a frame that looks along a beam, as columns, shape (3, 3).

    x is the beam, y is horizontal (along +Y for a beam along ±Z), z completes the right-handed
    frame.

    Args:
        direction: unit vector of the beam, shape (3,).
    """
    first, second = perpendiculars(direction)
    axes: Vector = np.column_stack([direction, first, second])
    return axes


def quaternion_of(axes: Vector) -> Quaternion:
    """Return the unit quaternion x, y, z, w (w >= 0) of a rotation.

    Args:
        axes: rotation matrix, its columns the turned axes, shape (3, 3).
    """
    # The symmetric matrix whose eigenvector to the eigenvalue 3 is the quaternion: no case is
    # singular (Bar-Itzhack, J. Guidance 23 (2000) 1085).
    r = np.asarray(axes, dtype=np.float64)
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0.0, 0.0, 0.0],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0.0, 0.0],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0.0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
        ]
    )
    vector = np.linalg.eigh(k, UPLO="L")[1][:, -1]
    x, y, z, w = (float(part) for part in (vector if vector[3] >= 0 else -vector))
    return x, y, z, w


def first_stop(line: Line, volume: Volume) -> Vector:
    """Return the stop next to the laser, m, shape (3,): the first of the forward pass."""
    stop: Vector = replace(line, direction=FORWARD).stops(volume)[0]
    return stop


def workpiece_placement(volume: Volume) -> Placement:
    """Return where the workpiece is: the first corner of the measured box."""
    return Placement(MACHINE, WORKPIECE, volume.origin)


def setup_placements(
    line: Line, volume: Volume, laser_distance: float, mirror_offset: Triple
) -> tuple[Placement, Placement]:
    """Return where laser and mirror are nominally for a line.

    Args:
        line: that is measured; the beam goes along its forward direction in both passes.
        volume: the measured box.
        laser_distance: from the laser's reference to the mirror at the first stop, m.
        mirror_offset: of the mirror's usual place from the tool point, m, X Y Z.
    """
    if line.tracked is None:
        beam = beam_direction(line.name, np.asarray(volume.step))
    else:
        way = first_stop(line, volume) - np.asarray(line.tracked.station)
        laser_distance = float(np.linalg.norm(way))
        beam = way / laser_distance
    rotation = quaternion_of(beam_axes(beam))
    on_tool = mirror_on_tool(line, mirror_offset)
    mirror = first_stop(line, volume) + np.asarray(on_tool)
    return (
        Placement(MACHINE, LASER, triple(mirror - laser_distance * beam), rotation),
        Placement(TOOL, MIRROR, on_tool, rotation),
    )


def mirror_on_tool(line: Line, usual: Triple) -> Triple:
    """Return where the mirror is on a line, from the tool point, m; ``usual``: on most lines."""
    return triple(np.asarray(usual) + np.asarray(line.mirror_offset))


def tool_placement(position: Triple) -> Placement:
    """Return where the tool is, from the actual axis positions, m."""
    return Placement(MACHINE, TOOL, position)


def beam_length(laser: Placement, position: Triple, mirror_offset: Triple) -> float:
    """Return the nominal way along the beam from the laser to the mirror's plane, m.

    Args:
        laser: from ``setup_placements``.
        position: of the tool, m.
        mirror_offset: of the mirror from the tool point, m.
    """
    x, y, z, w = laser.rotation
    along = np.array([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)])
    mirror = np.asarray(position) + np.asarray(mirror_offset)
    return float((mirror - np.asarray(laser.translation)) @ along)
