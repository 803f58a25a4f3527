"""Alternative formulation of the step diagonal test (Ibaraki & Hata 2010, eqs. 20-22)."""

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, TRANSLATIONS, Vector, beam_direction, line_signs
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.linear import (
    DIAGONALS,
    LinearMap,
    accumulate,
    apply,
    remarks_on_unused,
)
from stepdiag_ros.metrology.solvers.method import Method
from stepdiag_ros.metrology.solvers.monte_carlo import linear
from stepdiag_ros.metrology.solvers.observations import (
    ALL_READINGS,
    Observations,
    block_means,
    observe,
)
from stepdiag_ros.metrology.solvers.result import VolumetricErrors

UNKNOWNS = ((1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2))
"""Error direction and moving axis of the six unknowns of IH eq. (20), in its order."""
SINGLE_ROWS = (("pnp", 0), ("ppp", 1), ("ppp", 2))
"""Line and moving axis of the last three rows of IH eq. (20): x of pnp, y of ppp, z of ppp."""
_ZERO_ON_AVERAGE = (0, 1, 5)
"""Unknowns whose mean over the travel the frame makes zero (IH eq. 17): E_YX, E_ZX, E_YZ."""


def solve_alternative(measurement: Measurement) -> VolumetricErrors:
    """Solve IH eqs. (20)-(22), also KIMM eq. (1), with their right sides corrected.

    Both documents print the right side of a single move as R_x - a_x - Δe_x(x(k)). The reading is a
    length along the beam (eq. 1), so the known part must be projected on it: R_x - l_x(a_x +
    Δe_x(x(k))), and in a summed row Σ_i (R_i - |l_i|(a_i + Δe_i(i(k)))). KIMM's eq. (1) names every
    R ``ppp``; its rows are those of IH: the sums of ppp, npp and pnp, then x of pnp, y of ppp and z
    of ppp.

    The sum of a block's three moves is free of setup errors (eq. 5). The three constants δR of the
    single moves follow from the frame (eqs. 17, 22) and are the figures ``delta x pnp``, ``delta y
    ppp``, ``delta z ppp`` (m per block).

    It is the same as the setup-robust formulation wherever the readings agree with the model: all
    values to rounding, for any errors, setups and steps. Readings have noise, and then the twelve
    displacements of a block disagree: this formulation uses other combinations of them than section
    3.2 does. With the residuals of eq. (16),

        r_x(k) = R_x,ppp(k) + R_x,npp(N-k+1) - 2 l_x (a_x + Δe_x(x(k))) - λ_xx,

    r_y and r_z in the same way from λ_yy and λ_zz, and g_i = ‖a‖/(2a_i), it gives beyond section
    3.2

        Δe_y(x): 0                      Δe_z(x): g_z r_x
        Δe_x(y): -g_x (r_x + r_y + r_z)   Δe_z(y): g_z (r_x + 2 r_y + r_z)
        Δe_x(z): g_x (r_y + r_z)         Δe_y(z): -g_y r_y

    Each r has the mean 0 over k, so the last node of every curve is the same to rounding on any
    readings, and so is all of E_YX. The least-squares method weighs all displacements.

    Raises:
        NotDeterminable: one of ppp, npp, pnp, x, y, z is missing or has a move that was never
            measured.
        ValueError: the lines contradict the volume.
    """
    observations = observe(measurement)
    return apply(
        "alternative",
        measurement,
        observations,
        alternative_map,
        (*DIAGONALS, "x", "y", "z"),
        remarks_on_unused("alternative", observations),
    )


def alternative_map(observations: Observations, readings: slice = ALL_READINGS) -> LinearMap:
    """Return the formulation as a matrix on the readings' excess over a perfect machine and setup.

    Raises:
        NotDeterminable: as ``solve_alternative``.
    """
    step = np.asarray(observations.volume.step)
    displacement = block_means(observations, DIAGONALS, readings).weights
    linear = block_means(observations, ("x", "y", "z"), readings).weights
    straight = np.stack([linear[axis, axis] for axis in range(3)])
    cosine = step / np.linalg.norm(step)

    # What is left of each move when the known positioning error is taken out of it.
    beyond = displacement - cosine[None, :, None, None] * straight[None]
    right = np.stack(
        [
            *np.sum(beyond, axis=1),
            *(beyond[DIAGONALS.index(line), axis] for line, axis in SINGLE_ROWS),
        ]
    )
    inverse = np.linalg.inv(matrix_of_eq_20(step))
    unknown = np.tensordot(inverse, right, axes=1)
    # Rows 4 to 6 hold one constant setup error each; the frame tells them (eq. 22).
    effect = inverse[:, 3:]
    constants = np.linalg.solve(
        effect[_ZERO_ON_AVERAGE, :], np.mean(unknown[_ZERO_ON_AVERAGE, :], axis=1)
    )
    unknown = unknown - np.tensordot(effect, constants, axes=1)[:, None]

    increments = np.empty((3, 3, *straight[0].shape))
    for axis in range(3):
        increments[axis, axis] = straight[axis]
    for row, (error, axis) in enumerate(UNKNOWNS):
        increments[axis, error] = unknown[row]
    curves = accumulate(increments)
    for row in _ZERO_ON_AVERAGE:
        error, axis = UNKNOWNS[row]
        # Fixed by the frame; rounding would look like an uncertainty of its own.
        curves.reshape(3, 3, -1, curves.shape[1])[axis, error, -1] = 0.0
    return LinearMap(
        curves,
        constants,
        tuple(f"delta {AXES[axis].lower()} {line}" for line, axis in SINGLE_ROWS),
    )


def matrix_of_eq_20(step: Vector) -> Vector:
    """Return the matrix of IH eq. (20) for any steps, shape (6, 6).

    The coefficient of Δe_j as axis i moves on a line is the beam's component l_j, with the sense in
    which the axis runs on that line.

    Args:
        step: size of one block along X, Y, Z in m, shape (3,).
    """
    matrix = np.zeros((6, 6))
    for column, (error, axis) in enumerate(UNKNOWNS):
        for row, line in enumerate(DIAGONALS):
            matrix[row, column] = line_signs(line)[axis] * beam_direction(line, step)[error]
        for row, (line, moving) in enumerate(SINGLE_ROWS, start=3):
            if moving == axis:
                matrix[row, column] = line_signs(line)[axis] * beam_direction(line, step)[error]
    return matrix


METHOD = Method(
    name="alternative",
    title="Alternative (Ibaraki & Hata, KIMM)",
    summary="nine curves; sums of a block's moves cancel the errors of the setups",
    needs="three step diagonals and three linear lines",
    source="IH eqs. 20-22; KIMM eq. 1",
    solve=solve_alternative,
    order=30,
    reliance=3,
    curves=TRANSLATIONS,
    free_curves=len(TRANSLATIONS),
    estimator=linear(alternative_map),
)
