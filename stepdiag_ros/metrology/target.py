"""The uncertainty that a run is to reach: of which quantity, how small, and how far it has come.

A target is an expanded uncertainty (95 %) of one quantity: of the longest error vector in the
measured box, of an error curve (at its worst node), of a squareness error, or of a parameter of
ISO 230-2 and ISO 230-6. It is reached at the end of a line when three things hold: every line that
was begun has as many complete passes as its standard demands, the uncertainty is as small as was
asked, and the lines would show an effect that the model lacks (``discrepancy.power``).
"""

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from enum import IntEnum

from stepdiag_ros.metrology.geometry import AXES, LINEAR_LINES, ROTATIONS, SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.plan import LINEAR, Line, Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.iso230_2 import PARAMETERS, RUNS_OF_THE_STANDARD
from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription

VOLUMETRIC = "volumetric"
RUNS_OF_REPEATABILITY = 2
"""Runs in each direction below which the repeatability of a line is not known."""
_UNITS = {
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "µm": ("m", 1e-6),
    "nm": ("m", 1e-9),
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e-3),
    "urad": ("rad", 1e-6),
    "µrad": ("rad", 1e-6),
    "um/m": ("rad", 1e-6),
    "µm/m": ("rad", 1e-6),
}
_FORM = re.compile(r"\s*(?:(?P<name>[^=]+?)\s*=)?\s*(?P<size>[\d.eE+-]+)\s*(?P<unit>[a-zµ/]+)\s*")
_LARGEST = 1e-3
"""m or rad; a larger uncertainty is a typing error."""
_EXAMPLES = "such as 0.5um, E_XX=0.3um, C0Y=2urad or X:A=1um"


class TargetState(IntEnum):
    """How far a run is from its target; the numbers are STATE_* of TargetStanding.msg."""

    OPEN = 0
    REACHED = 1
    BEYOND_PLAN = 2


@dataclass(frozen=True)
class Target:
    """The uncertainty that a run is to reach.

    Attributes:
        quantity: ``volumetric``, a curve such as E_XX, a squareness error such as C0Y, or a line
            and a parameter of ISO 230-2 or ISO 230-6 such as X:A or ppp:E.
        size: expanded uncertainty (95 %; of parameters k = 2) to be reached, in the unit.
        unit: ``m`` or ``rad``.
        conditions: of the measurement, by which parameters of ISO 230 are uncertain.
    """

    quantity: str
    size: float
    unit: str
    conditions: UncertaintyDescription = field(default_factory=UncertaintyDescription)

    @classmethod
    def from_text(
        cls, text: str, conditions: UncertaintyDescription | None = None, source: str = "target"
    ) -> "Target":
        """Make a target of text such as ``0.5um``, ``E_XX=0.3um``, ``C0Y=2urad`` or ``X:A=1um``.

        Args:
            text: quantity and size; a size alone is of the longest error vector in the box.
            conditions: what is known of the measuring conditions.
            source: what the user calls the text.

        Raises:
            Refusal: it cannot be read, or the quantity, unit or size is not possible.
        """
        found = _FORM.fullmatch(text)
        size = _number(found["size"]) if found else -1.0
        if not found or found["unit"] not in _UNITS:
            raise Refusal(
                f"{source}: '{text}' is not an uncertainty to reach. Give a quantity, a size and a"
                f" unit, {_EXAMPLES}",
                fault="malformed",
            )
        quantity, (unit, scale) = found["name"] or VOLUMETRIC, _UNITS[found["unit"]]
        expected = _unit_of(quantity, source)
        if unit != expected:
            raise Refusal(
                f"{source}: the uncertainty of {quantity} is in {expected}, and '{found['unit']}'"
                " is not a unit of that",
                fault="mismatch",
                aspect="unit",
            )
        if not 0.0 < size * scale <= _LARGEST:
            raise Refusal(
                f"{source}: an uncertainty of {found['size']} {found['unit']} is not a target;"
                f" give more than 0 and up to {_LARGEST:g} {unit}",
                fault="out_of_range",
                aspect="uncertainty",
            )
        return cls(quantity, size * scale, unit, conditions or UncertaintyDescription())

    @property
    def line_and_parameter(self) -> tuple[str, str]:
        """Return line and parameter of a target of ISO 230-2 or ISO 230-6; else empty texts."""
        return _line_and_parameter(self.quantity)

    @property
    def words(self) -> str:
        """Return the quantity in words."""
        return _quantity_words(self.quantity)

    def runs_wanted(self, line: Line) -> int:
        """Return in how many runs in each direction a line has to be read at least."""
        name, _ = self.line_and_parameter
        if name and name == tested_as(line):
            return RUNS_OF_THE_STANDARD
        return RUNS_OF_REPEATABILITY


