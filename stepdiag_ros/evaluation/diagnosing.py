"""Diagnosing in the way that makes a live run, its replay and its bag agree bit for bit."""

import hashlib
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

from stepdiag_ros import __version__
from stepdiag_ros.configuration import model_from_text
from stepdiag_ros.evaluation.diagnosis import (
    NO_CHAIN,
    DiagnosisReport,
    model_remarks,
    rms_and_largest,
)
from stepdiag_ros.evaluation.not_testable import not_testable_sentences
from stepdiag_ros.evaluation.solving import one_thread
from stepdiag_ros.metrology.discrepancy.extension import ModelComparison, with_chain
from stepdiag_ros.metrology.discrepancy.findings import NOT_TESTABLE, Diagnosis, Finding
from stepdiag_ros.metrology.discrepancy.summary import (
    DiagnosisSummary,
    FoundEffect,
    FoundSize,
    GapFigures,
    Limit,
    ModelSource,
    Verdict,
)
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.effect import Effect
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import MachineModel
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.solvers.limits import TooLarge

MOST_SETTINGS = 12
"""Settings of one effect whose detection limits are listed one by one; of more, only the range."""


@dataclass(frozen=True)
class Reference:
    """With what lines are compared, and how.

    Attributes:
        model: what is taken as known of the machine.
        text: YAML of the model.
        catalogue: effects to try, by name.
        seed: of the draws that show the influence of chance.
    """

    model: MachineModel
    text: str
    catalogue: Mapping[str, Effect]
    seed: int = 0

    @classmethod
    def from_text(cls, text: str, source: str, seed: int) -> "Reference":
        """Make a reference of the text of a model file, with all effects that are installed.

        Raises:
            ValueError: the text is not a model; names the source and the key.
        """
        return cls(model_from_text(text, source), text, catalogue(), seed)

    @property
    def source(self) -> ModelSource:
        """Return how the model is named in a summary."""
        return ModelSource(
            self.model.name, self.text, hashlib.sha256(self.text.encode()).hexdigest()
        )


def diagnose_reproducibly(measurement: Measurement, reference: Reference) -> Diagnosis:
    """Compare lines with a model; what ``stepdiag diagnose`` says of the same lines.

    One thread of the numerical libraries gives the same numbers however many there could be.

    Raises:
        ValueError: lines and model contradict each other, or there is nothing to compare.
    """
    measured = with_chain(measurement, reference.model)
    effects = tuple(reference.catalogue.values())
    with one_thread():
        return ModelComparison(measured, effects, reference.seed).under(reference.model)


def verdict_on(measurement: Measurement) -> Verdict:
    """Return the verdict on lines that are solved with all error curves free and no effects.

    It is that of ``stepdiag diagnose`` without a model, whatever model a live run was compared
    with: what is solved contains nothing but error curves. It takes 0.1 s to 2.5 s for the plans
    in ``config/plans``. Very large runs are not diagnosed (``solvers.limits``).

    Args:
        measurement: the lines.
    """
    return verdict_and_effects(measurement)[0]


def verdict_and_effects(measurement: Measurement) -> tuple[Verdict, tuple[FoundEffect, ...]]:
    """Return the verdict of ``verdict_on``, and with their sizes the effects that it names."""
    try:
        found = diagnose_reproducibly(measurement, Reference(MachineModel(), "", catalogue()))
    except TooLarge as error:
        return Verdict(sentence=f"The run was not diagnosed: {error}."), ()
    except ValueError as error:
        return Verdict(sentence=f"The run cannot be compared with its model: {error}"), ()
    return verdict_of(found, measurement), _found_in(found)


def verdict_of(diagnosis: Diagnosis, measurement: Measurement) -> Verdict:
    """Return the verdict of a diagnosis of lines."""
    return Verdict.of_effects(
        *(diagnosis.verdict, diagnosis.sentence, _found_in(diagnosis)),
        rotation=measurement.plausible.rotation,
    )


def _found_in(diagnosis: Diagnosis) -> tuple[FoundEffect, ...]:
    return tuple(_found(one) for one in diagnosis.findings)


def diagnose_lines(
    measurement: Measurement, plan: Plan, model_text: str, seed: int
) -> DiagnosisSummary:
    """Compare the lines of a run, as far as it has come, with a model; see ``Reference``.

    The passes of a tracker are compared with each other; no model is used (``tracker.verdict``).

    Raises:
        ValueError: lines and model contradict each other, or there is nothing to compare.
    """
    reference = Reference.from_text(model_text, "model", seed)
    if plan.tracker is not None:
        return _tracker_summary(measurement, plan, reference)
    return summary_of(diagnose_reproducibly(measurement, reference), measurement, reference, plan)


def _tracker_summary(
    measurement: Measurement, plan: Plan, reference: Reference
) -> DiagnosisSummary:
    # Only here: few runs have a tracker, and its evaluation takes time to import.
    from stepdiag_ros.metrology.tracker.run_result import verdict_on_run

    with one_thread():
        name, sentence = verdict_on_run(plan, measurement.lines, measurement.chain)
    unknown = GapFigures(math.nan, 0, math.nan, math.nan, math.nan)
    return DiagnosisSummary(
        time=max(line.end_time for line in measurement.lines),
        run_over=False,
        lines=len(measurement.lines),
        lines_planned=len(plan.lines),
        verdict=name,
        sentence=sentence,
        findings=(),
        partial=(),
        covariance=(),
        noise=math.nan,
        noise_degrees_of_freedom=0.0,
        noise_correlation=math.nan,
        noise_source="estimated together with the errors of the machine",
        before=unknown,
        after=unknown,
        where=(),
        where_after=(),
        map=(),
        detection_limits=(),
        not_testable=(),
        tested=0,
        model=reference.source,
        seed=reference.seed,
        software_version=__version__,
    )


