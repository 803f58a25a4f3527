"""What becomes of effects from run to run, in sentences."""

from collections.abc import Sequence
from math import isfinite

from stepdiag_ros.evaluation.history import HistoryReport
from stepdiag_ros.metrology.discrepancy.course import (
    CHANGES,
    COMES_AND_GOES,
    GROWS,
    IN_ALL,
    UNDETERMINED,
    Figure,
)
from stepdiag_ros.metrology.discrepancy.findings import NOT_TESTABLE, UNEXPLAINED
from stepdiag_ros.metrology.discrepancy.history import EffectHistory
from stepdiag_ros.metrology.effects.effect import Size
from stepdiag_ros.text.numbers import UNKNOWN, with_uncertainty
from stepdiag_ros.words.diagnosis import chance, readable

ORDER = (GROWS, COMES_AND_GOES, CHANGES, IN_ALL, UNDETERMINED)
"""Kinds in the order in which a reader wants to know of them."""
_MOST_RIVALS = 4


def figure_words(figure: Figure, size: Size, per: str = "") -> str:
    """Write a number with its 95 % coverage interval, for example ``0.800 ± 0.021 µm``."""
    unit, factor = readable(size)
    low, high = figure.band
    if not isfinite(high - low):
        return UNKNOWN
    written, uncertainty = with_uncertainty(figure.value * factor, 0.5 * (high - low) * factor)
    return f"{written} ± {uncertainty} {unit}{per}".rstrip()


def runs_words(indices: Sequence[int]) -> str:
    """Name runs by their numbers: ``run 2``, ``runs 1, 3 and 4``."""
    numbers = [str(index + 1) for index in indices]
    if len(numbers) == 1:
        return f"run {numbers[0]}"
    return f"runs {', '.join(numbers[:-1])} and {numbers[-1]}"


def effect_sentence(effect: EffectHistory) -> str:
    """Say what becomes of an effect, how sure that is, and what the runs do not show."""
    said = [_main(effect)]
    course = effect.course
    if course.blind:
        said.append(f"{runs_words(course.blind).capitalize()} could not show it.")
    if effect.rivals:
        rivals = "; ".join(effect.rivals[:_MOST_RIVALS])
        more = len(effect.rivals) - _MOST_RIVALS
        said.append(
            f"All runs together do not rule out {rivals}{f'; and {more} more' if more > 0 else ''}."
        )
    return " ".join(said)


def _main(effect: EffectHistory) -> str:
    course, size = effect.course, effect.figure
    common = figure_words(course.common, size)
    if course.kind == IN_ALL:
        return f"One size explains all runs (p {chance(course.p_common)}): {common}."
    refuted = f"One size in all runs is refuted (p {chance(course.p_common)})"
    if course.kind == GROWS:
        rate = figure_words(course.rate, size, " per month")
        return f"{refuted}, a steady change is not: {rate}."
    if course.kind == COMES_AND_GOES:
        known = f" ({common})" if isfinite(course.common.value) else " (in different sizes)"
        return f"It is in {runs_words(course.having)}{known}, not in {runs_words(course.lacking)}."
    if course.kind == CHANGES:
        return f"{refuted}. {_why_open(effect)}"
    why = "the runs differ by more than is likely, but not beyond doubt"
    if len(course.having) == 1:
        why = f"only {runs_words(course.having)} shows it"
    elif not course.having:
        why = "no run shows it by itself"
    return f"Whether it stays or changes is undetermined: {why} (p {chance(course.p_common)})."


def _why_open(effect: EffectHistory) -> str:
    course = effect.course
    shown = [one for one in course.sizes if isfinite(one.value)]
    where = f" It is beyond chance in {runs_words(course.having)}." if course.having else ""
    if len(shown) == 2:
        return f"Two runs do not show whether it grows or comes and goes.{where}"
    if isfinite(course.rate.value) and course.lacking:
        return f"The runs do not decide between growth and coming and going.{where}"
    return f"Neither a steady change nor one size in some runs explains it.{where}"


def summary_sentence(report: HistoryReport) -> str:
    """Say in one sentence what grows, what comes and goes, and what is in all runs."""
    parts = []
    for kind, words in (
        (GROWS, "grows"),
        (COMES_AND_GOES, "comes and goes"),
        (CHANGES, "changes"),
        (IN_ALL, "in all runs"),
        (UNDETERMINED, "undetermined"),
    ):
        labels = [one.label for one in report.effects if one.course.kind == kind]
        if labels:
            parts.append(f"{words}: {'; '.join(labels)}")
    if not parts:
        return "No run names or describes an effect: nothing can be followed from run to run."
    text = ". ".join(f"{part[0].upper()}{part[1:]}" for part in parts)
    return f"{text}."


def remark_sentences(report: HistoryReport) -> list[str]:
    """Say what the sizes do not contain, and where the curves are compared."""
    said = []
    for number, run in enumerate(report.runs, 1):
        if run.diagnosis.verdict == UNEXPLAINED:
            said.append(f"Run {number} is UNEXPLAINED: what is missing there may change its sizes.")
        if run.diagnosis.verdict == NOT_TESTABLE:
            said.append(
                f"Run {number} is NOT TESTABLE: its noise is not known, or nothing can show."
            )
    first, last = (str(run.files[0].path) for run in (report.runs[0], report.runs[-1]))
    said.append(
        "Each run has error curves, alignments and zeros of its own. For what changed in the"
        f" curves: stepdiag changes {first} {last}"
    )
    return [*said, *report.remarks]
