"""Whether a machine can execute a plan: known before anything moves."""

import math

import numpy as np

from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import Plan


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
        stops = line.stops(plan.volume)
        beyond = plan.run_up(line)
        if beyond is not None:
            stops = np.vstack((beyond, stops))
        if line.tracked is not None:
            stops = np.vstack((stops, plan.corners))
        for axis in range(3):
            reach = stops[:, axis].min(), stops[:, axis].max()
            if reach[0] < low[axis] or reach[1] > high[axis]:
                overrun = "" if beyond is None else f", overrun of {plan.overrun:g} m included"
                return (
                    f"line {line.name} runs {AXES[axis]} from {reach[0]:g} m to {reach[1]:g} m"
                    f"{overrun}, outside the soft limits of {source}, {low[axis]:g} m to"
                    f" {high[axis]:g} m"
                )
    return ""
