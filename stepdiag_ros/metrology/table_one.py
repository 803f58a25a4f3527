"""Table 1 of Ibaraki & Hata 2010: positioning, straightness and squareness, by its definitions.

Section 4.1: straightness is the largest variation of the mean values of the normal errors from
their least-squares line; squareness is the gradient of the least-squares lines of e_x(y), e_x(z)
and e_z(y) with respect to that of e_y(x), e_z(x) and e_y(z), so the sum of both slopes; all are
given over the travel. The sum is positive where the angle between the positive axes is smaller than
90°: X-Y is -C0Y, X-Z is +B0Z, Y-Z is -A0Z. That this is the sign of the printed table is seen from
its conventional column: setup errors change all three and the positioning errors by amounts that
eq. (19) ties together (``setup_errors.closure_of_conventional``), and only this sign fulfils it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.direct import DirectCurve, DirectMeasurement
from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import AXES, Vector, moving_axis
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.solvers.summary import deviations_from_line

_STRAIGHTNESS = ("E_YX", "E_ZX", "E_XY", "E_ZY", "E_XZ", "E_YZ")
_SQUARENESS = {"C0Y": "X-Y", "B0Z": "X-Z", "A0Z": "Y-Z"}


@dataclass(frozen=True)
class Entry:
    """One cell of the table.

    Attributes:
        value: m over the travel; NaN if unknown.
        standard_uncertainty: m; NaN if unknown.
    """

    value: float
    standard_uncertainty: float


@dataclass(frozen=True)
class TableOneRow:
    """One row of the table.

    Attributes:
        label: as in the paper.
        name: ISO 230-1 name of the curve or the squareness.
        travel: over which the value is given, m.
        measured: with artefacts; None if it was not.
        estimated: method → value.
    """

    label: str
    name: str
    travel: float
    measured: Entry | None
    estimated: Mapping[str, Entry]


def table_one(
    results: Mapping[str, VolumetricErrors], direct: DirectMeasurement | None = None
) -> tuple[TableOneRow, ...]:
    """Return the rows of Table 1 in its order.

    Squareness is given over the travel of the axis that is out of square.

    Args:
        results: method → result from all repeats; each must hold the nine translations.
        direct: measurements with artefacts.

    Raises:
        ValueError: there is no result.
    """
    if not results:
        raise Refusal(
            "Table 1 needs at least one result with translational errors",
            fault="too_few",
            aspect="results",
        )
    nodes = next(iter(results.values())).nodes
    travel = [float(axis_nodes[-1] - axis_nodes[0]) for axis_nodes in nodes]
    rows = []
    for axis, letter in enumerate(AXES):
        name = f"E_{letter}{letter}"
        rows.append(
            TableOneRow(
                f"Positioning error in {letter}",
                name,
                travel[axis],
                _positioning(direct, name),
                _figures(results, f"positioning {name}", 1.0),
            )
        )
    for name in _STRAIGHTNESS:
        error, moving = name[2], name[3]
        rows.append(
            TableOneRow(
                f"Straightness of {moving} axis ({error} direction)",
                name,
                travel[moving_axis(name)],
                _straightness(direct, name),
                _figures(results, f"straightness {name}", 1.0),
            )
        )
    for name, axes in _SQUARENESS.items():
        length = travel[AXES.index(name[2])]
        factor = length * SQUARENESS_SLOPES[name][0]
        rows.append(
            TableOneRow(
                f"Squareness of {axes}",
                name,
                length,
                _squareness(direct, name, factor),
                _figures(results, name, factor),
            )
        )
    return tuple(rows)


def _figures(results: Mapping[str, VolumetricErrors], name: str, factor: float) -> dict[str, Entry]:
    found = {}
    for method, result in results.items():
        figure = result.figure(name)
        found[method] = Entry(factor * figure.value, abs(factor) * figure.standard_uncertainty)
    return found


def _positioning(direct: DirectMeasurement | None, name: str) -> Entry | None:
    if direct is None or name not in direct.curves:
        return None
    curve = direct.curves[name]
    ends = np.zeros(len(curve.positions))
    ends[0], ends[-1] = -1.0, 1.0
    return _entry(curve, ends)


def _straightness(direct: DirectMeasurement | None, name: str) -> Entry | None:
    if direct is None or name not in direct.curves:
        return None
    curve = direct.curves[name]
    matrix = deviations_from_line(curve.positions)
    deviation = matrix @ curve.mean
    functional = matrix[np.argmax(deviation)] - matrix[np.argmin(deviation)]
    return _entry(curve, functional)


def _squareness(direct: DirectMeasurement | None, name: str, factor: float) -> Entry | None:
    if direct is None or name not in direct.squareness:
        return None
    angle = direct.squareness[name]
    return Entry(factor * angle.mean, abs(factor) * angle.standard_uncertainty)


def _entry(curve: DirectCurve, functional: Vector) -> Entry:
    values, uncertainties = curve.evaluate(functional[None, :])
    return Entry(float(values[0]), float(uncertainties[0]))
