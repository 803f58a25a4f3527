"""The first page in plain words: is the machine good, its largest error, how sure, what to do."""

import math
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.evaluation.budget import shown_rotations
from stepdiag_ros.evaluation.compensation import CompensationReport
from stepdiag_ros.evaluation.positioning import PositioningReport
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    DESCRIBED,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
    Finding,
)
from stepdiag_ros.metrology.effects.several_angular_errors import EFFECT as SEVERAL_ANGULAR_ERRORS
from stepdiag_ros.metrology.plausible import ROTATIONS_KEY
from stepdiag_ros.metrology.standards.conformity import Conformity, conformity
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.uncertainty.source import ANGULAR
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.page import Fact, Lead
from stepdiag_ros.report.pages.sections.measurement import temperature_words
from stepdiag_ros.report.tables.diagnosis import rivals_words
from stepdiag_ros.report.tables.positioning import MEANINGS
from stepdiag_ros.text.numbers import (
    OF_READINGS,
    UNKNOWN,
    place_in_mm,
    plain,
    two_digits,
    with_expanded,
    with_uncertainty,
)
from stepdiag_ros.words.budget import LOWERED_BY
from stepdiag_ros.words.diagnosis import sizes_words
from stepdiag_ros.words.lead import ANGULAR_PLAN, laser_scale, missing_words, sentences_of
from stepdiag_ros.words.positioning import decimals_of, leading_parameters, size_words
from stepdiag_ros.words.proposal import proposed_sentences

_MEANS = {
    CONSISTENT: "the error curves explain all readings",
    NAMED: "another effect acts, and it is found",
    AMBIGUOUS: "another effect acts, and several causes explain it",
    DESCRIBED: "something without a name acts; a formula describes it",
    UNEXPLAINED: "something acts that the error curves do not contain",
    NOT_TESTABLE: "no reading of this run could contradict the error curves",
}
"""Verdict of the diagnosis → what it means to a customer."""
_ROTATES = "axes rotate as they move, which every ± contains"
KEEPS, EXCEEDS, OPEN, NOT_ASKED = "keeps", "exceeds", "open", "not asked"
_VERDICTS = {
    Conformity.NOT_ASKED: NOT_ASKED,
    Conformity.WITHIN: KEEPS,
    Conformity.NOT_WITHIN: EXCEEDS,
    Conformity.UNDECIDED: OPEN,
}


@dataclass(frozen=True)
class ToleranceJudgement:
    """Whether the longest error vector in the volume is allowed (ISO 14253-1).

    Attributes:
        verdict: ``keeps``: value + U is within the tolerance; ``exceeds``: value - U is beyond it;
            ``open``: neither, or value or U is unknown, or more acts than value and U contain;
            ``not asked``: no tolerance was given.
        value: longest error vector, m; NaN if unknown.
        expanded_uncertainty: of it (95 %), m; NaN if unknown.
        lower_bound: the uncertainty is a lower bound: a source that acts is not known.
        tolerance: m; NaN if none was given.
        more_acts: the run itself shows more than value and U contain.
        noise: the errors found are no more than noise makes.
        tested: a reading of the run could contradict the error curves, and was compared with them.
    """

    verdict: str
    value: float
    expanded_uncertainty: float
    lower_bound: bool
    tolerance: float
    more_acts: bool
    noise: bool
    tested: bool = True

    @property
    def guard_band(self) -> float:
        """Return how far a value is from its limit where it is proven on either side, m.

        By the default rule of ISO 14253-1 that is U; NaN without a limit.
        """
        return math.nan if self.verdict == NOT_ASKED else self.expanded_uncertainty

    @property
    def size(self) -> str:
        """Write the largest error with its uncertainty, which may be a lower bound."""
        size = with_expanded(self.value, self.expanded_uncertainty, IN_MICRO)
        bound = " (U is a lower bound)" if self.lower_bound else ""
        return UNKNOWN if size == UNKNOWN else f"{size} µm{bound}"

    @property
    def reservation(self) -> str:
        """Say on what a decision rests beyond the figures; empty without a decision or a doubt."""
        if not self.decided:
            return ""
        known = ", as far as the uncertainty is known" if self.lower_bound else ""
        return known if self.tested else f"{known}; the run could not test the error curves"

    @property
    def decided(self) -> bool:
        """Say whether the value is proven to be on either side of its limit."""
        return self.verdict in (KEEPS, EXCEEDS)

    @property
    def basis(self) -> str:
        """Say on what the value and a decision rest where the run did not test that."""
        if self.tested or not math.isfinite(self.value):
            return ""
        return (
            "The largest error and U rest on the assumption that the machine has no errors beside"
            " its error curves: no reading of this run tested that."
        )

    @property
    def limit(self) -> str:
        """Write the tolerance as exactly as it was given."""
        return f"{self.tolerance * IN_MICRO:.10g} µm"


