"""A run against a model: do they agree, and if not, where, why, and how sure is that."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.discrepancy import findings as verdicts
from stepdiag_ros.metrology.discrepancy.baseline import Baseline, Whitened, whitened
from stepdiag_ros.metrology.discrepancy.candidates import Signatures, limits, signatures
from stepdiag_ros.metrology.discrepancy.chance import LookElsewhere, look_elsewhere
from stepdiag_ros.metrology.discrepancy.described import described, description_worth
from stepdiag_ros.metrology.discrepancy.fading import or_fading
from stepdiag_ros.metrology.discrepancy.findings import (
    CONSISTENT_LEVEL,
    Diagnosis,
    Finding,
    Loose,
    Pattern,
)
from stepdiag_ros.metrology.discrepancy.gross import mislabelled
from stepdiag_ros.metrology.discrepancy.lack_of_fit import LackOfFit, LackOfFitTest
from stepdiag_ros.metrology.discrepancy.locate import gap_map, sentences
from stepdiag_ros.metrology.discrepancy.loose import (
    beyond,
    estimate_wander,
    judge_rotations,
    loosened,
    rotation_columns,
    wander_evidence,
)
from stepdiag_ros.metrology.discrepancy.noise import LEAST_STOPS, Noise, estimate_noise
from stepdiag_ros.metrology.discrepancy.patterns import patterns
from stepdiag_ros.metrology.discrepancy.rotation_finding import (
    beside_rotations,
    explained_by,
    rotation_finding,
)
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO, FALSE_NAME_LEVEL, Selection
from stepdiag_ros.metrology.discrepancy.slips import Slips, find_slips
from stepdiag_ros.metrology.discrepancy.start import Model, Progress, Start, stated_noise
from stepdiag_ros.metrology.discrepancy.steady import steadied
from stepdiag_ros.metrology.discrepancy.variants import better_variant
from stepdiag_ros.metrology.discrepancy.wrong_reading import with_wrong_readings
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect
from stepdiag_ros.metrology.effects.gross import gross_errors
from stepdiag_ros.metrology.effects.several_angular_errors import EFFECT as SEVERAL_ANGULAR_ERRORS
from stepdiag_ros.metrology.effects.stops import Stops, stops_of
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.limits import DIAGNOSIS, require_size_for

_GROSS_LEVEL = 1e-6
"""A line under a wrong name is far off."""
_NEEDLESS = 1e4
"""Odds for rotations in a run that agrees without them. Where no axis turns, odds of K come up in
no more than one run in K."""
_SAME_NOISE = 0.03
_SAME_CORRELATION = 0.05
_PASSES = 3


@dataclass(frozen=True)
class _Result:
    """One way through: a noise, what is chosen with it, and the tests before and after."""

    noise: Noise
    loose: Loose
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
    is taken again, since what changes between repeats is not noise. What the zero then scatters
    from pass to pass is noise too. Rotations of all axes at once are weighed against the single
    effects that would explain the gap without them.

    Args:
        measurement: the run; its chain, if known, lets angular errors be tried.
        known: effects of the model with fixed sizes.
        catalogue: effects to try; all that are installed if None.
        seed: of the draws that show the influence of chance.
        progress: called with what is being done.
        fitted: effects of the model whose sizes are free.
        curves: name → values at the nodes, m, of translational curves that the model has fixed.

    Raises:
        NotDeterminable: there is no reading at all.
        TooLarge: the run has too many blocks or stops (``solvers.limits``).
        ValueError: lines that contradict the volume or each other, or a known effect that the run
            lacks the data for.
    """
    require_size_for(DIAGNOSIS, measurement.volume.blocks, measurement.stop_count)
    tell = progress or (lambda _: None)
    model = Model(tuple(known), tuple(fitted), curves, _effects(catalogue))
    gross = gross_errors(measurement)
    if gross:
        return _gross(steadied(stops_of(measurement)), gross)
    tell("fitting the baseline")
    start = model.start(measurement)
    slips, sure = find_slips(start, model, tell)
    for wrong in [slips] if sure.found == slips.found else [slips, sure]:
        if wrong.first:
            found = _but_for_wrong_readings(wrong, start, model, seed, tell)
            if found is not None:
                return found
    found = _compared(start, model, seed, tell)
    if found.verdict == verdicts.UNEXPLAINED and not slips.first:
        return _but_for_wrong_readings(slips, start, model, seed, tell) or found
    return found


