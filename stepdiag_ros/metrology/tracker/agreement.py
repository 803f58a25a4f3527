"""Whether every pass of a tracker's test agrees with all the others.

The joint estimate describes a machine of smooth curves, a counter with drift, air and reversal
errors. A pass that something else has happened in, such as a slipped fringe, a reflector that was
touched or a machine that has warmed up, departs from what all other passes say of it. With

    V = s²_0 diag(u²) + Z diag(s²_g) Zᵀ,     P = V⁻¹ - V⁻¹ X (Xᵀ V⁻¹ X)⁻¹ Xᵀ V⁻¹

the departure of the n readings of a pass b from their prediction by all others is P_bb⁻¹ (P y)_b,
its covariance is P_bb⁻¹, and (P y)_bᵀ P_bb⁻¹ (P y)_b is χ² of n degrees of freedom if nothing has
happened (block deletion in a mixed model, Haslett and Dillane 2004). P follows from the solution of
the mixed-model equations (``mixed_model``) without V.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.tracker.readings import LOCATE, TrackerReading


@dataclass(frozen=True)
class PassDeparture:
    """How far one pass departs from what all others say of it.

    Attributes:
        line: name of the line.
        run: from 1.
        direction: of the pass.
        chi_squared: of its readings.
        degrees_of_freedom: number of its readings.
        p_value: chance of so large a χ² if nothing has happened.
        rms: of the departure, m.
    """

    line: str
    run: int
    direction: str
    chi_squared: float
    degrees_of_freedom: int
    p_value: float
    rms: float

    def __str__(self) -> str:
        """Say which pass it is, for example ``xy forward, run 2``."""
        if self.line == LOCATE:
            return "the places that locate the tracker"
        return f"{self.line} {self.direction}, run {self.run}"


def departures(
    readings: Sequence[TrackerReading],
    residuals: Vector,
    noise: Vector,
    design: Vector,
    covariance: Vector,
) -> tuple[PassDeparture, ...]:
    """Return how far each pass departs from all others, in the order of measurement.

    Args:
        readings: of one station.
        residuals: left by the mixed model, m, shape (n,).
        noise: standard uncertainty of each reading as the model has it, s_0 u, m, shape (n,).
        design: X and Z side by side, shape (n, p + m).
        covariance: C⁻¹ of the mixed-model equations with the same sizes, shape (p + m, p + m).
    """
    from scipy.special import chdtrc

    weights = 1.0 / noise**2
    force = weights * residuals
    passes: dict[tuple[str, int, str], list[int]] = {}
    for index, one in enumerate(readings):
        key = (
            (LOCATE, 1, one.direction) if one.line == LOCATE else (one.line, one.run, one.direction)
        )
        passes.setdefault(key, []).append(index)
    made = []
    for (line, run, direction), members in passes.items():
        inside = np.array(members)
        rows = weights[inside, None] * design[inside]
        block = np.diag(weights[inside]) - rows @ covariance @ rows.T
        departure = np.linalg.solve(block, force[inside])
        squares = float(force[inside] @ departure)
        made.append(
            PassDeparture(
                line,
                run,
                direction,
                squares,
                len(inside),
                float(chdtrc(len(inside), squares)),
                float(np.sqrt(np.mean(departure**2))),
            )
        )
    return tuple(made)


def familywise(passes: Sequence[PassDeparture]) -> tuple[PassDeparture | None, float]:
    """Return the pass that departs most, and the chance that any pass would depart as much.

    None and 1 if there is no pass. The chance counts how many passes were looked at (Šidák).
    """
    if not passes:
        return None, 1.0
    worst = min(passes, key=lambda one: one.p_value)
    chance = -float(np.expm1(len(passes) * np.log1p(-min(worst.p_value, 1.0 - 1e-16))))
    return worst, chance
