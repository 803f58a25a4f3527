"""What each reading does to each quantity of a result: one matrix, for any method.

The curves' derivatives come from the method itself (a matrix, or central differences through its
exact model at the solution). The figures (squareness, positioning, straightness, diagonals) are
linear in the curves, but for the two nodes between which a straightness is taken; their weights
are those of ``summary.functionals``, so that every figure is defined in one place.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import ROTATIONS, Vector, moving_axis
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.monte_carlo import Estimator, estimator
from stepdiag_ros.metrology.solvers.observations import Observations, observe
from stepdiag_ros.metrology.solvers.summary import (
    CurveEstimate,
    common_figures,
    deviations_from_line,
    functionals,
)


@dataclass(frozen=True)
class ResultQuantity:
    """One number of a result.

    Attributes:
        name: a figure's, or ``E_YX at 3``: the curve's value at its node 3, counted from 0.
        unit: ``m`` or ``rad``.
        curve: ISO 230-1 name of the curve, for values at nodes; empty for figures.
        node: of the curve; -1 for figures.
    """

    name: str
    unit: str
    curve: str = ""
    node: int = -1


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the quantities of a result by the readings.

    Attributes:
        method: name of the method.
        observations: the readings.
        quantities: all that is determined: curve values but those that the frame fixes, figures.
        values: of the quantities, in m and rad, shape (q,).
        matrix: shape (q, n), m/m and rad/m.
        weights: of the curve values in each quantity, shape (q, k).
        estimator: the method, ready for other readings.
        by_direct: change of the quantities by one standard uncertainty of each row of what was
            measured directly, m and rad, shape (q, rows).
    """

    method: str
    observations: Observations
    quantities: tuple[ResultQuantity, ...]
    values: Vector
    matrix: Vector
    weights: Vector
    estimator: Estimator
    by_direct: Vector = field(default_factory=lambda: np.zeros((0, 0)))

    def of_curves(self, curves: Vector) -> Vector:
        """Return the quantities of many sets of curves, by their definitions, shape (count, q).

        A straightness is the largest minus the smallest deviation of each set, wherever they are.

        Args:
            curves: stacked, m and rad, shape (count, k); NaN where not determined.
        """
        values: Vector = np.nan_to_num(curves) @ self.weights.T
        size = self.observations.volume.blocks + 1
        for row, quantity in enumerate(self.quantities):
            kind, _, curve = quantity.name.partition(" ")
            if kind not in ("straightness", "angular"):
                continue
            place = self.estimator.names.index(curve) * size
            shape = curves[:, place : place + size]
            if kind == "straightness":
                nodes = self.observations.volume.nodes(moving_axis(curve))
                shape = np.nan_to_num(shape) @ deviations_from_line(nodes).T
            values[:, row] = np.max(shape, axis=1) - np.min(shape, axis=1)
        return values


def sensitivity(measurement: Measurement, method: str = "least_squares") -> Sensitivity:
    """Return what each reading does to each quantity that a method determines.

    Args:
        measurement: the finished lines.
        method: one of ``monte_carlo.replicable``.

    Raises:
        NotDeterminable: the lines are not enough for this method.
        ValueError: no such method, or the lines contradict the volume or each other.
    """
    observations = observe(measurement)
    ready = estimator(measurement, observations, method)
    stacked = ready.solution()
    known = np.isfinite(stacked)
    by_reading = np.nan_to_num(ready.jacobian())
    quantities, rows = _nodes(ready, known, by_reading)
    # A figure of a line belongs to a result that uses its readings.
    used = np.unique(observations.setup[np.any(by_reading != 0.0, axis=0)])
    lines = [observations.setups[number].line for number in used]
    figures, figure_rows, figure_values = _figures(ready, stacked, known, lines, measurement.chain)
    weights = np.concatenate([rows, figure_rows])
    return Sensitivity(
        method=method,
        observations=observations,
        quantities=(*quantities, *figures),
        values=np.concatenate([rows @ np.nan_to_num(stacked), figure_values]),
        matrix=weights @ by_reading,
        weights=weights,
        estimator=ready,
        by_direct=weights @ np.nan_to_num(ready.by_direct()),
    )


def _nodes(
    ready: Estimator, known: NDArray[np.bool_], by_reading: Vector
) -> tuple[list[ResultQuantity], Vector]:
    """Return the curve values that are determined and not fixed by the frame."""
    size = ready.observations.volume.blocks + 1
    count = len(ready.names) * size
    moved = np.linalg.norm(by_reading[:count], axis=1)
    wanted = np.flatnonzero(known[:count] & (moved > 1e-9 * np.max(moved)))
    quantities = []
    for place in wanted:
        curve, node = ready.names[place // size], int(place % size)
        unit = "rad" if curve in ROTATIONS else "m"
        quantities.append(ResultQuantity(f"{curve} at {node}", unit, curve, node))
    rows = np.zeros((len(wanted), len(known)))
    rows[np.arange(len(wanted)), wanted] = 1.0
    return quantities, rows


def _figures(
    ready: Estimator, stacked: Vector, known: NDArray[np.bool_], lines: list[str], chain: str
) -> tuple[list[ResultQuantity], Vector, Vector]:
    """Return the figures that need determined curve values only, and their weights."""
    volume = ready.observations.volume
    values = np.nan_to_num(stacked)
    unseen = np.eye(len(values))[:, ~known]

    estimate = CurveEstimate(
        values, np.zeros((len(values), len(values))), unseen, (*ready.names, *ready.beside)
    )
    made = common_figures(volume, estimate, lines, chain, ready.names)
    start = np.array([figure.value for figure in made])
    wanted = np.flatnonzero(np.isfinite(start))
    every = functionals(volume, estimate, lines, chain, ready.names)
    rows = np.array([every[row].weights * known for row in wanted])
    quantities = [ResultQuantity(made[row].name, made[row].unit) for row in wanted]
    return quantities, rows, start[wanted]
