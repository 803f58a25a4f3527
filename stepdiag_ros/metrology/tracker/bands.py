"""Uncertainty of figures without a machine's curves, from the estimate with them.

A slope along one line, the squareness of a face line, the separation of one line and the tracker's
place from some places are made of a few readings as if the machine were straight. How wrong such a
figure is follows from the joint estimate: it knows the same quantity, with an uncertainty that
holds. So

    u² = u²(joint estimate of the quantity) + (figure - joint estimate of the quantity)²

is never less than what is known of the quantity, and a figure that the curves mislead says so.
Without a joint estimate the uncertainty is unknown (NaN).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.solvers.summary import slope_weights
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest
from stepdiag_ros.metrology.tracker.joint import JointEstimate


def widened(figures: Sequence[float], functionals: Vector, joint: JointEstimate) -> Vector:
    """Return the covariance of figures; see the module.

    Args:
        figures: shape (r,).
        functionals: what they are figures of, on the unknowns of ``joint.machine``, (r, unknowns).
        joint: from all readings.

    Returns:
        shape (r, r).
    """
    values, covariance = joint.told(functionals)
    away = np.asarray(figures) - values
    made: Vector = covariance + np.outer(away, away)
    return made


def standard_uncertainty(figure: float, functional: Vector, joint: JointEstimate | None) -> float:
    """Return the standard uncertainty of one figure; see the module."""
    if joint is None:
        return float("nan")
    return float(np.sqrt(widened([figure], functional[None, :], joint)[0, 0]))


def slope_along(joint: JointEstimate, targets: Vector) -> Vector:
    """Return the slope of the error along a line, over its length, in terms of the unknowns.

    Args:
        joint: whose machine it is.
        targets: of the line, m, shape (n, 3).
    """
    return slope_across(joint, targets, _direction(targets))


def slope_across(joint: JointEstimate, targets: Vector, towards: Vector) -> Vector:
    """Return the lean of a line towards a direction, in the frame of the results.

    Args:
        joint: whose machine it is.
        targets: of the line, m, shape (n, 3).
        towards: unit vector, shape (3,).

    Returns:
        slope of the least-squares line of the error in that direction, shape (unknowns,).
    """
    direction = _direction(targets)
    ways = (targets - targets[0]) @ direction
    moved = np.einsum("a,nap->np", towards, joint.machine.displacement(targets))
    turned = np.cross(direction, towards) @ joint.machine.turn()
    made: Vector = slope_weights(ways) @ moved + turned
    return made


def with_the_place(
    test: PositioningTest, targets: Vector, joint: JointEstimate | None
) -> PositioningTest:
    """Return a line's test whose U knows what the tracker's place does to its deviations.

    A wrong place bends all runs of a line alike, which is in A, E and M and not in B and R.

    Args:
        test: of the line.
        targets: from the forward start on, m, shape (n, 3).
        joint: from all readings; None: U of A, E and M is unknown.
    """
    bent = float("nan")
    if joint is not None:
        # Single axes are tested upwards, also where the line runs down.
        down = len(test.name) == 1 and float(np.sum(targets[-1] - targets[0])) < 0
        means = np.nanmean([test.mean_forward, test.mean_backward], axis=0)
        along = -means[::-1] if down else means
        moved = np.einsum("a,nap->np", _direction(targets), joint.machine.displacement(targets))
        covariance = widened(along - along[0], moved - moved[0], joint)
        bent = 2.0 * float(np.sqrt(np.max(np.diag(covariance))))
    return replace(
        test,
        expanded_uncertainty={
            name: float(np.hypot(spread, bent)) if name[0] in "AEM" else spread
            for name, spread in test.expanded_uncertainty.items()
        },
    )


def _direction(targets: Vector) -> Vector:
    way = targets[-1] - targets[0]
    made: Vector = way / np.linalg.norm(way)
    return made