def summary_of(
    diagnosis: Diagnosis, measurement: Measurement, reference: Reference, plan: Plan
) -> DiagnosisSummary:
    """Return what is published of a diagnosis, for a run that goes on.

    Args:
        diagnosis: of the lines.
        measurement: the lines, at least one.
        reference: with what they were compared.
        plan: of the run; says which lines are not there.
    """
    report = DiagnosisReport(diagnosis, reference.model, reference.catalogue)
    return DiagnosisSummary(
        time=max(line.end_time for line in measurement.lines),
        run_over=False,
        lines=len(measurement.lines),
        lines_planned=len(plan.lines),
        verdict=diagnosis.verdict,
        sentence=diagnosis.sentence,
        findings=_found_in(diagnosis),
        partial=tuple(_found(one) for one in diagnosis.partial),
        covariance=tuple(float(value) for value in diagnosis.covariance.ravel()),
        noise=diagnosis.noise,
        noise_degrees_of_freedom=diagnosis.noise_degrees_of_freedom,
        noise_correlation=diagnosis.noise_correlation,
        noise_source=diagnosis.noise_source,
        before=_gap(
            diagnosis.chi_squared_before,
            diagnosis.degrees_of_freedom_before,
            diagnosis.lack_of_fit_p_before,
            diagnosis.residual_before,
        ),
        after=_gap(
            diagnosis.chi_squared_after,
            diagnosis.degrees_of_freedom_after,
            diagnosis.lack_of_fit_p_after,
            diagnosis.residual_after,
        ),
        where=diagnosis.where,
        where_after=diagnosis.where_after,
        map=diagnosis.map,
        detection_limits=_limits(diagnosis, reference.catalogue),
        not_testable=tuple(not_testable_sentences(report)),
        tested=diagnosis.tested,
        model=reference.source,
        seed=reference.seed,
        software_version=__version__,
        remarks=tuple(_remarks(measurement, reference, plan)),
    )


def when_over(summary: DiagnosisSummary) -> DiagnosisSummary:
    """Return the same of a run that has ended.

    Advice on a plan is left out where the plan was not measured to its end.
    """
    if summary.verdict == NOT_TESTABLE and summary.lines < summary.lines_planned:
        reason = (
            "The lines do not show whether model and run agree: only"
            f" {summary.lines} of {summary.lines_planned} passes are measured."
        )
        return replace(summary, run_over=True, sentence=reason)
    return replace(summary, run_over=True)


def _remarks(measurement: Measurement, reference: Reference, plan: Plan) -> Iterator[str]:
    if not (measurement.chain or reference.model.chain):
        yield NO_CHAIN
    measured = {line.line_index for line in measurement.lines}
    yield from model_remarks(measurement, reference.model)
    missing = [line for index, line in enumerate(plan.lines) if index not in measured]
    if missing:
        names = ", ".join(dict.fromkeys(line.name for line in missing))
        yield f"{len(missing)} of the plan's {len(plan.lines)} lines are not among them: {names}."


def _gap(squares: float, freedom: int, chance: float, residual: Vector) -> GapFigures:
    return GapFigures(squares, freedom, chance, *rms_and_largest(residual))


def _found(finding: Finding) -> FoundEffect:
    effect = finding.candidate.effect
    return FoundEffect(
        label=finding.label,
        effect=effect.name,
        setting={name: _text(value) for name, value in finding.candidate.setting.items()},
        sentence=effect.sentence,
        source=effect.source,
        sizes=tuple(
            FoundSize(
                name=size.name,
                unit=size.unit,
                meaning=size.meaning,
                value=float(finding.sizes[size.name]),
                standard_uncertainty=float(finding.standard_uncertainty[size.name]),
                band=(float(finding.band[size.name][0]), float(finding.band[size.name][1])),
            )
            for size in effect.sizes
        ),
        gain=finding.gain,
        p_value=finding.p_value,
        probability=finding.probability,
        ambiguous_with=finding.ambiguous,
        runners_up=tuple(
            replace(one, ambiguous=one.label in finding.ambiguous) for one in finding.runners_up
        ),
    )


def _text(value: object) -> str:
    item = getattr(value, "item", None)
    return str(item() if callable(item) else value)


def _limits(diagnosis: Diagnosis, catalogue: Mapping[str, Effect]) -> tuple[Limit, ...]:
    found: list[Limit] = []
    for effect in catalogue.values():
        labels = dict.fromkeys(
            label
            for setting in effect.settings(diagnosis.stops)
            if (label := effect.label(setting)) in diagnosis.detection_limits
        )
        if len(labels) > MOST_SETTINGS:
            found.append(_limit(effect, effect.name, labels, diagnosis))
        else:
            found += [_limit(effect, label, [label], diagnosis) for label in labels]
    return tuple(found)


def _limit(effect: Effect, label: str, labels: Collection[str], diagnosis: Diagnosis) -> Limit:
    sizes = [abs(diagnosis.detection_limits[one]) for one in labels]
    first = effect.sizes[0]
    return Limit(effect.name, label, len(labels), first.name, first.unit, min(sizes), max(sizes))
