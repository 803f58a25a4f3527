"""What two measurements share: an error that is in both cancels in their difference.

Readings, setups, drift and turbulence are another matter each time. The calibration of the laser
and of the sensors is the same if the same instrument measured both times; a coefficient of thermal
expansion that both were corrected with is the same, since the machine is. Only a budget
states such sources, which it lists one by one. Without budgets the solver's own covariance gives
the influence on both alike of angular errors that no reading shows.
"""

from collections.abc import Sequence

import numpy as np

from stepdiag_ros.metrology.agreement.measured import ComparedMeasurement, curve_rows
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.source import COMMON, Source

SAME_INSTRUMENT = (
    "laser wavelength",
    "air temperature",
    "air pressure",
    "relative humidity",
    "equation for the index",
    "material temperature",
)
"""Sources that are one and the same value if one instrument, with its sensors, measured twice."""
SAME_MACHINE = ("expansion coefficient",)
"""Sources that are one and the same value because the machine is the same."""
UNSEEN_ANGLES = "angular errors that the readings do not show"
"""The same in both because the machine is, unless these themselves changed."""


def shared_sources(
    before: ComparedMeasurement, after: ComparedMeasurement, same_instrument: bool
) -> tuple[str, ...]:
    """Return the names of the sources that two measurements share.

    Args:
        before: the first, with its budget if its sources are known one by one.
        after: the second.
        same_instrument: one instrument, with its sensors, measured both.
    """
    if before.budget is None or after.budget is None:
        return () if _of_rotations(before, after) is None else (UNSEEN_ANGLES,)
    budgets = (before.budget, after.budget)
    wanted = (*SAME_INSTRUMENT, *SAME_MACHINE) if same_instrument else SAME_MACHINE
    return tuple(
        name
        for name in wanted
        if all(any(_acts(source, name) for source in one.sources) for one in budgets)
    )


def _of_rotations(before: ComparedMeasurement, after: ComparedMeasurement) -> Vector | None:
    """Return the errors in both alike from rotations that no reading determines.

    None where that is nothing, or not known.
    The same lines, moved in the same orders and solved by the same method, turn it into the same.
    Where the two state other sizes of the rotations, it is the product of the square roots of both:
    their mean could make a difference of two ranges, each between nodes of its own, certain.
    """
    parts = []
    for one in (before, after):
        total, readings = one.result.covariance, one.result.readings_covariance
        if one.budget is not None or not readings.size or readings.shape != total.shape:
            return None
        parts.append(np.nan_to_num(total - readings))
    layouts = [
        one.measurement and (one.result.method, layout_of(one.measurement))
        for one in (before, after)
    ]
    alike = layouts[0] and layouts[0] == layouts[1] and parts[0].shape == parts[1].shape
    if not alike or not all(map(np.any, parts)):
        return None
    made: Vector = _root(parts[0]) @ _root(parts[1])
    return made


def _root(covariance: Vector) -> Vector:
    """Return the symmetric square root of a covariance."""
    variances, vectors = np.linalg.eigh(covariance)
    root: Vector = (vectors * np.sqrt(np.maximum(variances, 0.0))) @ vectors.T
    return root


def layout_of(measurement: Measurement) -> tuple[object, ...]:
    """Return what decides, beside the method, what rotations do to a result: box and lines."""
    kinds = {
        (
            one.line.name,
            one.line.order,
            one.line.direction,
            one.line.offset,
            one.line.mirror_offset,
        )
        for one in measurement.lines
    }
    return (measurement.volume, tuple(sorted(kinds)))


def cross_covariance(
    before: ComparedMeasurement, after: ComparedMeasurement, names: Sequence[str]
) -> Vector:
    """Return the covariance of the stacked curves of one measurement with those of the other.

    A shared source is one value x with one standard uncertainty u: what it does to the first, times
    what it does to the second, times u² (GUM F.1.2.3). Where the two budgets state another u for
    it, the product of both is taken.

    Args:
        before: with its budget, if there is one.
        after: the same of the second.
        names: of the shared sources.

    Returns:
        in the products of the units, shape (k of the first, k of the second).
    """
    sizes = [sum(map(len, one.result.curves.values())) for one in (before, after)]
    made = np.zeros((sizes[0], sizes[1]))
    if before.budget is None or after.budget is None:
        rotations = _of_rotations(before, after)
        return made if rotations is None else rotations
    places, rows = curve_rows(before.budget, before.result)
    other_places, other_rows = curve_rows(after.budget, after.result)
    for name in names:
        first, second = _factors(before.budget, name), _factors(after.budget, name)
        made[np.ix_(places, other_places)] += first[rows] @ second[other_rows].T
    return made


def _acts(source: Source, name: str) -> bool:
    return source.name == name and source.known and source.correlation == COMMON


def _factors(budget: Budget, name: str) -> Vector:
    source = next(one for one in budget.sources if _acts(one, name))
    return source.factors(budget.sensitivity.matrix)
