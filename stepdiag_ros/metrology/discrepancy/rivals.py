"""Rivals for one gap: how well future readings would distinguish them.

A run leaves the sizes of every rival, and the curves beside it, with some uncertainty. Each rival
predicts further readings from that. If i is the cause, the readings will be what i predicts, but
for noise; what χ² of j then grows by is

    δ²_ij = min over all free values of χ²_j(run, further readings as i predicts) - min χ²_j(run),

the squared distance of the two predictions in units of what is uncertain about them. The evidence
for i over j, ln p_i/p_j of the run itself, grows by a normally distributed amount of mean δ²/2 and
standard deviation δ. From that follows the chance of odds that make i the only name (Box & Hill
1967, Technometrics 9, 57: discrimination among mechanistic models).

The run is compressed once to a triangular factor, so that many plans can be tried.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import SECOND_ORDER_SCALE, Baseline, whiten
from stepdiag_ros.metrology.discrepancy.findings import Candidate, Diagnosis
from stepdiag_ros.metrology.discrepancy.joint import appended, run_scales
from stepdiag_ros.metrology.discrepancy.loose import loosened
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import Stops, stops_of
from stepdiag_ros.metrology.geometry import TRANSLATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.observations import observe

_RANK_LIMIT = 1e-8
"""Singular values of scaled columns below this share of the largest count as zero."""
_NOTHING = 1e-7
"""Share of a column that is rounding."""

Acting = Candidate | ActiveEffect


@dataclass(frozen=True)
class Rival:
    """An effect, or a formula, that may be the cause.

    Attributes:
        candidate: in the setting in which it fits the run best; of a formula the first shape.
        probability: of it by the evidence of the run, 0..1.
        more: further shapes of a formula, each with a size of its own.
        words: on what a formula depends; empty for an effect.
    """

    candidate: Candidate
    probability: float
    more: tuple[Candidate, ...] = ()
    words: str = ""

    @property
    def label(self) -> str:
        """Return what it is called."""
        return self.words or self.candidate.label

    @property
    def acting(self) -> tuple[Candidate, ...]:
        """Return all that acts if it is the cause."""
        return (self.candidate, *self.more)


@dataclass(frozen=True)
class RivalSeparation:
    """How well the rivals of one finding would be distinguished.

    Attributes:
        distance: δ² of the cause i from the rival j, shape (rivals, rivals).
        overlap: share of one signature that the other makes up in all readings together (squared
            cosine, of several sizes the least), shape (rivals, rivals); 0 where they have other
            numbers of sizes.
    """

    distance: Vector
    overlap: Vector


class _Part:
    """Readings in units of their noise, without what is free in them alone.

    That is all but the curves: tilts, zeros, scales of second order, lengths of the axes in a run.

    Args:
        baseline: of the readings.
        noise: standard deviation of a reading, m.
        correlation: from stop to stop of a pass.
    """

    def __init__(self, baseline: Baseline, noise: float, correlation: float) -> None:
        self._baseline = baseline
        self._noise, self._correlation = noise, correlation
        count = min(part.start for part in baseline.parts.values() if isinstance(part, slice))
        own = self._white(np.column_stack([baseline.matrix[:, count:], baseline.loose]))
        loose = baseline.loose_rows
        own[len(baseline.gap) :, own.shape[1] - len(loose) :] = loose
        self._span = _span(own)
        self.curves = self.left(baseline.matrix[:, :count])

    def _white(self, columns: Vector) -> Vector:
        return whiten(columns, self._baseline, self._noise, self._correlation)

    def left(self, columns: Vector) -> Vector:
        """Return what is left of columns of the readings, m, shape (rows, k)."""
        white = self._white(columns[self._baseline.good])
        return _beyond(self._span, white)


class FurtherReadings:
    """Stops that are still to be measured.

    Args:
        blank: their lines, numbered as a run of their own (``Line.run``), with any readings.
        stops: of the runs so far.
        diagnosis: of these: the noise.
        curves: names of the curves that the model has fixed.
    """

    def __init__(
        self,
        blank: Measurement,
        stops: Stops,
        diagnosis: Diagnosis,
        curves: Mapping[str, Sequence[float]],
    ) -> None:
        own = stops_of(blank)
        self._before = len(stops.time)
        self._together = appended(stops, own)
        lengths = run_scales(self._together)[self._before :]
        design = Design(observe(blank), "", lengths[:, np.any(lengths, axis=0)])
        matrix = design.matrix
        for name in curves:
            columns = design.curve_column[TRANSLATIONS.index(name)]
            matrix[:, columns[columns < design.count]] = 0.0
        ends = design.curve_column[design.curve_column < design.count]
        count = len(own.time)
        baseline = Baseline(
            good=np.ones(count, dtype=bool),
            gap=np.zeros(count),
            matrix=matrix,
            parts={"what one run has alone": slice(int(ends.max()) + 1, design.count)},
            loose=np.where(
                own.setup[:, None] == np.arange(len(own.setups)), own.along[:, None], 0.0
            ),
            deviation=np.full(len(own.setups), SECOND_ORDER_SCALE),
            weight=np.ones(count),
            passes=own.pass_index,
            step=0.0,
        )
        baseline = loosened(baseline, own, replace(diagnosis.loose, rotation=0.0))
        self._part = _Part(baseline, diagnosis.noise, diagnosis.noise_correlation)

    @property
    def curves(self) -> Vector:
        """Return the columns of the curves, shape (rows, c)."""
        return self._part.curves

    def of(self, acting: Sequence[Acting]) -> tuple[Vector, Vector]:
        """Return the change by a unit of each size, and what no run determines of it, (rows, k)."""
        columns, unknown = (some[self._before :] for some in _columns(acting, self._together))
        return self._part.left(columns), self._part.left(unknown[:, np.any(unknown, axis=0)])


class Contest:
    """The rivals of one finding.

    Args:
        rivals: the effects that may be the cause, at least two.
        common: effects that act beside them, with free sizes.
        baseline: of the runs so far, without these effects.
        stops: of the same.
        diagnosis: of the same: the noise.
    """

    def __init__(
        self,
        rivals: Sequence[Rival],
        common: Sequence[Acting],
        baseline: Baseline,
        stops: Stops,
        diagnosis: Diagnosis,
    ) -> None:
        self.rivals = tuple(rivals)
        self._acting: tuple[tuple[Acting, ...], ...] = (
            *((one,) for one in common),
            *(one.acting for one in rivals),
        )
        self._common = len(common)
        baseline = loosened(baseline, stops, diagnosis.loose)
        part = _Part(baseline, diagnosis.noise, diagnosis.noise_correlation)
        blocks = [part.curves]
        for one in self._acting:
            blocks += map(part.left, _columns(one, stops))
        gap = np.zeros((len(stops.time), 1))
        gap[baseline.good, 0] = baseline.gap
        blocks.append(part.left(gap))
        factor = np.linalg.qr(np.column_stack(blocks), mode="r")
        ends = np.cumsum([block.shape[1] for block in blocks])[:-1]
        self._curves, *pieces, gap = np.split(factor, ends, axis=1)
        self._gap: Vector = gap[:, 0]
        self._sizes, self._unknown = pieces[::2], pieces[1::2]
        self._alone = [self._fitted_to_runs(rival) for rival in range(len(rivals))]

    def _free(self, rival: int) -> list[int]:
        """Return which acting effects are there if a rival is the cause, itself the last."""
        return [*range(self._common), self._common + rival]

    def _fitted_to_runs(self, rival: int) -> tuple[Vector, float]:
        """Return the curves and sizes if a rival is the cause, and χ² of the runs so far."""
        acting = self._free(rival)
        blocks = [self._curves, *(self._sizes[one] for one in acting)]
        columns = np.column_stack([*blocks, *(self._unknown[one] for one in acting)])
        values, squares = _solved(columns, self._gap)
        return values[: sum(block.shape[1] for block in blocks)], squares

    def separation(self, further: FurtherReadings) -> RivalSeparation:
        """Return how well the runs so far and further readings distinguish the rivals."""
        new = [further.of(one) for one in self._acting]
        before, after = len(self._gap), len(further.curves)
        span = _span(np.vstack([self._curves, further.curves]))

        def left(old: Vector | None, later: Vector | None) -> Vector:
            """Return columns of both, beyond the curves; None is nothing."""
            width = (later if old is None else old).shape[1]  # type: ignore[union-attr]
            stacked = np.vstack(
                [
                    np.zeros((before, width)) if old is None else old,
                    np.zeros((after, width)) if later is None else later,
                ]
            )
            return _beyond(span, stacked)

        shared = [left(old, sizes) for old, (sizes, _) in zip(self._sizes, new, strict=True)]
        single = [
            np.column_stack([left(old, None), left(None, untold)])
            for old, (_, untold) in zip(self._unknown, new, strict=True)
        ]
        readings = np.column_stack(
            [
                left(self._gap[:, None], self._predicted(rival, further, new))
                for rival in range(len(self.rivals))
            ]
        )
        distance = np.zeros((len(self.rivals), len(self.rivals)))
        units = []
        for rival in range(len(self.rivals)):
            acting = self._free(rival)
            others = [shared[one] for one in acting[:-1]]
            beside = _span(np.column_stack([*others, *(single[one] for one in acting)]))
            units.append(_span(_beyond(beside, shared[acting[-1]])))
            rest = _beyond(units[-1], _beyond(beside, readings))
            distance[:, rival] = np.sum(rest**2, axis=0) - self._alone[rival][1]
        np.fill_diagonal(distance, 0.0)
        return RivalSeparation(np.maximum(distance, 0.0), _overlaps(units))

    def overlap(self) -> Vector:
        """Return the overlap of the signatures in the runs so far, shape (rivals, rivals)."""
        span = _span(self._curves)
        units = []
        for rival in range(len(self.rivals)):
            acting = self._free(rival)
            blocks = [self._sizes[one] for one in acting[:-1]]
            blocks += [self._unknown[one] for one in acting]
            beside = _span(_beyond(span, np.column_stack(blocks)))
            units.append(_span(_beyond(beside, _beyond(span, self._sizes[acting[-1]]))))
        return _overlaps(units)

    def _predicted(
        self, rival: int, further: FurtherReadings, new: Sequence[tuple[Vector, Vector]]
    ) -> Vector:
        """Return the further readings that a rival predicts, shape (rows, 1)."""
        columns = [further.curves, *(new[one][0] for one in self._free(rival))]
        predicted: Vector = np.column_stack(columns) @ self._alone[rival][0][:, None]
        return predicted


def _columns(acting: Sequence[Acting], stops: Stops) -> tuple[Vector, Vector]:
    """Return the change by a unit of each size, and what no run determines, shape (n, k) each."""
    return (
        np.column_stack([one.effect.columns(one.setting, stops) for one in acting]),
        np.column_stack([one.effect.unknown(one.setting, stops) for one in acting]),
    )


def _solved(columns: Vector, target: Vector) -> tuple[Vector, float]:
    """Return the shortest solution in scaled columns, and the sum of squares that it leaves."""
    scale = _lengths(columns)
    values = np.linalg.lstsq(columns / scale, target, rcond=_RANK_LIMIT)[0] / scale
    return values, float(np.sum((target - columns @ values) ** 2))


def _overlaps(units: Sequence[Vector]) -> Vector:
    """Return the least squared cosine of each pair of spans; 0 where they differ in size."""
    overlap = np.zeros((len(units), len(units)))
    for one, own in enumerate(units):
        for other, its in enumerate(units):
            if own.shape[1] == its.shape[1] > 0:
                cosines = np.linalg.svd(own.T @ its, compute_uv=False)
                overlap[one, other] = float(cosines[-1] ** 2)
    return overlap


def _span(columns: Vector) -> Vector:
    """Return orthonormal columns that span what some columns do, shape (rows, rank)."""
    if not columns.shape[1]:
        return columns
    left, values, _ = np.linalg.svd(columns / _lengths(columns), full_matrices=False)
    span: Vector = left[:, values > _RANK_LIMIT * max(float(values[0]), 1e-300)]
    return span


def _beyond(span: Vector, columns: Vector) -> Vector:
    """Return columns beyond a span; of what is all within it no rounding is left."""
    left: Vector = columns - span @ (span.T @ columns)
    left[:, np.linalg.norm(left, axis=0) <= _NOTHING * np.linalg.norm(columns, axis=0)] = 0.0
    return left


def _lengths(columns: Vector) -> Vector:
    lengths = np.linalg.norm(columns, axis=0)
    scale: Vector = np.where(lengths > 0.0, lengths, 1.0)
    return scale
