"""Proof on data that took no part in the fit: does the named effect predict them better?

Some readings are held out. Everything free, and the sizes of the effects, is fitted to the others;
from these the held-out readings are predicted, without and with the effects. The χ² of a prediction
counts its whole uncertainty, that of the fit too: it is what χ² of a fit to all readings has more
than that of a fit to the training readings, with as many degrees of freedom as the readings have
more (recursive residuals; Brown, Durbin & Evans 1975). What the training readings do not determine,
such as the tilts of a setup that is held out whole, costs degrees of freedom and is not counted as
gap.

Where an effect is small in what was held out, both predictions are good, and their χ² per degree of
freedom say little. What the effect itself is worth there is tested by itself: the difference of the
two predictions is a known shape, made from the other readings alone, and by how much of it the
held-out readings follow is normally distributed about zero if there is no effect.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.discrepancy.baseline import Baseline
from stepdiag_ros.metrology.discrepancy.findings import Diagnosis
from stepdiag_ros.metrology.discrepancy.loose import loosened, rotation_columns
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement

Booleans = NDArray[np.bool_]

_LEAST_SHARE = 0.1
"""Share of the run's information on an effect that each part of a split must have."""
_EVERY = 3
_RANK_LIMIT = 1e-9


@dataclass(frozen=True)
class Prediction:
    """How well held-out readings were predicted.

    Attributes:
        chi_squared: with the uncertainty of the prediction counted in.
        degrees_of_freedom: of ``chi_squared``.
        p_value: chance of so large a χ² if nothing is missing; NaN without degrees of freedom.
        residual: measured minus predicted, m, shape (stops,); NaN where not held out.
    """

    chi_squared: float
    degrees_of_freedom: int
    p_value: float
    residual: Vector

    @property
    def reduced(self) -> float:
        """Return χ² per degree of freedom, NaN without any."""
        freedom = self.degrees_of_freedom
        return self.chi_squared / freedom if freedom > 0 else float("nan")


@dataclass(frozen=True)
class HeldOut:
    """Prediction of held-out readings without and with the named effects.

    Attributes:
        split: what was held out, in words.
        labels: of the effects.
        independent: the training readings alone named these effects too.
        training_verdict: of the training readings alone.
        readings: number of held-out readings.
        before: without the effects.
        after: with them, sizes from the training readings.
        gain: what χ² of the held-out readings loses by following the predicted difference; negative
            where they go the other way.
        gain_p_value: chance of as much where the effects do not act, one-sided; NaN if not known.
    """

    split: str
    labels: tuple[str, ...]
    independent: bool
    training_verdict: str
    readings: int
    before: Prediction
    after: Prediction
    gain: float
    gain_p_value: float

    @property
    def sentence(self) -> str:
        """Say what the proof shows."""
        who = (
            "The other readings alone name the same"
            if self.independent
            else f"The other readings alone are {self.training_verdict}, so that only the sizes are"
            " theirs, not the name"
        )
        return (
            f"Held out: {self.split} ({self.readings:,} stops). {who}; with it they predict what"
            f" was held out to χ²/dof {self.after.reduced:.3f}, without it to"
            f" {self.before.reduced:.3f}. Of the held-out readings the effect itself explains"
            f" Δχ² = {self.gain:.1f} (p {_chance_words(self.gain_p_value)})."
        )


def _chance_words(chance: float) -> str:
    if not np.isfinite(chance):
        return "unknown"
    return "< 0.0001" if chance < 1e-4 else f"= {chance:.4f}"


def prove(
    measurement: Measurement,
    diagnosis: Diagnosis,
    baseline: Baseline,
    diagnose_training: Callable[[Measurement], Diagnosis],
) -> HeldOut | None:
    """Predict readings that took no part in the fit, without and with the named effects.

    Args:
        measurement: the whole run.
        diagnosis: of it; its noise, from the repeats, is used for both parts.
        baseline: of the whole run, under the model as it was.
        diagnose_training: names what is missing in a run whose held-out readings are NaN.

    The first way of holding out is taken in which the other readings alone name the same effects;
    otherwise the first that leaves enough of every effect in both parts.

    Returns:
        None where nothing was found, or no split leaves enough of an effect in both parts.
    """
    found = [finding.candidate for finding in diagnosis.findings]
    if not found or not np.isfinite(diagnosis.noise):
        return None
    problem = _Problem(baseline, diagnosis)
    shown = [one.effect.columns(one.setting, diagnosis.stops) for one in found]
    if any(one.effect.typical for one in found):
        shown.append(rotation_columns(diagnosis.stops))
    columns = np.column_stack(shown)[baseline.good]
    columns = columns[:, np.any(columns, axis=0)]
    best: HeldOut | None = None
    for words, whole in _splits(diagnosis.stops):
        if not problem.both_tell(columns, whole[baseline.good]):
            continue
        trained = diagnose_training(_without(measurement, whole))
        proof = _proof(problem, diagnosis, trained, words, whole)
        if proof.independent:
            return proof
        best = best or proof
    return best


