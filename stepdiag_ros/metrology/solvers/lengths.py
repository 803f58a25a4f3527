"""What a wrong scale of the laser does to a result: no reading shows it, every length has it."""

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.observations import Observations


def length_readings(observations: Observations, plausible: Plausible) -> Vector:
    """Return what one standard uncertainty of each scale adds to each reading, m, shape (n, q).

    The first column is the scale that all setups share, the others are those of the setups.
    """
    directions = np.array([setup.direction for setup in observations.setups])[observations.setup]
    nominal = np.sum(directions * observations.way, axis=1)
    each = observations.setup[:, None] == np.arange(len(observations.setups))
    columns = [np.full((len(nominal), 1), plausible.scale), plausible.shift * each]
    readings: Vector = nominal[:, None] * np.column_stack(columns)
    return readings


def by_lengths(design: Design, matrix: Vector, plausible: Plausible) -> Vector:
    """Return what each scale of ``length_readings`` does to the unknowns of a fit, shape (p, q).

    Args:
        design: of the fit.
        matrix: of the design.
        plausible: the scales.
    """
    rows = length_readings(design.observations, plausible)[design.first]
    change: Vector = design.covariance @ (matrix.T @ (rows * design.weight[:, None]))
    return change
