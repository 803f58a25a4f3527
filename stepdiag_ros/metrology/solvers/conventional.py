"""Conventional formulation of the step diagonal test (Ibaraki & Hata 2010, section 2, eqs. 1-3)."""

import numpy as np

from stepdiag_ros.metrology.geometry import TRANSLATIONS, Vector, beam_direction, line_signs
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

NOMINAL_BEAMS = (
    "that of the nominal beams, as Ibaraki & Hata 2010, eq. 2 leaves it; the slopes of E_YX, E_ZX "
    "and E_YZ hold setup errors and are not turned to zero"
)


def solve_conventional(measurement: Measurement) -> VolumetricErrors:
    """Solve IH eq. (2) block by block with the nominal beam directions of eq. (3).

    For each block and each moved axis j with step a_j, the unknown is the change Δε_j of the error
    vector, (3,). Diagonal d (ppp, npp, pnp), whose beam has the direction e_d and whose moves have
    the signs s_d, reads the displacement r_dj of its move of axis j. Its error is::

        s_dj (e_d · Δε_j) = r_dj - a_j s_dj e_dj        d = ppp, npp, pnp

    with e_d = (s_dx a_x, s_dy a_y, s_dz a_z) / ‖a‖: three equations for three unknowns. The curves
    are the sums of Δε_j over the blocks.

    It is right only if beam and mirror stand exactly as they should: an error of the setup goes
    into every curve multiplied by ‖a‖/(2a) (IH section 3.1). Kept because the field uses it, and to
    show what it does. The uncertainties contain the tilts that least squares finds in the same
    readings; where it finds none (three diagonals alone), they are unknown.

    Raises:
        NotDeterminable: one of ppp, npp, pnp is missing or has a move that was never measured.
        ValueError: the lines contradict the volume.
    """
    observations = observe(measurement)
    remarks = [
        "The conventional formulation takes laser and mirror as perfectly aligned; its "
        "uncertainties contain the tilts that least squares finds in the same readings."
    ]
    remarks.extend(remarks_on_unused("conventional", observations))
    if any(not setup.diagonal for setup in observations.setups):
        remarks.append("The conventional formulation does not use the linear lines.")
    return apply(
        "conventional",
        measurement,
        observations,
        conventional_map,
        DIAGONALS,
        remarks,
        frame=NOMINAL_BEAMS,
        aligned=True,
    )


def conventional_map(observations: Observations, readings: slice = ALL_READINGS) -> LinearMap:
    """Return the formulation as a matrix on the readings.

    Raises:
        NotDeterminable: as ``solve_conventional``.
    """
    step = np.asarray(observations.volume.step)
    displacement = block_means(observations, DIAGONALS, readings).weights
    increments = np.empty_like(displacement)
    for axis in range(3):
        matrix = np.array(
            [line_signs(line)[axis] * beam_direction(line, step) for line in DIAGONALS]
        )
        increments[axis] = _solve_first(matrix, displacement[:, axis])
    curves = accumulate(increments)
    return LinearMap(curves, np.zeros((0, curves.shape[1])), ())


def _solve_first(matrix: Vector, right: Vector) -> Vector:
    """Solve matrix @ x = right over the first index of a right side with more indices."""
    solved = np.linalg.solve(matrix, right.reshape(len(right), -1))
    return np.asarray(solved, dtype=np.float64).reshape(right.shape)


METHOD = Method(
    name="conventional",
    title="Conventional (Wang)",
    summary="nine curves; laser and mirror taken as perfectly aligned",
    needs="three step diagonals",
    source="IH eqs. 1-3",
    solve=solve_conventional,
    order=10,
    reliance=1,
    curves=TRANSLATIONS,
    free_curves=len(TRANSLATIONS),
    takes_setup_as_perfect=True,
    estimator=linear(conventional_map),
)
