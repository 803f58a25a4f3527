"""What a result is worth as it stands: does it explain the readings, is it more than noise."""

from enum import Enum

import numpy as np

from stepdiag_ros.metrology.agreement.joint import FIXED, SIGNIFICANT, joint_test
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.noise_factor import exceeds_chance
from stepdiag_ros.metrology.solvers.observations import observe
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.tracker.tracked_line import TRACKER

_LACK = 1e-3
"""Probability below which a lack of fit beyond the scatter of repeats is not put down to chance."""


class Misfit(Enum):
    """How a result agrees with the readings that it was solved from."""

    NONE = "the readings agree, within what they and their repeats scatter"
    UNCLEAR = (
        "they do not, and without repeats this cannot be distinguished from poor repeatability"
    )
    SHOWN = "they do not, beyond what repeats scatter: something acts that is not in the result"


def misfit(result: VolumetricErrors, measurement: Measurement | None) -> Misfit:
    """Say whether errors explain the readings: lack of fit against pure error (F test).

    A machine repeats worse than the window of one stop shows; that is in the uncertainties, which
    are enlarged by it, and is not lack of fit. So what is left is compared with the scatter of
    repeated stops, where there are any, and not with the stops' own uncertainties.

    Args:
        result: by least squares, with χ² and degrees of freedom; others disagree with nothing.
        measurement: that it was solved from; None if it is not at hand. The repeats of a tracker's
            lengths are not compared, so that a lack of fit stays unclear.
    """
    freedom = result.degrees_of_freedom
    if not freedom or not exceeds_chance(result.chi_squared, freedom):
        return Misfit.NONE
    if measurement is None or any(line.line.kind == TRACKER for line in measurement.lines):
        return Misfit.UNCLEAR
    observations = observe(measurement)
    squares, pure = observations.pure_error(observations.uncertainty**-2)
    if pure < 1 or freedom <= pure:
        return Misfit.UNCLEAR
    if squares == 0.0:
        # A coarse display repeats exactly; whatever is left beside that is not scatter.
        return Misfit.SHOWN
    from scipy.special import fdtrc

    ratio = (result.chi_squared - squares) / (freedom - pure) / (squares / pure)
    return Misfit.SHOWN if fdtrc(freedom - pure, pure, max(ratio, 0.0)) < _LACK else Misfit.NONE


def is_noise(result: VolumetricErrors) -> bool:
    """Say whether all errors may be zero: by χ² of all values, and by the largest, each p > 0.05.

    The largest of many values is never zero, and a range never negative: of a machine without
    errors noise alone makes both, larger than their uncertainty. The displacements over the
    diagonals count among the values: rotations show there that are in no curve. Where the
    covariance is not known (a recorded result) nothing counts as noise.
    """
    if not result.covariance.size:
        return False
    values = np.concatenate([np.asarray(curve) for curve in result.curves.values()])
    together = joint_test(values, result.covariance)
    spread = np.sqrt(np.diag(result.covariance))
    used = np.isfinite(values) & (spread > FIXED)
    if not together.known or together.significant:
        return False
    from scipy.special import erfc

    diagonals = [
        abs(one.value) / one.standard_uncertainty
        for one in result.figures
        if one.name.startswith("diagonal") and one.standard_uncertainty > FIXED
    ]
    ratios = np.array([*(np.abs(values[used]) / spread[used]), *diagonals])
    chance = -np.expm1(len(ratios) * np.log1p(-erfc(np.max(ratios) / np.sqrt(2.0))))
    return bool(chance > SIGNIFICANT)
