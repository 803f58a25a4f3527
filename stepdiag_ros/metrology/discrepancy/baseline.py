"""What the machine model leaves free, fitted to a run: the gap, and what the fit cannot follow.

Free are the nine translational curves at every node, two tilts for each diagonal setup and a zero
for each setup (``solvers.design``), a zero for each pass where passes were zeroed one by one,
the first stops of passes of which is not known how the machine came to them, a scale of each axis
in each run after the first where several are joined (``joint``), and the sizes of effects that the
model says are to be fitted. A smoother baseline makes false names.

The exact model is fitted once; from there on everything is linear: what an effect of a micrometre
changes in tilts and curves acts on the readings by products of a few nanometres at most.

The beam's own direction acts as a scale of second order of each setup, |δl|²/2 - δl·δm, which
the tilts do not determine. It is a free value too, but one that is known to be small: it enters
with a standard uncertainty, as one more observation per setup. Without that, long lines are given
false cosine errors. What scatters in every run, the zero from pass to pass and rotations of the
axes, is let in the same way (``loose``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from stepdiag_ros.metrology.discrepancy.joint import run_scales
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, TRANSLATIONS, Vector, moving_axis
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import FORWARD
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.observations import observe

SECOND_ORDER_SCALE = 1e-7
"""Standard uncertainty of a setup's scale by beam and mirror each 0.3 mrad off: (0.3 mrad)²."""
_RANK_LIMIT = 1e-9
"""Singular values of the scaled baseline below this share of the largest count as zero."""
_EXACT_ZERO = 1e-12
AT_ONCE = 256
"""Columns that are written out at a time."""


@dataclass(frozen=True)
class Baseline:
    """The fitted baseline of a run. Rows are the readings that have a value, in order.

    Attributes:
        good: which stops have a value, shape (stops,).
        gap: measured minus simulated, with all free values fitted, m, shape (n,).
        matrix: derivatives of the readings by the free values, shape (n, p).
        parts: name of a part of the baseline → its columns, such as ``the curve E_XX``.
        loose: derivatives of the readings by values that are free but known to be small, m per
            their unit, shape (n, q).
        deviation: standard uncertainty of each of these, shape (q,).
        weight: uncertainty of each reading as a multiple of the common one, shape (n,).
        passes: index of each reading's pass, shape (n,).
        step: that readings come in, m; 0 if they are not rounded.
    """

    good: NDArray[np.bool_]
    gap: Vector
    matrix: Vector
    parts: dict[str, slice | NDArray[np.int64]]
    loose: Vector
    deviation: Vector
    weight: Vector
    passes: NDArray[np.int64]
    step: float

    def with_loose(self, columns: Vector, deviation: float) -> "Baseline":
        """Return the baseline with more values that are free but known to be small.

        Args:
            columns: derivatives of the readings by them, shape (n, k).
            deviation: standard uncertainty of each.
        """
        return replace(
            self,
            loose=np.column_stack([self.loose, columns]),
            deviation=np.append(self.deviation, np.full(columns.shape[1], deviation)),
        )

    def with_free(self, columns: Vector) -> "Baseline":
        """Return the baseline with more values that are free altogether.

        Args:
            columns: derivatives of the readings by them, m per their unit, shape (n, k).
        """
        return replace(self, matrix=np.column_stack([self.matrix, columns]))

    @property
    def loose_rows(self) -> Vector:
        """Return the observations that keep the loose values small, whitened, shape (q, q)."""
        rows: Vector = np.diag(1.0 / self.deviation)
        return rows

    def spread(self, values: Vector) -> Vector:
        """Return values of the readings at all stops, NaN at those that were rejected."""
        whole = np.full(len(self.good), np.nan)
        whole[self.good] = values
        return whole


