"""The error vectors of a result in the measured box, as far as they are known.

The error vector at q is where the tool is relative to the workpiece less q; it is zero at the
corner of the first nodes. It is computed as ``metrology.forward`` reads positions, so that what is
drawn and what was measured have the same signs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import nan

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, TRANSLATIONS, Vector
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy, of_result
from stepdiag_ros.metrology.volumetric_map import VolumetricMap
from stepdiag_ros.viewers.scene.shapes import spread

MOST_NODES = 60
"""Of an axis that are looked at for the largest error; of more, so many evenly spread ones."""


def error_vectors(result: VolumetricErrors, chain: str, positions: Vector) -> Vector:
    """Return the error vectors at places in the measured box, m, shape (n, 3).

    NaN where a curve that acts at the place is not determined there: a translation always acts, a
    rotation where an axis after it in the chain is away from the first corner. Rotations that the
    method does not estimate at all are left out (the caller says so); translations are not.

    Args:
        result: of a solver.
        chain: order of the axes from workpiece to tool; empty if it is not known, and then every
            place is unknown where the result has rotations.
        positions: machine coordinates, m, shape (n, 3).
    """
    turns = any(name in ROTATIONS for name in result.curves)
    missing = [name for name in TRANSLATIONS if name not in result.curves]
    if missing or (turns and not chain):
        return np.full(np.shape(positions), nan)
    return VolumetricMap.of_result(result, chain).errors(positions)


def axis_rotations(result: VolumetricErrors, axis: int) -> Vector:
    """Return the three rotations of an axis at its nodes, rad, shape (nodes, 3).

    Columns E_A, E_B, E_C; NaN where not determined or not estimated.
    """
    nodes = len(result.nodes[axis])
    names = [f"E_{letter}{AXES[axis]}" for letter in "ABC"]
    return np.column_stack([result.curves.get(name, np.full(nodes, nan)) for name in names])


@dataclass(frozen=True)
class Extremes:
    """How large the errors of a result are, over the nodes of the box.

    Attributes:
        accuracy: the longest error vector, with the place, the rms and what is known of its
            uncertainty.
        every: 1 if every node was looked at; 2: every second one of an axis, and so on.
    """

    accuracy: VolumetricAccuracy
    every: int


def extremes(result: VolumetricErrors, chain: str) -> Extremes:
    """Return how large the errors of a result are.

    A box of very many nodes is looked at in some of them only, so that it takes no time.

    Args:
        result: of a solver.
        chain: order of the axes from workpiece to tool; empty if it is not known.
    """
    if not chain and any(name in ROTATIONS for name in result.curves):
        unknown = VolumetricAccuracy(
            nan,
            (nan, nan, nan),
            (nan, nan, nan),
            frame=result.frame,
            remarks=("unknown, because the order of the machine's axes is not known",),
        )
        return Extremes(unknown, 1)
    every = max(-(-len(nodes) // MOST_NODES) for nodes in result.nodes)
    if every == 1:
        return Extremes(of_result(result, chain), 1)
    picked = [spread(len(nodes), MOST_NODES) for nodes in result.nodes]
    x, y, z = (nodes[pick] for nodes, pick in zip(result.nodes, picked, strict=True))

    def thin(curves: Mapping[str, Vector]) -> dict[str, Vector]:
        return {name: curve[picked[AXES.index(name[3])]] for name, curve in curves.items()}

    thinned = replace(
        result,
        nodes=(x, y, z),
        curves=thin(result.curves),
        standard_uncertainty=thin(result.standard_uncertainty),
        covariance=np.empty((0, 0)),
    )
    return Extremes(of_result(thinned, chain), every)
