"""Several runs of one machine over months: what each shows of every effect that any of them names.

Months apart, a machine has other error curves, alignments and zeros, and its laser another noise.
Each run therefore keeps its own baseline, noise and scatter, and is diagnosed alone. What the runs
share are the effects. Those named or described in any run are suspects, as are those that such a
run does not distinguish from them. All runs together decide between them: a suspect's evidence is
the sum of that in each run, its sizes free in each. The chosen effects are then fitted together in
each run; ``course`` says what becomes of each.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Whitened, fit_baseline, whitened
from stepdiag_ros.metrology.discrepancy.candidates import HIDDEN
from stepdiag_ros.metrology.discrepancy.course import (
    CHANGE_LEVEL,
    Course,
    SizesInRun,
    course_of,
)
from stepdiag_ros.metrology.discrepancy.findings import (
    LINE_AND_PARABOLA,
    Candidate,
    Diagnosis,
    Finding,
)
from stepdiag_ros.metrology.discrepancy.loose import loosened, unit_span
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO, FALSE_NAME_LEVEL
from stepdiag_ros.metrology.effects.effect import Effect, Size
from stepdiag_ros.metrology.effects.learned_rotation import learned
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import FITTED, FIXED, MachineModel

NAME_LEVEL = 0.01
"""Chance that any effect is listed that no run has, all runs together."""
OVER_TRAVEL = "change over the measured travel"
ON_READINGS = "rms of what it changes in the readings, in the sense of its shape"
_RENEWED = {"setup", "repeat"}
"""Keys of a setting that ties an effect to an alignment or a pass, another in every run."""


@dataclass(frozen=True)
class DiagnosedRun:
    """One run of a machine.

    Attributes:
        measurement: of the run, or of several that were made together (``joint``).
        month: its date in months, from any beginning.
        diagnosis: of this run alone.
    """

    measurement: Measurement
    month: float
    diagnosis: Diagnosis


@dataclass(frozen=True)
class EffectHistory:
    """What becomes of one effect.

    Attributes:
        label: of the effect, or on what a gap without a name depends.
        candidates: what acts: one effect, or the shapes of a description.
        figure: name, unit and meaning of the one number that is followed.
        course: what becomes of it.
        rivals: labels of other effects that all runs together do not distinguish from it.
        named_in: indices of the runs whose own diagnosis names it, or one of the rivals.
    """

    label: str
    candidates: tuple[Candidate, ...]
    figure: Size
    course: Course
    rivals: tuple[str, ...]
    named_in: tuple[int, ...]


@dataclass(frozen=True)
class _Suspect:
    """What may act in some of the runs."""

    label: str
    candidates: tuple[Candidate, ...]

    @property
    def renewed(self) -> bool:
        return any(not _RENEWED.isdisjoint(one.setting) for one in self.candidates)


@dataclass(frozen=True)
class _Named:
    """A finding of a run: the index of the run and all that may be behind it, the finding first."""

    run: int
    suspects: tuple[_Suspect, ...]


class _Run:
    """A run as a linear problem, and what its readings show of each suspect."""

    def __init__(self, diagnosis: Diagnosis, problem: Whitened) -> None:
        self.diagnosis = diagnosis
        self._problem = problem
        self._columns: dict[str, tuple[Vector, Vector]] = {}

    def columns(self, suspect: _Suspect) -> tuple[Vector, Vector]:
        """Return columns of its sizes, and of what no run determines of it, beyond the baseline.

        Columns of zeros where the run does not show it.
        """
        if suspect.label not in self._columns:
            self._columns[suspect.label] = self._made(suspect)
        return self._columns[suspect.label]

    def _made(self, suspect: _Suspect) -> tuple[Vector, Vector]:
        stops, good = self.diagnosis.stops, self._problem.baseline.good
        count = sum(len(one.effect.sizes) for one in suspect.candidates)
        rows = len(self._problem.gap)
        nothing = np.zeros((rows, count)), np.zeros((rows, 0))
        try:
            parts = [one.effect.columns(one.setting, stops) for one in suspect.candidates]
            free = [one.effect.unknown(one.setting, stops) for one in suspect.candidates]
        except ValueError:
            return nothing
        plain = np.column_stack(parts)[good]
        if not np.all(np.isfinite(plain)):
            return nothing
        before = self._problem.of(plain)
        left = self._problem.projected(before)
        hidden = np.linalg.norm(left, axis=0) <= HIDDEN * np.linalg.norm(before, axis=0)
        return np.where(hidden, 0.0, left), self._problem.left_of(np.column_stack(free))

    def shows(self, suspect: _Suspect, others: Sequence[_Suspect]) -> SizesInRun:
        """Return what the run shows of a suspect while the sizes of others are free."""
        own, unknown = self.columns(suspect)
        parts = [part for one in others for part in self.columns(one)]
        span = unit_span(np.column_stack([*parts, unknown]))
        left = own - span @ (span.T @ own)
        hidden = np.linalg.norm(left, axis=0) <= HIDDEN * np.linalg.norm(own, axis=0)
        left = np.where(hidden, 0.0, left)
        return SizesInRun(
            left.T @ left, left.T @ self._problem.gap, self.diagnosis.noise_degrees_of_freedom
        )

    def products(self, suspect: _Suspect) -> Vector:
        """Return the mean products of what units of the sizes change in the readings, m²."""
        stops = self.diagnosis.stops
        parts = [one.effect.columns(one.setting, stops) for one in suspect.candidates]
        columns = np.column_stack(parts)[self._problem.baseline.good]
        made: Vector = columns.T @ columns / len(columns)
        return made


def histories_of(
    runs: Sequence[DiagnosedRun], model: MachineModel, catalogue: Iterable[Effect]
) -> tuple[EffectHistory, ...]:
    """Return what becomes of every effect that any run names or describes, clearest first.

    A run whose noise is not known shows nothing of any effect.

    Args:
        runs: in the order of their dates, at least two, over the same box.
        model: that they were diagnosed under.
        catalogue: effects that were tried.
    """
    return _Together(runs, model, tuple(catalogue)).histories()


class _Together:
    """All runs of a machine and what any of them names."""

    def __init__(
        self, runs: Sequence[DiagnosedRun], model: MachineModel, catalogue: tuple[Effect, ...]
    ) -> None:
        rotation = max(one.diagnosis.loose.rotation for one in runs)
        self._months = np.array([one.month for one in runs])
        self._runs = {
            index: _Run(one.diagnosis, _problem(one, model, rotation))
            for index, one in enumerate(runs)
            if np.isfinite(one.diagnosis.noise)
        }
        self._named = [
            _Named(index, (own, *_others(finding, run.diagnosis, catalogue)))
            for index, run in self._runs.items()
            for own, finding in _suspects(run.diagnosis)
            if finding.p_value * len(runs) <= NAME_LEVEL
        ]

    def histories(self) -> tuple[EffectHistory, ...]:
        """Choose suspects until no finding of any run is left, and follow each."""
        chosen: list[_Suspect] = []
        rivals: dict[str, tuple[str, ...]] = {}
        while left := [one for one in self._named if self._stands_out(one, chosen)]:
            pool = {suspect.label: suspect for one in left for suspect in one.suspects}
            evidence = {label: self._evidence(one, chosen) for label, one in pool.items()}
            best = max(evidence, key=lambda label: evidence[label])
            groups = [one for one in left if best in [each.label for each in one.suspects]]
            near = evidence[best] - np.log(EVIDENCE_RATIO)
            alike = dict.fromkeys(each.label for one in groups for each in one.suspects)
            rivals[best] = tuple(one for one in alike if one != best and evidence[one] > near)
            chosen.append(pool[best])
        return tuple(self._history(one, chosen, rivals[one.label]) for one in chosen)

    def _stands_out(self, named: _Named, chosen: Sequence[_Suspect]) -> bool:
        """Say whether a finding of a run is still one beside what was chosen."""
        own = named.suspects[0]
        if own.label in [one.label for one in chosen]:
            return False
        run = self._runs[named.run]
        chance = run.shows(own, chosen).p_value
        return chance * max(run.diagnosis.tested, 1) < FALSE_NAME_LEVEL

    def _evidence(self, suspect: _Suspect, chosen: Sequence[_Suspect]) -> float:
        """Return ln p of a suspect beside what was chosen against none, in all runs together.

        Its sizes are free in each run, and as large as is likeliest.
        """
        total = 0.0
        for run in self._runs.values():
            shown = run.shows(suspect, chosen)
            count = shown.shown
            if count and shown.gain > count:
                total += 0.5 * (shown.gain - count - count * float(np.log(shown.gain / count)))
        return total

    def _history(
        self, suspect: _Suspect, chosen: Sequence[_Suspect], rivals: tuple[str, ...]
    ) -> EffectHistory:
        others = [one for one in chosen if one is not suspect]
        shown = {index: run.shows(suspect, others) for index, run in self._runs.items()}
        clearest = max(shown, key=lambda index: shown[index].gain)
        size = len(shown[clearest].score)
        nothing = SizesInRun(np.zeros((size, size)), np.zeros(size), np.inf)
        figure, functional = _figure(suspect, shown[clearest].sizes, self._runs[clearest])
        names = {suspect.label, *rivals}
        return EffectHistory(
            suspect.label,
            suspect.candidates,
            figure,
            course_of(
                [shown.get(index, nothing) for index in range(len(self._months))],
                self._months,
                functional,
                CHANGE_LEVEL / len(chosen),
                suspect.renewed,
            ),
            rivals,
            tuple(
                dict.fromkeys(
                    one.run for one in self._named if names & {each.label for each in one.suspects}
                )
            ),
        )


def _suspects(diagnosis: Diagnosis) -> Iterator[tuple[_Suspect, Finding]]:
    """Yield what a run names or describes; shapes of one dependence are one suspect."""
    shapes: dict[str, Finding] = {}
    for finding in diagnosis.findings:
        effect = finding.candidate.effect
        if effect.learned:
            shapes[finding.label] = finding
        elif not effect.typical:
            yield _Suspect(finding.label, (finding.candidate,)), finding
    for one in () if diagnosis.description is None else diagnosis.description.dependences:
        effect = learned(one.acts_on)
        labels = [effect.label({"acts_on": one.acts_on, "shape": shape}) for shape in one.shapes]
        found = [shapes[label] for label in labels if label in shapes]
        if found:
            yield _Suspect(one.words, tuple(each.candidate for each in found)), found[0]


def _others(
    finding: Finding, diagnosis: Diagnosis, catalogue: Iterable[Effect]
) -> tuple[_Suspect, ...]:
    """Return what a run does not distinguish from a finding."""
    labels = set(finding.ambiguous)
    if not labels:
        return ()
    made = {
        label: _Suspect(label, (Candidate(effect, setting, label),))
        for effect in catalogue
        for setting in effect.settings(diagnosis.stops)
        if (label := effect.label(setting)) in labels
    }
    return tuple(made.values())


def _figure(suspect: _Suspect, sizes: Vector, run: _Run) -> tuple[Size, Vector]:
    """Return the one number by which an effect is followed, and what of the sizes it is.

    Args:
        suspect: the effect.
        sizes: in the run that shows it best.
        run: that run.
    """
    own = [size for one in suspect.candidates for size in one.effect.sizes]
    if len(own) == 1:
        return own[0], np.ones(1)
    first = own[0]
    if tuple(size.name for size in own) == LINE_AND_PARABOLA:
        return replace(first, name="over_travel", meaning=OVER_TRAVEL), np.ones(2)
    products = run.products(suspect)
    whole = float(np.sqrt(sizes @ products @ sizes))
    return Size("on_readings", "m", first.low, first.high, ON_READINGS), products @ sizes / whole


def _problem(run: DiagnosedRun, model: MachineModel, rotation: float) -> Whitened:
    """Return a run with its own baseline, noise and scatter, and rotations if any run has them."""
    diagnosis = run.diagnosis
    baseline = fit_baseline(
        run.measurement,
        diagnosis.stops,
        model.of_status(FIXED),
        model.of_status(FITTED),
        model.curves,
    )
    loose = replace(diagnosis.loose, rotation=rotation if diagnosis.stops.chain else 0.0)
    free = loosened(baseline, diagnosis.stops, loose)
    return whitened(free, diagnosis.noise, diagnosis.noise_correlation)