def _but_for_wrong_readings(
    slips: Slips, start: Start, model: Model, seed: int, tell: Progress
) -> Diagnosis | None:
    """Return the diagnosis of a run of which these readings are wrong; None if more is."""
    if not slips.found:
        return None
    rest = _compared(slips.rest, model, seed, tell)
    if not np.isfinite(rest.noise):
        return None
    problem = whitened(start.baseline, rest.noise, rest.noise_correlation)
    return with_wrong_readings(rest, slips.found, problem, start.measurement)


def _compared(start: Start, model: Model, seed: int, tell: Progress) -> Diagnosis:
    """Compare a run with a model; whether a single reading is wrong is not asked."""
    stops, baseline, noise = start.stops, start.baseline, start.noise
    stated = stated_noise(start.measurement)
    effects = model.effects
    if not start.noise_is_known:
        unknown = f"no pass of {LEAST_STOPS} stops or more is repeated, so the noise is unknown"
        return _not_testable(stops, baseline, noise, unknown)
    taken = {(one.effect.name, one.effect.label(one.setting)) for one in model.fitted}
    given = Loose(rotation=_typical((*model.known, *model.fitted)))
    run = _Run(baseline, stops, effects, taken, seed, tell)
    result = run.once(noise, given)
    if result.problem.freedom <= baseline.loose.shape[1]:
        return _not_testable(
            stops,
            baseline,
            noise,
            "the free values of the model fit any readings of these lines, so no disagreement can "
            f"show; measure also {_what_is_lacking(stops)}",
        )
    result = run.settled(result, stated)
    diagnosis, evidence = _diagnosis(result, stops), result.selection.weighed
    if stops.chain and not given.rotation and SEVERAL_ANGULAR_ERRORS in effects:
        diagnosis, evidence = _turning(run, result, diagnosis, stated)
    if diagnosis.verdict == verdicts.UNEXPLAINED and result.after.p_value < _GROSS_LEVEL:
        tell("trying whether a line has a wrong name")
        names = mislabelled(start.measurement, model.known, noise)
        if names:
            words = "; or: ".join(names)
            return replace(
                diagnosis,
                sentence=f"Model and run disagree, but agree if {words}. Correct the run's names.",
                where=(*diagnosis.where, f"The run fits if {words}."),
            )
    return _described(run, result, diagnosis, evidence)


def _effects(catalogue: Iterable[Effect] | None) -> list[Effect]:
    if catalogue is not None:
        return list(catalogue)
    # Late, since effects of other packages are imported with it.
    from stepdiag_ros.metrology.effects import catalogue as installed

    return list(installed().values())


def _typical(active: Sequence[ActiveEffect]) -> float:
    """Return the size of rotations that a model has, rad; 0 if it has none."""
    sizes = [one.sizes["size"] for one in active if one.effect.typical]
    return max(sizes, default=0.0)


