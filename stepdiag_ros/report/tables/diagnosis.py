"""A diagnosis in words and tables; the physics is in ``metrology.discrepancy``."""

import math
from collections.abc import Sequence

from stepdiag_ros.evaluation.diagnosis import DiagnosisReport, rms_and_largest
from stepdiag_ros.evaluation.not_testable import (
    _MOST_SETTINGS,
    by_effect,
    not_testable_sentences,
    settings_words,
)
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    DESCRIBED,
    UNEXPLAINED,
    Diagnosis,
    Finding,
    dependence_words,
    in_order,
)
from stepdiag_ros.metrology.discrepancy.held_out import HeldOut
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.report.tables.proposal import pairs_table
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import UNKNOWN, plain, two_digits
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.diagnosis import chance, readable, size_rows
from stepdiag_ros.words.hints import hints
from stepdiag_ros.words.proposal import proposed_sentences

_LIMIT_COLUMNS = ("effect", "smallest size", "unit", "of")
_MOST_LABELS = 4
_MOST_RIVALS = 3
_MOST_RUNNERS_UP = 5
_NARROW, _WIDE = 80, 120
"""Fewest and most columns of a terminal that the tables are made for."""


def known_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say how large an unexplained gap is beside the noise, and how much of it names would take.

    Returns:
        Nothing unless the verdict is UNEXPLAINED and the noise is known.
    """
    rms, largest = rms_and_largest(diagnosis.residual_before)
    if diagnosis.verdict != UNEXPLAINED or not diagnosis.noise > 0.0 or not math.isfinite(rms):
        return []
    said = [
        f"Known: the gap is {two_digits(rms * IN_MICRO)} µm (rms),"
        f" {two_digits(rms / diagnosis.noise)} times the noise of a stop, and"
        f" {two_digits(largest * IN_MICRO)} µm where it is largest."
    ]
    if diagnosis.partial:
        left = rms_and_largest(diagnosis.residual_after)[0]
        said.append(
            f"Effects that close a part of it leave {two_digits(left * IN_MICRO)} µm (rms). Until"
            " the rest has a cause, they may only resemble the true one."
        )
    return said


def description_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say on what a gap without a name depends, how sure that is, and what else it may be."""
    if diagnosis.description is None:
        return []
    partly = "A part of the gap is" if diagnosis.verdict == UNEXPLAINED else "The gap is"
    said = []
    for one in diagnosis.description.dependences:
        said.append(
            f"{partly} {one.words} (Δχ² {one.gain:,.0f}, p {chance(one.p_value)}, probability"
            f" {chance(one.probability)})."
        )
        if one.rivals:
            others = "; ".join(dependence_words(*rival) for rival in one.rivals[:_MOST_RIVALS])
            said.append(
                f"This run does not rule out {others}. 'stepdiag diagnose --propose' seeks lines"
                " that decide it."
            )
        said += [f"What has such a shape: {hint}." for hint in hints(one)]
    return said


def findings_title(diagnosis: Diagnosis) -> str:
    """Return what the effects of a diagnosis are: named, possible, or only a part."""
    if diagnosis.verdict == AMBIGUOUS:
        return "One of those that would close the gap"
    if diagnosis.verdict == DESCRIBED:
        return "The formula that closes the gap: sum of size times shape"
    if diagnosis.findings:
        return "What is missing in the model"
    return "Closes a part of the gap; not to be believed alone"


def findings_table(findings: Sequence[Finding], title: str) -> Table:
    """Return what is missing in the model, strongest first."""
    table = new_table(title, "effect", "size ± U (95 %)", "Δχ²", "p", "probability")
    table.columns[0].wraps = True
    for finding in findings:
        table.add_row(
            finding.label,
            "\n".join(size_rows(finding)),
            f"{finding.gain:,.1f}",
            chance(finding.p_value),
            chance(finding.probability),
        )
    return table


def physics_sentences(findings: Sequence[Finding]) -> list[str]:
    """Say what each effect does in the machine, once for each kind, and where that is described."""
    effects = {one.candidate.effect.name: one.candidate.effect for one in findings}
    return [
        f"{name[0].upper()}{name[1:]}: {effect.sentence.rstrip('.')} ({effect.source})."
        for name, effect in effects.items()
    ]


def runners_up_tables(findings: Sequence[Finding]) -> list[Table]:
    """Return what else was tried and why it lost, a table for each finding."""
    tables = []
    for finding in findings:
        table = new_table(
            f"Instead of '{finding.label}' these were tried",
            "candidate",
            "Δχ²",
            "probability",
            "why it lost",
        )
        table.columns[0].wraps = table.columns[3].wraps = True
        table.columns[3].number = False
        for other in in_order(finding.runners_up)[:_MOST_RUNNERS_UP]:
            table.add_row(
                other.label,
                f"{other.gain:,.1f}",
                chance(other.probability),
                f"NOT RULED OUT: {other.why}" if other.ambiguous else other.why,
            )
        if table.rows:
            tables.append(table)
    return tables


