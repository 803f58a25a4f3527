"""Whether a run separates an effect of one axis from the same effect of several axes.

A worn machine has backlash on every axis. On few lines, the backlash of one axis alone may close a
gap to which all three contribute: the fewest names then are a wrong name, and its size is wrong by
far more than its uncertainty. So each name of one axis has rivals beyond the candidates:
the effect on several axes with the same sizes. And where the effect is fitted on all axes
together, those that were not named must show nothing.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from stepdiag_ros.metrology.discrepancy.chance import tail
from stepdiag_ros.metrology.discrepancy.ranking import Ranker
from stepdiag_ros.metrology.discrepancy.sizes import Sizes, solved
from stepdiag_ros.metrology.geometry import Vector

_AS_WELL = 0.01
"""Chance by noise alone of such sizes on the other axes, below which these act as well."""
_SAME = 1e-9
"""Share of the largest variance below which a combination of sizes has none."""
ONE_OF_AXES = frozenset({"axis"})
"""Keys of the setting of an effect that acts on one axis and may act on each."""


def not_separated(
    ranker: Ranker, chosen: Sequence[int], index: int, freedom: float, odds: float
) -> tuple[int, ...]:
    """Return the same effect on other axes that a run does not separate from a chosen one.

    Args:
        ranker: of the run.
        chosen: candidates that close the gap.
        index: one of these.
        freedom: degrees of freedom of the noise.
        odds: by which a name must be better than a rival to be the only one.

    Returns:
        the candidates; empty where the name of the chosen one stands.
    """
    found = ranker.found
    own = found.candidates[index]
    if own.setting.keys() != ONE_OF_AXES:
        return ()
    others = [
        number
        for number, one in enumerate(found.candidates)
        if one.effect is own.effect and one.setting.keys() == ONE_OF_AXES and number not in chosen
    ]
    if not others:
        return ()
    if _chance(Sizes(ranker, [*chosen, *others]), others, freedom) < _AS_WELL:
        return tuple(others)
    span = ranker.span([other for other in chosen if other != index])
    gap = ranker.gap - span @ (span.T @ ranker.gap)

    def left(some: Sequence[int]) -> float:
        """Return χ² with the effect on some axes, of the same sizes on each."""
        columns = sum(found.columns.dense(found.of(one)) for one in some)
        columns = columns - span @ (span.T @ columns)
        rest: Vector = gap - columns @ solved(columns, gap)[0]
        return float(rest @ rest)

    most = left([index]) + 2.0 * float(np.log(odds))
    several = [some for count in (2, 3) for some in combinations([index, *others], count)]
    close = {one for some in several if left(some) < most for one in some}
    return tuple(one for one in others if one in close)


def _chance(sizes: Sizes, some: Sequence[int], freedom: float) -> float:
    """Return the chance of such sizes of some candidates by noise alone; 1 if not determined."""
    values = np.concatenate([sizes.values[one] for one in some])
    covariance = sizes.in_order(some)
    if not np.all(np.isfinite(covariance)):
        return 1.0
    # An effect of somebody else may do the same on several axes: singular.
    variances, ways = np.linalg.eigh(covariance)
    seen = variances > _SAME * variances[-1]
    squares = np.sum((ways.T @ values)[seen] ** 2 / variances[seen])
    return float(tail(np.asarray(squares), int(np.count_nonzero(seen)), freedom))
