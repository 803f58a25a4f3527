"""Error curves of a machine from multilaterated points on a grid.

To first order the reflector's displacement at the machine coordinates q is

    e(q) = Σ_i t_i(q_i) + Σ_i ε_i(q_i) × (L_i(q) - L_i(q_0)) + shift + turn × (q - q̄)

with t_i, ε_i the errors of axis i at the reference point (``geometry.REFERENCE_POINT``), L_i(q) its
lever (``forward.levers``), q_0 the grid's first corner, and a rigid motion that takes the points'
frame to that of the results. A point has no direction, so an axis's rotations are seen only by what
moves after it in the chain: all three of the first axis, the two of the middle one that are square
to the last, and none of the last axis. These stay unknown; they need a second reflector at another
offset, or an angular measurement.
"""

import numpy as np

from stepdiag_ros.metrology.forward import levers
from stepdiag_ros.metrology.geometry import (
    AXES,
    CHAINS,
    CURVES,
    FRAME,
    ROTATIONS,
    TRANSLATIONS,
    Vector,
    moving_axis,
)
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors
from stepdiag_ros.metrology.solvers.summary import CurveEstimate, make_result
from stepdiag_ros.metrology.solvers.tracker_methods import MULTILATERATION
from stepdiag_ros.metrology.tracker.multilateration import Points, rigid_motions

_NEAR = 1e-6
_RANK = 1e-9
_ZERO_AT_THE_END = ("E_YX", "E_ZX", "E_YZ")
"""Their mean slopes are zero in the frame of the results."""


def grid_of(commanded: Vector) -> Volume:
    """Return the grid that points lie on.

    Args:
        commanded: places, m, shape (n, 3).

    Raises:
        NotDeterminable: they are on no grid with the same number of equal steps in X, Y and Z.
    """
    nodes = []
    for axis in range(3):
        found = np.unique(np.round(commanded[:, axis], 9))
        steps = np.diff(found)
        if len(found) < 2 or np.max(np.abs(steps - steps.mean())) > _NEAR:
            raise NotDeterminable(
                f"the points are on no grid: {AXES[axis]} needs two or more equally spaced places",
                fault="too_few",
                aspect="grid",
            )
        nodes.append(found)
    counts = {len(found) for found in nodes}
    if len(counts) > 1:
        raise NotDeterminable(
            "the points are on no grid with the same number of places along X, Y and Z:"
            f" {', '.join(str(len(found)) for found in nodes)}"
        )
    x, y, z = (float(found[0]) for found in nodes)
    step_x, step_y, step_z = (float(np.mean(np.diff(found))) for found in nodes)
    return Volume((x, y, z), (step_x, step_y, step_z), len(nodes[0]) - 1)


def displacement_design(commanded: Vector, volume: Volume, chain: str) -> Vector:
    """Return the derivatives of all displacements by the values of all eighteen curves.

    Args:
        commanded: places on the grid's nodes, m, shape (n, 3).
        volume: the grid.
        chain: order of the axes from workpiece to tool.

    Returns:
        shape (3n, 18 (N + 1)), curves stacked in the order of ``geometry.CURVES``.
    """
    size = volume.blocks + 1
    node = np.rint((commanded - np.asarray(volume.origin)) / np.asarray(volume.step)).astype(int)
    design = np.zeros((len(commanded), 3, len(CURVES), size))
    arms = levers(commanded - np.asarray(volume.origin), chain)
    every = np.arange(len(commanded))
    for index, name in enumerate(CURVES):
        axis, error = moving_axis(name), name[2]
        if name in TRANSLATIONS:
            design[every, AXES.index(error), index, node[:, axis]] = 1.0
        else:
            turned = np.cross(np.eye(3)["ABC".index(error)], arms[axis])
            design[every, :, index, node[:, axis]] = turned
    return design.reshape(3 * len(commanded), -1)


def error_curves(points: Points, chain: str) -> VolumetricErrors:
    """Return the error curves that multilaterated points determine; NaN elsewhere.

    Args:
        points: on a grid, not all nodes of which need be there.
        chain: order of the axes from workpiece to tool.

    Raises:
        NotDeterminable: the points are on no grid.
        ValueError: no such chain.
    """
    if chain not in CHAINS:
        raise ValueError(f"'{chain}' is not a kinematic chain; use one of {', '.join(CHAINS)}")
    volume = grid_of(points.commanded)
    size = volume.blocks + 1
    arm = float(np.max(np.asarray(volume.step)) * volume.blocks)
    scale = np.repeat([arm if name in ROTATIONS else 1.0 for name in CURVES], size)
    # Columns in metres: a rotation counts by what it does at the end of the longest side.
    design = displacement_design(points.commanded, volume, chain) / scale
    unknown = np.ones((len(CURVES), size), dtype=bool)
    unknown[:, 0] = False
    for name in _ZERO_AT_THE_END:
        unknown[CURVES.index(name), -1] = False
    free = unknown.ravel()
    whole = np.hstack([design[:, free], rigid_motions(points.commanded)])
    u, s, vt = np.linalg.svd(whole, full_matrices=True)
    rank = int(np.sum(s > _RANK * s[0]))
    inverse = (vt[:rank].T / s[:rank]) @ u[:, :rank].T
    count = int(np.sum(free))
    functionals = np.zeros((len(free), len(whole)))
    functionals[free] = inverse[:count]
    functionals /= scale[:, None]
    unseen = np.zeros((len(free), len(vt) - rank))
    unseen[free] = vt[rank:, :count].T
    displacement = points.displacement.ravel()
    estimate = CurveEstimate(
        values=functionals @ displacement,
        covariance=points.covariance_of(functionals),
        unseen=unseen,
        names=CURVES,
        arm=arm,
    )
    left = displacement - u[:, :rank] @ (u[:, :rank].T @ displacement)
    freedom = len(displacement) - rank
    remarks = [*points.remarks]
    if freedom:
        rms = float(np.sqrt(np.sum(left**2) / freedom))
        remarks.append(
            f"What a rigid-body machine does not explain of the points: {rms * 1e6:.3g} µm rms"
            f" ({freedom} degrees of freedom)."
        )
    known = estimate.curves_determined().reshape(len(CURVES), size)
    missing = [name for name, one in zip(CURVES, known, strict=True) if not np.all(one)]
    said = []
    if missing:
        said.append(
            f"{', '.join(missing)}: the points of one reflector do not determine all of it; a"
            " second reflector at another offset, or an angular measurement, would"
        )
    return make_result(
        MULTILATERATION.name,
        volume,
        estimate,
        (),
        len(points.stations),
        (),
        chi_squared=points.chi_squared,
        degrees_of_freedom=points.degrees_of_freedom,
        not_determined=said,
        remarks=remarks,
        frame=FRAME,
        chain=chain,
    )
