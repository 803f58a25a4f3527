"""A machine as rigid bodies joined by slides, composed with 4×4 matrices in the shop's frame.

Written from the definitions, not from the package: every axis is a joint between two bodies, the
one nearer to the workpiece and the one nearer to the tool. ISO 230-1 counts an error as motion of
the tool side against the workpiece side; so a joint's matrix is the pose of the body on the tool
side seen from the body on the workpiece side. One body stands on the floor; what lies between it
and the workpiece carries the workpiece and really moves the other way.
"""

import numpy as np
from scipy.spatial.transform import Rotation

LETTERS = "XYZ"


def joint(axis, position, errors):
    """Return the 4×4 pose of the tool side of an axis, seen from its workpiece side.

    Args:
        axis: X, Y or Z.
        position: commanded, m.
        errors: E_X, E_Y, E_Z (m) and E_A, E_B, E_C (rad) there.
    """
    pose = np.eye(4)
    pose[:3, 3] = errors[:3]
    pose[LETTERS.index(axis), 3] += position
    pose[:3, :3] = Rotation.from_rotvec(errors[3:]).as_matrix()
    return pose


def tool_seen_from_workpiece(chain, floor, position, errors, offset=(0.0, 0.0, 0.0)):
    """Return the 4×4 pose of the tool seen from the workpiece.

    Args:
        chain: axes from workpiece to tool.
        floor: number of axes that carry the workpiece (0: it stands on the floor; 3: the tool
            does).
        position: commanded X, Y, Z.
        errors: {"X": six errors at that position, ...}.
        offset: of the mirror in the tool's coordinates.
    """
    in_shop_workpiece, in_shop_tool = np.eye(4), np.eye(4)
    for axis in reversed(chain[:floor]):
        # From the floor towards the workpiece each joint is gone through the other way round.
        step = joint(axis, position[LETTERS.index(axis)], errors[axis])
        in_shop_workpiece = in_shop_workpiece @ np.linalg.inv(step)
    for axis in chain[floor:]:
        in_shop_tool = in_shop_tool @ joint(axis, position[LETTERS.index(axis)], errors[axis])
    mirror = np.eye(4)
    mirror[:3, 3] = offset
    return np.linalg.inv(in_shop_workpiece) @ in_shop_tool @ mirror


def beam_length(pose, beam, normal, origin):
    """Return the length from the laser to the mirror's plane along the beam.

    The point of the beam, origin + s·beam, is a point of the plane, p + u·a + v·b with a, b across
    the turned normal: three equations for s, u, v.
    """
    turned = pose[:3, :3] @ normal
    across = np.linalg.svd(turned[None, :])[2][1:]
    system = np.column_stack([beam, -across[0], -across[1]])
    return np.linalg.solve(system, pose[:3, 3] - origin)[0]


def moved_by_msl(bridge, position, tip, t, r):
    """Return a CMM's probe position in the convention of MSL's error map, Measurement Standards NZ.

    Their carriages carry one another like ours, with small rotations as inverse frame turns:
    ``bridge`` 0 is y carrying x carrying z, 1 is x carrying y carrying z, on a fixed table. Names
    are moving axis first: t["yx"] is the error of axis y along x (our E_XY), r["yx"] its rotation
    about x (our E_AY).
    """
    frames, moves = {}, {}
    for i, axis in enumerate("xyz"):
        a, b, c = (r[axis + about] for about in "xyz")
        frames[axis] = np.linalg.inv(np.array([[1, c, -b], [-c, 1, a], [b, -a, 1]]))
        moves[axis] = np.array([t[axis + along] for along in "xyz"])
        moves[axis][i] += position[i]
    first, second = ("y", "x") if bridge == 0 else ("x", "y")
    return moves[first] + frames[first] @ (
        moves[second] + frames[second] @ (moves["z"] + frames["z"] @ np.asarray(tip))
    )