def _proof(
    problem: "_Problem", diagnosis: Diagnosis, trained: Diagnosis, words: str, whole: Booleans
) -> HeldOut:
    """Predict what a split holds out, with the effects that the rest names if these are the same.

    Where the rest names others, the prediction is made with those of the whole run.
    """
    found = [finding.candidate for finding in diagnosis.findings]
    named = [finding.candidate for finding in trained.findings]
    same = sorted(one.family for one in named) == sorted(one.family for one in found)
    used = named if same else found
    columns = np.column_stack([one.free(diagnosis.stops) for one in used])[problem.good]
    columns = columns[:, np.any(columns, axis=0)]
    held = whole[problem.good]
    turning = problem.turning if any(one.effect.typical for one in used) else problem
    before, after = problem.predict(held, columns[:, :0]), turning.predict(held, columns)
    gain, chance = problem.gain(held, before.residual - after.residual)
    return HeldOut(
        split=words,
        labels=tuple(one.label for one in used),
        independent=same,
        training_verdict=trained.verdict,
        readings=int(np.count_nonzero(held)),
        before=before,
        after=after,
        gain=gain,
        gain_p_value=chance,
    )


def _splits(stops: Stops) -> Iterator[tuple[str, Booleans]]:
    """Yield ways of holding out a part of a run, the farthest from the rest first."""
    run = stops.run
    if run.max() > run.min():
        yield f"run {run.max()}, the last", run == run.max()
    repeat = np.array([line.repeat for line in stops.lines])[stops.pass_index]
    if repeat.max() > repeat.min():
        yield "the last repeat of every line", repeat == repeat.max()
        yield "the first repeat of every line", repeat == 0
    else:
        setups = len(stops.setups)
        last = np.array([_last_of_its_line(stops, setup) for setup in range(setups)])
        if np.any(last) and not np.all(last):
            yield "the last setup of every line that has several", last[stops.setup]
    number = stops.number % _EVERY == _EVERY - 1
    yield "every third stop of every pass", number


def _last_of_its_line(stops: Stops, setup: int) -> bool:
    names = [""] * len(stops.setups)
    for index, line in enumerate(stops.lines):
        names[int(stops.setup[stops.pass_index == index][0])] = line.name
    same = [place for place, name in enumerate(names) if name == names[setup]]
    return len(same) > 1 and same[-1] == setup


def _without(measurement: Measurement, held: Booleans) -> Measurement:
    lines, place = [], 0
    for line in measurement.lines:
        count = len(line.displacement)
        out = held[place : place + count]
        lines.append(replace(line, displacement=np.where(out, np.nan, line.displacement)))
        place += count
    return replace(measurement, lines=tuple(lines))