def fit_baseline(
    measurement: Measurement,
    stops: Stops,
    known: Sequence[ActiveEffect] = (),
    fitted: Sequence[ActiveEffect] = (),
    curves: Mapping[str, Sequence[float]] | None = None,
) -> Baseline:
    """Fit what is free to a run.

    Args:
        measurement: the run.
        stops: of the same run.
        known: effects that the model has with fixed sizes.
        fitted: effects that the model has with free sizes.
        curves: name → values at the nodes, m, of curves that the model has fixed.

    Raises:
        NotDeterminable: there is no reading at all.
        ValueError: lines that contradict the volume or each other, a curve that is not
            translational, or one with a wrong number of values.
    """
    curves = curves or {}
    good = np.isfinite(np.concatenate([line.displacement for line in measurement.lines]))
    taken = sum(
        (effect.readings(stops) for effect in known), _of_curves(curves, measurement, stops)
    )
    observations = observe(without_readings(measurement, taken))
    further = _pass_zeros(measurement, stops)
    untold = [active.effect.unknown(active.setting, stops) for active in known]
    lengths = run_scales(stops)
    free = [
        part
        for one in fitted
        if not one.effect.typical
        for part in (one.effect.columns(one.setting, stops), one.effect.unknown(one.setting, stops))
    ]
    extra = np.column_stack([further, _approaches(stops), *untold, *free, lengths])[good]
    design = Design(observations, "", extra)
    matrix = design.matrix
    fit = design.fit()
    gap = observations.excess - fit.fitted
    uncertainty = observations.uncertainty
    weight = (
        uncertainty / np.sqrt(np.mean(uncertainty**2))
        if observations.noise_known
        else np.ones(len(gap))
    )
    parts: dict[str, slice | NDArray[np.int64]] = {
        f"the curve {name}": np.asarray(columns[columns < design.count])
        for name, columns in zip(TRANSLATIONS, design.curve_column, strict=True)
    }
    for name in curves:
        place = TRANSLATIONS.index(name)
        free = design.curve_column[place] < design.count
        columns = design.curve_column[place][free]
        # What the fit above gave to a curve that is fixed goes back into the gap.
        gap = gap + matrix[:, columns] @ fit.curves.reshape(len(TRANSLATIONS), -1)[place][free]
        matrix[:, columns] = 0.0
        del parts[f"the curve {name}"]
    first = int(design.tilt_column.min()) if design.tilt_column.size else design.count
    zeros = int(design.zero_column[0])
    if design.tilt_column.size:
        parts["the tilts of the setups"] = slice(first, zeros)
    parts["the zeros of the setups"] = slice(zeros, zeros + len(observations.setups))
    end = design.count - lengths.shape[1]
    if end > design.count - extra.shape[1]:
        parts["the zeros of the passes and the fitted effects"] = slice(
            design.count - extra.shape[1], end
        )
    if lengths.shape[1]:
        parts["the lengths of the axes in later runs"] = slice(end, design.count)
    way = np.sum(stops.direction * (stops.position - stops.start), axis=1)[good]
    setup = stops.setup[good]
    scales = np.where(setup[:, None] == np.arange(len(stops.setups)), way[:, None], 0.0)
    return Baseline(
        good=good,
        gap=gap,
        matrix=matrix,
        parts=parts,
        loose=scales,
        deviation=np.full(scales.shape[1], SECOND_ORDER_SCALE),
        weight=weight,
        passes=stops.pass_index[good],
        step=(observe(measurement) if np.any(taken) else observations).step,
    )


def _of_curves(
    curves: Mapping[str, Sequence[float]], measurement: Measurement, stops: Stops
) -> Vector:
    """Return what fixed curves add to the readings, m, shape (stops,)."""
    total = np.zeros(len(stops.time))
    volume = measurement.volume
    for name, values in curves.items():
        if name not in TRANSLATIONS:
            raise ValueError(f"{name} is not a translational error curve; only such can be fixed")
        if len(values) != volume.blocks + 1:
            raise ValueError(
                f"{name}: {len(values)} values are given, the run has {volume.blocks + 1} nodes"
            )
        axis = moving_axis(name)
        nodes = volume.nodes(axis) - volume.origin[axis]
        values_at = np.interp(stops.position[:, axis], nodes, np.asarray(values, dtype=np.float64))
        total += stops.direction[:, AXES.index(name[2])] * values_at
    return total


