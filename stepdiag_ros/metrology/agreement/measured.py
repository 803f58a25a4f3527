"""Two measurements on their common nodes and in one frame, so that their values may be compared."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np

from stepdiag_ros.metrology.forward import in_result_frame
from stepdiag_ros.metrology.geometry import (
    AXES,
    CURVES,
    EDGE,
    FRAME,
    ROTATIONS,
    TRANSLATIONS,
    Vector,
    moving_axis,
)
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.observations import Integers
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.solvers.summary import CurveEstimate, common_figures, functionals
from stepdiag_ros.metrology.uncertainty.budget import Budget

_COMPARED = ("positioning", "straightness", "angular", "angular-shape", "diagonal")
"""First words of the figures that belong to the machine; a tilt belongs to a setup."""


@dataclass(frozen=True)
class ComparedMeasurement:
    """One measurement, as it goes into a comparison.

    Attributes:
        result: of a solver.
        chain: order of the machine's axes from workpiece to tool; empty if not known.
        measurement: the lines that it was solved from; None if they are not at hand.
        budget: uncertainty of the result by its sources; None: as the solver gives it.
        approach: covariance of all curves stacked that is added where the other measurement's stops
            were approached in another way, shape (k, k); see ``approach``.
    """

    result: VolumetricErrors
    chain: str = ""
    measurement: Measurement | None = None
    budget: Budget | None = None
    approach: Vector | None = None

    def covariance(self) -> Vector:
        """Return the covariance of all curves stacked, the approach in it; NaN where not known.

        Where only the standard uncertainties are at hand (a document), they are on the diagonal,
        and what is beside it is not known.
        """
        known = self._by_readings_or_budget()
        return known if self.approach is None else known + self.approach

    def _by_readings_or_budget(self) -> Vector:
        values = np.concatenate(list(self.result.curves.values()))
        if self.budget is not None:
            places, rows = curve_rows(self.budget, self.result)
            made = np.zeros((values.size, values.size))
            made[np.ix_(places, places)] = self.budget.covariance[np.ix_(rows, rows)]
            made[~np.isfinite(values)] = nan
            made[:, ~np.isfinite(values)] = nan
            return made
        if self.result.covariance.shape == (values.size, values.size):
            return self.result.covariance
        spread = [
            self.result.standard_uncertainty.get(name, np.full(curve.shape, nan))
            for name, curve in self.result.curves.items()
        ]
        made = np.full((values.size, values.size), nan)
        np.fill_diagonal(made, np.concatenate(spread) ** 2)
        return made


@dataclass(frozen=True)
class ResultPair:
    """Two results with the same curves at the same nodes in one frame.

    Attributes:
        before: the first, with its covariance.
        after: the second.
        cross: covariance of the first's stacked curves with the second's, shape (k, k): what both
            share; zero if they are independent.
        chain: order of the machine's axes; empty if not known.
        remarks: what was done to bring them together, in words.
    """

    before: VolumetricErrors
    after: VolumetricErrors
    cross: Vector
    chain: str
    remarks: tuple[str, ...]


def curve_rows(budget: Budget, result: VolumetricErrors) -> tuple[list[int], list[int]]:
    """Return the places of a budget's curve values in the stacked curves, and their rows in it."""
    starts, start = {}, 0
    for name, curve in result.curves.items():
        starts[name] = start
        start += len(curve)
    rows = [row for row, one in enumerate(budget.sensitivity.quantities) if one.curve]
    quantities = [budget.sensitivity.quantities[row] for row in rows]
    return [starts[one.curve] + one.node for one in quantities], rows