@dataclass(frozen=True)
class _Run:
    """A run, which may be looked at with one noise or another.

    Attributes:
        baseline: of the run, without what scatters in it.
        stops: of the run.
        effects: to try.
        taken: name and label of those that the model has already with a free size.
        seed: of the draws that show the influence of chance.
        tell: called with what is being done.
    """

    baseline: Baseline
    stops: Stops
    effects: list[Effect]
    taken: set[tuple[str, str]]
    seed: int
    tell: Progress

    def whitened(self, noise: Noise, loose: Loose) -> Whitened:
        """Return the problem with a noise and what scatters beside it."""
        baseline = loosened(self.baseline, self.stops, loose)
        return whitened(baseline, noise.size, noise.correlation)

    def once(self, noise: Noise, loose: Loose) -> _Result:
        """Look for effects once."""
        problem = self.whitened(noise, loose)
        self.tell("making the candidates")
        found = signatures(self.effects, self.stops, problem, self.taken)
        self.tell(f"drawing what chance does with {len(found.candidates)} candidates")
        luck = look_elsewhere(found, noise.freedom, self.seed)
        self.tell("choosing")
        selection = Selection(found, problem.gap, luck, self.tell)
        return _Result(
            noise,
            loose,
            problem,
            found,
            luck,
            selection,
            *self._fits(problem, selection, noise, loose),
        )

    def _fits(
        self, problem: Whitened, selection: Selection, noise: Noise, loose: Loose
    ) -> tuple[LackOfFit, LackOfFit]:
        """Test whether a gap is left without and with what was chosen.

        Where all axes turn, by rotations that are free: how rough they are is not to be tested.
        """
        left, span = selection.left(), selection.span()
        if loose.rotation:
            plain = loosened(self.baseline, self.stops, replace(loose, rotation=0.0))
            turning = plain.with_free(rotation_columns(self.stops)[plain.good])
            problem = whitened(turning, noise.size, noise.correlation)
            left, span = beyond(problem, self.stops, selection.candidates)
        none = np.zeros((len(problem.gap), 0))
        before, after = LackOfFitTest(problem, self.stops, noise)((problem.gap, none), (left, span))
        return before, after

    def settled(self, result: _Result, stated: float) -> _Result:
        """Take noise and scatter again from what the effects leave, until they stay the same."""
        result = self._scattering(result)
        for _ in range(_PASSES):
            left = result.problem.readings(result.selection.left())
            noise = estimate_noise(self.baseline, left, self.stops, stated)
            chosen = result.selection.candidates
            fixed = self.whitened(noise, Loose(rotation=result.loose.rotation))
            wander = estimate_wander(fixed, self.stops, chosen, noise.freedom)
            loose = replace(wander, rotation=result.loose.rotation)
            if _same(result, noise, loose):
                break
            self.tell("estimating the noise again, without the effects found")
            result = self.once(noise, loose)
        return result

    def _scattering(self, result: _Result) -> _Result:
        """Return the run with a zero that scatters instead of effects, if that is likelier.

        Several slow effects together can imitate the scatter of a few passes. Every workshop has
        such a scatter; effects in its place have to be clearly likelier, and each of them is one
        out of all that were tried.
        """
        if not result.selection.chosen:
            return result
        none = Loose(rotation=result.loose.rotation)
        problem = self.whitened(result.noise, none)
        wander = estimate_wander(problem, self.stops, (), result.noise.freedom)
        if wander == Loose():
            return result
        other = self.once(result.noise, replace(wander, rotation=none.rotation))
        evidence = wander_evidence(problem, self.stops) + other.selection.weighed
        ahead = result.selection.weighed - evidence
        return result if ahead > np.log(EVIDENCE_RATIO) else other


def _described(run: _Run, result: _Result, diagnosis: Diagnosis, evidence: float) -> Diagnosis:
    """Return a diagnosis with a description of its gap, where that says more than its names.

    What changes slowly can pass for a zero that scatters from pass to pass: where one was taken,
    the run is described without it too, and that counts if it is clearly likelier than the scatter.
    """
    run.tell("looking for what a gap without a name depends on")
    if result.loose.zero or result.loose.slope:
        none = replace(result.loose, zero=0.0, slope=0.0)
        plain = run.whitened(result.noise, none)
        scatter = evidence + wander_evidence(plain, run.stops)
        if description_worth(plain, run.stops, result.noise, run.seed) > scatter:
            other = run.once(result.noise, none)
            made = _diagnosis(other, run.stops)
            made = described(made, scatter, other.problem, other.selection, other.noise, run.seed)
            if made.verdict == verdicts.DESCRIBED:
                return made
    made = described(diagnosis, evidence, result.problem, result.selection, result.noise, run.seed)
    return or_fading(made, result.problem)


def _same(result: _Result, noise: Noise, loose: Loose) -> bool:
    return (
        abs(noise.size / result.noise.size - 1.0) < _SAME_NOISE
        and abs(noise.correlation - result.noise.correlation) < _SAME_CORRELATION
        and loose == result.loose
    )