def gap_table(report: DiagnosisReport) -> Table:
    """Return the gap before and after: of the run, and of what took no part in the fit."""
    diagnosis = report.diagnosis
    columns = ["", "run before" if report.findings else "run"]
    cells = [_gap_column(diagnosis, after=False)]
    if report.findings:
        columns.append("run after")
        cells.append(_gap_column(diagnosis, after=True))
    for number, again in enumerate(report.rounds, 1):
        columns.append("extended model" if number == 1 else f"extended again ({number})")
        cells.append(_gap_column(again, after=False))
    if report.held_out is not None:
        columns += ["held out before", "held out after"]
        cells += [_held_out_column(report.held_out, after) for after in (False, True)]
    table = new_table("The gap, readings minus model", *columns)
    names = (
        "χ²",
        "degrees of freedom",
        "χ² per degree of freedom",
        "p: total and shapes",
        "rms / µm",
        "largest / µm",
    )
    for column in table.columns:
        column.wraps = True
    for row, name in enumerate(names):
        table.add_row(name, *(column[row] for column in cells))
    return table


def _gap_column(diagnosis: Diagnosis, after: bool) -> tuple[str, ...]:
    if after:
        squares, freedom = diagnosis.chi_squared_after, diagnosis.degrees_of_freedom_after
        fit, gap = diagnosis.lack_of_fit_p_after, diagnosis.residual_after
    else:
        squares, freedom = diagnosis.chi_squared_before, diagnosis.degrees_of_freedom_before
        fit, gap = diagnosis.lack_of_fit_p_before, diagnosis.residual_before
    return _cells(squares, freedom, fit, *rms_and_largest(gap))


def _held_out_column(proof: HeldOut, after: bool) -> tuple[str, ...]:
    part = proof.after if after else proof.before
    return _cells(
        part.chi_squared, part.degrees_of_freedom, part.p_value, *rms_and_largest(part.residual)
    )


def _cells(squares: float, freedom: int, fit: float, rms: float, largest: float) -> tuple[str, ...]:
    each = squares / freedom if freedom > 0 else math.nan
    return (
        f"{squares:,.1f}" if math.isfinite(squares) else UNKNOWN,
        f"{freedom:,}",
        plain(each, 3),
        chance(fit),
        plain(rms * IN_MICRO, 3),
        plain(largest * IN_MICRO, 3),
    )


def limits_table(report: DiagnosisReport) -> Table | None:
    """Return the smallest sizes that this run would have shown, 19 times in 20, one row a kind."""
    limits = report.diagnosis.detection_limits
    table = new_table("Smallest size that would have been seen (95 % power)", *_LIMIT_COLUMNS)
    table.columns[2].number = table.columns[3].number = False
    for column in table.columns:
        column.wraps = column.header != "unit"
    for name, labels in by_effect(report, limits).items():
        first = report.catalogue[name].sizes[0]
        unit, factor = readable(first)
        sizes = [two_digits(abs(limits[label]) * factor) for label in labels]
        if len(set(sizes)) == 1:
            text = sizes[0]
        elif len(labels) > _MOST_SETTINGS:
            ordered = sorted(abs(limits[label]) * factor for label in labels)
            text = f"{two_digits(ordered[0])} .. {two_digits(ordered[-1])}"
        else:
            text = ", ".join(sizes)
        table.add_row(settings_words(name, labels), text, unit, first.meaning)
    return table if table.rows else None


def noise_sentence(diagnosis: Diagnosis) -> str:
    """Say how large the noise of a stop is, how that is known, and what scatters beside it."""
    if not math.isfinite(diagnosis.noise):
        return f"Noise of a stop: {UNKNOWN}; {diagnosis.noise_source.rstrip('.')}."
    text = (
        f"Noise of a stop: {two_digits(diagnosis.noise * IN_MICRO)} µm"
        f" ({diagnosis.noise_degrees_of_freedom:,.0f} degrees of freedom;"
        f" {diagnosis.noise_source.rstrip('.')})"
    )
    if abs(diagnosis.noise_correlation) >= 0.005:
        text += f", correlation of neighbouring stops {diagnosis.noise_correlation:.2f}"
    if diagnosis.loose.zero > 0.0:
        text += (
            ". In addition, the zero scatters from pass to pass by"
            f" {two_digits(diagnosis.loose.zero * IN_MICRO)} µm (standard deviation, estimated from"
            " passes over the same places)"
        )
    return f"{text}."