def pair(before: ComparedMeasurement, after: ComparedMeasurement, cross: Vector) -> ResultPair:
    """Bring two measurements together; see ``ResultPair``.

    Args:
        before: the first.
        after: the second.
        cross: covariance of the first's stacked curves with the second's.

    Raises:
        ValueError: they are of different machines or boxes, or have no curve in common, or their
            frames cannot be brought together; one sentence.
    """
    chain = _chain(before.chain, after.chain)
    picks = common_nodes(before.result, after.result)
    first, second = before.result.curves, after.result.curves
    names = [name for name in CURVES if name in first and name in second]
    if not names:
        raise Refusal(
            "the two results have no error curve in common: nothing can be compared",
            fault="mismatch",
            aspect="curves",
        )
    places = [
        _places(one.result, names, pick) for one, pick in zip((before, after), picks, strict=True)
    ]
    results = [
        _restricted(one, names, pick, place, chain)
        for one, pick, place in zip((before, after), picks, places, strict=True)
    ]
    shared = cross[np.ix_(*places)]
    remarks = []
    counts = [len(one.result.nodes[0]) for one in (before, after)]
    if len(results[0].nodes[0]) < max(counts):
        remarks.append(
            f"the grids differ ({counts[0]} and {counts[1]} nodes an axis): compared at the"
            f" {len(results[0].nodes[0])} that they have in common"
        )
    left = [name for name in CURVES if (name in first) != (name in second)]
    if left:
        remarks.append(f"{', '.join(left)}: in one of both only, not compared")
    if results[0].frame != results[1].frame:
        turned = [_in_one_frame(one, chain) for one in results]
        results = [one for one, _ in turned]
        shared = turned[0][1] @ shared @ turned[1][1].T
        remarks.append(f"the frames differ: both were turned into one, {FRAME}")
    return ResultPair(results[0], results[1], shared, chain, tuple(remarks))


def common_nodes(
    one: VolumetricErrors, other: VolumetricErrors
) -> tuple[list[Integers], list[Integers]]:
    """Return which nodes of each axis both results have, as indices into those of each.

    Raises:
        ValueError: they are not of the same box.
    """
    picks: tuple[list[Integers], list[Integers]] = ([], [])
    for letter, first, second in zip(AXES, one.nodes, other.nodes, strict=True):
        low, high = first[[0, -1]] * 1e3, second[[0, -1]] * 1e3
        if np.max(np.abs(low - high)) > EDGE * 1e3:
            raise Refusal(
                f"the measured boxes differ: {letter} from {low[0]:g} to {low[1]:g} mm and from"
                f" {high[0]:g} to {high[1]:g} mm; measure the same box again",
                fault="mismatch",
                aspect="box",
            )
        same = np.abs(first[:, None] - second[None, :]) <= EDGE
        rows, columns = np.nonzero(same)
        picks[0].append(rows)
        picks[1].append(columns)
    return picks


def volume_of(result: VolumetricErrors) -> Volume:
    """Return the box of a result and its grid."""
    low = [float(nodes[0]) for nodes in result.nodes]
    blocks = len(result.nodes[0]) - 1
    step = [float(nodes[-1] - nodes[0]) / blocks for nodes in result.nodes]
    return Volume((low[0], low[1], low[2]), (step[0], step[1], step[2]), blocks)


def figures_of(result: VolumetricErrors, lines: Sequence[str], chain: str) -> tuple[Figure, ...]:
    """Return the figures of a result from its curves and their covariance.

    Args:
        result: with its covariance.
        lines: names of the measured body diagonals.
        chain: order of the machine's axes; empty if not known.
    """
    return common_figures(volume_of(result), _estimate(result), lines, chain)


def figure_weights(result: VolumetricErrors, names: Sequence[str], chain: str) -> Vector:
    """Return the derivatives of figures by the stacked curves, shape (figures, k).

    Zero for a figure that is known though the curves that it is made of are not.

    Args:
        result: the curves.
        names: of the figures.
        chain: order of the machine's axes; empty if not known.
    """
    lines = [name.partition(" ")[2] for name in names if name.startswith("diagonal")]
    estimate = _estimate(result)
    known = estimate.curves_determined()
    every = functionals(volume_of(result), estimate, lines, chain)
    told = {one.name: one.weights for one in every}
    return np.array([told[name] * (not np.any(told[name][~known])) for name in names])


def _estimate(result: VolumetricErrors) -> CurveEstimate:
    values = np.concatenate(list(result.curves.values()))
    known = np.isfinite(values)
    return CurveEstimate(
        np.nan_to_num(values),
        np.where(known[:, None] & known, result.covariance, 0.0),
        np.eye(len(values))[:, ~known],
        tuple(result.curves),
    )