def without_readings(measurement: Measurement, taken: Vector) -> Measurement:
    """Return the measurement with something taken off each reading, m, shape (stops,)."""
    lines, place = [], 0
    for line in measurement.lines:
        count = len(line.displacement)
        lines.append(replace(line, displacement=line.displacement - taken[place : place + count]))
        place += count
    return replace(measurement, lines=tuple(lines))


def _pass_zeros(measurement: Measurement, stops: Stops) -> Vector:
    """Return a column for each pass that has a zero of its own, shape (stops, passes).

    Where every forward pass of a setup begins with exactly nothing, each was zeroed at its first
    stop, whose noise then is in all of the pass.
    """
    own: list[int] = []
    by_setup: dict[str, list[int]] = {}
    for index, line in enumerate(measurement.lines):
        by_setup.setdefault(line.setup, []).append(index)
    for members in by_setup.values():
        again = [
            index
            for index in members[1:]
            if measurement.lines[index].line.direction == FORWARD
            and measurement.lines[members[0]].line.direction == FORWARD
        ]
        starts = [abs(float(measurement.lines[index].displacement[0])) for index in again]
        if starts and max(starts) <= _EXACT_ZERO:
            own.extend(members[1:])
    # One exact zero may be chance where readings are rounded; all of them are not.
    columns = stops.pass_index[:, None] == np.array(own, dtype=np.int64)
    zeros: Vector = columns.astype(np.float64)
    return zeros


def _approaches(stops: Stops) -> Vector:
    """Return a column for stops of passes before an axis's first move, with an unknown approach.

    Passes of one setup in the same direction have it in common, but for the first one of the setup,
    before which the machine may have come from anywhere. What reversal error or settling makes at
    such a stop depends on whether the axis turned round there, so it says nothing of either.
    """
    rows = np.flatnonzero(~stops.approach_told)
    _, begins = np.unique(stops.setup, return_index=True)
    opening = stops.pass_index[begins]
    kinds: dict[tuple[int, str, bool, int], list[int]] = {}
    for row in rows:
        line, setup = stops.lines[stops.pass_index[row]], int(stops.setup[row])
        opens = bool(stops.pass_index[row] == opening[setup])
        kind = (setup, line.direction, opens, int(stops.number[row]))
        kinds.setdefault(kind, []).append(int(row))
    columns = np.zeros((len(stops.time), len(kinds)))
    for column, alike in enumerate(kinds.values()):
        columns[alike, column] = 1.0
    return columns