def group_sentences(findings: Sequence[Finding]) -> list[str]:
    """State which names this run does not distinguish from those found."""
    sentences = []
    for finding in findings:
        if finding.ambiguous:
            sentences.append(
                f"'{finding.label}' cannot be distinguished from {_listed(finding.ambiguous)}"
                " by this run."
            )
        if finding.equivalent:
            sentences.append(
                f"'{finding.label}' is one name with {_listed(finding.equivalent)}: that alignment"
                " is over, and no further measurement distinguishes them."
            )
    return sentences


def rivals_words(report: DiagnosisReport) -> str:
    """Name, kind by kind, what this run cannot choose between; empty unless something is open."""
    parts = []
    for finding in report.diagnosis.findings:
        if finding.ambiguous:
            labels = [finding.label, *finding.ambiguous]
            kinds = by_effect(report, labels)
            # A label may be of no setting here, as one that belongs to another run.
            others = set(labels).difference(*kinds.values())
            words = [settings_words(name, own) for name, own in kinds.items()]
            parts.append(", ".join([*words, *(label for label in labels if label in others)]))
    return "; and between ".join(parts)


def _listed(labels: Sequence[str]) -> str:
    more = len(labels) - 2 * _MOST_LABELS
    shown = [f"'{label}'" for label in labels[: 2 * _MOST_LABELS]]
    if more > 0:
        return ", ".join(shown) + f" and {more:,} more"
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


def extension_sentences(report: DiagnosisReport) -> list[str]:
    """Say what became of the model, and what the proof on held-out data says."""
    words = []
    proof = report.held_out
    if proof is not None:
        words.append(proof.sentence)
    if report.extended_path is not None and report.extended is not None:
        added = _listed([finding.label for finding in report.diagnosis.findings])
        words.append(f"The extended model is in {report.extended_path}: it now has {added}.")
    if report.rounds:
        last = report.rounds[-1]
        words.append(f"The run under the extended model: {last.verdict}. {last.sentence}")
    return words


def print_diagnosis(report: DiagnosisReport, console: PlainConsole) -> None:
    """Print a diagnosis: the verdict first, then where, what, and how well that is known."""
    diagnosis = report.diagnosis

    # Wide terminals get no wider tables than can be read, narrow ones wrap the words in them.
    width = min(max(console.text_width or _WIDE, _NARROW), _WIDE)

    def table(one: Table | None) -> None:
        if one is not None:
            console.print()
            console.print(one, width=width)

    console.sentence(f"{diagnosis.verdict}: {diagnosis.sentence}")
    console.print()
    for name, text in (
        ("Run", report.run_id),
        ("Bag", "" if report.bag is None else str(report.bag)),
        *((f"Run {number}", str(one.path)) for number, one in enumerate(report.further, 2)),
        ("Model", model_words(report)),
    ):
        if text:
            console.sentence(f"{name + ':':<7}{text}")
    console.sentence(noise_sentence(diagnosis))
    for text in known_sentences(diagnosis):
        console.sentence(text)
    _list(console, "Where the gap is", diagnosis.where)
    _list(console, "On what it depends", description_sentences(diagnosis))
    if report.findings:
        table(findings_table(report.findings, findings_title(diagnosis)))
        for text in (*physics_sentences(report.findings), *group_sentences(report.findings)):
            console.sentence(text)
        for one in runners_up_tables(report.findings):
            table(one)
    _list(console, "What to measure next", proposed_sentences(report))
    table(pairs_table(report.proposal))
    table(gap_table(report))
    for text in extension_sentences(report):
        console.sentence(text)
    _list(console, "Where the gap is that is left", diagnosis.where_after)
    table(limits_table(report))
    _list(console, "Not testable by this run", not_testable_sentences(report))
    _list(console, "Remarks", report.remarks)


def _list(console: PlainConsole, title: str, texts: Sequence[str]) -> None:
    if not texts:
        return
    console.print()
    console.sentence(f"{title}:")
    for text in texts:
        console.sentence(f"- {text}")


def model_words(report: DiagnosisReport) -> str:
    """Say what the model takes as known."""
    model = report.model
    curves = f"{', '.join(model.curves)} fixed" if model.curves else "all error curves free"
    effects = ", ".join(f"{effect.label} ({effect.status})" for effect in model.effects)
    parts = [
        report.model_source,
        f"chain {model.chain or UNKNOWN}",
        curves,
        f"effects: {effects}" if effects else "no further effects",
        f"{report.diagnosis.tested:,} candidates tried",
    ]
    return "; ".join(part for part in parts if part)
