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
        error_map: of which the vector is the longest.
        length: of the vector, m.
        place: machine coordinates of the vector, m, shape (3,).
        scale: factor by which errors are larger than the covariance of the map states.

    Returns:
        NaN where the covariance is not known.
    """
    places = np.vstack([_places(error_map), place])
    longest = _longest(error_map.errors(places), scale * error_map.factors_at(places))
    values = np.concatenate(list(error_map.curves.values()))
    covariance = scale**2 * np.nan_to_num(error_map.covariance)
    if not np.all(np.isfinite(longest)) or covariance.shape != (values.size, values.size):
        return float("nan")
    farthest = float(np.quantile(np.abs(longest - length), COVERAGE_PROBABILITY))
    return max(farthest, share_by_chance(values, covariance) * length) / COVERAGE_FACTOR


def spread_after_correction(error_map: VolumetricMap) -> float:
    """Return the standard uncertainty of what is left where all errors of a map are corrected, m.

    In 95 of 100 cases the longest error vector is at most 1.96 times as long, wherever it is.

    Returns:
        NaN where the covariance is not known.
    """
    factors = error_map.factors_at(_places(error_map))
    longest = _longest(np.zeros(factors.shape[:2]), factors)
    return float(np.quantile(longest, COVERAGE_PROBABILITY)) / COVERAGE_FACTOR


def _places(error_map: VolumetricMap) -> Vector:
    corners = places_of([nodes[[0, -1]] for nodes in error_map.nodes])
    return np.vstack([error_map.some_nodes(_PLACES), corners])


def _longest(vectors: Vector, factors: Vector) -> Vector:
    """Return the length of the longest vector of each draw, m; NaN where none is known.

    Args:
        vectors: of the map at places, m, shape (n, 3).
        factors: what causes of standard deviation 1 do to the vectors, m, shape (n, 3, causes).
    """
    known = np.all(np.isfinite(factors), axis=(1, 2)) & np.all(np.isfinite(vectors), axis=1)
    if not np.any(known):
        return np.array([np.nan])
    count, _, causes = factors[known].shape
    errors = factors[known].reshape(-1, causes) @ draws(causes).T
    drawn = vectors[known][:, :, None] + errors.reshape(count, 3, -1)
    longest: Vector = np.sqrt(np.max(np.einsum("nik,nik->nk", drawn, drawn), axis=0))
    return longest
