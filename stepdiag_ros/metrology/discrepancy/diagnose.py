"""A run against a model: do they agree, and if not, where, why, and how sure is that."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.discrepancy import findings as verdicts
from stepdiag_ros.metrology.discrepancy.baseline import (
    Baseline,
    Whitened,
    fit_baseline,
    whitened,
)
from stepdiag_ros.metrology.discrepancy.candidates import Signatures, limits, signatures
from stepdiag_ros.metrology.discrepancy.chance import LookElsewhere, look_elsewhere
from stepdiag_ros.metrology.discrepancy.findings import (
    CONSISTENT_LEVEL,
    Diagnosis,
    Finding,
    Pattern,
)
from stepdiag_ros.metrology.discrepancy.gross import mislabelled
from stepdiag_ros.metrology.discrepancy.lack_of_fit import LackOfFit, LackOfFitTest
from stepdiag_ros.metrology.discrepancy.locate import gap_map, sentences
from stepdiag_ros.metrology.discrepancy.noise import Noise, estimate_noise
from stepdiag_ros.metrology.discrepancy.patterns import patterns
from stepdiag_ros.metrology.discrepancy.selection import FALSE_NAME_LEVEL, Selection
from stepdiag_ros.metrology.discrepancy.steady import steadied
from stepdiag_ros.metrology.discrepancy.variants import better_variant
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect
from stepdiag_ros.metrology.effects.gross import gross_errors
from stepdiag_ros.metrology.effects.stops import Stops, stops_of
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement

_GROSS_LEVEL = 1e-6
"""A line under a wrong name is far off."""
_SAME_NOISE = 0.03
_SAME_CORRELATION = 0.05
_PASSES = 3

Progress = Callable[[str], None]


@dataclass(frozen=True)
class _Result:
    """One way through: a noise, what is chosen with it, and the tests before and after."""

    noise: Noise
    problem: Whitened
    found: Signatures
    luck: LookElsewhere
    selection: Selection
    before: LackOfFit
    after: LackOfFit


def diagnose(
    measurement: Measurement,
    known: Sequence[ActiveEffect] = (),
    catalogue: Iterable[Effect] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    fitted: Sequence[ActiveEffect] = (),
    curves: Mapping[str, Sequence[float]] | None = None,
) -> Diagnosis:
    """Compare a run with a model and name what the model lacks.

    The model is a machine with nine free translational curves and free setups (see ``baseline``),
    plus the effects that are known. The noise is taken from the repeats; with the gap explained, it
    is taken anew, since what changes between repeats is no noise.

    Args:
        measurement: the run; its chain, if known, lets angular errors be tried.
        known: effects of the model with fixed sizes.
        catalogue: effects to try; all that are installed if None.
        seed: of the draws that tell what chance does.
        progress: told what is being done.
        fitted: effects of the model whose sizes are free.
        curves: name → values at the nodes, m, of translational curves that the model has fixed.

    Raises:
        NotDeterminable: there is no reading at all.
        ValueError: lines that contradict the volume or each other, or a known effect that the run
            lacks the data for.
    """
    tell = progress or (lambda _: None)
    stops = steadied(stops_of(measurement))
    gross = gross_errors(measurement)
    if gross:
        return _gross(stops, gross)
    tell("fitting the baseline")
    baseline = fit_baseline(measurement, stops, known, fitted, curves)
    stated = _stated(measurement)
    noise = estimate_noise(baseline, baseline.gap, stops, stated)
    effects = _effects(catalogue)
    if not np.isfinite(noise.size) or not noise.size > 0.0:
        return _not_testable(stops, baseline, noise, "nothing tells the noise: no pass is repeated")
    taken = {(one.effect.name, one.effect.label(one.setting)) for one in fitted}
    result = _once(baseline, stops, noise, effects, taken, seed, tell)
    if result.problem.freedom <= baseline.scales.shape[1]:
        return _not_testable(
            stops,
            baseline,
            noise,
            "the free values of the model fit any readings of this plan, so no disagreement can "
            "ever show; measure linear lines, a fourth diagonal or another move order too",
        )
    for _ in range(_PASSES):
        left = result.problem.readings(result.selection.left())
        again = estimate_noise(baseline, left, stops, stated)
        if (
            abs(again.size / result.noise.size - 1.0) < _SAME_NOISE
            and abs(again.correlation - result.noise.correlation) < _SAME_CORRELATION
        ):
            break
        tell("taking the noise anew, without what was found")
        result = _once(baseline, stops, again, effects, taken, seed, tell)
    diagnosis = _diagnosis(result, stops)
    if diagnosis.verdict == verdicts.UNEXPLAINED and result.after.p_value < _GROSS_LEVEL:
        tell("trying whether a line has a wrong name")
        names = mislabelled(measurement, known, noise)
        if names:
            words = "; or: ".join(names)
            return replace(
                diagnosis,
                sentence=f"Model and run disagree, but agree if {words}. Correct the run's names.",
                where=(*diagnosis.where, f"The run fits if {words}."),
            )
    return diagnosis


def _effects(catalogue: Iterable[Effect] | None) -> list[Effect]:
    if catalogue is not None:
        return list(catalogue)
    # Late, since effects of other packages are imported with it.
    from stepdiag_ros.metrology.effects import catalogue as installed

    return list(installed().values())


def _stated(measurement: Measurement) -> float:
    values = np.concatenate([line.standard_uncertainty for line in measurement.lines])
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _once(
    baseline: Baseline,
    stops: Stops,
    noise: Noise,
    effects: list[Effect],
    taken: set[tuple[str, str]],
    seed: int,
    tell: Progress,
) -> _Result:
    problem = whitened(baseline, noise.size, noise.correlation)
    tell("making the candidates")
    found = signatures(effects, stops, problem, taken)
    tell(f"drawing what chance does with {len(found.candidates)} candidates")
    luck = look_elsewhere(found, noise.freedom, seed)
    tell("choosing")
    selection = Selection(found, problem.gap, luck, tell)
    test = LackOfFitTest(problem, stops, noise)
    none = np.zeros((len(problem.gap), 0))
    return _Result(
        noise,
        problem,
        found,
        luck,
        selection,
        test(problem.gap, none),
        test(selection.left(), selection.span()),
    )


def _diagnosis(result: _Result, stops: Stops) -> Diagnosis:
    problem, noise, selection = result.problem, result.noise, result.selection
    chosen = selection.findings()
    misfit = result.after.p_value < CONSISTENT_LEVEL
    contrived = (
        ""
        if misfit
        else selection.contrived
        or better_variant(result.found, problem.gap, selection.sizes(), problem, stops)
    )
    gap_left = misfit or bool(contrived)
    verdict, sentence = _verdict(chosen, misfit, contrived, result.after, noise)
    seen, hidden = limits(result.found, result.luck.threshold(FALSE_NAME_LEVEL))
    none = np.zeros((len(problem.gap), 0))
    freedom = noise.freedom
    shares = gap_map(problem, problem.gap, none, stops, freedom)
    where: tuple[str, ...] = ()
    looks: tuple[Pattern, ...] = ()
    if verdict != verdicts.CONSISTENT:
        looks = patterns(problem, problem.gap, none, stops, freedom)
        where = sentences(shares, looks, result.before.shape, noise.size)
    left = selection.left()
    after: tuple[str, ...] = ()
    looks_after: tuple[Pattern, ...] = ()
    if gap_left:
        rest = gap_map(problem, left, selection.span(), stops, freedom)
        looks_after = patterns(problem, left, selection.span(), stops, freedom)
        after = sentences(rest, looks_after, result.after.shape, noise.size)
    spread = problem.baseline.spread
    return Diagnosis(
        verdict=verdict,
        sentence=sentence,
        findings=() if gap_left else chosen,
        partial=chosen if gap_left else (),
        noise=noise.size,
        noise_degrees_of_freedom=freedom,
        noise_correlation=noise.correlation,
        noise_source=noise.source,
        chi_squared_before=result.before.chi_squared,
        chi_squared_after=result.after.chi_squared,
        degrees_of_freedom_before=result.before.freedom,
        degrees_of_freedom_after=result.after.freedom,
        lack_of_fit_p_before=result.before.p_value,
        lack_of_fit_p_after=result.after.p_value,
        residual_before=spread(problem.readings(problem.gap)),
        residual_after=spread(problem.readings(left)),
        detection_limits=seen,
        not_testable={**result.found.not_testable, **hidden},
        where=where,
        stops=stops,
        where_after=after,
        map=shares,
        patterns=looks,
        patterns_after=looks_after,
        tested=len(result.found.candidates),
        covariance=selection.covariance(),
    )


def _verdict(
    chosen: tuple[Finding, ...], misfit: bool, contrived: str, after: LackOfFit, noise: Noise
) -> tuple[str, str]:
    if contrived and not misfit:
        return verdicts.UNEXPLAINED, (
            f"Model and run disagree. {'; '.join(one.label for one in chosen)} would close the "
            f"gap, but {contrived}."
        )
    if misfit:
        start = (
            f"{'; '.join(one.label for one in chosen)} would explain part of the gap, but"
            if chosen
            else "Model and run disagree, and"
        )
        return verdicts.UNEXPLAINED, (
            f"{start} no effect of the catalogue closes it; what is left is clearest in: "
            f"{after.shape} (p = {after.p_value:.1g})."
        )
    if not chosen:
        return verdicts.CONSISTENT, (
            f"Model and run agree to within the noise of {noise.size * 1e6:.3g} µm."
        )
    open_names = [one for one in chosen if one.ambiguous]
    if open_names:
        words = "; ".join(
            f"{one.label}, or as well {', '.join(one.ambiguous)}" for one in open_names
        )
        return verdicts.AMBIGUOUS, f"The gap closes, but this run cannot tell by what: {words}."
    words = " and ".join(one.label for one in chosen)
    return verdicts.NAMED, f"The model lacks {words}; with that, model and run agree."


def _gross(stops: Stops, words: tuple[str, ...]) -> Diagnosis:
    count = len(stops.time)
    nothing = np.full(count, np.nan)
    noise = Noise(float("nan"), 0.0, 0.0, "not estimated")
    empty = _unfitted(verdicts.UNEXPLAINED, "", stops, nothing, 0, noise)
    return replace(
        empty,
        sentence=f"Model and run disagree grossly: {'; '.join(words)}.",
        where=words,
    )


def _not_testable(stops: Stops, baseline: Baseline, noise: Noise, why: str) -> Diagnosis:
    freedom = len(baseline.gap) - int(np.linalg.matrix_rank(baseline.matrix))
    sentence = f"Whether model and run agree cannot be told: {why}."
    gap = baseline.spread(baseline.gap)
    return _unfitted(verdicts.NOT_TESTABLE, sentence, stops, gap, freedom, noise)


def _unfitted(
    verdict: str, sentence: str, stops: Stops, gap: Vector, freedom: int, noise: Noise
) -> Diagnosis:
    unknown = float("nan")
    return Diagnosis(
        verdict=verdict,
        sentence=sentence,
        findings=(),
        partial=(),
        noise=noise.size,
        noise_degrees_of_freedom=noise.freedom,
        noise_correlation=noise.correlation,
        noise_source=noise.source,
        chi_squared_before=unknown,
        chi_squared_after=unknown,
        degrees_of_freedom_before=freedom,
        degrees_of_freedom_after=freedom,
        lack_of_fit_p_before=unknown,
        lack_of_fit_p_after=unknown,
        residual_before=gap,
        residual_after=gap,
        detection_limits={},
        not_testable={},
        where=(),
        stops=stops,
    )