def verdict_words(material: Material) -> str:
    """Return the verdict of the diagnosis, and what it means to a customer."""
    verdict = material.lead.verdict
    if verdict.contained:
        return f"{verdict.name}: {_ROTATES}"
    return f"{verdict.name}: {_MEANS[verdict.name]}" if verdict.name in _MEANS else verdict.name


def judge(material: Material) -> ToleranceJudgement:
    """Judge the longest error vector in the volume."""
    accuracy, tolerance = material.accuracy, material.given.tolerance
    value = math.nan if accuracy is None else accuracy.value
    expanded = material.expanded_uncertainty
    more_acts, noise = material.lead.more_acts, material.lead.noise
    proven = conformity(value, expanded, tolerance, more_acts=more_acts, noise=noise)
    verdict = _VERDICTS[proven]
    return ToleranceJudgement(
        *(verdict, value, expanded, material.lower_bound, tolerance, more_acts, noise),
        tested=material.lead.verdict.tested,
    )


def lead_of(material: Material) -> Lead:
    """Return what stands on the first page."""
    judged = judge(material)
    if material.lead.positioning is not None:
        return _lead_of_tests(material, material.lead.positioning, judged)
    tone, headline = _headline(material, judged)
    if judged.more_acts and tone != "bad":
        # Whatever the figures are, something is to be done about what acts beside them.
        tone = "open"
    if not material.lead.whole and tone == "good":
        tone = "open"
    sentences = [*sentences_of(material.lead), *_judged(judged)]
    if math.isfinite(judged.value):
        sentences.append(f"Temperature of these results: {temperature_words(material)}.")
    sentences += _basis(material)
    first, *others = what_to_do(material, judged)
    sentences += [f"What to do: {first}", *(f"Then: {text}" for text in others)]
    facts = tuple(_facts(material, judged))
    return Lead(tone, headline, tuple(sentences), facts, _worst(material, judged, headline))


def _lead_of_tests(
    material: Material, positioning: PositioningReport, judged: ToleranceJudgement
) -> Lead:
    """Return what stands on the first page of a run that is nothing but tests of axes."""
    decimals = decimals_of(positioning.tests)
    several = len(positioning.tests) > 1
    figures, facts = [], []
    for test in positioning.tests:
        names = leading_parameters(test)
        sizes = [
            size_words(test.parameters[name], test.expanded_uncertainty[name], decimals)
            for name in names
        ]
        figures.append(f"{test.name} {names[0]} = {sizes[0]}")
        facts += [
            Fact(f"{test.name}: {name}" if several else name, f"{size}, {MEANINGS[name]}")
            for name, size in zip(names, sizes, strict=True)
        ]
    standard = " and ".join(dict.fromkeys(test.standard for test in positioning.tests))
    sentences = sentences_of(material.lead)
    if judged.verdict != NOT_ASKED:
        sentences += _judged(judged)
    sentences.append(f"Temperature of these results: {temperature_words(material)}.")
    if not material.uneven:
        sentences += _basis(material)
        facts.append(Fact("Model and run", verdict_words(material)))
    first, *others = what_to_do(material, judged)
    sentences += [f"What to do: {first}", *(f"Then: {text}" for text in others)]
    tone = "neutral" if material.lead.whole and judged.verdict == NOT_ASKED else "open"
    facts += _identity(material)
    return Lead(tone, f"{standard}: {'; '.join(figures)}", tuple(sentences), tuple(facts))


