"""All that is known of a plan before it is run: duration, visibility, uncertainty, limits."""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.visibility import Visibility, visibility
from stepdiag_ros.planning.duration import Assumptions, PlanDuration, duration
from stepdiag_ros.planning.expectation import (
    Noise,
    PlanExpectation,
    expect,
    expect_with_rotations,
    nominal_measurement,
)
from stepdiag_ros.planning.limits import limits, warnings
from stepdiag_ros.planning.own_lines import AxisWithoutLine, axes_without_line
from stepdiag_ros.planning.undetermined import Undetermined, undetermined
from stepdiag_ros.run.feasibility import beyond_machine


@dataclass(frozen=True)
class Assessment:
    """What is known of a plan before it is run.

    Attributes:
        plan: the plan.
        machine: that shall execute it.
        stop_uncertainty: standard uncertainty of a single stop that all rests on, m; of the nodes
            of lines on the fly the root mean square.
        duration: by line.
        expectation: standard uncertainties by the noise of the stops alone, without rotations.
        with_rotations: those that ``least_squares`` will print: also with rotations of the size
            that is plausible of the machine, and with the laser's scale.
        rotating: the same with all rotations free, as by ``rigid_body``; None without a chain.
        seen: visibility without rotations.
        seen_rotating: visibility with all rotations free; None without a chain.
        undetermined: which of the nine curves and squareness errors it does not determine.
        without_line: axes that only step diagonals or shifted lines show.
        limits: what the plan does not determine, in sentences.
        warnings: what is unwise in it, in sentences.
    """

    plan: Plan
    machine: Machine
    stop_uncertainty: float
    duration: PlanDuration
    expectation: PlanExpectation
    with_rotations: PlanExpectation
    rotating: PlanExpectation | None
    seen: Visibility
    seen_rotating: Visibility | None
    undetermined: Undetermined
    without_line: tuple[AxisWithoutLine, ...]
    limits: tuple[str, ...]
    warnings: tuple[str, ...]


def assess(
    plan: Plan,
    machine: Machine,
    stop_uncertainty: Noise,
    assumptions: Assumptions | None = None,
) -> Assessment:
    """Assess a plan on a machine.

    Args:
        plan: what is measured.
        machine: its chain may be empty: then rotations are not assessed.
        stop_uncertainty: of each stop.
        assumptions: for the duration; the default ones if None.

    Raises:
        ValueError: the machine cannot execute the plan; one sentence.
    """
    beyond = beyond_machine(plan, machine)
    if beyond:
        raise ValueError(f"'{plan.name}' cannot be executed on {machine.name}: {beyond}")
    chain = machine.chain
    nominal = nominal_measurement(plan, stop_uncertainty)
    every = np.concatenate([line.standard_uncertainty for line in nominal.lines])
    usual = float(np.sqrt(np.mean(every**2)))
    seen = visibility(plan, "", usual)
    rotating = visibility(plan, chain, usual) if chain else None
    unknown = undetermined(plan, seen)
    printed = expect_with_rotations(plan, stop_uncertainty, chain, machine.rotations)
    taken = duration(plan, machine, assumptions)
    said = limits(plan, chain, usual, seen, rotating)
    return Assessment(
        plan=plan,
        machine=machine,
        stop_uncertainty=usual,
        duration=taken,
        expectation=expect(plan, stop_uncertainty),
        with_rotations=printed,
        rotating=expect(plan, stop_uncertainty, chain) if chain else None,
        seen=seen,
        seen_rotating=rotating,
        undetermined=unknown,
        without_line=axes_without_line(plan, machine, stop_uncertainty, taken.assumptions, printed),
        limits=(*([unknown.sentence] if unknown.sentence else []), *said),
        warnings=tuple(warnings(plan)),
    )
