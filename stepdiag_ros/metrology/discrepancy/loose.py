"""Scatter of every run that is not an effect: the zero of each pass and rotations of all axes.

Such things have no single size to be found, only a typical one. They enter the baseline as free
values that are known to be small: each is one more column, and one more observation of zero with
the typical size as its standard uncertainty. The sizes themselves come from the run, by the
evidence (restricted maximum likelihood; Patterson & Thompson 1971, Biometrika 58, 545):

    ln p(r) = -½ ln|1 + D S D| + ½ (D b)ᵀ (1 + D S D)⁻¹ (D b) + const,    S = Zᵀ Z,  b = Zᵀ r,

with r the gap and Z the columns, both in units of the noise and beyond all that is free, and D the
sizes on the diagonal.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Baseline, Whitened
from stepdiag_ros.metrology.discrepancy.chance import tail_of
from stepdiag_ros.metrology.discrepancy.findings import Candidate, Loose
from stepdiag_ros.metrology.discrepancy.patterns import TURNED, patterns
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.plausible import ORDINARY, mode_count, rotation_readings

LARGEST_WANDER = 0.3e-6
"""m: a zero that scatters by more from pass to pass is not ordinary scatter but an effect."""
LARGEST_INCLINATION = 0.15e-6
"""m: the same of what a pass gains or loses from its middle to its end."""
_WANDERS = (0.03e-6, 0.05e-6, 0.07e-6, 0.1e-6, 0.14e-6, 0.2e-6, 0.28e-6, 0.4e-6, 0.8e-6)
_WORTH = 2.0
"""Evidence that a scatter must gain to be taken for one."""
_TRIED = 9.0
"""Evidence that a shape loses for the some ten thousand that were tried."""
_PASS = {"repeat"}
"""Keys of a setting that ties an effect to one pass."""
_LEVEL = 1e-5
"""Probability at which candidates are distinguished from scatter of a size known from few
passes.
"""
_SIZES = 40
_DRAWS = 4000
_RANK_LIMIT = 1e-9
_FOLLOWED = 1e-3
"""Share of a column beyond the baseline below which only rounding is left of it."""


def loosened(baseline: Baseline, stops: Stops, loose: Loose) -> Baseline:
    """Return a baseline with what scatters in a run among its free values."""
    zeros, slopes = pass_shapes(stops)
    parts = [(zeros, loose.zero), (slopes, loose.slope)]
    if loose.rotation:
        parts.append((rotation_columns(stops), loose.rotation))
    for columns, size in parts:
        if size:
            baseline = baseline.with_loose(columns[baseline.good], size)
    return baseline


def pass_shapes(stops: Stops) -> tuple[Vector, Vector]:
    """Return the zero of each pass and its straight change from -1 to 1, shape (n, passes) each."""
    passes = (stops.pass_index[:, None] == np.arange(len(stops.lines))).astype(np.float64)
    length = np.bincount(stops.pass_index, minlength=len(stops.lines))
    along = 2.0 * stops.number / np.maximum(length[stops.pass_index] - 1, 1) - 1.0
    return passes, passes * along[:, None]


def rotation_columns(stops: Stops) -> Vector:
    """Return what each mode of each rotation adds to the readings, m/rad; see ``plausible``.

    Raises:
        ValueError: the chain is not known.
    """
    arms = np.stack(stops.arms, axis=1)
    places = (np.unique(np.round(stops.share[:, axis], 9)) for axis in range(3))
    blocks = max(len(one) for one in places) - 1
    return rotation_readings(stops.share, stops.direction, arms, mode_count(blocks))


def _free(stops: Stops, candidates: Sequence[Candidate]) -> Vector:
    parts = [one.free(stops) for one in candidates]
    return np.column_stack([np.zeros((len(stops.time), 0)), *parts])


@dataclass(frozen=True)
class _Problem:
    """S and b of columns beyond all that is free."""

    products: Vector
    parts: Vector

    @classmethod
    def of(cls, problem: Whitened, columns: Vector, span: Vector) -> "_Problem":
        """Make it of columns of all stops, m, beyond orthonormal ones that are free beside it."""
        left = problem.left_of(columns)
        left -= span @ (span.T @ left)
        return cls(left.T @ left, left.T @ problem.gap)

    def evidence(self, sizes: Vector) -> float:
        """Return ln p of sizes of the columns against that of none."""
        scaled = np.eye(len(sizes)) + sizes[:, None] * self.products * sizes
        factor = np.linalg.cholesky(scaled)
        pulled = np.linalg.solve(factor, sizes * self.parts)
        return float(0.5 * pulled @ pulled - np.sum(np.log(np.diag(factor))))


def unit_span(columns: Vector) -> Vector:
    """Return orthonormal columns that span what some columns do, shape (rows, rank)."""
    lengths = np.linalg.norm(columns, axis=0)
    columns = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    if not columns.shape[1]:
        return columns
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    span: Vector = left[:, values > _RANK_LIMIT**0.5 * values[0]]
    return span


def span_beyond(problem: Whitened, columns: Vector) -> Vector:
    """Return orthonormal columns that span what the baseline cannot follow of columns, (rows, k).

    Of a column that the baseline follows, only rounding is left, which spans nothing.

    Args:
        problem: whitened, the baseline projected out.
        columns: of all stops, m, shape (n, k).
    """
    left = problem.left_of(columns)
    before = np.linalg.norm(columns, axis=0) / problem.noise
    return unit_span(left[:, np.linalg.norm(left, axis=0) > _FOLLOWED * before])


def estimate_wander(
    problem: Whitened, stops: Stops, candidates: Sequence[Candidate], noise_freedom: float
) -> Loose:
    """Return how the zero scatters from pass to pass beside what was found.

    Only repeats determine it: what passes of one setup in one direction do not share; where nothing
        is
    repeated, what forward and backward passes do not share. It is a scatter only if no few shapes
    explain it better, such as a growth with time or one jump. Effects of single passes, with which
    any scatter can be imitated, do not count as found.

    Few passes determine the size of a scatter badly. It is enlarged, so that a test with
    a normal distribution errs as seldom as it should (Student's distribution).

    Args:
        problem: whitened, without any scatter of passes in its baseline.
        stops: of the run.
        candidates: effects that were found, their sizes free.
        noise_freedom: degrees of freedom of the noise.
    """
    from scipy.special import ndtri, stdtrit

    candidates = [one for one in candidates if _PASS.isdisjoint(one.setting)]
    kinds = _kinds(stops)
    shared = np.column_stack([shapes @ kinds for shapes in pass_shapes(stops)])
    freedom = repeated_passes(stops)
    if freedom < 1:
        return Loose()
    span = unit_span(problem.left_of(_free(stops, candidates)))
    both = unit_span(np.column_stack([span, problem.left_of(shared)]))
    evidence = _by_size(problem, stops, both)
    sizes = max(filter(_ordinary, evidence), key=lambda one: evidence[one])
    best = evidence[sizes]
    gap = problem.gap - both @ (both.T @ problem.gap)
    if best < max(_WORTH, max(evidence.values()) - _WORTH):
        return Loose()
    # Every workshop has a scatter; what takes its place has to be clearly likelier.
    shape = _shape_evidence(problem, gap, both, stops, noise_freedom)
    if shape > best + np.log(EVIDENCE_RATIO):
        return Loose()
    wider = float(stdtrit(max(freedom, 3), _LEVEL) / ndtri(_LEVEL))
    return Loose(zero=wider * sizes[0], slope=wider * sizes[1])


def wander_evidence(problem: Whitened, stops: Stops) -> float:
    """Return ln p of an ordinary scatter from pass to pass against that of none.

    Nothing else is taken as found. The scatter has the size that is likeliest, not the enlarged
    one of ``estimate_wander``.

    Args:
        problem: whitened, without any scatter of passes in its baseline.
        stops: of the run.
    """
    found = _by_size(problem, stops, np.zeros((len(problem.gap), 0)))
    return max(evidence for sizes, evidence in found.items() if _ordinary(sizes))


def _by_size(problem: Whitened, stops: Stops, span: Vector) -> dict[tuple[float, float], float]:
    """Return ln p of each scatter of zero and slope (m) beside a span, against that of none."""
    made = _Problem.of(problem, np.column_stack(pass_shapes(stops)), span)
    return {
        (zero, slope): made.evidence(np.repeat([zero, slope], len(stops.lines)))
        for zero in (0.0, *_WANDERS)
        for slope in (0.0, *_WANDERS)
    }


def _ordinary(sizes: tuple[float, float]) -> bool:
    return sizes[0] <= LARGEST_WANDER and sizes[1] <= LARGEST_INCLINATION


def repeated_passes(stops: Stops) -> int:
    """Return how many passes repeat another one; without any, no scatter shows."""
    passes, kinds = map(int, _kinds(stops).shape)
    return passes - kinds


def _kinds(stops: Stops) -> Vector:
    """Return which passes are repeats of one another, shape (passes, kinds).

    Where no pass is repeated, one in each direction over the same places counts as that.
    """
    kinds = _alike(stops, by_direction=True)
    return kinds if kinds.shape[1] < len(kinds) else _alike(stops, by_direction=False)


def _alike(stops: Stops, by_direction: bool) -> Vector:
    setup = [int(stops.setup[stops.pass_index == index][0]) for index in range(len(stops.lines))]
    keys = [
        (number, line.order, line.direction if by_direction else "")
        for number, line in zip(setup, stops.lines, strict=True)
    ]
    kinds = list(dict.fromkeys(keys))
    return np.array([[key == kind for kind in kinds] for key in keys], dtype=np.float64)


def _shape_evidence(
    problem: Whitened, gap: Vector, span: Vector, stops: Stops, noise_freedom: float
) -> float:
    """Return the evidence for what a gap looks like, by single shapes (``patterns``)."""
    best = total = 0.0
    repeated = _alike(stops, by_direction=True).shape
    for one in patterns(problem, gap, span, stops, noise_freedom):
        # Without repeats, the scatter of the passes is what the directions differ by.
        if one.with_what == TURNED and repeated[0] == repeated[1]:
            continue
        total += 0.5 * (one.gain - one.columns * np.log(len(gap))) - _TRIED
        best = max(best, total)
    return best


def beyond(
    problem: Whitened, stops: Stops, candidates: Sequence[Candidate]
) -> tuple[Vector, Vector]:
    """Return what candidates of free sizes leave of a gap, and what they span, whitened."""
    span = unit_span(problem.left_of(_free(stops, candidates)))
    return problem.gap - span @ (span.T @ problem.gap), span


@dataclass(frozen=True)
class RotationTest:
    """Whether several axes turn: rotations of all of them against none.

    Attributes:
        size: of the rotations by the evidence, rad.
        standard_uncertainty: of ``size``, rad.
        evidence: ln p of rotations, averaged over all their sizes, against that of none.
        gain: what χ² loses by free rotations.
        columns: number of independent sums of rotations that the run shows.
        p_value: chance of such evidence where no axis turns.
    """

    size: float
    standard_uncertainty: float
    evidence: float
    gain: float
    columns: int
    p_value: float


def judge_rotations(
    problem: Whitened,
    stops: Stops,
    candidates: Sequence[Candidate],
    noise_freedom: float,
    seed: int,
) -> RotationTest:
    """Test a run for rotations of all axes.

    Args:
        problem: whitened, without rotations in its baseline.
        stops: of the run, its chain known.
        candidates: effects that were found, their sizes free.
        noise_freedom: degrees of freedom of the noise.
        seed: of the draws that show the influence of chance.
    """
    span = unit_span(problem.left_of(_free(stops, candidates)))
    columns = rotation_columns(stops)
    made = _Problem.of(problem, columns, span)
    values, vectors = np.linalg.eigh(made.products)
    seen = values > _RANK_LIMIT * values[-1]
    values, vectors = values[seen], vectors[:, seen]
    parts = vectors.T @ made.parts
    sizes = ORDINARY.rotation * np.geomspace(1e-2, 30.0, _SIZES)
    spread = 1.0 + sizes[:, None] ** 2 * values
    share = sizes[:, None] ** 2 / spread
    cost = 0.5 * np.sum(np.log(spread), axis=1)
    evidence = 0.5 * share @ parts**2 - cost
    best = int(np.argmax(evidence))
    rng = np.random.default_rng(seed)
    # Size and memory of every draw's noise are estimated as those of the run. An error of the
    # memory makes all that is slow larger or smaller together, and rotations are slow.
    left = problem.left_of(columns)
    units = (left - span @ (span.T @ left)) @ (vectors / np.sqrt(values))
    memory = rng.standard_normal(_DRAWS) / np.sqrt(noise_freedom)
    spread_by_memory = np.maximum(1.0 + np.outer(memory, problem.slowness(units)), 0.0)
    variance = rng.chisquare(noise_freedom, _DRAWS) / noise_freedom
    draws = rng.standard_normal((_DRAWS, len(values))) ** 2 / variance[:, None]
    draws *= spread_by_memory
    luck = np.max(0.5 * (draws * values) @ share.T - cost, axis=1)
    likeliest = float(evidence[best])
    weight = np.exp(evidence - likeliest)
    whole = likeliest + float(np.log(np.mean(weight)))
    weight /= np.sum(weight)
    mean = float(weight @ sizes)
    return RotationTest(
        size=float(sizes[best]),
        standard_uncertainty=float(np.sqrt(weight @ (sizes - mean) ** 2)),
        evidence=whole,
        gain=float(np.sum(parts**2 / values)),
        columns=len(values),
        p_value=tail_of(luck, likeliest),
    )
