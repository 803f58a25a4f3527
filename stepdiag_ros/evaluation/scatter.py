"""What of a result's uncertainty differs from run to run, and what stays the same.

Rotations that no reading shows spoil every run of a machine alike, as long as its lines and the
method are the same: they are in the uncertainty of each run, but a mean of many runs is no better
known for it (VIM 2.17, systematic error), and a difference of two runs does not contain them.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.agreement.measured import figures_of
from stepdiag_ros.metrology.agreement.shared import layout_of
from stepdiag_ros.metrology.geometry import BODY_DIAGONALS
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plausible import ORDINARY
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import of_result

NOTHING_TURNS = replace(ORDINARY, rotation=0.0)


def scatter_of_figures(result: VolumetricErrors, chain: str) -> Mapping[str, float]:
    """Return the standard uncertainty of each figure by what differs from run to run.

    Args:
        result: of a solver.
        chain: order of the machine's axes; empty if not known.

    Returns:
        name of the figure → m or rad; without figures of the setup, and without those for which it
        is not known.
    """
    size = sum(map(len, result.curves.values()))
    if result.readings_covariance.shape != (size, size):
        return {}
    names = {one.name for one in result.figures}
    lines = [line for line in BODY_DIAGONALS if f"diagonal {line}" in names]
    made = figures_of(_scattering(result), lines, chain)
    return {
        one.name: one.standard_uncertainty for one in made if np.isfinite(one.standard_uncertainty)
    }


def scatter_of_largest(result: VolumetricErrors, chain: str) -> float:
    """Return the same of the longest error vector in the measured box, m; NaN where not known.

    Args:
        result: of a solver.
        chain: order of the machine's axes; empty if not known.
    """
    if not result.readings_covariance.size:
        return float("nan")
    return of_result(_scattering(result), chain, NOTHING_TURNS).at_the_place


def layout_digest(measurement: Measurement) -> str:
    """Return 64 hexadecimal digits that are the same for runs with the same box and lines."""
    return hashlib.sha256(repr(layout_of(measurement)).encode()).hexdigest()


def _scattering(result: VolumetricErrors) -> VolumetricErrors:
    return replace(result, covariance=result.readings_covariance, turned_factor=np.empty((0, 0)))
