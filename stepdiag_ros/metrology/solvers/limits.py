"""What is left out of an evaluation of a run with very many blocks, known before it starts.

Least squares follows the levels of nodes (``folded``) and has no limit. The other methods and the
diagnosis hold dense matrices of all values at the nodes that they leave free: their memory grows
with the square of the blocks, their time with the cube. Stops beyond these values, such as repeated
passes, cost them no more than in proportion.
"""

from stepdiag_ros.metrology.geometry import CURVES, TRANSLATIONS

MOST_VALUES = 1000
"""Free values at the nodes up to which whole matrices are made: they take 8 MB each."""
DIAGNOSIS = "diagnosis"
VISIBILITY = "visibility"
_CURVES = {
    "conventional": len(TRANSLATIONS),
    "setup_robust": len(TRANSLATIONS),
    "alternative": len(TRANSLATIONS),
    "rigid_body": len(CURVES),
    DIAGNOSIS: len(TRANSLATIONS),
    VISIBILITY: len(CURVES),
}
"""Evaluation → number of curves of which each value is free."""


def left_out(blocks: int) -> dict[str, str]:
    """Return which evaluations are left out for a box of so many blocks, and why.

    Returns:
        method, ``DIAGNOSIS`` or ``VISIBILITY`` → why; empty where nothing is.
    """
    return {
        name: (
            f"left out for its size: {blocks} blocks have {count * (blocks + 1):,} free values,"
            f" more than {MOST_VALUES:,}; up to {MOST_VALUES // count - 1} blocks are evaluated"
        )
        for name, count in _CURVES.items()
        if count * (blocks + 1) > MOST_VALUES
    }


def left_out_sentence(blocks: int, asked: tuple[str, ...]) -> str:
    """Say in one sentence what is left out of what was asked for; empty where nothing is."""
    names = [name for name in left_out(blocks) if name in asked]
    if not names:
        return ""
    return (
        f"{blocks} blocks are too many for {', '.join(names)}: left out; least_squares is solved in"
        " full"
    )
