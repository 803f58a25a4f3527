"""What a seven-line test says of itself: does one machine with one tracker explain all readings?"""

from stepdiag_ros.metrology.discrepancy.findings import CONSISTENT, NOT_TESTABLE, UNEXPLAINED
from stepdiag_ros.metrology.tracker.agreement import familywise
from stepdiag_ros.metrology.tracker.joint import JointEstimate

ALPHA = 0.01
"""Chance of calling a test unexplained in which nothing has happened."""
_LEAST_PASSES = 3


def verdict_on(joint: JointEstimate | None) -> tuple[str, str]:
    """Return the verdict on the readings of a station and what it rests on, in words.

    ``UNEXPLAINED`` if one pass departs from what all others say of it by more than chance allows
    (``agreement``), ``NOT TESTABLE`` without a joint estimate or with fewer than three passes.

    Args:
        joint: estimate from all readings; None without one.
    """
    if joint is None:
        return NOT_TESTABLE, "Too few readings for a joint estimate: no pass can be compared."
    worst, chance = familywise(joint.passes)
    count = len(joint.passes)
    if worst is None or count < _LEAST_PASSES:
        return NOT_TESTABLE, f"{count} passes: too few to compare one with the others."
    of_chance = f"p = {chance:.2g}, {count} passes looked at"
    if chance >= ALPHA:
        return CONSISTENT, f"Every pass agrees with all others ({of_chance})."
    return (
        UNEXPLAINED,
        f"{worst} departs by {worst.rms * 1e6:.2g} µm (rms) from what all other passes say of it"
        f" ({of_chance}): measure this line again.",
    )
