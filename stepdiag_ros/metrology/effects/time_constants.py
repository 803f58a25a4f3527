"""Time constants of warming up that a run can determine."""

import numpy as np

from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector

_HALVINGS = 5


def time_constants(stops: Stops) -> tuple[float, ...]:
    """Return time constants to be tried, s: the run's length, half of it and so on, longest first.

    Two significant digits. A longer one looks like a steady change, a shorter one is over before
    the run has well begun; one in between is met to within a factor of 1.4.
    """
    if not stops.duration > 0.0:
        return ()
    return tuple(float(f"{stops.duration / 2**halving:.1e}") for halving in range(_HALVINGS + 1))


def warmed(stops: Stops, time_constant: float) -> Vector:
    """Return 1 - exp(-time / time constant) at each stop, shape (n,); the time is the run's."""
    warm: Vector = -np.expm1(-stops.time / time_constant)
    return warm
