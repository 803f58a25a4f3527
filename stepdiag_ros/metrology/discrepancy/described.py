"""When a gap is described instead of named: the description must be likelier than the names."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.chance import coverage_factor
from stepdiag_ros.metrology.discrepancy.describe import MOST_DEPENDENCES, Describer, Shapes
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    CONSISTENT_LEVEL,
    DESCRIBED,
    NAMED,
    Candidate,
    Description,
    Diagnosis,
    Finding,
    RunnerUp,
)
from stepdiag_ros.metrology.discrepancy.lack_of_fit import LackOfFitTest
from stepdiag_ros.metrology.discrepancy.loose import span_beyond, unit_span
from stepdiag_ros.metrology.discrepancy.noise import Noise
from stepdiag_ros.metrology.discrepancy.rotation_finding import shaken_by
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO, Selection
from stepdiag_ros.metrology.effects.learned_rotation import learned
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector

_EXPLAINED = (CONSISTENT, NAMED, AMBIGUOUS)
WITHOUT_A_NAME = "something without a name"
"""A rival of names that is a formula."""
_APART = 9.0
"""χ² between what two explanations leave of the readings below which these say the same."""
_SHARE_APART = 0.2
"""The same, as a share of what they take of the readings."""
_LARGEST = 3_000_000
"""Readings times free values of a run beyond which the search would take minutes."""


def described(
    diagnosis: Diagnosis,
    evidence: float,
    problem: Whitened,
    selection: Selection,
    noise: Noise,
    seed: int,
) -> Diagnosis:
    """Return a diagnosis with a description of its gap, where that says more than its names.

    Args:
        diagnosis: by the effects of the catalogue.
        evidence: of what it names, each effect being one of all that were tried.
        problem: whitened, rotations of all axes not in its baseline.
        selection: effects chosen for the gap of ``problem``.
        noise: that ``problem`` was whitened with.
        seed: of the draws that show the influence of chance.
    """
    if _is_too_large(problem):
        return diagnosis
    explained = diagnosis.verdict in _EXPLAINED
    evidence = max(evidence, _worth_of_names(selection, problem, diagnosis.stops))
    describer = Describer(problem, diagnosis.stops, noise.freedom, seed)
    alone = describer(np.zeros((len(problem.gap), 0)))
    ahead = -np.inf if alone is None else alone.evidence - evidence
    if alone is not None and (not explained or ahead > -np.log(EVIDENCE_RATIO)):
        made = _made(diagnosis, alone, problem, (), noise)
        if explained and says_the_same(diagnosis, made):
            return diagnosis
        closes = made.lack_of_fit_p_after >= CONSISTENT_LEVEL
        if closes and (not explained or ahead > np.log(EVIDENCE_RATIO)):
            return made
        if explained:
            # A formula that is likelier but not complete leaves doubt about names that are.
            return or_without_a_name(diagnosis, alone, ahead if closes else min(ahead, 0.0))
    if explained:
        return diagnosis
    names = len(selection.chosen)
    beside = describer(selection.span()) if 0 < names < MOST_DEPENDENCES else None
    if beside is not None and names + len(beside.dependences) <= MOST_DEPENDENCES:
        made = _made(diagnosis, beside, problem, selection.findings(), noise)
        if made.lack_of_fit_p_after >= CONSISTENT_LEVEL:
            return made
    partly = alone or beside
    if partly is None:
        return diagnosis
    return replace(diagnosis, description=Description(partly.dependences))


def description_worth(problem: Whitened, stops: Stops, noise: Noise, seed: int) -> float:
    """Return the evidence of what describes a gap alone, less the odds that it must have.

    Args:
        problem: whitened, rotations of all axes not in its baseline.
        stops: of the run.
        noise: that ``problem`` was whitened with.
        seed: of the draws that show the influence of chance.
    """
    if _is_too_large(problem):
        return -np.inf
    alone = Describer(problem, stops, noise.freedom, seed)(np.zeros((len(problem.gap), 0)))
    return -np.inf if alone is None else alone.evidence - float(np.log(EVIDENCE_RATIO))


def _worth_of_names(selection: Selection, problem: Whitened, stops: Stops) -> float:
    """Return the evidence of the chosen effects as a description has it, by Schwarz's criterion.

    What a run does not determine of an effect is free, and counts for it neither way.
    """
    if not selection.chosen:
        return 0.0
    columns, free = _columns_of(selection.candidates, problem, stops)
    gap = problem.gap - free @ (free.T @ problem.gap)
    gain = float(np.sum((unit_span(columns).T @ gap) ** 2))
    price = 0.5 * int(columns.shape[1]) * float(np.log(len(gap)))
    return 0.5 * gain - price + selection.prior


def _columns_of(
    candidates: Sequence[Candidate], problem: Whitened, stops: Stops
) -> tuple[Vector, Vector]:
    """Return the columns of sizes beyond what is free, and what is free beside the baseline.

    Args:
        candidates: of which the columns are.
        problem: whitened, the baseline projected out.
        stops: of the run.
    """
    acting = [(one.effect, one.setting) for one in candidates]
    unknown = [effect.unknown(setting, stops) for effect, setting in acting]
    free = span_beyond(problem, np.column_stack(unknown))
    columns = problem.left_of(np.column_stack([one.columns(at, stops) for one, at in acting]))
    return columns - free @ (free.T @ columns), free


def _is_too_large(problem: Whitened) -> bool:
    return problem.span.size > _LARGEST


def _made(
    diagnosis: Diagnosis,
    shapes: Shapes,
    problem: Whitened,
    names: Sequence[Finding],
    noise: Noise,
) -> Diagnosis:
    """Return a diagnosis by shapes, alone or beside named effects."""
    empty = [*names, *_unfitted(shapes)]
    columns, free = _columns_of([one.candidate for one in empty], problem, diagnosis.stops)
    span = np.column_stack([free, unit_span(columns)])
    left = problem.gap - span @ (span.T @ problem.gap)
    (after,) = LackOfFitTest(problem, diagnosis.stops, noise)((left, span))
    description = Description(shapes.dependences)
    if not names:
        description = _with_nearest(description, shapes.gain, diagnosis)
    explained = not names and diagnosis.verdict in _EXPLAINED
    covariance = np.linalg.pinv(columns.T @ columns)
    return replace(
        diagnosis,
        verdict=DESCRIBED,
        sentence=_sentence(description, [one.label for one in names], explained),
        findings=_fitted(empty, np.linalg.pinv(columns) @ problem.gap, covariance, noise),
        partial=(),
        covariance=covariance,
        chi_squared_after=after.chi_squared,
        degrees_of_freedom_after=after.freedom,
        lack_of_fit_p_after=after.p_value,
        residual_after=problem.baseline.spread(problem.readings(left)),
        where_after=(),
        patterns_after=(),
        description=description,
    )


def says_the_same(named: Diagnosis, described: Diagnosis) -> bool:
    """Say whether names leave the same readings as a formula of no fewer terms."""
    if any(one.candidate.effect.typical for one in named.findings):
        return False
    apart = named.residual_after - described.residual_after
    taken = named.residual_before - named.residual_after
    squares, whole = (float(np.nansum((one / named.noise) ** 2)) for one in (apart, taken))
    fewer = len(described.findings) < sum(len(one.sizes) for one in named.findings)
    return squares < min(_APART, _SHARE_APART * whole) and not fewer


def or_without_a_name(diagnosis: Diagnosis, shapes: Shapes, ahead: float) -> Diagnosis:
    """Return a diagnosis by names that says that a description cannot be ruled out either.

    Args:
        diagnosis: by names.
        shapes: by which the run is described without any of them.
        ahead: evidence of the description over that of the names.
    """
    chance = float(np.exp(ahead))
    words = " and ".join(dict.fromkeys(one.words for one in shapes.dependences))
    count = sum(len(one.shapes) for one in shapes.dependences)
    rival = RunnerUp(
        f"{WITHOUT_A_NAME} ({words})",
        shapes.gain,
        chance / (1.0 + chance),
        f"lowers χ² by {shapes.gain:.3g} with a formula of {count} terms: odds {chance:.2g} to 1,"
        " too close to rule out",
        ambiguous=True,
    )
    for place in range(len(diagnosis.findings)):
        diagnosis = shaken_by(rival, diagnosis, place)
    return diagnosis


def _unfitted(shapes: Shapes) -> list[Finding]:
    """Return a finding for each shape, its sizes to be fitted."""
    made = []
    for one in shapes.dependences:
        for shape in one.shapes:
            setting = {"acts_on": one.acts_on, "shape": shape}
            effect = learned(one.acts_on)
            candidate = Candidate(effect, setting, effect.label(setting))
            made.append(Finding(candidate, {}, {}, {}, 0.0, one.p_value, one.probability))
    return made


def _fitted(
    findings: Sequence[Finding], sizes: Vector, covariance: Vector, noise: Noise
) -> tuple[Finding, ...]:
    """Return findings with the sizes that were fitted together."""
    factor = coverage_factor(noise.freedom)
    made = []
    place = 0
    for finding in findings:
        own = slice(place, place + len(finding.candidate.effect.sizes))
        place = own.stop
        part = covariance[own, own]
        uncertainty = np.sqrt(np.diag(part))
        named = [size.name for size in finding.candidate.effect.sizes]
        values = dict(zip(named, sizes[own].tolist(), strict=True))
        u = dict(zip(named, uncertainty.tolist(), strict=True))
        made.append(
            replace(
                finding,
                sizes=values,
                standard_uncertainty=u,
                band={
                    name: (value - factor * u[name], value + factor * u[name])
                    for name, value in values.items()
                },
                gain=float(sizes[own] @ np.linalg.pinv(part) @ sizes[own]),
                covariance=part,
            )
        )
    return tuple(made)


def _with_nearest(description: Description, gain: float, diagnosis: Diagnosis) -> Description:
    """Return a description that says which effect of the catalogue comes nearest to it."""
    findings = diagnosis.findings or diagnosis.partial
    if not findings or not gain > 0.0:
        return description
    taken = max(findings, key=lambda one: one.gain)
    share = min(taken.gain / gain, 1.0)
    return replace(description, nearest=taken.label, nearest_share=share)


def _sentence(description: Description, names: Sequence[str], explained: bool) -> str:
    words = "; and ".join(dict.fromkeys(one.words for one in description.dependences))
    beside = f"Beside {'; '.join(names)}, it" if names else "It"
    start, near = "No effect of the catalogue closes the gap", ""
    if explained:
        start = "A formula explains the gap better than any effect of the catalogue"
    if description.nearest:
        percent = f"{100.0 * description.nearest_share:.0f} % of the gap"
        odds = f", at odds of less than 1 to {EVIDENCE_RATIO:g}" if explained else ""
        near = f" Nearest in the catalogue: {description.nearest} ({percent}{odds})."
    return f"{start}. {beside} is {words}.{near}"