def _worst(material: Material, judged: ToleranceJudgement, headline: str) -> str:
    """Say the largest error with its uncertainty and its place; empty where it is not known."""
    accuracy = material.accuracy
    if accuracy is None or not math.isfinite(judged.value) or judged.noise:
        return ""
    where = place_in_mm(accuracy.position)
    if judged.size in headline:
        return f"at {where} (U: 95 %)"
    size = with_expanded(judged.value, judged.expanded_uncertainty, IN_MICRO)
    bound = ", a lower bound" if judged.lower_bound else ""
    return f"Largest error {size} µm (U: 95 %{bound}) at {where}"


def _headline(material: Material, judged: ToleranceJudgement) -> tuple[str, str]:
    limit = judged.limit
    if material.report.preferred() is None:
        return "open", "This run does not determine the machine's errors"
    if not math.isfinite(judged.value):
        return "open", "This run determines only some of the machine's errors"
    if material.lead.verdict.name in (UNEXPLAINED, DESCRIBED):
        return "bad", "Something acts in this machine that the error curves do not contain"
    words = {
        KEEPS: (
            "open" if judged.reservation else "good",
            f"The machine conforms to its limit of {limit} in the measured volume",
        ),
        EXCEEDS: ("bad", f"The machine exceeds its limit of {limit} in the measured volume"),
        OPEN: (
            "open",
            f"The measurement does not decide whether the machine conforms to its limit of {limit}",
        ),
    }
    if judged.verdict not in words:
        if judged.noise:
            return "neutral", "No error of this machine stands out from the noise"
        return "neutral", f"Largest error in the measured volume: {judged.size}"
    tone, text = words[judged.verdict]
    return tone, text + judged.reservation


def _judged(judged: ToleranceJudgement) -> list[str]:
    if not math.isfinite(judged.value):
        nor = "" if judged.verdict == NOT_ASKED else f", nor whether it is within {judged.limit}"
        return [f"These lines do not determine the largest error in the volume{nor}."]
    if judged.verdict == NOT_ASKED:
        return ["No limit was agreed, so this report does not judge the machine."]
    limit = judged.limit
    if judged.more_acts:
        return [
            "The run shows more than the error curves: no decision at"
            f" {limit}, since the rule of ISO 14253-1 needs an uncertainty that contains all that"
            " acts."
        ]
    reason = {
        KEEPS: f"The largest error plus its uncertainty is within {limit} (ISO 14253-1).",
        EXCEEDS: f"The largest error minus its uncertainty is beyond {limit} (ISO 14253-1).",
        OPEN: f"The largest error or its uncertainty does not allow a decision at {limit}"
        " (ISO 14253-1).",
    }
    rests = f" {judged.basis}" if judged.decided and judged.basis else ""
    return [reason[judged.verdict] + rests]


def _basis(material: Material) -> list[str]:
    """Say what the ± hold."""
    if not any(math.isfinite(one.value) for one in material.single_errors):
        return ["How sure: The ± in the sections are those without the uncertainty budget."]
    narrow, wide = (
        f", {with_uncertainty(one.value, one.value * IN_MICRO)[1]} µm for the largest error"
        if math.isfinite(one.value)
        else ""
        for one in (material.expanded_of_readings, material.expanded_of_budget)
    )
    scale = laser_scale(material.measurement.plausible)
    return [
        "How sure: Each ± on this page and the next is the larger of two.",
        f"By the readings{narrow}: It contains the scatter of the readings, {scale}, and pitch, yaw"
        f" and roll as far as the readings of this run leave them open. Tables headed"
        f" '{OF_READINGS}' show it.",
        f"By the uncertainty budget{wide}: {_of_rotations(material)} {_of_laser(material)}",
        _plausible_size(material),
    ]


