"""Writes the sheet that lies beside an NC program: what the operator does, in the plan's order."""

import re
import textwrap
from collections.abc import Iterator
from itertools import pairwise
from pathlib import PurePath

import numpy as np

from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.planning.duration import Assumptions, LineDuration, duration
from stepdiag_ros.planning.mirror import mirror_width
from stepdiag_ros.planning.moves import DrivenLine, beam_words, dwell_of, passes_of

_WIDTH = 80
_BOX = "[ ] "


def operator_sheet(
    plan: Plan,
    machine: Machine,
    program: str,
    plan_file: str,
    assumptions: Assumptions | None = None,
    table: str = "",
) -> str:
    """Return the sheet for the operator of an NC program, as text of 80 columns.

    It has an entry for each alignment: laser and mirror, first stop, passes, stops, time, change of
    the reading to check, and name of the recording. The names are those that the command at its end
    evaluates.

    Args:
        plan: that the program executes.
        machine: that executes it.
        program: name of the program's file; the recordings are named after it.
        plan_file: name of the plan's file.
        assumptions: for the duration; the default ones if None.
        table: name of the file into which a person writes the readings; empty where the laser
            records them.

    Raises:
        ValueError: the plan has no feed.
    """
    taken = duration(plan, machine, assumptions)
    groups = list(_alignments(plan, taken.lines))
    stem = PurePath(program).stem
    files = [
        f"{stem}_{number}_{re.sub(r'[^A-Za-z0-9]+', '_', made[0][1].setup).strip('_')}.csv"
        for number, made in enumerate(groups, start=1)
    ]
    aligning = f", {_minutes(taken.alignment)} to align" if taken.alignment else ""
    lines = [
        *_wrapped(f"SHEET FOR THE OPERATOR: {plan.name}"),
        *_wrapped(
            f"Program {program}, plan {plan_file}, machine {machine.name}. {len(plan.lines)} passes"
            f" and {plan.stop_count} stops in {len(groups)} alignments:"
            f" {_minutes(taken.running)} of machine time{aligning}."
        ),
        "",
        "Before the program starts, check",
        *_each(_checks(plan, bool(table))),
        "",
        "For each alignment",
        *_each(_steps(plan, table)),
    ]
    for number, (made, name) in enumerate(zip(groups, files, strict=True), start=1):
        lines += ["", *_entry(plan, number, made, "" if table else name)]
    what = " (MAPPING, MACHINE: the YAML files that describe columns and machine)"
    command = (
        f"stepdiag by-hand {' '.join(files)} --mapping MAPPING --plan {plan_file} --machine MACHINE"
    )
    if table:
        what = ""
        command = f"stepdiag import {table} --mapping {PurePath(table).with_suffix('.yaml')}"
    lines += ["", *_wrapped(f"Afterwards{what}"), *_wrapped(command, "  ", "    ")]
    return "\n".join(lines) + "\n"


_Passes = list[tuple[int, DrivenLine, LineDuration]]
"""Passes of one alignment, each with its number in the program."""


def _alignments(plan: Plan, times: tuple[LineDuration, ...]) -> Iterator[_Passes]:
    """Yield the passes of each alignment."""
    passes = list(zip(range(1, len(times) + 1), passes_of(plan), times, strict=True))
    begins = [index for index, (_, one, _) in enumerate(passes) if one.new_setup]
    for first, end in pairwise((*begins, len(passes))):
        yield passes[first:end]


def _checks(plan: Plan, noted: bool) -> list[str]:
    """Return what is checked once."""
    width = mirror_width(plan)
    wide = f"mirror at least {width * IN_MILLI:.1f} mm wider than the beam"
    return [
        "way of tool, mirror and cable free in the whole travel",
        "work offsets, tool length and rotation zero; feed and dwell as in the program's head",
        *([wide] if width else []),
        *(
            ["laser: display of 0.1 µm or finer; air and material temperature noted"]
            if noted
            else [
                "laser: readings with time, 0.1 µm or finer; air sensors connected, or air noted",
                f"at least 3 readings in {plan.sampling.window:g} s, better 10",
            ]
        ),
    ]


def _steps(plan: Plan, table: str) -> list[str]:
    """Return what is done at each alignment, in order."""
    aligned = [
        "First stop of the program (M0): clear the way to the first stop of the line, then start.",
        "Second stop (M0), at the first stop of the line: align laser and mirror. The signal must"
        " hold along the whole line.",
    ]
    if table:
        return [
            *aligned,
            "Zero the laser, now and not again before the next alignment. Then start.",
            f"Write the reading at each stop into its row of {table} as soon as it stands still;"
            " '-' where it was missed.",
            "After the first pass, the reading must have changed as stated below.",
        ]
    return [
        *aligned,
        "Zero the laser, now and not again before the next alignment. Start the recording.",
        f"Hands off for {2.0 * dwell_of(plan):g} s or more, then start. No feed hold, and no hand"
        " on the laser, before the last stop.",
        "After the last pass, end and export the recording under its name. The reading must have"
        " changed in the first pass as stated below.",
    ]


def _entry(plan: Plan, number: int, made: _Passes, name: str) -> list[str]:
    """Return the entry of one alignment."""
    first_number, one, time = made[0]
    last_number = made[-1][0]
    many = f"passes {first_number} to {last_number}"
    which = f"pass {first_number}" if first_number == last_number else many
    place = " ".join(
        f"{axis} {value * IN_MILLI:g}"
        for axis, value in zip(AXES, one.targets[-one.stops], strict=True)
    )
    running = sum(took.total - took.alignment for _, _, took in made)
    align = f", after {_minutes(time.alignment)} to align" if time.alignment else ""
    title = f"{one.setup}, {which} of {len(plan.lines)}"
    texts = [
        f"laser and mirror: {beam_words(one.line)}{_mount(one)}",
        f"first stop: {place} mm",
        f"{sum(one.stops for _, one, _ in made)} stops, {_minutes(running)}{align}",
        f"check: pass {first_number} ({one.line.direction}) changes the reading by"
        f" {_change(plan, one) * IN_MILLI:+.3f} mm",
        *([f"file: {name}"] if name else []),
    ]
    body = [row for text in texts for row in _wrapped(text, " " * 6, " " * 8)]
    return [*_wrapped(f"{_BOX}{number}  {title}", "", " " * 6), *body]


def _mount(one: DrivenLine) -> str:
    """Say where the mirror is mounted, if it is not at its usual place."""
    if not any(one.line.mirror_offset):
        return ""
    shift = ", ".join(f"{value * IN_MILLI:g}" for value in one.line.mirror_offset)
    return f"; mirror moved by {shift} mm (X, Y, Z) from its usual place on the tool"


def _change(plan: Plan, one: DrivenLine) -> float:
    """Return the nominal change of the reading from the first stop of a pass to its last, m."""
    first, last = np.array(one.targets[-one.stops]), np.array(one.targets[-1])
    return float(one.line.beam(plan.volume).between(first, last))


def _minutes(seconds: float) -> str:
    return f"{seconds / 60.0:.1f} min"


def _each(texts: list[str]) -> list[str]:
    return [row for text in texts for row in _wrapped(text, _BOX, " " * len(_BOX))]


def _wrapped(text: str, first: str = "", then: str = "") -> list[str]:
    return textwrap.wrap(
        text, _WIDTH, initial_indent=first, subsequent_indent=then, break_on_hyphens=False
    )