def _turning(
    run: _Run, result: _Result, diagnosis: Diagnosis, stated: float
) -> tuple[Diagnosis, float]:
    """Weigh rotations of all axes at once against the effects that were chosen without them.

    Returns:
        the likelier diagnosis, and its evidence less what it costs that its effects are some of all
        that were tried.

    Both explanations are compared by their evidence with the same noise. That of rotations is
    averaged over their sizes, and beside them effects are looked for as without them.
    """
    run.tell("weighing rotations of all axes")
    freedom = result.noise.freedom
    without = diagnosis, result.selection.weighed
    rotations = judge_rotations(result.problem, run.stops, (), freedom, run.seed)
    if rotations.p_value > FALSE_NAME_LEVEL:
        return without
    turned = run.once(result.noise, replace(result.loose, rotation=rotations.size))
    chosen = turned.selection.candidates
    beside = judge_rotations(result.problem, run.stops, chosen, freedom, run.seed)
    if beside.p_value > FALSE_NAME_LEVEL:
        return without
    ahead = rotations.evidence + turned.selection.evidence - result.selection.evidence
    explained = (verdicts.CONSISTENT, verdicts.NAMED, verdicts.AMBIGUOUS)
    margin = float(np.log(_NEEDLESS)) if diagnosis.verdict == verdicts.CONSISTENT else 0.0
    if ahead <= margin and diagnosis.verdict in explained:
        return beside_rotations(diagnosis, beside, float(ahead)), result.selection.weighed
    evidence = rotations.evidence + turned.selection.weighed - float(np.log(len(run.effects)))
    turned = run.settled(turned, stated)
    made = _diagnosis(turned, run.stops)
    if made.verdict not in explained and diagnosis.verdict in explained:
        return without
    finding = rotation_finding(beside, diagnosis, float(ahead), turned.luck.freedom)
    return _with_rotations(made, finding, result, run.stops), evidence


def _with_rotations(
    made: Diagnosis, rotations: Finding, without: _Result, stops: Stops
) -> Diagnosis:
    """Return a diagnosis beside rotations of all axes with these as its first finding.

    Args:
        made: with the rotations in its baseline.
        rotations: as a finding.
        without: the run as it was looked at before, without them.
        stops: of the run.
    """
    findings = (rotations, *made.findings)
    partial = made.partial
    if made.verdict == verdicts.UNEXPLAINED:
        findings, partial = (), (rotations, *made.partial)
        verdict = made.verdict
        sentence = f"{rotations.label} explain part of the gap. Beside them: {made.sentence}"
    else:
        verdict, sentence = explained_by(findings)
    count = len(made.covariance)
    covariance = np.zeros((count + 1, count + 1))
    covariance[0, 0] = rotations.covariance[0, 0]
    covariance[1:, 1:] = made.covariance
    problem, none = without.problem, np.zeros((len(without.problem.gap), 0))
    freedom = without.noise.freedom
    shares = gap_map(problem, problem.gap, none, stops, freedom)
    looks = patterns(problem, problem.gap, none, stops, freedom)
    return replace(
        made,
        verdict=verdict,
        sentence=sentence,
        findings=findings,
        partial=partial,
        covariance=covariance,
        chi_squared_before=without.before.chi_squared,
        degrees_of_freedom_before=without.before.freedom,
        lack_of_fit_p_before=without.before.p_value,
        residual_before=problem.baseline.spread(problem.readings(problem.gap)),
        where=sentences(shares, looks, without.before.shape, without.noise.size),
        map=shares,
        patterns=looks,
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
        loose=result.loose,
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
    return explained_by(chosen)


def _gross(stops: Stops, words: tuple[str, ...]) -> Diagnosis:
    count = len(stops.time)
    nothing = np.full(count, np.nan)
    noise = Noise(float("nan"), 0.0, 0.0, "not estimated", 0.0)
    empty = _unfitted(verdicts.UNEXPLAINED, "", stops, nothing, 0, noise)
    return replace(
        empty,
        sentence=f"Model and run disagree grossly: {'; '.join(words)}.",
        where=words,
    )


def _what_is_lacking(stops: Stops) -> str:
    """List what these lines do not have and what would let them contradict the model."""
    lines = stops.lines
    diagonals = [line for line in lines if line.kind != "linear"]
    lacking = {
        "both directions": len({line.direction for line in lines}) < 2,
        "each line again": not any(line.repeat for line in lines),
        "linear lines": len(diagonals) == len(lines),
        "a fourth diagonal": len({line.name for line in diagonals}) < 4,
        "another move order": len({line.order for line in diagonals}) < 2,
    }
    return " or ".join(name for name, lacks in lacking.items() if lacks) or "more lines"


def _not_testable(stops: Stops, baseline: Baseline, noise: Noise, why: str) -> Diagnosis:
    freedom = len(baseline.gap) - int(np.linalg.matrix_rank(baseline.matrix))
    sentence = f"The model was not tested: {why}."
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
