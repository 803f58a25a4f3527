"""How small a gap between model and run a diagnosis of some lines would show.

The lines are taken as the diagnosis takes them: the same free baseline and the same noise from the
repeats. What the repeats have in common and the baseline does not follow is tested against that
noise, by an F test at the level at which a run is no longer consistent. The power of that test is
that of the noncentral F distribution, whose noncentrality is the sum of squares of the gap over the
variance of a reading.
"""

from dataclasses import dataclass
from math import nan, sqrt

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline, whitened
from stepdiag_ros.metrology.discrepancy.findings import CONSISTENT_LEVEL
from stepdiag_ros.metrology.discrepancy.noise import estimate_noise
from stepdiag_ros.metrology.discrepancy.start import stated_noise
from stepdiag_ros.metrology.discrepancy.steady import steadied
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.limits import DIAGNOSIS, left_out

POWER = 0.95
"""A gap of the size that is given would be seen 19 times in 20."""
_MOST = 1e9
"""Noncentrality beyond which no run is."""


@dataclass(frozen=True)
class Power:
    """What a diagnosis of some lines would show.

    Attributes:
        gap: root mean square over all readings of the smallest gap that would be seen, m; NaN if
            no gap would be seen, however large.
        why: what hinders the diagnosis, in words; empty if nothing does.
        diagnosed: lines of this size are diagnosed.
    """

    gap: float
    why: str = ""
    diagnosed: bool = True


def power_of(measurement: Measurement) -> Power:
    """Return how small a gap a diagnosis of these lines would show.

    Raises:
        NotDeterminable: there is no reading at all.
        ValueError: lines that contradict the volume or each other.
    """
    if DIAGNOSIS in left_out(measurement.volume.blocks, measurement.stop_count):
        return Power(nan, "a run of this size is not diagnosed", diagnosed=False)
    stops = steadied(stops_of(measurement))
    baseline = fit_baseline(measurement, stops)
    noise = estimate_noise(baseline, baseline.gap, stops, stated_noise(measurement))
    if not noise.size > 0.0 or not np.isfinite(noise.size):
        return Power(nan, "no pass is repeated, so that the noise is not known")
    left = whitened(baseline, noise.size, noise.correlation).freedom - baseline.loose.shape[1]
    if left <= 0:
        return Power(nan, "the free values of the model fit any readings of these lines")
    # The differences that the noise is known by cannot test the model too.
    pure = 0.0 if not noise.shown or noise.freedom >= left else noise.freedom
    tested = left - pure
    strength = noncentrality(tested, noise.freedom)
    return Power(noise.size * sqrt(strength / len(baseline.gap)))


def noncentrality(freedom: float, noise_freedom: float) -> float:
    """Return the noncentrality of an F test that is significant with probability ``POWER``.

    Args:
        freedom: degrees of freedom of what is tested.
        noise_freedom: degrees of freedom of the noise.
    """
    from scipy.optimize import brentq
    from scipy.special import fdtri, ncfdtr

    level = fdtri(freedom, noise_freedom, 1.0 - CONSISTENT_LEVEL)
    high = 1.0
    while ncfdtr(freedom, noise_freedom, high, level) > 1.0 - POWER and high < _MOST:
        high *= 2.0
    return float(
        brentq(
            lambda one: ncfdtr(freedom, noise_freedom, one, level) - (1.0 - POWER),
            0.0,
            high,
        )
    )