def _of_rotations(material: Material) -> str:
    """Say what the budget contains of pitch, yaw and roll."""
    if not material.report.chain:
        return (
            "It does not contain pitch, yaw and roll, because the order of the machine's axes is"
            " not known, and is a lower bound."
        )
    if math.isfinite(_shown_size(material)):
        return (
            "It contains pitch, yaw and roll in the size that the readings show, which is larger"
            " than the plausible one."
        )
    return (
        "It contains pitch, yaw and roll in their whole plausible size, even where the readings"
        " show that they are smaller."
    )


def _shown_size(material: Material) -> float:
    """Return how large the readings show rotations where that is more than plausible, rad; NaN."""
    stated = material.given.instrument.angular_errors
    size = material.measurement.plausible.rotation
    expected = stated.standard_uncertainty if stated.known else size
    return shown_rotations(None if material.budget is None else material.budget.budget, expected)


def _of_laser(material: Material) -> str:
    """Say what the budget contains of laser, air and setup."""
    known = material.given.instrument_source
    if not known and material.given.conditions.stated:
        return (
            "The measuring conditions were stated for the ISO 230 tests alone (--uncertainty): the"
            " ± of a positioning error is at least the U that ISO 230-2 states for it, as far as"
            " that U is known. The budget takes laser, air and setup from an instrument file"
            " (--instrument) alone and does not contain them, so that every other ± is a lower"
            " bound."
        )
    if not known:
        what = "expansion coefficient, material temperature, " * material.lead.material
        return (
            f"Nothing was stated about {what}laser, air and setup (--instrument), so that the"
            " budget does not contain them and every ± is a lower bound."
        )
    words = (
        "The budget contains the uncertainties of laser, air and setup that the instrument file"
        f' "{known}" states'
    )
    if material.lower_bound:
        return f"{words}. Unknown: {material.unknown_sources}; every ± is a lower bound."
    return f"{words}."


def _plausible_size(material: Material) -> str:
    """Say what the plausible size of rotations is, who stated it, and how much of U it makes."""
    stated = material.given.instrument.angular_errors
    size = material.measurement.plausible.rotation
    meaning = "standard deviation of each angle at the end of its travel"
    if stated.known:
        source = f"{stated.standard_uncertainty * IN_MICRO:.3g} µrad by the instrument file"
    elif ROTATIONS_KEY in material.recorded.machine:
        source = f"{size * IN_MICRO:.3g} µrad by '{ROTATIONS_KEY}' of the machine file"
    else:
        source = (
            f"{size * IN_MICRO:.3g} µrad, assumed because '{ROTATIONS_KEY}' is not stated (key of"
            " the machine file, or of the mapping of a table)"
        )
    most = ""
    largest = material.budget_of_largest_error
    if material.budget is not None and largest is not None:
        turning = [one.group == ANGULAR for one in material.budget.budget.sources]
        parts = largest.contributions**2
        if 2.0 * np.nansum(parts[turning]) > np.nansum(parts):
            most = " Most of the U of the largest error comes from it."
    shown, larger = _shown_size(material), ""
    if math.isfinite(shown):
        larger = f" The readings show {shown * IN_MICRO:.3g} µrad."
    return f"Plausible size of pitch, yaw and roll: {source} ({meaning}).{larger}{most}"


