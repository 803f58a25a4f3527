"""The one interface of all controls, and what their tables have in common.

A control is one module: what it calls itself, which of the nine translations it can correct, its
settings, how its files are written, and how they are read back. Reading back is not a luxury: what
remains of the errors, and the proof of every sign, is computed from the written text.

The error of a machine that is sent to q is e(q), so a table must add -e(q). A constant is added to
each table so that it is zero at the reference point of its axis, where a control switches it on:
a step there would move the axis when the machine is referenced, and means nothing, since errors are
counted from an arbitrary zero.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from stepdiag_ros.compensation.applied import Applied, TableSet
from stepdiag_ros.compensation.identified import Identified, curve_at
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES, Vector, translation
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.text.controls import FARTHEST, Comment, refuse_foreign

INCH = 0.0254
"""m."""
AXIS = "[A-Za-z][A-Za-z0-9_]{0,31}"
"""Pattern of the name of an axis, which is part of statements and of names of files."""
Files = dict[str, str]
"""Name → text of the files of a control."""


@dataclass(frozen=True)
class ControlSetting:
    """A setting of a control, as ``--set NAME=VALUE`` gives it.

    Attributes:
        name: for example ``digits``.
        default: its type is that of the setting: a whole number, a number, or a text.
        meaning: in words, with the unit.
        low: smallest number.
        high: largest number.
        choices: of a text; empty: any.
    """

    name: str
    default: int | float | str
    meaning: str
    low: float = 0.0
    high: float = 1e6
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """How tables are to be made.

    Attributes:
        reference: of X, Y, Z, m: where the correction of each axis is zero; beyond the measured
            box the nearest end of it counts.
        spacing: between the entries of a table, m; 0: as the nodes of the measurement.
        settings: of the control, checked by ``checked_settings``.
        on_top_of: tables that were at work in the measured run; the new ones contain them.
        header: texts that say where the tables come from, for controls whose files have comments;
            from anywhere, so they pass through ``Layout.comments``.
    """

    reference: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spacing: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)
    on_top_of: TableSet = field(default_factory=lambda: TableSet(()))
    header: tuple[str, ...] = ()

    def comments(self, kind: Comment, *further: str) -> list[str]:
        """Return the header, and further texts, as comment lines of a file, without line ends."""
        return [line for text in (*self.header, *further) for line in kind.lines(text)]


@runtime_checkable
class Control(Protocol):
    """A kind of controller; a module of this package has one as ``CONTROL``.

    Attributes:
        name: as the command line calls it.
        title: in words.
        settings: that it has.
        corrects: the translations that it can correct, by their ISO 230-1 names.
        says: what its user must know, sentence by sentence.
        source: which public documents its format was taken from.
        grammar: pattern of the names of its files → patterns of every line that these may have.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def title(self) -> str: ...  # noqa: D102
    @property
    def settings(self) -> tuple[ControlSetting, ...]: ...  # noqa: D102
    @property
    def corrects(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def says(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def source(self) -> str: ...  # noqa: D102
    @property
    def grammar(self) -> Mapping[str, tuple[str, ...]]: ...  # noqa: D102

    def holds_reversal(self, settings: Mapping[str, Any], /) -> bool:
        """Say whether the tables correct reversal errors, with these (checked) settings."""
        ...

    def write(self, identified: Identified, layout: Layout) -> Files:
        """Return the files of the control.

        Raises:
            ValueError: the errors are not known, or beyond what the control can take.
        """
        ...

    def read(self, files: Mapping[str, str]) -> Applied:
        """Return what the control would do with these files.

        Raises:
            ValueError: they are not such files; names the file and the line.
        """
        ...


def checked_files(control: Control, identified: Identified, layout: Layout) -> Files:
    """Return the files of a control, read once more for anything that is not ours.

    Raises:
        ValueError: the control cannot take the errors, or a file has a line that is not a line of a
            table, of its setting or of a comment; one sentence.
    """
    files = control.write(identified, layout)
    for name, text in files.items():
        known = [lines for pattern, lines in control.grammar.items() if re.fullmatch(pattern, name)]
        if not known:
            raise ValueError(f"'{name}' is not a file name for {control.title}")
        refuse_foreign(name, text, *known[0])
    return files


def checked_settings(control: Control, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return all settings of a control, the given ones checked.

    Raises:
        ValueError: an unknown setting, or a value that is not allowed; says what is expected.
    """
    section = Section(given, f"settings for {control.name}")
    found: dict[str, Any] = {}
    for one in control.settings:
        if isinstance(one.default, int):
            low, high = int(one.low), int(one.high)
            found[one.name] = section.integer(one.name, low, high, default=one.default)
        elif isinstance(one.default, float):
            found[one.name] = section.number(one.name, one.low, one.high, default=one.default)
        elif one.choices:
            found[one.name] = section.names(one.name, one.choices, default=one.default)[0]
        else:
            found[one.name] = section.text(one.name, default=one.default)
    section.finish()
    return found


def reference_of(identified: Identified, axis: int, layout: Layout) -> float:
    """Return where the correction of an axis is zero: the reference, or the nearest end, m."""
    nodes = identified.error_map.nodes[axis]
    refuse_far(np.array([layout.reference[axis]]), f"the reference point of {AXES[axis]}")
    return float(np.clip(layout.reference[axis], nodes[0], nodes[-1]))


def table_positions(identified: Identified, axis: int, layout: Layout) -> Vector:
    """Return the positions of a table over the measured travel of an axis, m, evenly spaced.

    Where a spacing is asked for that does not divide the travel, the next smaller one that does is
    taken, so that both ends of the travel have an entry.

    Raises:
        ValueError: a position is not a number, or beyond what a control takes.
    """
    nodes = identified.error_map.nodes[axis]
    refuse_far(nodes, f"the travel of {AXES[axis]}")
    travel = float(nodes[-1] - nodes[0])
    if layout.spacing <= 0.0:
        smallest = float(np.min(np.diff(nodes)))
        intervals = max(1, round(travel / smallest))
    else:
        intervals = max(1, int(np.ceil(travel / layout.spacing - 1e-9)))
    return np.linspace(nodes[0], nodes[-1], intervals + 1)


def wanted(
    identified: Identified, error: int, axis: int, positions: Vector, layout: Layout, sense: int
) -> Vector:
    """Return what a table should add to an axis, m, shape (n,).

    Args:
        identified: the errors.
        error: axis (0, 1, 2) that is corrected.
        axis: axis at whose position the table is read.
        positions: of that axis, m, shape (n,).
        layout: of the tables.
        sense: +1: for the positive direction of the moving axis; -1: for the negative; 0: for both.

    Raises:
        ValueError: the error is not determined.
    """
    name = translation(error, axis)
    reference = np.array([reference_of(identified, axis, layout)])
    error_there = curve_at(identified, name, positions) - curve_at(identified, name, reference)
    if not np.all(np.isfinite(error_there)):
        raise Refusal(
            f"{name} is not determined by these lines, so it cannot be compensated; "
            "'stepdiag plan' proposes lines that determine it",
            fault="undetermined",
        )
    if error == axis:
        error_there = error_there + sense * identified.half_reversal(axis, positions)
    before = 0.5 * (
        (1 + sense) * layout.on_top_of.total(axis, error, positions, True)
        + (1 - sense) * layout.on_top_of.total(axis, error, positions, False)
    )
    added: Vector = before - error_there
    return added


def refuse_far(positions: Vector, what: str) -> None:
    """Refuse positions (m) that are not numbers, or that a control has no digits for.

    Raises:
        ValueError: names the first.
    """
    # Written so that what is not a number is refused, too.
    wrong = ~(np.abs(positions) <= FARTHEST)
    if np.any(wrong):
        raise Refusal(
            f"{what} has a position of {positions[wrong][0]:g} m; a control takes positions"
            f" within {FARTHEST * IN_MILLI:.3f} mm of its zero",
            fault="out_of_range",
            aspect="position",
        )


def refuse_large(values: Vector, limit: float, what: str) -> None:
    """Refuse corrections beyond a limit (m).

    Raises:
        ValueError: names the largest.
    """
    largest = float(np.max(np.abs(values)))
    if not largest <= limit:
        raise Refusal(
            f"{what}: a correction of {largest * IN_MILLI:.4f} mm is beyond the limit of "
            f"{limit * IN_MILLI:g} mm; such an error is set right mechanically, not in a table",
            fault="out_of_range",
            aspect="limit",
        )


def refuse_long(count: int, most: int, what: str, advice: str) -> None:
    """Refuse a table of too many entries.

    Raises:
        ValueError: says how many there may be, and what to do.
    """
    if count > most:
        raise Refusal(
            f"{what} would have {count} entries, the control takes {most}: {advice}",
            fault="too_many",
        )


def axis_names(names: str) -> list[str]:
    """Return the names of X, Y, Z in a control.

    Raises:
        ValueError: there are not three different ones of a letter and further letters and digits.
    """
    found = [name.strip() for name in names.split(",")]
    fit = all(re.fullmatch(AXIS, name) for name in found)
    if len(found) != len(AXES) or len(set(found)) < len(AXES) or not fit:
        raise Refusal(
            f"axes is '{names}'; expected three different names, such as X1,Y1,Z1",
            fault="malformed",
            aspect="axes",
        )
    return found
