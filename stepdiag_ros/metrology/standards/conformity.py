"""Conformity with a largest permissible error, proven with the uncertainty.

Source: ISO 14253-1:2017, default decision rule: conformity is proven if the value with its expanded
uncertainty is within the limit, non-conformity if the value without it is beyond the limit; between
the two neither is proven.
"""

from enum import IntEnum
from math import isfinite, nan


class Conformity(IntEnum):
    """What is proven; the numbers are CONFORMITY_* of RunVerdict.msg."""

    NOT_ASKED = 0
    WITHIN = 1
    NOT_WITHIN = 2
    UNDECIDED = 3


def conformity(
    value: float,
    expanded_uncertainty: float,
    tolerance: float,
    *,
    more_acts: bool = False,
    noise: bool = False,
    upper_bound: float = nan,
) -> Conformity:
    """Return what is proven of a value that is not negative.

    Args:
        value: in the unit of the tolerance; NaN if unknown.
        expanded_uncertainty: of it; NaN if unknown.
        tolerance: largest that is permissible; NaN if none was agreed.
        more_acts: more acts than value and uncertainty contain, so that nothing is proven.
        noise: the value is no more than noise makes, so that it is not beyond the limit.
        upper_bound: of the same at every other place, with its uncertainty; NaN if not known.
    """
    if not isfinite(tolerance):
        return Conformity.NOT_ASKED
    if more_acts:
        return Conformity.UNDECIDED
    if value + expanded_uncertainty <= tolerance and not upper_bound > tolerance:
        return Conformity.WITHIN
    if value - expanded_uncertainty > tolerance and not noise:
        return Conformity.NOT_WITHIN
    return Conformity.UNDECIDED
