"""The error vectors in the volume, of two measurements: rms, worst place, largest change."""

import math
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

    The uncertainty of the rms and of a length is that to first order, with the covariance of the
    curves (JCGM 100:2008, 5.2), and what the uncertainty of the vectors adds to a length on
    average, √(v² + s²) - v: near zero a length has no first order. That another place may be the
    worst is not in it. All is NaN where a curve is not determined at a node, since the worst place
    may then be anywhere.

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
    rms_sums = [_rms_sum(one, spread_places) for one in maps]
    worst_sums = [_length_sum(one) for one in found]
    noise = [_rms_noise(one, spread_places) for one in maps]
    figures = [
        _changed(name, values, both, maps, sums, sizes)
        for name, values, sums, sizes in (
            (RMS, (found[0].rms, found[1].rms), rms_sums, noise),
            (
                *(WORST, (found[0].value, found[1].value), worst_sums),
                [
                    _rms_noise(one, places)
                    for one, (places, _) in zip(maps, worst_sums, strict=True)
                ],
            ),
        )
    ]
    return (
        figures[0],
        figures[1],
        _moved(both, maps),
        np.array([one.position for one in found]),
        (noise[0], noise[1]),
    )


def _changed(
    name: str,
    values: tuple[float, float],
    both: ResultPair,
    maps: list[VolumetricMap],
    sums: list[tuple[Vector, Vector]],
    sizes: list[float],
) -> FigureChange:
    """Return the change of a figure of which both derivatives by the error vectors are known.

    Args:
        name: of the figure.
        values: before and after, m.
        both: the two results.
        maps: of them.
        sums: places, m, and the derivative by the error vector at each, shape (n, 3), of both.
        sizes: rms standard uncertainty of the error vectors at these places, m, of both.
    """
    slopes = [
        np.einsum("ni,nij->j", along, one.sensitivities(places)[0])
        for one, (places, along) in zip(maps, sums, strict=True)
    ]
    before, after = (
        one.left_out_variance(places, along)
        for one, (places, along) in zip(maps, sums, strict=True)
    )
    shared = float(slopes[0] @ both.cross @ slopes[1])
    if np.any(both.cross):
        # Rotations that no reading shows are the same in both: only what they do differs.
        differs = (math.sqrt(abs(before)) - math.sqrt(abs(after))) ** 2
        shared += 0.5 * (before + after - differs)
    first_order = (
        _spread(slopes[0], both.before, before),
        _spread(slopes[1], both.after, after),
    )
    spread_before, spread_after = (
        math.hypot(spread, math.hypot(value, size) - value)
        for spread, value, size in zip(first_order, values, sizes, strict=True)
    )
    spreads = (spread_before, spread_after)
    return FigureChange.of(name, "m", values, spreads, shared)


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


def _rms_sum(error_map: VolumetricMap, places: Vector) -> tuple[Vector, Vector]:
    """Return places and the derivative of the rms over them by each error vector, (n, 3) each."""
    vectors = error_map.errors(places)
    rms = float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
    return places, vectors / (len(places) * rms) if rms > 0.0 else np.zeros_like(vectors)


def _length_sum(found: VolumetricAccuracy) -> tuple[Vector, Vector]:
    """Return the place of the longest vector and its direction, shape (1, 3) each."""
    along = np.asarray(found.vector) / found.value if found.value > 0.0 else np.zeros(3)
    return np.asarray(found.position)[None, :], along[None, :]


def _sensitivity(error_map: VolumetricMap, places: Vector) -> Vector:
    return error_map.sensitivities(places)[0]


def _spread(slope: Vector, result: VolumetricErrors, left_out: float) -> float:
    variance = float(slope @ result.covariance @ slope) + left_out
    if not np.any(slope) or not np.isfinite(variance):
        return nan
    return float(np.sqrt(max(variance, 0.0)))