class _Problem:
    """The linear problem of a run, of which any part of the readings can be fitted.

    Args:
        baseline: of the run.
        diagnosis: of the run: noise, its correlation from stop to stop, scatter, and the stops.
        rotation: size of rotations of all axes that are free, rad; as before what was named if
            None.

    Attributes:
        good: which stops have a reading.
    """

    def __init__(
        self, baseline: Baseline, diagnosis: Diagnosis, rotation: float | None = None
    ) -> None:
        self.good = baseline.good
        named = any(one.candidate.effect.typical for one in diagnosis.findings)
        if rotation is None:
            rotation = 0.0 if named else diagnosis.loose.rotation
        self._plain, self._diagnosis = baseline, diagnosis
        baseline = loosened(baseline, diagnosis.stops, replace(diagnosis.loose, rotation=rotation))
        self._baseline = baseline
        self._noise = diagnosis.noise
        self._freedom = diagnosis.noise_degrees_of_freedom
        self._correlation = diagnosis.noise_correlation
        self._number = diagnosis.stops.number[baseline.good]
        self._free = np.column_stack([baseline.matrix, baseline.loose])
        loose = baseline.loose_rows
        self._loose_rows = np.column_stack(
            [np.zeros((len(loose), baseline.matrix.shape[1])), loose]
        )

    @property
    def turning(self) -> "_Problem":
        """Return the problem with the rotations of all axes that were found."""
        return _Problem(self._plain, self._diagnosis, self._diagnosis.loose.rotation)

    def gain(self, held: Booleans, difference: Vector) -> tuple[float, float]:
        """Return what following a predicted difference takes from χ², and the chance of as much.

        Args:
            held: held-out readings.
            difference: of two predictions of them, m, shape (stops,); NaN where not held out.
        """
        from scipy.special import ndtr, stdtr

        column = np.where(held, np.nan_to_num(difference[self.good]), 0.0)[:, None]
        if not np.any(column):
            return 0.0, float("nan")
        whole = held | ~held
        with_it = self._fit(whole, column)
        gain = self._fit(whole, column[:, :0]).squares - with_it.squares
        # Which way: the column is the first after what is free.
        sign = float(np.sign(with_it.values[self._free.shape[1]]))
        root = sign * float(np.sqrt(max(gain, 0.0)))
        known = np.isfinite(self._freedom) and self._freedom < 1e6
        chance = float(stdtr(max(self._freedom, 1.0), -root) if known else ndtr(-root))
        return sign * gain, chance

    def both_tell(self, columns: Vector, held: Booleans) -> bool:
        """Say whether both parts of a split show every column that the whole run shows.

        A column that the baseline can follow entirely, such as a rotation that no line sees, leaves
        only rounding, which differs between processors: no share is computed from that.
        """
        if not np.any(held) or np.all(held):
            return False
        everything = held | ~held
        whole, part = self._told(columns, everything), self._told(columns, ~held)
        length = np.sum(self._white(columns, everything) ** 2, axis=0)
        shown = whole > _RANK_LIMIT**2 * length
        share = part[shown] / whole[shown]
        within = (share >= _LEAST_SHARE) & (share <= 1.0 - _LEAST_SHARE)
        return bool(np.any(shown) and np.all(within))

    def predict(self, held: Booleans, columns: Vector) -> Prediction:
        """Predict the held-out readings from the others, with these columns' sizes free too."""
        everything, others = self._fit(held | ~held, columns), self._fit(~held, columns)
        squares = everything.squares - others.squares
        freedom = everything.freedom - others.freedom
        raw = np.column_stack([self._free, columns])[held]
        gap = self._baseline.gap[held] - raw @ others.values
        unseen = raw @ others.unseen
        if unseen.shape[1]:
            gap = gap - unseen @ np.linalg.lstsq(unseen, gap, rcond=_RANK_LIMIT)[0]
        readings = np.full(len(held), np.nan)
        readings[held] = gap
        chance = self._chance(squares, freedom)
        return Prediction(squares, freedom, chance, self._baseline.spread(readings))

    def _chance(self, squares: float, freedom: int) -> float:
        from scipy.special import chdtrc, fdtrc

        if freedom < 1:
            return float("nan")
        if not np.isfinite(self._freedom) or self._freedom > 1e6:
            return float(chdtrc(freedom, squares))
        return float(fdtrc(freedom, max(self._freedom, 1.0), squares / freedom))

    def _white(self, values: Vector, rows: Booleans) -> Vector:
        """Return rows in units of the noise, made independent along each pass, gaps and all."""
        scaled: Vector = values[rows] / (self._noise * self._baseline.weight[rows])[:, None]
        if not self._correlation:
            return scaled
        passes, number = self._baseline.passes[rows], self._number[rows]
        white: Vector = scaled.copy()
        follows = passes[1:] == passes[:-1]
        rho = (self._correlation ** np.maximum(np.diff(number), 1))[follows][:, None]
        white[1:][follows] = (scaled[1:][follows] - rho * scaled[:-1][follows]) / np.sqrt(
            1.0 - rho * rho
        )
        return white

    def _matrix(self, rows: Booleans, columns: Vector) -> Vector:
        loose_rows = np.column_stack(
            [self._loose_rows, np.zeros((len(self._loose_rows), columns.shape[1]))]
        )
        free = self._white(np.column_stack([self._free, columns]), rows)
        return np.vstack([free, loose_rows])

    def _told(self, columns: Vector, rows: Booleans) -> Vector:
        """Return how much of each column the baseline cannot follow, squared, shape (k,)."""
        matrix = self._matrix(rows, columns)
        count = self._free.shape[1]
        free, tried = matrix[:, :count], matrix[:, count:]
        lengths = np.linalg.norm(free, axis=0)
        left, values, _ = np.linalg.svd(
            free / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False
        )
        span = left[:, values > _RANK_LIMIT * values[0]]
        told: Vector = np.sum((tried - span @ (span.T @ tried)) ** 2, axis=0)
        return told

    def _fit(self, rows: Booleans, columns: Vector) -> "_Fit":
        matrix = self._matrix(rows, columns)
        target = np.zeros(len(matrix))
        count = int(np.count_nonzero(rows))
        target[:count] = self._white(self._baseline.gap[:, None], rows)[:, 0]
        lengths = np.linalg.norm(matrix, axis=0)
        lengths = np.where(lengths > 0.0, lengths, 1.0)
        left, sizes, right = np.linalg.svd(matrix / lengths, full_matrices=False)
        rank = int(np.count_nonzero(sizes > _RANK_LIMIT * sizes[0]))
        values = right[:rank].T @ ((left[:, :rank].T @ target) / sizes[:rank]) / lengths
        unseen = right[rank:].T / lengths[:, None]
        squares = float(np.sum((target - matrix @ values) ** 2))
        return _Fit(values, unseen, squares, len(matrix) - rank)


@dataclass(frozen=True)
class _Fit:
    """Values of the unknowns, undetermined directions, χ² and degrees of freedom."""

    values: Vector
    unseen: Vector
    squares: float
    freedom: int
