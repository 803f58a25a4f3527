"""Two measurements of one machine beside each other: every difference with its uncertainty.

    E_n = (after - before) / (U_before² + U_after² - 2 k² cov)^½,  U = k u, k = 2

(ISO 13528:2022, 9.7, for independent measurements, with what both share taken out). |E_n| <= 1:
the two agree within what is known of them. Of many nodes one in twenty is outside by chance, and
nodes of one curve hang together; so each curve, and all of them, are also judged at once
(``joint``), and whether anything changed is judged by all numbers of all tables (``judgement``).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from stepdiag_ros.metrology.agreement.approach import by_their_approach
from stepdiag_ros.metrology.agreement.joint import JointTest, joint_test, significant_of_many
from stepdiag_ros.metrology.agreement.judgement import (
    CURVES,
    NODES,
    OF_CURVES,
    TOGETHER,
    JointJudgement,
    of_figures,
)
from stepdiag_ros.metrology.agreement.measured import (
    ComparedMeasurement,
    ResultPair,
    figure_weights,
    pair,
)
from stepdiag_ros.metrology.agreement.reversal import reversals
from stepdiag_ros.metrology.agreement.shared import cross_covariance, shared_sources
from stepdiag_ros.metrology.agreement.values import FigureChange, PlaceChange, chance_of
from stepdiag_ros.metrology.agreement.volume import volume_changes
from stepdiag_ros.metrology.comparison import normalised_error
from stepdiag_ros.metrology.geometry import Vector, curve_unit
from stepdiag_ros.metrology.solvers.result import VolumetricErrors


@dataclass(frozen=True)
class CurveChange:
    """One error curve of both measurements, at their common nodes.

    Attributes:
        name: ISO 230-1 name.
        unit: ``m`` or ``rad``.
        positions: machine coordinates of the moving axis, m, shape (n,).
        before: of the first measurement, shape (n,); NaN where not determined.
        before_uncertainty: standard uncertainties, shape (n,); NaN where not known, 0 where the
            frame fixes the value.
        after: of the second.
        after_uncertainty: of the second.
        difference_uncertainty: standard uncertainties of ``difference``, shape (n,).
        joint: of all nodes together.
        changed: chance does not explain this curve's change, or that of one of its nodes, although
            there are many; None where that is undetermined.
    """

    name: str
    unit: str
    positions: Vector
    before: Vector
    before_uncertainty: Vector
    after: Vector
    after_uncertainty: Vector
    difference_uncertainty: Vector
    joint: JointTest
    changed: bool | None = None

    @property
    def difference(self) -> Vector:
        """Return after minus before, shape (n,)."""
        return self.after - self.before

    @property
    def normalised_error(self) -> Vector:
        """Return E_n, shape (n,); NaN where an uncertainty is unknown or the frame fixes both."""
        return normalised_error(self.difference, self.difference_uncertainty)

    @property
    def largest(self) -> int:
        """Return the node of the largest difference; -1 where none is known but by the frame."""
        told = np.isfinite(self.difference) & ~(self.difference_uncertainty == 0.0)
        size = np.where(told, np.abs(self.difference), -1.0)
        return int(np.argmax(size)) if np.any(told) else -1


@dataclass(frozen=True)
class MachineChanges:
    """What two measurements say of one machine.

    Attributes:
        before: the first on the common nodes in the common frame, with its covariance.
        after: the second.
        chain: order of the machine's axes from workpiece to tool; empty if not known.
        curves: of both.
        figures: squareness, positioning, straightness, angles, diagonals, reversal.
        rms: of the error vectors' lengths over the nodes of the volume.
        worst: length of the longest error vector (volumetric accuracy).
        moved: the error vector that changed most; None where the volume is not known.
        worst_places: machine coordinates of the longest error vector before and after, m, shape
            (2, 3); NaN where not known.
        rms_noise: rms over the volume of the standard uncertainty of the error vectors, before
            and after, m: what a perfect machine would show; NaN where not known.
        joint: of all nodes of all curves together.
        judgement: whether anything has changed, by every number that stands in a table.
        shared: names of the sources of uncertainty that are the same in both.
        at_least: a source that acts is not known, so that every uncertainty is a lower bound.
        remarks: what a reader must know, in words.
    """

    before: VolumetricErrors
    after: VolumetricErrors
    chain: str
    curves: tuple[CurveChange, ...]
    figures: tuple[FigureChange, ...]
    rms: FigureChange
    worst: FigureChange
    moved: PlaceChange | None
    worst_places: Vector
    rms_noise: tuple[float, float]
    joint: JointTest
    judgement: JointJudgement = field(default=JointJudgement())
    shared: tuple[str, ...] = ()
    at_least: bool = False
    remarks: tuple[str, ...] = field(default=())

    @cached_property
    def normalised_errors(self) -> Vector:
        """Return E_n of all nodes of all curves at which it is known, shape (m,)."""
        every = np.concatenate([one.normalised_error for one in self.curves])
        known: Vector = every[np.isfinite(every)]
        return known

    @property
    def changed(self) -> tuple[CurveChange, ...]:
        """Return the curves that changed, the least explained by chance first."""
        named = [one for one in self.curves if one.changed]
        return tuple(sorted(named, key=lambda one: np.nan_to_num(one.joint.probability, nan=1.0)))

    @property
    def every_figure(self) -> tuple[FigureChange, ...]:
        """Return those of the volume and all others, as a table shows them."""
        return (self.rms, self.worst, *self.figures)

    def most_changed(self, unit: str = "m") -> CurveChange | None:
        """Return the curve with the largest difference; None where none is known.

        Args:
            unit: ``m``: of the translations; ``rad``: of the rotations.
        """
        known = [one for one in self.curves if one.unit == unit and one.largest >= 0]
        if not known:
            return None
        return max(known, key=lambda one: float(abs(one.difference[one.largest])))


def compare(
    before: ComparedMeasurement, after: ComparedMeasurement, same_instrument: bool = False
) -> MachineChanges:
    """Return how two measurements of a machine differ.

    Args:
        before: the first.
        after: the second.
        same_instrument: one laser with its sensors measured both; only of effect where both have a
            budget, since nothing else shows what comes from the instrument.

    Raises:
        ValueError: they cannot be compared; see ``measured.pair``.
    """
    before, after, approach = by_their_approach(before, after)
    shared = shared_sources(before, after, same_instrument)
    both = pair(before, after, cross_covariance(before, after, shared))
    combined = both.before.covariance + both.after.covariance - both.cross - both.cross.T
    curves, joint = _curves(both, combined)
    rms, worst, moved, places, noise = volume_changes(both)
    told, remarks = reversals(before.measurement, after.measurement)
    figures = (rms, worst, *_figures(both), *told)
    judgement = JointJudgement.of({**_of_curves(curves, joint), **of_figures(figures)})
    rms, worst, *others = (_judged_figure(one, judgement) for one in figures)
    return MachineChanges(
        before=both.before,
        after=both.after,
        chain=both.chain,
        curves=_judged_curves(curves, judgement),
        figures=tuple(others),
        rms=rms,
        worst=worst,
        moved=moved,
        worst_places=places,
        rms_noise=noise,
        joint=joint,
        judgement=judgement,
        shared=shared,
        at_least=any(
            one.budget is not None and bool(np.any(one.budget.at_least)) for one in (before, after)
        ),
        remarks=(*both.remarks, *approach, *remarks),
    )


def _curves(both: ResultPair, combined: Vector) -> tuple[tuple[CurveChange, ...], JointTest]:
    names = list(both.before.curves)
    ends = np.cumsum([len(both.before.curves[name]) for name in names])
    starts = [0, *ends[:-1].tolist()]
    places = {name: slice(s, int(e)) for name, s, e in zip(names, starts, ends, strict=True)}
    difference = {name: both.after.curves[name] - both.before.curves[name] for name in names}
    joint = joint_test(np.concatenate(list(difference.values())), combined)
    spread = np.sqrt(np.maximum(np.diag(combined), 0.0))
    made = [
        CurveChange(
            name=name,
            unit=curve_unit(name),
            positions=both.before.nodes_of(name),
            before=both.before.curves[name],
            before_uncertainty=both.before.standard_uncertainty[name],
            after=both.after.curves[name],
            after_uncertainty=both.after.standard_uncertainty[name],
            difference_uncertainty=spread[places[name]],
            joint=joint_test(difference[name], combined[places[name], places[name]]),
        )
        for name in names
    ]
    return tuple(made), joint


def _of_curves(curves: tuple[CurveChange, ...], joint: JointTest) -> dict[str, dict[str, float]]:
    """Return the families that look at the curves with the probability of each member."""
    nodes: dict[str, float] = {}
    for one in curves:
        chances = chance_of(one.normalised_error)
        nodes.update({_node(one.name, row): float(p) for row, p in enumerate(chances)})
    return {
        TOGETHER: {TOGETHER: joint.probability},
        CURVES: {one.name: one.joint.probability for one in curves},
        NODES: nodes,
    }


def _node(curve: str, row: int) -> str:
    return f"{curve} at {row}"


def _judged_curves(
    curves: tuple[CurveChange, ...], judgement: JointJudgement
) -> tuple[CurveChange, ...]:
    """Return the curves with whether each changed.

    Where any of the three families of the curves has changed, the single ones are named by Holm's
    method, and those of which a single node is named.
    """
    named = {member.partition(" ")[0] for member in judgement.named(NODES)}
    single = judgement.family(CURVES)
    if single is not None and judgement.changed(*OF_CURVES):
        named.update(significant_of_many(single.probabilities))
    return tuple(
        replace(one, changed=one.name in named) if one.joint.known or one.name in named else one
        for one in curves
    )


def _judged_figure(one: FigureChange, judgement: JointJudgement) -> FigureChange:
    """Return a figure with whether it changed."""
    if not np.isfinite(one.probability):
        return one
    return replace(one, changed=one.name in judgement.named(one.family))


def _figures(both: ResultPair) -> list[FigureChange]:
    """Return the figures of both; of each its size and sign as the result has it."""
    later = {figure.name: figure for figure in both.after.figures}
    shown = [figure for figure in both.before.figures if figure.name in later]
    covariance = np.zeros(len(shown))
    if np.any(both.cross):
        told = [row for row, figure in enumerate(shown) if np.isfinite(figure.value)]
        names = [shown[row].name for row in told]
        first, second = (
            figure_weights(one, names, both.chain) for one in (both.before, both.after)
        )
        cross = np.einsum("ij,jk,ik->i", first, np.nan_to_num(both.cross), second)
        # A diagonal's displacement is measured itself, with the rotations in it, which the weights
        # of nine curves have not: what both measurements share of the curves is not shared by it.
        own = [figure.name.startswith("diagonal") for figure in shown]
        covariance[told] = np.where(np.array(own)[told], 0.0, cross)
    return [
        FigureChange.of(
            figure.name,
            figure.unit,
            (figure.value, later[figure.name].value),
            (figure.standard_uncertainty, later[figure.name].standard_uncertainty),
            float(shared),
        )
        for figure, shared in zip(shown, covariance, strict=True)
    ]
