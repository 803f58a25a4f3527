"""Two measurements of one machine beside each other, as a person reads it."""

from math import isfinite

import numpy as np

from stepdiag_ros.evaluation.changes import ChangesReport
from stepdiag_ros.metrology.agreement import CurveChange, FigureChange, MachineChanges
from stepdiag_ros.metrology.geometry import AXES, moving_axis
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import ARC_SECONDS, UNKNOWN, plain, plus_minus
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.changes import (
    SQUARENESS_UNIT,
    UNITS,
    meaning,
    ratio,
    remarks_of,
    sentences_of,
    title,
    uncertainty_words,
)
from stepdiag_ros.words.diagnosis import chance

_SQUARENESS_UNITS = ((SQUARENESS_UNIT, IN_MICRO), ("arcsec", ARC_SECONDS))


def print_changes(report: ChangesReport, console: PlainConsole) -> None:
    """Print both measurements beside each other."""
    for when, one in (("before", report.before), ("after", report.after)):
        console.sentence(
            f"{when}: {one.origin.file} (run {one.origin.run_id}, {one.origin.method})"
        )
    console.print()
    for table in (figure_table(report.changes), curve_table(report.changes)):
        console.print(table)
        console.print()
    for text in sentences_of(report):
        console.sentence(text)
    console.print()
    for text in (*meaning(report.changes), *uncertainty_words(report)):
        console.sentence(text)
    for remark in remarks_of(report):
        console.sentence(f"- {remark}")


def figure_table(changes: MachineChanges, space: str = " ") -> Table:
    """Return the figures of both, with the change, its uncertainty and E_n.

    Args:
        changes: between two measurements.
        space: between the words of a name; one that does not break keeps them together where the
            paper is narrow.
    """
    table = new_table(
        "Figures",
        "",
        "unit",
        "before ± U",
        "after ± U",
        "change ± U",
        "times smaller",
        "E_n",
        "changed",
    )
    for one in changes.every_figure:
        name, comma, taken = title(one).partition(",")
        name = f"{name.replace(' ', space)}{comma}{taken}"
        units = _SQUARENESS_UNITS if one.family == "squareness" else (UNITS[one.unit],)
        for row, (unit, scale) in enumerate(units):
            last = (times(one), e_n(one.normalised_error), whether(one.changed))
            table.add_row(
                name if row == 0 else "",
                unit,
                plus_minus(one.before, one.before_uncertainty, scale),
                plus_minus(one.after, one.after_uncertainty, scale),
                plus_minus(one.difference, one.difference_uncertainty, scale),
                *(last if row == 0 else ("", "", "")),
            )
    return table


def curve_table(changes: MachineChanges) -> Table:
    """Return for each curve its largest change and what all of its nodes together say."""
    table = new_table(
        "Error curves, node by node",
        "",
        "unit",
        "largest change ± U",
        "at / mm",
        "largest |E_n|",
        "|E_n| > 1",
        "χ² / nodes",
        "p",
        "changed",
    )
    for one in changes.curves:
        unit, scale = UNITS[one.unit]
        row = one.largest
        known = one.normalised_error[np.isfinite(one.normalised_error)]
        table.add_row(
            one.name,
            unit,
            UNKNOWN
            if row < 0
            else plus_minus(one.difference[row], one.difference_uncertainty[row], scale),
            UNKNOWN if row < 0 else _place(one, row),
            plain(float(np.max(np.abs(known)))) if known.size else UNKNOWN,
            f"{np.count_nonzero(np.abs(known) > 1.0)} of {known.size}" if known.size else UNKNOWN,
            f"{plain(one.joint.chi_squared, 1)} / {one.joint.degrees_of_freedom}"
            if one.joint.known
            else UNKNOWN,
            chance(one.joint.probability) if one.joint.known else UNKNOWN,
            whether(one.changed),
        )
    return table


def node_table(one: CurveChange) -> Table:
    """Return one curve at every node."""
    unit, scale = UNITS[one.unit]
    letter = AXES[moving_axis(one.name)]
    table = new_table(
        f"{one.name}, in {unit}", f"{letter} / mm", "before ± U", "after ± U", "change ± U", "E_n"
    )
    for row in range(len(one.positions)):
        table.add_row(
            _place(one, row),
            plus_minus(one.before[row], one.before_uncertainty[row], scale),
            plus_minus(one.after[row], one.after_uncertainty[row], scale),
            plus_minus(one.difference[row], one.difference_uncertainty[row], scale),
            _node_e_n(one, row),
        )
    return table


def e_n(value: float) -> str:
    """Write a normalised error."""
    return plain(value)


def whether(changed: bool | None) -> str:
    """Write whether something has changed."""
    return UNKNOWN if changed is None else ("yes" if changed else "no")


def times(one: FigureChange) -> str:
    """Write how many times smaller a figure is; a dash where chance may explain its change."""
    if not isfinite(one.before) or not isfinite(one.after):
        return UNKNOWN
    if not one.changed or not one.before:
        return "-"
    return ratio(one.factor)


def _place(one: CurveChange, row: int) -> str:
    return f"{one.positions[row] * IN_MILLI:g}"


def _node_e_n(one: CurveChange, row: int) -> str:
    if one.difference_uncertainty[row] == 0.0 and one.difference[row] == 0.0:
        return "-"
    return e_n(float(one.normalised_error[row]))
