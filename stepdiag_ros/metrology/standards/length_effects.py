"""What acts on the lengths of diagonals beside positioning, squareness and the noise of readings.

RL says that squareness from diagonals assumes that nothing else differs between them. Two things
do. The axes turn: a rotation ε_i moves the tool by ε_i × L_i with the lever L_i of the axes after
i in the chain (``metrology.forward``), and at the far ends of diagonals other rotations act on
other levers, so that opposite faces of the box have other squarenesses. And the laser's scale
shifts from one setup to the next, as the air on the beam is not that at the sensor: RL's graph has
1 ppm for 1 µrad. Neither can be determined from the lengths; both are in the uncertainty, as large
as is plausible.
"""

from collections.abc import Sequence

import numpy as np

from stepdiag_ros.metrology.forward import levers
from stepdiag_ros.metrology.geometry import CHAINS, Vector
from stepdiag_ros.metrology.plausible import Plausible


def added_variances(
    weights: Vector,
    ends: Sequence[tuple[Vector, Vector]],
    lengths: Vector,
    chain: str,
    plausible: Plausible,
) -> Vector:
    """Return what rotations and air add to the variances of quantities that are sums of lengths.

    Args:
        weights: of each length in each quantity, shape (q, d).
        ends: start and finish of each length, m.
        lengths: nominal, m, shape (d,).
        chain: order of the axes from workpiece to tool; empty if not known: then that chain counts
            in which the rotations do most.
        plausible: sizes of both.

    Returns:
        in the quantities' units squared, shape (q,).
    """
    chains = (chain,) if chain else CHAINS
    by_rotation = [weights @ rotation_effects(ends, one) for one in chains]
    rotations = np.max([np.sum(one**2, axis=1) for one in by_rotation], axis=0)
    made: Vector = (
        plausible.rotation**2 * rotations
        + plausible.shift**2 * np.sum((weights * lengths) ** 2, axis=1)
        + plausible.scale**2 * (weights @ lengths) ** 2
    )
    return made


def remark(chain: str, plausible: Plausible) -> str:
    """Say what the uncertainties contain."""
    which = (
        f"of the chain {chain}"
        if chain
        else "of the chain in which they do most (the machine's is not known)"
    )
    return (
        f"the uncertainties contain what axes {which} do that turn by"
        f" {plausible.rotation * 1e6:.3g} µrad over the travel (plausible, not measured), and a"
        f" scale of the laser that shifts by {plausible.shift * 1e6:.2g} ppm between setups"
    )


def rotation_effects(ends: Sequence[tuple[Vector, Vector]], chain: str) -> Vector:
    """Return what each rotation at the end of its travel adds to lengths, m/rad, shape (d, 9).

    A rotation is zero where its axis stands at the lowest of all ends, and one unit at the highest.

    Args:
        ends: start and finish of each length, m.
        chain: order of the axes from workpiece to tool.
    """
    starts, finishes = (np.array([pair[number] for pair in ends]) for number in (0, 1))
    low = np.min([starts, finishes], axis=(0, 1))
    travel = np.max([starts, finishes], axis=(0, 1)) - low
    way = finishes - starts
    length = np.linalg.norm(way, axis=1)
    beam = way / length[:, None]
    effect = np.zeros((len(ends), 3, 3))
    for sense, places in ((1.0, finishes - low), (-1.0, starts - low)):
        share = places / np.where(travel > 0.0, travel, 1.0)
        for axis, arms in enumerate(levers(places, chain)):
            effect[:, axis] += sense * share[:, axis, None] * np.cross(arms, beam)
    made: Vector = effect.reshape(len(ends), 9)
    return made
