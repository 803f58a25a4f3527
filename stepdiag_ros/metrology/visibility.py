"""What a test plan or a measurement determines of each error, and how well, before and after.

Every error is free at every node, as in ``solvers.rigid_body`` (with a kinematic chain) or
``solvers.least_squares`` (without), beside the angles and the zero of every setup. An error is

- *determined*: every value of it follows from the readings, whatever the other errors are;
- *partly determined*: some of it does: its shape but not its slope, some nodes, or some sums;
- *confounded*: it would show in the readings, but other errors can show in the same way;
- *invisible*: whatever it is, the readings would be explained without it: no line sees it, or the
  nine translations and the setups together do what it does.

With four step diagonals for the chain ``YXZ`` the rotations that are not invisible are E_AX, E_CX,
E_AZ, E_BZ and E_CZ, as Ibaraki & Hata 2010, section 4.2, say.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import ROTATIONS, TRANSLATIONS
from stepdiag_ros.metrology.measurement import Environment, MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import stop_times
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.observations import observe
from stepdiag_ros.metrology.solvers.verdicts import (
    CONFOUNDED,
    DETERMINED,
    INVISIBLE,
    PARTLY,
    SHAPE,
    VerdictRow,
    Verdicts,
)

__all__ = [
    "CONFOUNDED",
    "DETERMINED",
    "INVISIBLE",
    "PARTLY",
    "SHAPE",
    "VerdictRow",
    "Visibility",
    "measured_visibility",
    "visibility",
]

MOST_UNKNOWNS = 4000
"""Of a plan that is looked at: a square matrix of them takes 128 MB, and there are some."""
_OF_A_SETUP = 3


@dataclass(frozen=True)
class Visibility:
    """The visibility table of a plan or a measurement.

    Attributes:
        rows: the curves (nine without a chain, eighteen with one) and the three squareness errors.
        chain: for which it holds; empty: translations only, as if nothing turned.
        stop_uncertainty: standard uncertainty of a stop that the expected uncertainties rest on, m
            (of the readings: root mean square); NaN if unknown.
        readings: number of stops.
        unknowns: number of free values.
        rank: number of independent sums of them that are determined.
        condition_number: of the determined part of the problem, ratio of the singular values.
    """

    rows: tuple[VerdictRow, ...]
    chain: str
    stop_uncertainty: float
    readings: int
    unknowns: int
    rank: int
    condition_number: float

    def row(self, name: str) -> VerdictRow:
        """Return the row of an error.

        Raises:
            KeyError: the table has no such row.
        """
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(f"the visibility table has no row '{name}'")

    def named(self, status: str) -> tuple[str, ...]:
        """Return the names of the errors with this status."""
        return tuple(row.name for row in self.rows if row.status == status)


def visibility(plan: Plan, chain: str, stop_uncertainty: float) -> Visibility:
    """Return before measuring what a plan will determine.

    Args:
        plan: the test plan.
        chain: order of the axes from workpiece to tool; empty if not known: translations only.
        stop_uncertainty: expected standard uncertainty of a stop, m.

    Raises:
        ValueError: no such chain, an uncertainty that is not above zero, a plan without lines, or
            one with more unknowns than ``MOST_UNKNOWNS``.
    """
    if not stop_uncertainty > 0.0:
        raise Refusal(
            f"the stop uncertainty is {stop_uncertainty:g} m; expected a number above 0",
            fault="out_of_range",
        )
    if not plan.lines:
        raise ValueError(f"the plan '{plan.name}' has no lines, so it determines nothing")
    curves = len(TRANSLATIONS) + (len(ROTATIONS) if chain else 0)
    setups = len({plan.setup_of(line) for line in plan.lines})
    unknowns = curves * plan.volume.blocks + _OF_A_SETUP * setups
    if unknowns > MOST_UNKNOWNS:
        raise ValueError(
            f"cannot compute what the plan '{plan.name}' determines: {plan.volume.blocks} blocks"
            f" and {setups} setups have {unknowns} unknowns, more than {MOST_UNKNOWNS}; use fewer"
        )
    lines = []
    time = 0.0
    for index, line in enumerate(plan.lines):
        target = line.stops(plan.volume)
        times = stop_times(line, plan, time)
        time = float(times[-1])
        lines.append(
            MeasuredLine(
                line=line,
                line_index=index,
                attempt=1,
                setup=plan.setup_of(line),
                time=times,
                end_time=0,
                target=target,
                displacement=np.zeros(len(target)),
                standard_uncertainty=np.full(len(target), stop_uncertainty),
                environment=np.full((len(target), len(Environment._fields)), np.nan),
                overrun=plan.overrun_of(line),
            )
        )
    return measured_visibility(Measurement(plan.volume, tuple(lines), chain))


def measured_visibility(measurement: Measurement) -> Visibility:
    """Return after measuring what the lines determine, with their own uncertainties.

    Args:
        measurement: the lines; its rejected stops do not count. Its chain decides whether rotations
            are looked at.

    Raises:
        NotDeterminable: there is no reading at all.
        ValueError: the lines contradict the volume or each other.
    """
    observations = observe(measurement)
    design = Design(observations, measurement.chain)
    verdicts = Verdicts(design)
    known = observations.noise_known
    scale = float(np.sqrt(np.mean(observations.uncertainty**2))) if known else float("nan")
    return Visibility(
        rows=verdicts.rows(),
        chain=design.chain,
        stop_uncertainty=scale,
        readings=len(observations.displacement),
        unknowns=design.count,
        rank=design.count - design.unseen.shape[1],
        condition_number=verdicts.condition_number,
    )
