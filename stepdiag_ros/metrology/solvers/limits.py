"""What is left out of an evaluation of a very large run, known before it starts.

Least squares follows the levels of nodes (``folded``) and has no limit. The other methods and the
diagnosis hold dense matrices of all values at the nodes that they leave free: their memory grows
with the square of the blocks, their time with the cube. Stops beyond these values, such as repeated
passes, cost the methods no more than in proportion. The diagnosis looks at single stops, single
passes and single places too, so that it has a limit of stops.
"""

from stepdiag_ros.metrology.geometry import CURVES, TRANSLATIONS
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.catalogue import methods

MOST_VALUES = 1000
"""Free values at the nodes up to which whole matrices are made: they take 8 MB each."""
MOST_STOPS = 10_000
"""Stops up to which a run is diagnosed: that takes half a minute and 0.5 GB."""
DIAGNOSIS = "diagnosis"
BUDGET = "uncertainty budget"
VISIBILITY = "visibility"
_CURVES = {
    DIAGNOSIS: len(TRANSLATIONS),
    BUDGET: len(TRANSLATIONS),
    VISIBILITY: len(CURVES),
}
"""Evaluation beside the methods → number of curves of which each value is free."""


class TooLarge(Refusal):
    """The run is too large for what was asked; the text says how large it may be."""


def left_out(blocks: int, stops: int = 0) -> dict[str, str]:
    """Return which evaluations are left out for a run of this size, and why.

    Args:
        blocks: of the measured box.
        stops: of all lines; 0 if not known.

    Returns:
        method, ``DIAGNOSIS``, ``BUDGET`` or ``VISIBILITY`` → why; empty where nothing is.
    """
    curves = {name: one.free_curves for name, one in methods().items()} | _CURVES
    reasons = {
        name: (
            f"left out for its size: {blocks} blocks have {count * (blocks + 1):,} free values,"
            f" more than {MOST_VALUES:,}; up to {MOST_VALUES // count - 1} blocks are evaluated"
        )
        for name, count in curves.items()
        if count * (blocks + 1) > MOST_VALUES
    }
    if stops > MOST_STOPS and DIAGNOSIS not in reasons:
        reasons[DIAGNOSIS] = (
            f"left out for its size: {stops:,} stops; up to {MOST_STOPS:,} stops are evaluated"
        )
    return reasons


def require_size_for(evaluation: str, blocks: int, stops: int) -> None:
    """Refuse a run that is too large for an evaluation.

    Args:
        evaluation: ``DIAGNOSIS`` or ``BUDGET``.
        blocks: of the measured box.
        stops: of all lines.

    Raises:
        TooLarge: it is.
    """
    why = left_out(blocks, stops).get(evaluation)
    if why is not None:
        raise TooLarge(f"the {evaluation} is {why}", fault="too_many")


def left_out_sentence(blocks: int, stops: int, asked: tuple[str, ...]) -> str:
    """Return a sentence on the requested evaluations that are left out; empty without any."""
    names = [name for name in left_out(blocks, stops) if name in asked]
    if not names:
        return ""
    return (
        f"{blocks} blocks with {stops:,} stops are too many for {', '.join(names)}: left out;"
        " least_squares is solved in full"
    )