def _line_and_parameter(quantity: str) -> tuple[str, str]:
    line, colon, parameter = quantity.partition(":")
    return (line, parameter) if colon else ("", "")


def _quantity_words(quantity: str) -> str:
    line, parameter = _line_and_parameter(quantity)
    if line:
        return f"{parameter} of {line}"
    return "the largest error in the volume" if quantity == VOLUMETRIC else quantity


@dataclass(frozen=True)
class TargetStanding:
    """How far a run is from its target by its lines so far.

    Attributes:
        quantity: as in ``Target``.
        unit: of the uncertainties, ``m`` or ``rad``.
        demanded: expanded uncertainty to be reached.
        reached: expanded uncertainty by the lines so far; NaN if not known.
        expected: expanded uncertainty to be expected at the end of the plan; NaN if not known.
        time_left: machine time to the target, s, without pauses and setups; NaN if not known, or
            if the plan is not expected to reach it.
        state: of the run.
        lines: that were used.
        text: what is still missing, in words.
    """

    quantity: str
    unit: str
    demanded: float
    reached: float
    expected: float
    time_left: float
    state: TargetState
    lines: int
    text: str

    @property
    def words(self) -> str:
        """Return the quantity in words."""
        return _quantity_words(self.quantity)


def tested_as(line: Line) -> str:
    """Return what the test of a line is called: X, Y, Z of an axis, else the diagonal's name."""
    return AXES[LINEAR_LINES.index(line.name)] if line.kind == LINEAR else line.name


def lacking_runs(
    target: Target, plan: Plan, measured: Collection[int]
) -> tuple[tuple[Line, int, int], ...]:
    """Return which lines that were begun lack runs: line and direction, runs there are and wanted.

    A plan with fewer runs of a line demands no more than it has, but for what a standard demands.

    Args:
        target: of the run.
        plan: of the run.
        measured: indices of the complete passes.
    """
    name, _ = target.line_and_parameter
    last = max(measured, default=-1)
    lacking = []
    for passes in _passes_of_lines(plan):
        line = plan.lines[min(min(one) for one in passes.values())]
        of_standard = bool(name) and name == tested_as(line)
        begun = any(index <= last for one in passes.values() for index in one)
        for indices in passes.values() if begun or of_standard else ():
            wanted = target.runs_wanted(line)
            wanted = wanted if of_standard else min(wanted, len(indices))
            done = sum(index in measured for index in indices)
            if done < wanted:
                lacking.append((plan.lines[indices[0]], done, wanted))
    return tuple(lacking)


def _passes_of_lines(plan: Plan) -> Iterable[dict[str, list[int]]]:
    """Return the indices of the passes along each line by their directions, in plan order."""
    groups: dict[tuple[str, str], dict[str, list[int]]] = {}
    for index, line in enumerate(plan.lines):
        key = plan.setup_of(line), line.order
        groups.setdefault(key, {}).setdefault(line.direction, []).append(index)
    return groups.values()


def line_ends(target: Target, plan: Plan) -> tuple[int, ...]:
    """Return after how many lines of the plan enough passes are measured to end the run."""
    counts = range(1, len(plan.lines) + 1)
    return tuple(count for count in counts if not lacking_runs(target, plan, range(count)))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return -1.0


def _unit_of(quantity: str, source: str) -> str:
    line, colon, parameter = quantity.partition(":")
    if quantity == VOLUMETRIC or quantity in TRANSLATIONS:
        return "m"
    if quantity in (*SQUARENESS, *ROTATIONS):
        return "rad"
    if colon and line and parameter in PARAMETERS:
        return "m"
    if colon:
        raise Refusal(
            f"{source}: '{parameter}' is not a parameter of ISO 230-2; use {', '.join(PARAMETERS)}",
            fault="unknown",
        )
    names = (VOLUMETRIC, *TRANSLATIONS, *ROTATIONS, *SQUARENESS)
    raise Refusal(
        f"{source}: '{quantity}' is not a quantity of a run; use {', '.join(names)}, or a line and"
        " a parameter of ISO 230-2 such as X:A",
        fault="unknown",
    )