@dataclass(frozen=True)
class Whitened:
    """The linear problem with independent noise of unit size, baseline projected out.

    Rows are the readings, then one observation of each loose value.

    Attributes:
        baseline: from which it is made.
        noise: standard deviation of a reading, m.
        correlation: of the noise of neighbouring stops of a pass.
        span: orthonormal columns that the baseline spans, shape (rows, rank).
        gap: what the baseline does not follow, shape (rows,).
    """

    baseline: Baseline
    noise: float
    correlation: float
    span: Vector
    gap: Vector

    @property
    def freedom(self) -> int:
        """Return readings minus determined free values."""
        return len(self.gap) - int(self.span.shape[1])

    def of(self, columns: NDArray[Any]) -> Vector:
        """Return columns of the readings (m) with white noise of unit size, shape (rows, k)."""
        return whiten(columns, self.baseline, self.noise, self.correlation)

    def projected(self, columns: Vector) -> Vector:
        """Return what the baseline cannot follow of whitened columns, shape (rows, k)."""
        left: Vector = columns - self.span @ (self.span.T @ columns)
        return left

    def left_of(self, columns: NDArray[Any]) -> Vector:
        """Return what the baseline cannot follow of columns of all stops (m), whitened, (rows, k).

        Of a long run, columns of all passes are among the largest things that a diagnosis makes, so
        that only a few of them are copied at a time.
        """
        left: Vector = np.empty((len(self.gap), columns.shape[1]))
        for start in range(0, columns.shape[1], AT_ONCE):
            here = slice(start, start + AT_ONCE)
            left[:, here] = self.projected(self.of(columns[:, here][self.baseline.good]))
        return left

    def pulled(self, vectors: Vector) -> Vector:
        """Return whitened vectors times the derivatives of ``of``, its transpose, shape (n, k).

        Args:
            vectors: shape (rows, k).
        """
        pulled = vectors[: len(self.baseline.gap)].copy()
        rho = self.correlation
        if rho:
            root = np.sqrt(1.0 - rho * rho)
            follows = self.baseline.passes[1:] == self.baseline.passes[:-1]
            pulled[1:][follows] /= root
            pulled[:-1][follows] -= rho / root * vectors[1 : len(pulled)][follows]
        made: Vector = pulled / (self.noise * self.baseline.weight[:, None])
        return made

    def slowness(self, units: Vector) -> Vector:
        """Return by what share a memory larger by one makes the square in each column larger.

        Args:
            units: columns of unit length, whitened, shape (rows, k).

        Returns:
            shape (k,): from -2 for what alternates from stop to stop to 2 for what is slow.
        """
        passes = self.baseline.passes
        follows = np.flatnonzero(passes[1:] == passes[:-1]) + 1
        slow = np.zeros(units.shape[1])
        for start in range(0, len(follows), AT_ONCE):
            some = follows[start : start + AT_ONCE]
            slow += 2.0 * np.sum(units[some] * units[some - 1], axis=0)
        return slow

    def readings(self, values: Vector) -> Vector:
        """Return whitened values as values of the readings again, m, shape (n,)."""
        plain = values[: len(self.baseline.gap)].copy()
        rho = self.correlation
        if rho:
            passes = self.baseline.passes
            for row in range(1, len(plain)):
                if passes[row] == passes[row - 1]:
                    plain[row] = rho * plain[row - 1] + np.sqrt(1.0 - rho * rho) * plain[row]
        back: Vector = plain * self.baseline.weight * self.noise
        return back


def whiten(columns: NDArray[Any], baseline: Baseline, noise: float, correlation: float) -> Vector:
    """Return columns in units of the noise, independent along each pass, with rows of the loose."""
    count = len(baseline.gap)
    padded: Vector = np.zeros((count + len(baseline.deviation), columns.shape[1]))
    scaled = padded[:count]
    np.divide(columns, noise * baseline.weight[:, None], out=scaled)
    if correlation:
        follows = baseline.passes[1:] == baseline.passes[:-1]
        scaled[1:][follows] = (scaled[1:][follows] - correlation * scaled[:-1][follows]) / np.sqrt(
            1.0 - correlation * correlation
        )
    return padded


def whitened(baseline: Baseline, noise: float, correlation: float) -> Whitened:
    """Return the problem for a given noise (m) and its correlation from stop to stop."""
    count, loose = baseline.matrix.shape[1], baseline.loose.shape[1]
    rows = len(baseline.gap) + len(baseline.deviation)
    whole = np.empty((rows, count + loose), order="F")
    for start in range(0, count, AT_ONCE):
        here = slice(start, min(start + AT_ONCE, count))
        whole[:, here] = whiten(baseline.matrix[:, here], baseline, noise, correlation)
    whole[:, count:] = whiten(baseline.loose, baseline, noise, correlation)
    whole[len(baseline.gap) :, count:] = baseline.loose_rows
    lengths = np.sqrt(np.einsum("ij,ij->j", whole, whole))
    whole /= np.where(lengths > 0.0, lengths, 1.0)
    # Singular vectors by the small normal matrix would lose half of the digits.
    across, small = qr(whole, mode="economic", overwrite_a=True, check_finite=False)
    left, values, _ = np.linalg.svd(small, full_matrices=False)
    span = across @ left[:, values > _RANK_LIMIT * values[0]]
    gap = whiten(baseline.gap[:, None], baseline, noise, correlation)[:, 0]
    return Whitened(baseline, noise, correlation, span, gap - span @ (span.T @ gap))
