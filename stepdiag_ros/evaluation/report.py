"""Contents of a report, and comparison of a result with the true errors of a simulated cell."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepdiag_ros.bags.passes import Completeness
from stepdiag_ros.bags.tally import Flaw
from stepdiag_ros.metrology.curve_set import CurveSet
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.forward import ErrorCurves
from stepdiag_ros.metrology.geometry import CHAINS, ROTATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plausible import ORDINARY, Plausible
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.catalogue import in_order_of_reliance, methods, to_rely_on
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy, volumetric_accuracy
from stepdiag_ros.metrology.target import TargetStanding
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.visibility import Visibility

if TYPE_CHECKING:
    from stepdiag_ros.metrology.uncertainty.budget import Budget

ZERO_BY_DEFINITION = 1e-15
"""Below this standard uncertainty, m, a value is fixed by the frame; what is left is rounding."""
ROUNDING = 1e-6
"""Part of a standard uncertainty. A processor of another kind, whose linear algebra adds in another
order, changes a result by less."""


def method_title(method: str) -> str:
    """Return the name of a method for people."""
    return methods()[method].title if method in methods() else method


def short_title(method: str) -> str:
    """Return the name of a method for the head of a narrow column."""
    return method_title(method).split(" (")[0]


def robust_to_setup(results: Iterable[VolumetricErrors]) -> list[VolumetricErrors]:
    """Return the results of methods that do not take the setup as perfect."""
    known = methods()
    return [
        one
        for one in results
        if one.method not in known or not known[one.method].takes_setup_as_perfect
    ]


@dataclass(frozen=True)
class Truth(CurveSet):
    """The error curves that a simulated cell was built with, in the frame of the results.

    It has the nine translations, or all eighteen.

    Attributes:
        figures: squareness, straightness and positioning of these curves.
    """

    figures: tuple[Figure, ...] = ()


@dataclass(frozen=True)
class TruthComparison:
    """Deviation of a result from the true errors.

    Attributes:
        rms: over all determined points of all curves, m or rad; NaN without a point.
        largest: largest absolute deviation of a point, m or rad; NaN without a point.
        points: number of determined points.
        points_with_uncertainty: of those, the ones whose uncertainty is known and not zero.
        points_inside: of those, the ones whose 95 % coverage interval contains the true value.
    """

    rms: float
    largest: float
    points: int
    points_with_uncertainty: int
    points_inside: int

    @property
    def coverage(self) -> float:
        """Return the share (0..1) of ``points_inside``; NaN without any uncertainty."""
        if not self.points_with_uncertainty:
            return float("nan")
        return self.points_inside / self.points_with_uncertainty


@dataclass(frozen=True)
class Report:
    """Everything that a person is shown of one run.

    Attributes:
        results: one for each method that could be used.
        refused: method → why these lines are not enough for it.
        run_id: identity of the run; empty if it has none.
        plan: name of the plan.
        machine: name of the machine.
        chain: order of its axes from workpiece to tool; empty if unknown.
        run_software_version: of stepdiag_ros that made the run; empty if unknown.
        bag: the file; None if the run was not recorded.
        simulated: whether the run was made on a simulated cell; None if unknown.
        truth: of the simulated cell; None if unknown.
        measurement: the lines; None leaves their picture out.
        visibility: what these lines show of each error; None if it was not asked for.
        equals_recorded: method → whether the result equals the one in the bag bit for bit;
            methods without a recorded result are not there.
        rounded: methods whose result differs from the recorded one by rounding alone.
        remarks: about the run as a whole, in words.
        routine: those of the remarks that a summary leaves out.
        verdict: of a diagnosis of these lines, or why it is missing.
        passes: how much of the plan was measured; None if that is not known.
        recording: what is wrong with the recording: missing, doubled, out of order.
        target: how far the run has come to its target; None if it has none.
        budget: uncertainty budget of the result to rely on; None if none was made.
        rotation_stated: somebody stated how large rotations plausibly are; if not, it is assumed.
    """

    results: tuple[VolumetricErrors, ...]
    refused: Mapping[str, str] = field(default_factory=dict)
    run_id: str = ""
    plan: str = ""
    machine: str = ""
    chain: str = ""
    run_software_version: str = ""
    bag: Path | None = None
    simulated: bool | None = None
    truth: Truth | None = None
    measurement: Measurement | None = None
    visibility: Visibility | None = None
    equals_recorded: Mapping[str, bool] = field(default_factory=dict)
    rounded: frozenset[str] = frozenset()
    remarks: tuple[str, ...] = ()
    routine: tuple[str, ...] = ()
    verdict: Verdict = field(default_factory=Verdict)
    passes: Completeness | None = None
    recording: tuple[Flaw, ...] = ()
    target: TargetStanding | None = None
    budget: "Budget | None" = None
    rotation_stated: bool = False

    def ordered_results(self) -> tuple[VolumetricErrors, ...]:
        """Return the results in the order in which they are shown."""
        order = in_order_of_reliance(one.method for one in self.results)
        return tuple(sorted(self.results, key=lambda one: order.index(one.method)))

    @property
    def plausible(self) -> Plausible:
        """Return how large rotations are of which the lines show nothing."""
        return ORDINARY if self.measurement is None else self.measurement.plausible

    def preferred(self) -> VolumetricErrors | None:
        """Return the result to rely on; None without a result of a method to rely on."""
        best = to_rely_on(one.method for one in self.results)
        return next((one for one in self.results if one.method == best), None)


def frame_sentences(results: Sequence[VolumetricErrors]) -> list[str]:
    """Say in which frame results are given: one sentence for each different frame."""
    frames: dict[str, list[str]] = {}
    for result in results:
        frames.setdefault(result.frame, []).append(short_title(result.method))
    if len(frames) == 1:
        return [f"Frame: {frame}." for frame in frames]
    return [f"Frame of {' and '.join(methods)}: {frame}." for frame, methods in frames.items()]


def true_largest(truth: Truth, chain: str) -> VolumetricAccuracy:
    """Return the longest true error vector over the nodes of the measured volume.

    Args:
        truth: of a simulated cell.
        chain: order of its axes; where it is not known, the true errors are without rotations too.
    """
    curves = ErrorCurves.from_curves(truth.nodes, truth.curves)
    return volumetric_accuracy(curves, chain or CHAINS[0])


def compare_with_truth(
    result: VolumetricErrors, truth: Truth, rotations: bool = False
) -> TruthComparison:
    """Compare the translations (or rotations) of a result with the true errors, node by node.

    Points without uncertainty are fixed by the definition of the frame; they count for the rms, but
    not for the coverage.

    Raises:
        ValueError: the true errors lack a curve or have it at other nodes. (True errors
            without any rotation leave nothing to compare rotations with.)
    """
    names = [name for name in result.curves if (name in ROTATIONS) == rotations]
    if rotations and not any(name in truth.curves for name in ROTATIONS):
        names = []
    deviations, uncertainties = [np.empty(0)], [np.empty(0)]
    for name in names:
        estimated = np.asarray(result.curves[name], dtype=np.float64)
        if name not in truth.curves:
            raise ValueError(f"the true errors lack the curve {name}")
        true = np.asarray(truth.curves[name], dtype=np.float64)
        if true.shape != estimated.shape:
            raise Refusal(
                f"the true curve {name} has {true.size} nodes, the result has {estimated.size}",
                fault="mismatch",
            )
        deviations.append(estimated - true)
        uncertainties.append(np.asarray(result.standard_uncertainty[name], dtype=np.float64))
    deviation = np.concatenate(deviations)
    uncertainty = np.concatenate(uncertainties)
    determined = np.isfinite(deviation)
    banded = determined & np.isfinite(uncertainty) & (uncertainty > ZERO_BY_DEFINITION)
    inside = np.abs(deviation[banded]) <= COVERAGE_FACTOR * uncertainty[banded]
    found = np.abs(deviation[determined])
    return TruthComparison(
        rms=float(np.sqrt(np.mean(found**2))) if found.size else float("nan"),
        largest=float(np.max(found)) if found.size else float("nan"),
        points=int(np.count_nonzero(determined)),
        points_with_uncertainty=int(np.count_nonzero(banded)),
        points_inside=int(np.count_nonzero(inside)),
    )


def _same_bits(first: object, second: object) -> bool:
    a = np.atleast_1d(np.asarray(first, dtype=np.float64))
    b = np.atleast_1d(np.asarray(second, dtype=np.float64))
    if a.shape != b.shape:
        return False
    both_unknown = np.isnan(a) & np.isnan(b)
    return bool(np.all(both_unknown | (a.view(np.int64) == b.view(np.int64))))


def same_to_the_last_bit(first: VolumetricErrors, second: VolumetricErrors) -> bool:
    """Say whether two results are the same in every bit of every number, and in every word.

    Covariances are not compared: a recorded result does not hold them.
    """
    for entry in fields(VolumetricErrors):
        if not entry.compare:
            continue
        a, b = getattr(first, entry.name), getattr(second, entry.name)
        if entry.name == "nodes":
            same = len(a) == len(b) and all(map(_same_bits, a, b))
        elif entry.name in ("curves", "standard_uncertainty"):
            same = a.keys() == b.keys() and all(_same_bits(a[name], b[name]) for name in a)
        elif entry.name == "figures":
            same = len(a) == len(b) and all(map(_same_figure, a, b))
        elif entry.name == "chi_squared":
            same = _same_bits(a, b)
        else:
            same = a == b
        if not same:
            return False
    return True


def same_but_for_rounding(first: VolumetricErrors, second: VolumetricErrors) -> bool:
    """Say whether two results differ by no more than processors of different kinds round.

    No value differs by more than ``ROUNDING`` times its standard uncertainty (times itself where
    that is unknown), and no uncertainty and no χ² by more than ``ROUNDING`` times itself.
    """
    names = [
        (tuple(one.curves), tuple((figure.name, figure.unit) for figure in one.figures))
        for one in (first, second)
    ]
    if names[0] != names[1]:
        return False
    (values, uncertainty), (others, other_uncertainty) = _numbers(first), _numbers(second)
    if values.shape != others.shape:
        return False
    scale = np.where(uncertainty > ZERO_BY_DEFINITION, uncertainty, np.abs(values))
    near = np.abs(values - others) <= ROUNDING * scale + ZERO_BY_DEFINITION
    return bool(
        np.all(near | (np.isnan(values) & np.isnan(others)))
        and _near(uncertainty, other_uncertainty)
        and _near(np.array(first.chi_squared), np.array(second.chi_squared))
    )


def _near(first: Vector, second: Vector) -> bool:
    return np.allclose(first, second, ROUNDING, ZERO_BY_DEFINITION, equal_nan=True)


def _numbers(result: VolumetricErrors) -> tuple[Vector, Vector]:
    """Return all values of a result, and their standard uncertainties in the same order."""
    values = [*result.curves.values(), np.array([one.value for one in result.figures])]
    uncertainty = [
        *(result.standard_uncertainty[name] for name in result.curves),
        np.array([one.standard_uncertainty for one in result.figures]),
    ]
    return np.concatenate(values), np.concatenate(uncertainty)


def _same_figure(first: Figure, second: Figure) -> bool:
    return (first.name, first.unit) == (second.name, second.unit) and _same_bits(
        [first.value, first.standard_uncertainty], [second.value, second.standard_uncertainty]
    )
