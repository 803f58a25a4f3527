"""Axes without a line from the box's first corner: how uncertain that leaves them, and its price.

A positioning error is that along the line from the first corner. Step diagonals determine it, and
so does a linear line at another edge, but less well, since rotations act on them.
"""

from dataclasses import dataclass, replace
from math import isfinite

from stepdiag_ros.metrology.geometry import AXES, LINEAR_LINES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import FORWARD, LINEAR, STEP_DIAGONAL, Line, Plan
from stepdiag_ros.planning.duration import Assumptions
from stepdiag_ros.planning.expectation import (
    POSITIONING,
    Noise,
    PlanExpectation,
    expect_with_rotations,
)
from stepdiag_ros.planning.offers import offers_of

_WORTH = 0.5
"""Share of the uncertainty below which a line must bring it to be worth a word."""


@dataclass(frozen=True)
class AxisWithoutLine:
    """An axis along which no linear line of a plan runs from the first corner.

    Attributes:
        axis: its letter.
        curve: its positioning, such as ``E_XX``.
        uncertainty: expected standard uncertainty of the curve, largest over the nodes, m.
        with_line: the same if each axis without a line had one, m.
        seconds: time for such a line, run as often as the others, its alignment included, s.
        volumetric_with_line: expected standard uncertainty, if each axis had a line, of the error
            of the mirror's point, largest over the box, m.
    """

    axis: str
    curve: str
    uncertainty: float
    with_line: float
    seconds: float
    volumetric_with_line: float


def axes_without_line(
    plan: Plan,
    machine: Machine,
    stop_uncertainty: Noise,
    assumptions: Assumptions,
    expected: PlanExpectation,
) -> tuple[AxisWithoutLine, ...]:
    """Return the axes that only step diagonals or shifted lines show, and what a line would give.

    Args:
        plan: what is measured.
        machine: that shall execute it.
        stop_uncertainty: of each stop.
        assumptions: for the duration.
        expected: uncertainties of the plan with plausible rotations.
    """
    if not any(line.kind == STEP_DIAGONAL for line in plan.lines):
        return ()
    measured = {line.name for line in plan.lines if line.kind == LINEAR and not any(line.offset)}
    missing = [
        (letter, name, curve)
        for letter, name, curve in zip(AXES, LINEAR_LINES, POSITIONING, strict=True)
        if name not in measured and isfinite(expected.positioning[curve])
    ]
    if not missing:
        return ()
    directions = tuple(dict.fromkeys(line.direction for line in plan.lines))
    # What is wanted of them is lines and times alone.
    offers = offers_of(
        [Line(LINEAR, name, "", 0, FORWARD) for _, name, _ in missing],
        plan,
        machine,
        0.0,
        directions,
        assumptions,
        1 + max(line.repeat for line in plan.lines),
    )
    added = tuple(line for offer in offers for line in offer.passes(1))
    better = expect_with_rotations(
        replace(plan, lines=(*plan.lines, *added)),
        stop_uncertainty,
        machine.chain,
        machine.rotations,
    )
    return tuple(
        AxisWithoutLine(
            letter,
            curve,
            expected.positioning[curve],
            better.positioning[curve],
            offer.alignment + offer.seconds,
            better.volumetric,
        )
        for (letter, _, curve), offer in zip(missing, offers, strict=True)
        if better.positioning[curve] < _WORTH * expected.positioning[curve]
    )
