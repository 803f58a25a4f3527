"""Which error curves and squareness errors some lines do not determine, and which would."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isnan

from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, LINEAR, STEP_DIAGONAL, Line, Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.iso230_2 import RUNS_OF_THE_STANDARD
from stepdiag_ros.metrology.standards.positioning_uncertainty import expanded_uncertainties
from stepdiag_ros.metrology.target import VOLUMETRIC, Target, tested_as
from stepdiag_ros.metrology.visibility import DETERMINED, SHAPE, Visibility, visibility
from stepdiag_ros.planning.candidates import FOUR_DIAGONALS, LINEAR_AXES
from stepdiag_ros.planning.limits import coarse, single

_BLOCKS = 4
"""What lines distinguish does not depend on how often they stop."""
_ANY_NOISE = 1e-7
"""m; what is determined does not depend on it."""


@dataclass(frozen=True)
class Undetermined:
    """Positioning, straightness and squareness errors that lines do not determine.

    Rotations are taken as zero here: ``planning.limits`` covers them.

    Attributes:
        curves: names of the curves that are not determined, or only in part.
        squareness: names of the squareness errors that are not determined.
        shape_told: curves of these of which the shape is determined, and only the slope is not.
        remedy: lines that determine all of them beside those that are there; empty where no step
            diagonal and no linear line along the box's edges does.
    """

    curves: tuple[str, ...] = ()
    squareness: tuple[str, ...] = ()
    shape_told: bool = False
    remedy: tuple[Line, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all errors that are not determined."""
        return (*self.curves, *self.squareness)

    @property
    def remedy_words(self) -> str:
        """Return the lines to add: ``the linear lines x, y, z``; empty without any."""
        parts = []
        for kind, words in ((LINEAR, "linear line"), (STEP_DIAGONAL, "step diagonal")):
            names = [line.name for line in self.remedy if line.kind == kind]
            if names:
                parts.append(f"the {words}{'s' if len(names) > 1 else ''} {', '.join(names)}")
        return " and ".join(parts)

    @property
    def sentence(self) -> str:
        """State what stays unknown and what would determine it; empty where nothing does."""
        if not self.names:
            return ""
        said = f"These lines do not determine {', '.join(self.names)}, which stay unknown"
        if self.shape_told:
            said += " but for their shape"
        if self.remedy:
            return f"{said}; measured as well, {self.remedy_words} would determine them."
        return f"{said}."


def undetermined(plan: Plan, seen: Visibility | None = None) -> Undetermined:
    """Return what the lines of a plan do not determine, found by trying and not by rule.

    Args:
        plan: with one line at least.
        seen: its visibility without rotations, where that is known already.
    """
    small = coarse(plan, _BLOCKS)
    table = seen if seen is not None else visibility(small, "", _ANY_NOISE)
    hidden = _hidden(table)
    if not hidden:
        return Undetermined()
    there = {(line.kind, line.name) for line in plan.lines if not any(line.offset)}
    # Given up first are the step diagonals, which take longest.
    lines = [
        line
        for group in (LINEAR_AXES, FOUR_DIAGONALS)
        for line in single(group, small)
        if (line.kind, line.name) not in there
    ]
    return Undetermined(
        curves=tuple(name for name in hidden if name in TRANSLATIONS),
        squareness=tuple(name for name in hidden if name in SQUARENESS),
        shape_told=all(table.row(name).part == SHAPE for name in hidden),
        remedy=_fewest(small, lines),
    )


def refuse_undetermined(target: Target, plan: Plan, chain: str) -> None:
    """Refuse a target for a quantity that a plan does not determine.

    Args:
        target: that a run of the plan is to reach.
        plan: of the run.
        chain: order of the axes from workpiece to tool; empty if not known.

    Raises:
        Refusal: the plan does not determine the quantity, or its uncertainty cannot be known.
    """
    why = _why_undetermined(target, plan, chain)
    if why:
        raise Refusal(
            f"the plan '{plan.name}' cannot reach an uncertainty of {target.words}: {why}",
            fault="undetermined",
            about=target.quantity,
        )


def _why_undetermined(target: Target, plan: Plan, chain: str) -> str:
    if plan.tracker is not None:
        return "runs with a tracker have no target"
    line, parameter = target.line_and_parameter
    if line:
        return _why_untested(target, line, parameter, plan)
    small, quantity = coarse(plan, _BLOCKS), target.quantity
    if quantity in ROTATIONS:
        seen = chain and visibility(small, chain, _ANY_NOISE).row(quantity).status == DETERMINED
        return "" if seen else f"its lines do not determine {quantity}"
    unknown = undetermined(small)
    if quantity in unknown.names or (quantity == VOLUMETRIC and unknown.names):
        return unknown.sentence.rstrip(".")
    return ""


def _why_untested(target: Target, name: str, parameter: str, plan: Plan) -> str:
    tested = dict.fromkeys(tested_as(line) for line in plan.lines)
    if name not in tested:
        return f"it has no line {name}; its lines are {', '.join(tested)}"
    directions = {line.direction for line in plan.lines if tested_as(line) == name}
    one_way = {"↑": FORWARD, "↓": BACKWARD}.get(parameter[-1])
    wanted = {one_way} if one_way else {FORWARD, BACKWARD}
    if not wanted <= directions:
        return f"{parameter} needs runs {' and '.join(sorted(wanted))}"
    known = expanded_uncertainties(target.conditions, 1.0, RUNS_OF_THE_STANDARD)[parameter]
    if isnan(known):
        lacking = ", ".join(target.conditions.unknown())
        return f"the conditions of the measurement are not known: {lacking}"
    return ""


def _hidden(seen: Visibility) -> list[str]:
    names = (*TRANSLATIONS, *SQUARENESS)
    return [name for name in names if seen.row(name).status != DETERMINED]


def _fewest(plan: Plan, lines: Sequence[Line]) -> tuple[Line, ...]:
    """Return as few of some lines as determine everything beside a plan; none if all do not."""

    def enough(added: Sequence[Line]) -> bool:
        more = replace(plan, lines=(*plan.lines, *added))
        return not _hidden(visibility(more, "", _ANY_NOISE))

    if not lines or not enough(lines):
        return ()
    needed = list(lines)
    for line in reversed(lines):
        fewer = [one for one in needed if one is not line]
        if enough(fewer):
            needed = fewer
    return tuple(needed)