def what_to_do(material: Material, judged: ToleranceJudgement) -> list[str]:
    """Return what is to be done, most urgent first, in sentences that go on from a colon."""
    bag, run = material.recorded.path.name, material.lead
    said = [] if run.whole else [f"measure what is missing: {missing_words(run)}."]
    if material.diagnosis is not None:
        diagnosis = material.diagnosis.diagnosis
        proposed = proposed_sentences(material.diagnosis)
        if diagnosis.verdict in (UNEXPLAINED, DESCRIBED):
            said.append("find the cause of the gap before the machine is corrected by this run.")
            if diagnosis.where:
                said[-1] += f" {diagnosis.where[0]}"
            said += [f"{text[:1].lower()}{text[1:]}" for text in proposed[:1]]
        if diagnosis.verdict == AMBIGUOUS:
            said.append(
                "measure what distinguishes the causes; possible are"
                f" {rivals_words(material.diagnosis)}."
            )
            said += [f"measure next: {text}" for text in proposed[:1]]
            said.append(f"the extra plan as a file: stepdiag diagnose {bag} --propose more.yaml.")
        for finding in diagnosis.findings if diagnosis.verdict == NAMED else ():
            said.append(f"see to {finding.label} ({sizes_words(finding)}).{_which(finding)}")
        if diagnosis.verdict == NOT_TESTABLE:
            said.append(
                "measure lines that test each other, with repeats: nothing in this run could"
                " contradict its figures."
            )
    if material.uneven:
        tests = material.positioning
        if tests is not None and tests.unknown:
            said.append(
                "state the measuring conditions (--uncertainty FILE), from which U follows."
            )
        said.append("to have error curves, measure at evenly spaced targets.")
    elif not math.isfinite(judged.value) and run.whole:
        needed = run.remedy or "the lines that the whole volume still needs"
        said.append(
            f"measure {needed} as well; the section 'What is not known' lists what is unknown."
        )
    elif material.compensation is not None and material.compensation.identified.warning:
        said.append(f"do not compensate by this run: {material.compensation.identified.warning}.")
    elif material.compensation is not None and (not said or run.verdict.contained):
        said += _compensated(material, material.compensation, judged)
    if judged.verdict == OPEN and math.isfinite(judged.value) and not judged.more_acts:
        said.append(f"reduce the uncertainty{_by_its_largest_source(material)}.")
    if not said:
        said.append("nothing by these figures.")
    return said


def _compensated(
    material: Material, made: CompensationReport, judged: ToleranceJudgement
) -> list[str]:
    """Say what the tables could bring the largest error to; nothing where they do not help.

    What they leave is uncertain everywhere, and most where the error is known least well.
    """
    change = made.remainder.change("volume, largest")
    if not change.after < change.before:
        return []
    before, after = (
        with_uncertainty(one * IN_MICRO, judged.expanded_uncertainty * IN_MICRO)[0]
        for one in (change.before, change.after)
    )
    reached = f"{after} µm"
    wide = COVERAGE_FACTOR * made.remainder.largest_uncertainty
    if math.isfinite(wide):
        largest = material.budget_of_largest_error
        wide *= 1.0 if largest is None else largest.scale
        most = two_digits((change.after + wide) * IN_MICRO)
        known = ", as far as the uncertainty is known" if judged.lower_bound else ""
        more = "" if change.after + wide < change.before else ", which is more than now"
        reached += f"; up to {most} µm may remain somewhere in the volume (95 %{known}){more}"
    return [
        f"compensation ({made.control.title}) could bring the largest error in the volume, with"
        f" reversal, from {before} µm to {reached}. Measure again after it."
    ]


def _which(finding: Finding) -> str:
    """Say how to learn which axes rotate, where a finding does not name them."""
    if finding.candidate.effect.name != SEVERAL_ANGULAR_ERRORS.name:
        return ""
    return (
        " These lines do not determine which axes rotate about what; a plan by"
        f" 'stepdiag {ANGULAR_PLAN}' does."
    )


def _by_its_largest_source(material: Material) -> str:
    """Name the largest source of the budget, and what lowers it; nothing without a budget."""
    if material.budget is None:
        return ""
    source = material.budget.budget.largest_group
    return f". Its largest known source: {source}. {LOWERED_BY[source]}"


def _facts(material: Material, judged: ToleranceJudgement) -> list[Fact]:
    accuracy = material.accuracy
    rms = math.nan if accuracy is None else accuracy.rms
    largest = judged.size
    if judged.noise:
        largest = f"{plain(judged.value * IN_MICRO, 3)} µm, no more than noise makes"
    return [
        Fact("Largest error in the volume", largest),
        Fact(
            "Root mean square over its nodes",
            f"{plain(rms * IN_MICRO, 2)} µm" if math.isfinite(rms) else UNKNOWN,
        ),
        Fact("Model and run", verdict_words(material)),
        *_identity(material),
    ]


def _identity(material: Material) -> list[Fact]:
    report = material.report
    return [
        Fact("Machine", (report.machine or UNKNOWN) + (", simulated" if report.simulated else "")),
        Fact("Customer", material.given.customer or UNKNOWN),
    ]
