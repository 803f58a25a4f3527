"""Whether a machine can execute a plan: known before anything moves."""

import math

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import Line, Plan
from stepdiag_ros.metrology.units import IN_MILLI


def beyond_machine(plan: Plan, machine: Machine) -> str:
    """Say why a machine cannot execute a plan; empty if it can."""
    if math.isnan(plan.feed):
        return "the plan has no feed_m_per_s: it can be solved, but not executed"
    if plan.feed > machine.feed_limit_m_per_s:
        return (
            f"the plan's feed_m_per_s {plan.feed:g} is above the machine's feed limit "
            f"{machine.feed_limit_m_per_s:g} m/s"
        )
    return out_of_limits(plan, machine.travel_low_m, machine.travel_high_m, "the machine file")


def out_of_limits(
    plan: Plan, low: tuple[float, float, float], high: tuple[float, float, float], source: str
) -> str:
    """Say which line first leaves the soft limits (m) of a source; empty if none does."""
    for line in plan.lines:
        for axis, (least, most) in enumerate(zip(*_reach(plan, line), strict=True)):
            if least < low[axis] or most > high[axis]:
                run_up = plan.run_up(line) is not None
                overrun = f", overrun of {plan.overrun:g} m included" if run_up else ""
                return (
                    f"line {line.name} runs {AXES[axis]} from {least:g} m to {most:g} m"
                    f"{overrun}, outside the soft limits of {source}, {low[axis]:g} m to"
                    f" {high[axis]:g} m{_meant(most, high[axis])}"
                )
    return ""


def _meant(most: float, high: float) -> str:
    """Ask for millimetres where a line runs so far beyond a limit; empty otherwise."""
    meant = most / IN_MILLI
    in_millimetres = most > 10.0 * high and meant <= high
    return f"; lengths are in metres: was {meant:g} m meant?" if in_millimetres else ""


def least_clearance(plan: Plan, machine: Machine) -> tuple[float, str]:
    """Return how near a plan comes to an end of the travel, m (negative: beyond it), and its axis.

    Run-ups count as well as stops.
    """
    reaches = [_reach(plan, line) for line in plan.lines]
    low = np.min([least for least, _ in reaches], axis=0) - np.array(machine.travel_low_m)
    high = np.array(machine.travel_high_m) - np.max([most for _, most in reaches], axis=0)
    clearance = np.minimum(low, high)
    nearest = int(np.argmin(clearance))
    return float(clearance[nearest]), AXES[nearest]


def _reach(plan: Plan, line: Line) -> tuple[Vector, Vector]:
    """Return the least and the largest position of each axis on a line, run-up included, m."""
    places = [line.stops(plan.volume)]
    beyond = plan.run_up(line)
    if beyond is not None:
        places.append(np.atleast_2d(beyond))
    if line.tracked is not None:
        places.append(plan.corners)
    reached = np.vstack(places)
    return reached.min(axis=0), reached.max(axis=0)
