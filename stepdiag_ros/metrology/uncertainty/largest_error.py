"""The uncertainty of the largest error in the volume, source by source.

Its length is to first order a sum of values of curves at one place, with factors w. A source acts
on it by w·F, F what it does to the curves with all correlations, so that contributions of curves
cancel in part or add. Rotations that the method leaves out act twice: by the readings on the
curves, and by their levers on the tool itself, which the error map does not contain.

That the largest error may be at another place, or point another way, is in no such sum. It is a
contribution of its own (``longest_vector``).
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, Vector, moving_axis
from stepdiag_ros.metrology.plausible import ORDINARY, Plausible, modes
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy
from stepdiag_ros.metrology.uncertainty.budget import (
    Budget,
    coverage_factor,
    effective_degrees_of_freedom,
)
from stepdiag_ros.metrology.uncertainty.coverage import Expanded
from stepdiag_ros.metrology.uncertainty.longest_vector import spread_of_longest
from stepdiag_ros.metrology.uncertainty.source import ANGULAR, Source
from stepdiag_ros.metrology.volumetric_map import VolumetricMap


@dataclass(frozen=True)
class LargestErrorBudget:
    """The budget of the length of the largest error vector.

    Attributes:
        value: its length, m.
        scale: factor by which the sources do more at the place found than the covariance of the map
            states; at least 1.
        elsewhere: standard uncertainty beside the sources, because the largest error may be at
            another place or point another way, m; NaN where the covariance is not known.
        contributions: standard uncertainty by each source of the budget alone, m, shape (s,); NaN
            where the source is not known and acts; 0 where it does not act.
        degrees_of_freedom: effective, by Welch and Satterthwaite (GUM G.4.1).
        coverage_factor: by Student's t of these.
    """

    value: float
    scale: float
    elsewhere: float
    contributions: Vector
    degrees_of_freedom: float
    coverage_factor: float

    @property
    def standard_uncertainty(self) -> float:
        """Return the combined standard uncertainty of all that is known, m."""
        return float(np.sqrt(np.nansum([*self.contributions**2, self.elsewhere**2])))

    @property
    def expanded(self) -> Expanded:
        """Return the expanded uncertainty, m."""
        return Expanded(self.coverage_factor * self.standard_uncertainty, self.coverage_factor)

    @property
    def at_least(self) -> bool:
        """Say whether a source that acts is not known: U is then a lower bound."""
        return bool(np.any(np.isnan(self.contributions)))


def budget_of_largest_error(
    result: VolumetricErrors,
    found: VolumetricAccuracy,
    budget: Budget,
    chain: str,
    plausible: Plausible = ORDINARY,
) -> LargestErrorBudget:
    """Return what each source of a budget does to the length of the largest error vector.

    Args:
        result: of the method that the budget is of.
        found: its largest error vector, which is determined and not zero.
        budget: of the method.
        chain: order of the axes from workpiece to tool; empty if not known.
        plausible: size of rotations that the result does not determine.
    """
    along = np.asarray(found.vector) / found.value
    place = np.asarray(found.position)[None, :]
    error_map = VolumetricMap.of_result(result, chain, plausible)
    by_curves = _of_quantities(along @ error_map.sensitivities(place)[0][0], error_map, budget)
    levers = along @ error_map.rotation_weights(place)[0] if chain else np.zeros(0)
    names = [quantity.name for quantity in budget.sensitivity.quantities]
    known = np.array([source.known for source in budget.sources])
    turning = iter(AXES)
    sizes = np.zeros(len(known))
    for number, source in enumerate(budget.sources):
        effect = by_curves @ source.errors(budget.sensitivity.matrix, names)
        if source.group == ANGULAR:
            # Each axis has one such source.
            axis = next(turning)
            if chain and source.known:
                effect = effect - levers @ _turned(source, axis, error_map)
        sizes[number] = np.linalg.norm(effect)
    unknown = np.any(np.isnan(budget.contributions[:, by_curves != 0.0]), axis=1)
    contributions = np.where(known, sizes, np.where(unknown, np.nan, 0.0))
    freedom = effective_degrees_of_freedom(
        contributions[:, None], np.array([source.degrees_of_freedom for source in budget.sources])
    )
    factor = coverage_factor(freedom, budget.coverage)
    # Where the sources do more here than the covariance of the map states, they do so everywhere.
    of_sources = float(np.sqrt(np.nansum(contributions**2)))
    scale = max(of_sources / found.at_the_place, 1.0) if found.at_the_place > 0.0 else 1.0
    whole = spread_of_longest(error_map, found.value, place[0], scale)
    elsewhere = float(np.sqrt(np.maximum(whole**2 - of_sources**2, 0.0)))
    return LargestErrorBudget(
        found.value, scale, elsewhere, contributions, float(freedom[0]), float(factor[0])
    )


def _of_quantities(weights: Vector, error_map: VolumetricMap, budget: Budget) -> Vector:
    """Return weights of curve values, stacked as in a map, as weights of a budget's quantities.

    The budget does not contain what the frame fixes, because that has no uncertainty.
    """
    places = [
        (name, node) for name, curve in error_map.curves.items() for node in range(len(curve))
    ]
    at = dict(zip(places, weights, strict=True))
    return np.array([at.get((one.curve, one.node), 0.0) for one in budget.sensitivity.quantities])


def _turned(source: Source, axis: str, error_map: VolumetricMap) -> Vector:
    """Return what a source makes of the rotations of its axis that the map leaves out, rad.

    Returns:
        values of all nine rotations at the nodes, for one standard uncertainty of each component of
        the source, shape (9(N+1), components).
    """
    parts = []
    for name in ROTATIONS:
        nodes = error_map.nodes[moving_axis(name)]
        part = np.zeros((len(nodes), source.slopes.shape[0]))
        if name[3] == axis and name in error_map.left_out:
            count = source.slopes.shape[0] // 3
            first = "ABC".index(name[2]) * count
            share = (nodes - nodes[0]) / (nodes[-1] - nodes[0])
            part[:, first : first + count] = source.standard_uncertainty * modes(share, count)
        parts.append(part)
    return np.concatenate(parts)
