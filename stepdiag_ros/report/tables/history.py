"""What becomes of effects from run to run, as a person reads it."""

from stepdiag_ros.evaluation.history import HistoryReport
from stepdiag_ros.metrology.discrepancy.history import EffectHistory
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import UNKNOWN, two_digits
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.history import (
    ORDER,
    effect_sentence,
    figure_words,
    remark_sentences,
    summary_sentence,
)


def print_history(report: HistoryReport, console: PlainConsole) -> None:
    """Print what grows, what comes and goes, and what stays, with its size in each run."""
    console.sentence(summary_sentence(report))
    console.print()
    console.print(_runs_table(report))
    for effect in sorted(report.effects, key=lambda one: ORDER.index(one.course.kind)):
        console.print()
        console.sentence(f"{effect.course.kind.upper()}: {effect.label} ({effect.figure.meaning})")
        console.print(_sizes_table(report, effect))
        console.sentence(effect_sentence(effect))
    console.print()
    for remark in remark_sentences(report):
        console.sentence(f"- {remark}")


def _runs_table(report: HistoryReport) -> Table:
    table = new_table("Runs", "run", "date", "file", "noise / µm", "verdict alone")
    table.columns[2].wraps = True
    table.columns[4].number = False
    for number, run in enumerate(report.runs, 1):
        noise = run.diagnosis.noise
        table.add_row(
            str(number),
            f"{run.start:%Y-%m-%d}",
            "\n".join(one.path.name for one in run.files),
            two_digits(noise * IN_MICRO) if noise > 0.0 else UNKNOWN,
            run.diagnosis.verdict,
        )
    return table


def _sizes_table(report: HistoryReport, effect: EffectHistory) -> Table:
    course = effect.course
    table = new_table(
        "",
        "run",
        "date",
        "size ± U (95 %)",
        "seen",
    )
    table.columns[3].number = False
    for index, (run, size) in enumerate(zip(report.runs, course.sizes, strict=True)):
        seen = "yes" if index in course.having else "no" if index in course.lacking else UNKNOWN
        table.add_row(
            str(index + 1), f"{run.start:%Y-%m-%d}", figure_words(size, effect.figure), seen
        )
    return table
