"""Setup-robust formulation of the step diagonal test (Ibaraki & Hata 2010, section 3.2)."""

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.linear import (
    DIAGONALS,
    LinearMap,
    accumulate,
    apply,
    remarks_on_unused,
)
from stepdiag_ros.metrology.solvers.observations import Observations, block_means, observe
from stepdiag_ros.metrology.solvers.result import VolumetricErrors

_X, _Y, _Z = range(3)
LAMBDAS = ("xx", "yx", "zx", "xy", "yy", "zy", "xz", "yz", "zz")
"""The nine λ of IH eq. (15) in the order of the result's figures."""


def solve_setup_robust(measurement: Measurement) -> VolumetricErrors:
    """Solve IH eqs. (6)-(19): the linear lines cancel the errors of the setups.

    Misalignment adds a constant to every block's displacement (eq. 4); the nine combinations λ of
    these constants (eq. 15) follow from the linear lines (16), the frame (17, 18) and the closure
    of a block (5, 19), the latter evaluated in the order xz, xy, zy. Exact to the first order of
    the misalignment. Unequal steps a_x, a_y, a_z are allowed. The result has the figures ``lambda
    xx`` … (m per block).

    Raises:
        NotDeterminable: one of ppp, npp, pnp, x, y, z is missing or has a move that was never
            measured.
        ValueError: the lines contradict the volume.
    """
    observations = observe(measurement)
    return apply(
        "setup_robust",
        measurement,
        observations,
        setup_robust_map(observations),
        (*DIAGONALS, "x", "y", "z"),
        remarks_on_unused("setup-robust", observations),
    )


def setup_robust_map(observations: Observations) -> LinearMap:
    """Return the formulation as a matrix on the readings.

    Every quantity below is a matrix with one column a reading, and stands for its excess over a
    perfect machine and setup: a_x in (6) and its like are gone with it, and so are the a_x in (16).

    Raises:
        NotDeterminable: as ``solve_setup_robust``.
    """
    step = np.asarray(observations.volume.step)
    # IH write ‖a‖/(2a_x) for the factor from a displacement along the beam to one along the axis.
    gain = np.linalg.norm(step) / (2.0 * step)
    ppp, npp, pnp = block_means(observations, DIAGONALS).weights
    linear = block_means(observations, ("x", "y", "z")).weights
    straight = [linear[axis, axis] for axis in range(3)]

    # The bracket { } of (6)-(14) without λ: error direction, then moving axis.
    bracket: dict[str, Vector] = {
        "xx": ppp[_X] + npp[_X],
        "yx": ppp[_X] - pnp[_X],
        "zx": pnp[_X] - npp[_X],
        "xy": ppp[_Y] - npp[_Y],
        "yy": ppp[_Y] + pnp[_Y],
        "zy": npp[_Y] - pnp[_Y],
        "xz": ppp[_Z] - npp[_Z],
        "yz": ppp[_Z] - pnp[_Z],
        "zz": npp[_Z] + pnp[_Z],
    }

    def mean(values: Vector) -> Vector:
        averaged: Vector = np.mean(values, axis=0)
        return averaged

    lambdas: dict[str, Vector] = {}
    for axis, name in enumerate(("xx", "yy", "zz")):
        lambdas[name] = mean(bracket[name] - straight[axis] / gain[axis])  # (16)
    for name in ("yx", "zx", "yz"):
        lambdas[name] = mean(bracket[name])  # (18) with (17)
    lambdas["xz"] = -lambdas["zx"] - lambdas["xx"] - lambdas["yy"] - lambdas["zz"]  # (19)
    lambdas["xy"] = -lambdas["yx"] - lambdas["zx"] - lambdas["xz"]
    lambdas["zy"] = -lambdas["yx"] - lambdas["yz"] - lambdas["xy"]

    increments = np.empty((3, 3, *straight[0].shape))
    for axis, moving in enumerate("xyz"):
        for error, letter in enumerate("xyz"):
            name = letter + moving
            increments[axis, error] = (
                straight[axis]
                if axis == error
                else gain[error] * (bracket[name] - lambdas[name])  # (7)-(9), (11)-(13)
            )
    return LinearMap(
        accumulate(increments),
        np.array([lambdas[name] for name in LAMBDAS]),
        tuple(f"lambda {name}" for name in LAMBDAS),
    )
