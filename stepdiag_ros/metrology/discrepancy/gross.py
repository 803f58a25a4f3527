"""Gross errors of a run: what nominal displacements show at once, and lines under a wrong name."""

from collections.abc import Sequence

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline, whitened
from stepdiag_ros.metrology.discrepancy.chance import tail
from stepdiag_ros.metrology.discrepancy.noise import Noise
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.gross import renamed
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.measurement import Measurement

_FITS = 0.005


def mislabelled(
    measurement: Measurement, known: Sequence[ActiveEffect], noise: Noise
) -> tuple[str, ...]:
    """Return under which other name or move order of one setup the run fits, best first.

    Args:
        measurement: a run that its own names do not explain.
        known: effects of the model with fixed sizes.
        noise: of a reading, from the repeats, which a wrong name does not change.
    """
    found = []
    for words, other in renamed(measurement):
        try:
            # A wrong name may turn a setup by more than any tilt can; the fit then gives up.
            with np.errstate(invalid="ignore"):
                baseline = fit_baseline(other, stops_of(other), known)
                problem = whitened(baseline, noise.size, noise.correlation)
        except ValueError:
            continue
        chance = float(
            tail(np.array(float(problem.gap @ problem.gap)), float(problem.freedom), noise.freedom)
        )
        if chance > _FITS:
            found.append((-chance, words))
    return tuple(words for _, words in sorted(found))
