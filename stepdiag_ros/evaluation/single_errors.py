"""The single errors of a machine over the travel, by one definition: positioning peak to peak.

Positioning, ISO 230-1: the largest less the smallest error over the travel. The figure
``positioning E_XX`` of a result is another quantity, the error at the end of the travel (Ibaraki &
Hata 2010, Table 1): an error that comes back to zero at the end is nothing there. Straightness is
the range off the least-squares line (Ibaraki & Hata 2010, section 4.1), so peak to peak as well.
Squareness counts by what it makes over the travel of the axis that is out of square.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan, sqrt

import numpy as np

from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.metrology.forward import AXES_OF
from stepdiag_ros.metrology.geometry import AXES, SQUARENESS, TRANSLATIONS, Vector, moving_axis
from stepdiag_ros.metrology.plan import LINEAR
from stepdiag_ros.metrology.solvers.ranges import range_excess
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest
from stepdiag_ros.metrology.standards.positioning_uncertainty import (
    COVERAGE_FACTOR as FACTOR_OF_THE_STANDARD,
)
from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR, Expanded, larger

PEAK_TO_PEAK = "positioning-range"
"""First word of the figures that ``with_ranges`` adds."""


@dataclass(frozen=True)
class SingleError:
    """One error over the travel of its axis.

    Attributes:
        name: ISO 230-1 name of the curve or the squareness.
        value: m, never negative; NaN if not determined.
        expanded_uncertainty: of it (95 %), m; NaN if not known.
        travel: m.
        coverage_factor: of the expanded uncertainty.
        angle: of squareness with its sign (as the axes turn, ISO 230-1), rad; NaN of the others.
    """

    name: str
    value: float
    expanded_uncertainty: float
    travel: float
    coverage_factor: float = COVERAGE_FACTOR
    angle: float = nan

    @classmethod
    def made(
        cls, name: str, value: float, wide: Expanded, travel: float, angle: float = nan
    ) -> "SingleError":
        """Make it with the expanded uncertainty that counts."""
        return cls(name, value, wide.value, travel, wide.coverage_factor, angle)

    @property
    def words(self) -> str:
        """Return what it is, for people."""
        if self.name in AXES_OF:
            reference, other = AXES_OF[self.name]
            return f"squareness {self.name} of {other} to {reference}"
        error, axis = self.name[2], self.name[3]
        if error == axis:
            return f"positioning {self.name} of {axis}"
        return f"straightness {self.name} of {axis} in {error}"


def single_errors(
    result: VolumetricErrors, budget: Budget | None = None
) -> tuple[SingleError, ...]:
    """Return positioning, straightness and squareness over the travel, as far as a result has them.

    Args:
        result: of a solver.
        budget: of this result. The larger expanded uncertainty counts, that of the readings alone
            or that of the budget; None: that of the readings.
    """
    travel = [float(nodes[-1] - nodes[0]) for nodes in result.nodes]
    figures = {figure.name: figure for figure in result.figures}
    made = []
    for name in TRANSLATIONS:
        length = travel[moving_axis(name)]
        if name[2] != name[3]:
            figure = figures.get(f"straightness {name}")
            if figure is not None:
                wide = expanded_of_figure(figure, budget)
                made.append(SingleError.made(name, figure.value, wide, length))
        elif name in result.curves:
            figure = _range(result, name)
            of_readings = Expanded.of_normal(figure.standard_uncertainty)
            wide = larger(of_readings, _expanded_range(budget, name, result.curves[name]))
            made.append(SingleError.made(name, figure.value, wide, length))
    for name in SQUARENESS:
        figure, length = figures.get(name), travel[AXES.index(name[2])]
        if figure is not None:
            wide = expanded_of_figure(figure, budget).times(length)
            value = abs(figure.value) * length
            made.append(SingleError.made(name, value, wide, length, figure.value))
    return tuple(made)


def at_least_of_tests(
    errors: Sequence[SingleError], tests: Iterable[PositioningTest]
) -> tuple[SingleError, ...]:
    """Return single errors whose positioning has no smaller U than ISO 230-2 states for it.

    Peak to peak of a positioning error is the mean bidirectional error M of ISO 230-2, or E↑ or E↓
    of lines in one direction only.

    Args:
        errors: by ``single_errors``.
        tests: of the same run; those of diagonals are passed over.
    """
    largest: dict[str, Expanded] = {}
    for test in tests:
        if test.kind != LINEAR:
            continue
        name = f"E_{test.name}{test.name}"
        for parameter in ("M", "E↑", "E↓"):
            value = test.expanded_uncertainty[parameter]
            if isfinite(value):
                found = Expanded(value, FACTOR_OF_THE_STANDARD)
                largest[name] = larger(largest.get(name, Expanded()), found)
                break
    made = []
    for one in errors:
        own = Expanded(one.expanded_uncertainty, one.coverage_factor)
        wide = larger(own, largest.get(one.name, Expanded()))
        made.append(
            replace(one, expanded_uncertainty=wide.value, coverage_factor=wide.coverage_factor)
        )
    return tuple(made)


def expanded_of_figure(figure: Figure, budget: Budget | None) -> Expanded:
    """Return the expanded uncertainty of a figure: the larger of two, see ``single_errors``."""
    of_readings = Expanded.of_normal(figure.standard_uncertainty)
    if budget is not None:
        for row, quantity in enumerate(budget.sensitivity.quantities):
            if quantity.name == figure.name:
                return larger(of_readings, _of_budget(budget, row))
    return of_readings


def expanded_of_curve(
    result: VolumetricErrors, name: str, budget: Budget | None
) -> tuple[Expanded, ...]:
    """Return the expanded uncertainty at every node of a curve: the larger of two, as above."""
    wide = [Expanded.of_normal(float(one)) for one in result.standard_uncertainty[name]]
    if budget is not None:
        for row, quantity in enumerate(budget.sensitivity.quantities):
            if quantity.curve == name:
                wide[quantity.node] = larger(wide[quantity.node], _of_budget(budget, row))
    return tuple(wide)


def _of_budget(budget: Budget, row: int) -> Expanded:
    return Expanded(float(budget.expanded[row]), float(budget.coverage_factor[row]))


def _ends_of_range(values: Vector) -> tuple[int, int]:
    """Return the nodes where a curve is largest and smallest."""
    return int(np.argmax(values)), int(np.argmin(values))


def _range(result: VolumetricErrors, name: str) -> Figure:
    """Return the largest less the smallest value of a curve, with the uncertainty of a range."""
    values = np.asarray(result.curves[name])
    label = f"{PEAK_TO_PEAK} {name}"
    if not np.all(np.isfinite(values)):
        return Figure(label, nan, nan, "m")
    begin = sum(len(result.curves[one]) for one in _before(result, name))
    end, spread = begin + len(values), nan
    if result.covariance.shape[0] >= end:
        spread = _of_range(values, result.covariance[begin:end, begin:end])
    return Figure(label, float(np.ptp(values)), spread, "m")


def _before(result: VolumetricErrors, name: str) -> list[str]:
    names = list(result.curves)
    return names[: names.index(name)]


def _of_range(values: Vector, covariance: Vector) -> float:
    """Return the standard uncertainty of the range of values, m.

    It is that of the difference between the nodes where the curve is largest and smallest, and of
    the excess that comes with choosing these two (``solvers.ranges``).
    """
    high, low = _ends_of_range(values)
    variance = covariance[high, high] + covariance[low, low] - 2.0 * covariance[high, low]
    return float(np.hypot(sqrt(max(variance, 0.0)), range_excess(values, covariance)))


def _expanded_range(budget: Budget | None, name: str, values: Vector) -> Expanded:
    """Return the expanded uncertainty of a range, with the larger coverage factor of its nodes."""
    if budget is None or not np.all(np.isfinite(values)):
        return Expanded()
    rows = {
        quantity.node: row
        for row, quantity in enumerate(budget.sensitivity.quantities)
        if quantity.curve == name
    }
    # What the frame fixes is not a quantity of the budget, and has no uncertainty.
    at = [rows[node] for node in _ends_of_range(values) if node in rows]
    if not at:
        return Expanded()
    nodes, places = list(rows), list(rows.values())
    covariance = np.zeros((len(values),) * 2)
    covariance[np.ix_(nodes, nodes)] = budget.covariance[np.ix_(places, places)]
    factor = float(np.max(budget.coverage_factor[at]))
    return Expanded(factor * _of_range(values, covariance), factor)


def with_ranges(report: Report) -> Report:
    """Return a report whose results, and whose truth, have the peak to peak positioning as figures.

    They are for tables: a result as it is recorded and published does not hold them.

    Args:
        report: as it was solved.
    """
    names = [f"E_{letter}{letter}" for letter in AXES]
    results = tuple(
        replace(
            one,
            figures=(*one.figures, *(_range(one, name) for name in names if name in one.curves)),
        )
        for one in report.results
    )
    truth = report.truth
    if truth is not None:
        exact = [
            Figure(f"{PEAK_TO_PEAK} {name}", float(np.ptp(truth.curves[name])), 0.0, "m")
            for name in names
        ]
        truth = replace(truth, figures=(*truth.figures, *exact))
    return replace(report, results=results, truth=truth)
