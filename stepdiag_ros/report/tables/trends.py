"""The years of machines, as a person reads them."""

from collections.abc import Sequence

from stepdiag_ros.archive.histories import LARGEST, MachineHistory, urgency
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import UNKNOWN, plain
from stepdiag_ros.text.table import Column, Table
from stepdiag_ros.words.diagnosis import readable_unit
from stepdiag_ros.words.trends import (
    attention_words,
    change_sentence,
    crossing_sentence,
    crossing_words,
    effects_sentence,
    history_sentence,
    remarks,
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
                    value_words(one, trend.level, trend.level_expanded),
                    value_words(one, trend.slope, trend.slope_expanded),
                ]
        table.add_row(
            machine.name,
            f"{machine.last:%Y-%m-%d}",
            *sizes,
            attention_words(machine),
        )
    console.print(table)
    _print_rest(len(machines), "machines", console, every)


def print_machine(machine: MachineHistory, console: PlainConsole, every: bool) -> None:
    """Print the figures of a machine, worst first, and its changes.

    Args:
        machine: any.
        console: to print on.
        every: print all, not only what fits on a screen.
    """
    console.sentence(history_sentence(machine))
    console.print(_figures(machine, every))
    _print_rest(len(machine.figures), "figures", console, every)
    changes = sorted(
        (
            (change.latest, change_sentence(one, change))
            for one in machine.figures
            for change in one.trend.changes
        ),
        reverse=True,
    )
    console.sentence("Changes, newest first:" if changes else "No change was found.")
    for _, sentence in changes[: None if every else _MOST]:
        console.sentence(f"- {sentence}")
    _print_rest(len(changes), "changes", console, every)
    console.sentence(effects_sentence(machine))
    for sentence in (*filter(None, map(crossing_sentence, machine.figures)), *remarks(machine)):
        console.sentence(f"- {sentence}")


def _figures(machine: MachineHistory, every: bool) -> Table:
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
    for one in sorted(machine.figures, key=urgency)[: None if every else _MOST]:
        trend, (unit, factor) = one.trend, readable_unit(one.unit)
        limits = [plain(limit * factor, 1) for limit in trend.limits]
        table.add_row(
            f"{one.name} / {unit}" if unit else one.name,
            value_words(one, trend.level, trend.level_expanded),
            value_words(one, trend.slope, trend.slope_expanded),
            UNKNOWN if trend.unknown else "..".join(limits),
            crossing_words(trend),
        )
    return table


def _print_rest(number: int, what: str, console: PlainConsole, every: bool) -> None:
    if number > _MOST and not every:
        console.sentence(f"{number - _MOST} more {what}: --all lists them")