def with_curves(result: VolumetricErrors, stacked: Vector) -> VolumetricErrors:
    """Return a result with other values of its curves, stacked in their order."""
    ends = np.cumsum([len(curve) for curve in result.curves.values()])
    parts = np.split(stacked, ends[:-1])
    return replace(result, curves=dict(zip(result.curves, parts, strict=True)))


def _chain(before: str, after: str) -> str:
    if before and after and before != after:
        raise Refusal(
            f"these are different machines: the axes of the first are in the order {before} from"
            f" workpiece to tool, those of the second {after}",
            fault="mismatch",
            aspect="machine",
        )
    return before or after


def _places(result: VolumetricErrors, names: Sequence[str], picks: Sequence[Integers]) -> Vector:
    starts, start = {}, 0
    for name, curve in result.curves.items():
        starts[name] = start
        start += len(curve)
    return np.concatenate([starts[name] + picks[moving_axis(name)] for name in names])


def _restricted(
    one: ComparedMeasurement,
    names: Sequence[str],
    picks: Sequence[Integers],
    places: Vector,
    chain: str,
) -> VolumetricErrors:
    """Return a result with some of its curves at some of its nodes."""
    result = one.result
    x, y, z = (nodes[pick] for nodes, pick in zip(result.nodes, picks, strict=True))
    covariance = one.covariance()[np.ix_(places, places)]
    curves = {name: result.curves[name][picks[moving_axis(name)]] for name in names}
    ends = np.cumsum([len(curve) for curve in curves.values()])
    spread = np.split(np.sqrt(np.maximum(np.diag(covariance), 0.0)), ends[:-1])
    made = replace(
        result,
        nodes=(x, y, z),
        curves=curves,
        standard_uncertainty=dict(zip(names, spread, strict=True)),
        covariance=covariance,
    )
    whole = len(places) == sum(len(curve) for curve in result.curves.values())
    plain = one.budget is None and one.approach is None
    if whole and plain and result.figures:
        # A figure may be known where the curves that it is made of are not.
        figures = result.figures
    else:
        lines = [f.name.partition(" ")[2] for f in result.figures if f.name.startswith("diagonal")]
        complete = all(name in curves for name in TRANSLATIONS)
        figures = figures_of(made, lines, chain) if complete else ()
    kept = tuple(f for f in figures if f.name[:2] in ("C0", "B0", "A0") or _first(f) in _COMPARED)
    return replace(made, figures=kept)


def _first(figure: Figure) -> str:
    return figure.name.partition(" ")[0]


def _in_one_frame(result: VolumetricErrors, chain: str) -> tuple[VolumetricErrors, Vector]:
    """Return a result in the frame of IH eq. (17), and the matrix that turned its curves."""
    turning = [name for name in result.curves if name in ROTATIONS]
    unknown = [name for name in TRANSLATIONS if name not in result.curves]
    unknown += [name for name, values in result.curves.items() if not np.all(np.isfinite(values))]
    if turning or unknown:
        raise ValueError(
            "the frames of the two results differ, and they cannot be brought into one:"
            + (f" {', '.join(unknown)} is not determined" if unknown else " angular errors in them")
            + "; name another --method"
        )

    def turned(stacked: Vector) -> Vector:
        moved = in_result_frame(result.nodes, with_curves(result, stacked).curves)
        return np.concatenate([moved[name] for name in result.curves])

    stacked = np.concatenate(list(result.curves.values()))
    matrix = np.array([turned(unit) for unit in np.eye(stacked.size)]).T
    covariance = matrix @ result.covariance @ matrix.T
    made = replace(with_curves(result, turned(stacked)), covariance=covariance, frame=FRAME)
    ends = np.cumsum([len(curve) for curve in made.curves.values()])
    spread = np.split(np.sqrt(np.maximum(np.diag(covariance), 0.0)), ends[:-1])
    lines = [f.name.partition(" ")[2] for f in result.figures if f.name.startswith("diagonal")]
    made = replace(made, standard_uncertainty=dict(zip(made.curves, spread, strict=True)))
    return replace(made, figures=figures_of(made, lines, chain)), matrix
