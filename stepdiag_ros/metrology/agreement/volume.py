"""The error vectors in the volume, of two measurements: rms, worst place, largest change."""

from math import nan

import numpy as np

from stepdiag_ros.metrology.agreement.measured import ResultPair
from stepdiag_ros.metrology.agreement.values import FigureChange, PlaceChange
from stepdiag_ros.metrology.geometry import TRANSLATIONS, Vector
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy, of_result
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

RMS, WORST = "volume, rms", "volume, worst"
MOST_PLACES = 30_000
"""Nodes that are looked at for the largest change; of more, every second one, or third."""
MOST_WITH_UNCERTAINTY = 1000
"""Places, evenly spread, from which the uncertainty of the rms is computed."""

Volumes = tuple[FigureChange, FigureChange, PlaceChange | None, Vector, tuple[float, float]]


def volume_changes(both: ResultPair) -> Volumes:
    """Return what changed in the volume.

    The uncertainty of the rms and of a length is to first order, with the covariance of the curves
    (JCGM 100:2008, 5.2); that another place may be the worst is not in it. All is NaN where a curve
    is not determined at a node, since the worst place may then be anywhere.

    Args:
        both: the two on their common nodes.

    Returns:
        rms; longest vector; the place where the vector changed most, None where not known; the
        places of the longest vectors, m, shape (2, 3); rms over the volume of the standard
        uncertainty of the vectors, m, of both.
    """
    results = (both.before, both.after)
    lacking = any(
        name not in result.curves or not np.all(np.isfinite(result.curves[name]))
        for result in results
        for name in (*TRANSLATIONS, *result.curves)
    )
    turning = any(name not in TRANSLATIONS for name in both.before.curves)
    if lacking or (turning and not both.chain):
        nothing = (nan, nan)
        return (
            FigureChange.of(RMS, "m", nothing, nothing),
            FigureChange.of(WORST, "m", nothing, nothing),
            None,
            np.full((2, 3), nan),
            nothing,
        )
    maps = [VolumetricMap.of_result(result, both.chain) for result in results]
    found = [of_result(result, both.chain) for result in results]
    spread_places = maps[0].some_nodes(MOST_WITH_UNCERTAINTY)
    rms_slopes = [_rms_slope(one, spread_places) for one in maps]
    worst_slopes = [_length_slope(one, accuracy) for one, accuracy in zip(maps, found, strict=True)]
    noise = [_rms_noise(one, spread_places) for one in maps]
    figures = [
        FigureChange.of(
            name,
            "m",
            values,
            (_spread(slopes[0], both.before), _spread(slopes[1], both.after)),
            float(slopes[0] @ both.cross @ slopes[1]),
        )
        for name, values, slopes in (
            (RMS, (found[0].rms, found[1].rms), rms_slopes),
            (WORST, (found[0].value, found[1].value), worst_slopes),
        )
    ]
    return (
        figures[0],
        figures[1],
        _moved(both, maps),
        np.array([one.position for one in found]),
        (noise[0], noise[1]),
    )


def _moved(both: ResultPair, maps: list[VolumetricMap]) -> PlaceChange:
    places = maps[0].some_nodes(MOST_PLACES)
    before, after = (one.errors(places) for one in maps)
    row = int(np.argmax(np.sum((after - before) ** 2, axis=1)))
    place = places[row : row + 1]
    difference = (after - before)[row]
    first, second = (_sensitivity(one, place)[0] for one in maps)
    covariance = (
        first @ both.before.covariance @ first.T
        + second @ both.after.covariance @ second.T
        - first @ both.cross @ second.T
        - second @ both.cross.T @ first.T
    )
    length = float(np.linalg.norm(difference))
    along = difference / length if length > 0.0 else np.full(3, nan)
    return PlaceChange(
        position=place[0],
        before=before[row],
        after=after[row],
        difference_uncertainty=np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        length=length,
        length_uncertainty=float(np.sqrt(np.maximum(along @ covariance @ along, 0.0))),
    )


def _rms_noise(error_map: VolumetricMap, places: Vector) -> float:
    if not np.all(np.isfinite(error_map.covariance)):
        return nan
    spread = error_map.standard_uncertainty_at(places)
    return float(np.sqrt(np.mean(np.sum(spread**2, axis=1))))


def _rms_slope(error_map: VolumetricMap, places: Vector) -> Vector:
    """Return the derivative of the rms over places by all curve values, shape (k,)."""
    vectors = error_map.errors(places)
    rms = float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
    total = np.einsum("ni,nij->j", vectors, _sensitivity(error_map, places))
    slope: Vector = total / (len(places) * rms) if rms > 0.0 else np.zeros_like(total)
    return slope


def _length_slope(error_map: VolumetricMap, found: VolumetricAccuracy) -> Vector:
    """Return the derivative of the longest vector's length by all curve values, shape (k,)."""
    weights = _sensitivity(error_map, np.asarray(found.position)[None, :])[0]
    along = np.asarray(found.vector) / found.value if found.value > 0.0 else np.zeros(3)
    slope: Vector = along @ weights
    return slope


def _sensitivity(error_map: VolumetricMap, places: Vector) -> Vector:
    return error_map.sensitivities(places)[0]


def _spread(slope: Vector, result: VolumetricErrors) -> float:
    variance = float(slope @ result.covariance @ slope)
    if not np.any(slope) or not np.isfinite(variance):
        return nan
    return float(np.sqrt(max(variance, 0.0)))
