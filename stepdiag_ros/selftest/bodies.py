"""A machine as rigid bodies, composed with 4×4 matrices; laser and mirror in front of it.

Every axis is a joint: the pose of its tool side seen from its workpiece side is the commanded
displacement and three small translations, then three small rotations (ISO 230-1: motion of the tool
relative to the workpiece). Joints are multiplied in the order of the chain. The reading is the
length at which the beam's line meets the mirror's plane.
"""

from collections.abc import Mapping

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, Vector


def rotation(angles: Vector) -> Vector:
    """Return the rotation matrix of a rotation vector (E_A, E_B, E_C), rad, shape (3, 3).

    By the power series of the matrix exponential; for angles below 1e-3 rad six terms are
    exact in double precision.
    """
    a, b, c = angles
    generator = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
    term, turned = np.eye(3), np.eye(3)
    for power in range(1, 7):
        term = term @ generator / power
        turned = turned + term
    return np.asarray(turned, dtype=np.float64)


def joint(axis: int, position: float, errors: Vector) -> Vector:
    """Return the pose of an axis's tool side seen from its workpiece side, shape (4, 4).

    Args:
        axis: 0, 1, 2.
        position: commanded, m.
        errors: E_X, E_Y, E_Z (m), E_A, E_B, E_C (rad) there, shape (6,).
    """
    pose = np.eye(4)
    pose[:3, :3] = rotation(errors[3:])
    pose[:3, 3] = errors[:3]
    pose[axis, 3] += position
    return pose


def mirror_pose(
    chain: str, position: Vector, errors: Mapping[str, Vector], offset: Vector
) -> Vector:
    """Return the pose of the mirror seen from the workpiece, shape (4, 4).

    Args:
        chain: axes from workpiece to tool.
        position: commanded X, Y, Z, m, shape (3,).
        errors: axis letter → its six errors at that position.
        offset: of the mirror in the tool's coordinates, m, shape (3,).
    """
    pose = np.eye(4)
    for letter in chain:
        axis = AXES.index(letter)
        pose = pose @ joint(axis, float(position[axis]), errors[letter])
    mirror = np.eye(4)
    mirror[:3, 3] = offset
    return np.asarray(pose @ mirror, dtype=np.float64)


def beam_length(pose: Vector, beam: Vector, normal: Vector, laser: Vector) -> float:
    """Return the length of the beam from the laser to the mirror's plane, m.

    The point laser + s·beam lies in the plane through the mirror's point p across its turned
    normal: laser + s·beam = p + u·a + v·b, three equations for s, u, v.

    Args:
        pose: of the mirror, shape (4, 4).
        beam: unit vector away from the laser, shape (3,).
        normal: unit normal of the mirror in the tool's coordinates, shape (3,).
        laser: where the beam starts, m, shape (3,).
    """
    turned = pose[:3, :3] @ normal
    least = np.eye(3)[int(np.argmin(np.abs(turned)))]
    one = np.cross(turned, least)
    other = np.cross(turned, one)
    system = np.column_stack([beam, -one, -other])
    return float(np.linalg.solve(system, pose[:3, 3] - laser)[0])
