"""How far the longest error vector in the volume may be from the longest one of an error map.

The length of an error vector is uncertain along the vector, to first order. Beyond that, an error
across the vector makes it longer, never shorter; and where lengths at many places are uncertain,
the longest is more likely at a place where the map errs upwards. Neither is in the law of
propagation. So errors of the map are drawn from its covariance, the same causes at all places
(JCGM 101:2008), and the longest vector is looked for in each draw.

Errors of the readings have lengthened the vectors of the map itself. As far as they explain its
curves, the true vectors may be shorter (``ranges.share_by_chance``).
"""

import numpy as np

from stepdiag_ros.metrology.geometry import Vector, places_of
from stepdiag_ros.metrology.solvers.ranges import draws, share_by_chance
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR, COVERAGE_PROBABILITY
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

_PLACES = 500
"""Nodes at which the longest vector of a draw is looked for, besides corners and that found."""


def spread_of_longest(
    error_map: VolumetricMap, length: float, place: Vector, scale: float = 1.0
) -> float:
    """Return the standard uncertainty of the longest error vector of a map, m.

    1.96 times it holds the true one in 95 of 100 cases, wherever that is.

    Args:
        error_map: determined at every node.
        length: of its longest error vector, m.
        place: machine coordinates of this vector, m, shape (3,).
        scale: factor by which errors are larger than the covariance of the map states.

    Returns:
        NaN where the covariance is not known.
    """
    corners = places_of([nodes[[0, -1]] for nodes in error_map.nodes])
    places = np.vstack([error_map.some_nodes(_PLACES), corners, place])
    factors = scale * error_map.factors_at(places)
    if not np.all(np.isfinite(factors)):
        return float("nan")
    causes = factors.shape[2]
    errors = factors.reshape(-1, causes) @ draws(causes).T
    drawn = error_map.errors(places)[:, :, None] + errors.reshape(*factors.shape[:2], -1)
    longest = np.sqrt(np.max(np.einsum("nik,nik->nk", drawn, drawn), axis=0))
    farthest = float(np.quantile(np.abs(longest - length), COVERAGE_PROBABILITY))
    values = np.concatenate(list(error_map.curves.values()))
    by_chance = share_by_chance(values, scale**2 * np.nan_to_num(error_map.covariance))
    return max(farthest, by_chance * length) / COVERAGE_FACTOR
