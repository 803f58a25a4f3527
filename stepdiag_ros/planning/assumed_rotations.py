"""Whether a plan reaches what is wished only since the size of pitch, yaw and roll is assumed."""

import math
from dataclasses import dataclass

from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plausible import CLASSES, DEFAULT_CLASS
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.planning.candidates import PURPOSES, of_expectation
from stepdiag_ros.planning.expectation import expect, expect_with_rotations
from stepdiag_ros.planning.request import PlanCandidate, Request


@dataclass(frozen=True)
class AssumedRotations:
    """An assumption without which a wish is not reached: the size of the rotations.

    Attributes:
        size: that is assumed over the measured travel, rad.
        usual: the size where a machine file says nothing, rad.
        quantities: whose wish rests on it.
        with_usual: expanded uncertainty (95 %) of the worst of them with the usual size, m or rad;
            NaN where that is not larger than the assumed one.
        without: the same with all rotations free, by the noise of the stops alone; NaN if the lines
            do not determine it.
    """

    size: float
    usual: float
    quantities: tuple[str, ...]
    with_usual: float
    without: float


def assumed_rotations(request: Request, chosen: PlanCandidate) -> AssumedRotations | None:
    """Return the assumption that a wish rests on; None where it is reached without, or not wished.

    Args:
        request: with the wish and the machine, whose rotations are assumed.
        chosen: the plan that is expected to reach the wish.
    """
    if not request.until or PURPOSES[request.purpose].rotations:
        return None
    free = _without(request, chosen)
    resting = tuple(
        name for name, limit in request.until.items() if not COVERAGE_FACTOR * free[name] <= limit
    )
    if not resting:
        return None
    size, usual = request.machine.rotations, CLASSES[DEFAULT_CLASS]
    with_usual = math.nan
    if size < usual:
        noise, chain = request.noise_of(chosen.plan), request.machine.chain
        told = expect_with_rotations(chosen.plan, noise, chain, usual)
        with_usual = COVERAGE_FACTOR * max(of_expectation(told, resting).values())
    worst = [free[name] for name in resting]
    unknown = any(not math.isfinite(one) for one in worst)
    return AssumedRotations(
        size, usual, resting, with_usual, math.nan if unknown else COVERAGE_FACTOR * max(worst)
    )


def _without(request: Request, chosen: PlanCandidate) -> dict[str, float]:
    """Return standard uncertainties with all rotations free; NaN without a chain."""
    machine: Machine = request.machine
    if not machine.chain:
        return dict.fromkeys(request.until, math.nan)
    told = expect(chosen.plan, request.noise_of(chosen.plan), machine.chain)
    return of_expectation(told, request.until)
