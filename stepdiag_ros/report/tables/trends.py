"""The years of machines, as a person reads them."""

from collections.abc import Sequence

from stepdiag_ros.archive.histories import MachineHistory, urgency
from stepdiag_ros.archive.stated import LARGEST
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import UNKNOWN, plain
from stepdiag_ros.text.table import Column, Table
from stepdiag_ros.words.diagnosis import readable_unit
from stepdiag_ros.words.trends import (
    LAST_SENTENCE,
    attention_words,
    change_sentences,
    crossing_words,
    effects_sentence,
    history_sentence,
    limitations,
    now_words,
    value_words,
)

_MOST = 10
"""Rows of a screen; some need two lines."""


def print_machines(machines: Sequence[MachineHistory], console: PlainConsole, every: bool) -> None:
    """Print a row a machine.

    Args:
        machines: of an archive, in the order of ``machine_urgency``.
        console: to print on.
        every: print all, not only what fits on a screen.
    """
    table = Table(
        "",
        [
            Column("machine", wraps=True, widest=14),
            Column("last run"),
            Column("largest / µm", number=True),
            Column("a year / µm", number=True),
            Column("attention", wraps=True, widest=25),
        ],
    )
    for machine in machines[: None if every else _MOST]:
        sizes = [UNKNOWN, UNKNOWN]
        for one in machine.figures:
            if one.name == LARGEST:
                trend = one.trend
                sizes = [
                    now_words(one),
                    value_words(one, trend.slope, trend.slope_expanded),
                ]
        table.add_row(
            machine.name,
            f"{machine.last:%Y-%m-%d}",
            *sizes,
            attention_words(machine),
        )
    console.print(table)
    if any(one.trend.unknown for machine in machines for one in machine.figures):
        console.sentence(LAST_SENTENCE)
    _print_rest(len(machines), "machines", console, every)


def print_machine(machine: MachineHistory, console: PlainConsole, every: bool) -> None:
    """Print the figures of a machine, worst first, and its changes.

    Args:
        machine: any.
        console: to print on.
        every: print all, not only what fits on a screen.
    """
    console.sentence(history_sentence(machine))
    console.print(figures_table(machine, None if every else _MOST))
    _print_rest(len(machine.figures), "figures", console, every)
    changes = change_sentences(machine)
    console.sentence("Changes, newest first:" if changes else "No change was found.")
    for sentence in changes[: None if every else _MOST]:
        console.sentence(f"- {sentence}")
    _print_rest(len(changes), "changes", console, every)
    console.sentence(effects_sentence(machine))
    for sentence in limitations(machine):
        console.sentence(f"- {sentence}")


def figures_table(machine: MachineHistory, most: int | None = None) -> Table:
    """Return the figures of a machine, worst first.

    Args:
        machine: any.
        most: number of rows; None: all.
    """
    table = Table(
        "",
        [
            Column("figure", wraps=True, widest=16),
            Column("now ± U", number=True),
            Column("a year ± U", number=True),
            Column("limits", number=True),
            Column("outside"),
        ],
    )
    for one in sorted(machine.figures, key=urgency)[:most]:
        trend, (unit, factor) = one.trend, readable_unit(one.unit)
        limits = [plain(limit * factor, 1) for limit in trend.limits]
        table.add_row(
            f"{one.name} / {unit}" if unit else one.name,
            now_words(one),
            value_words(one, trend.slope, trend.slope_expanded),
            UNKNOWN if trend.unknown else "..".join(limits),
            crossing_words(trend),
        )
    return table


def _print_rest(number: int, what: str, console: PlainConsole, every: bool) -> None:
    if number > _MOST and not every:
        console.sentence(f"{number - _MOST} more {what}: --all lists them")
